"""`pyinfra site traffic SITE`: who moves there, by SUMO."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from pyinfra.arrays import FloatArray
from pyinfra.site.tracks import Track

_MOST_NOTES = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Simulates traffic on SITE/map.net.xml by SUMO, with its signals and right of way, and "
        "writes it as SITE/trajectories.csv: boxes that move as vehicles on two axles."
    )
    parser.epilog = "example: pyinfra site traffic sites/corner --vehicles-per-hour 1200"
    parser.add_argument("site", type=Path, metavar="SITE")
    add = parser.add_argument
    add("--vehicles-per-hour", type=float, default=1000, help="through the region; default: 1000")
    add("--pedestrians-per-hour", type=float, default=0, help="default: 0")
    add("--bicycles-per-hour", type=float, default=0, help="default: 0")
    add("--seconds", type=float, default=500, help="of the file; default: 500")
    add("--seed", type=int, default=1, help="default: 1")


def run(args: argparse.Namespace) -> int:
    from pyinfra.site import site_folder
    from pyinfra.site.traffic import NET, simulate
    from pyinfra.site.traffic_demand import Demand
    from pyinfra.site.trajectory_file import NAME, write_trajectories

    demand = Demand(args.vehicles_per_hour, args.pedestrians_per_hour, args.bicycles_per_hour)
    feet = site_folder.feet(args.site)
    traffic = simulate(args.site / NET, feet, demand, args.seconds, args.seed)
    write_trajectories(args.site / NAME, traffic.tracks)
    print_figures(args.site / NAME, traffic.tracks, feet)
    notes = [f"{name}: left out: no average makes it smooth" for name in traffic.rough]
    notes += [f"{name}: left out: it stood in another" for name in traffic.overlapping]
    print_notes(notes)
    return 0


def print_figures(file: Path, tracks: list[Track], feet: FloatArray) -> None:
    from pyinfra.site.traffic_figures import traffic_figures

    print(file)
    for name, value in traffic_figures(tracks, feet).rows():
        print(f"  {name:45} {value}")


def print_notes(notes: Sequence[str]) -> None:
    for note in notes[:_MOST_NOTES]:
        print(f"  {note}")
    if len(notes) > _MOST_NOTES:
        print(f"  and {len(notes) - _MOST_NOTES} more")
