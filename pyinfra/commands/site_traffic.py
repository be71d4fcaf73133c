"""`pyinfra site traffic SITE` and `pyinfra site trajectories FILE --out SITE`: who moves there."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from pyinfra.arrays import FloatArray
from pyinfra.site.tracks import Track

_MOST_NOTES = 20


def add_traffic_arguments(parser: argparse.ArgumentParser) -> None:
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


def run_traffic(args: argparse.Namespace) -> int:
    from pyinfra.site import site_folder
    from pyinfra.site.traffic import NET, simulate
    from pyinfra.site.traffic_demand import Demand
    from pyinfra.site.trajectory_file import NAME, write_trajectories

    demand = Demand(args.vehicles_per_hour, args.pedestrians_per_hour, args.bicycles_per_hour)
    feet = site_folder.feet(args.site)
    traffic = simulate(args.site / NET, feet, demand, args.seconds, args.seed)
    write_trajectories(args.site / NAME, traffic.tracks)
    _print_figures(args.site / NAME, traffic.tracks, feet)
    notes = [f"{name}: left out: no average makes it smooth" for name in traffic.rough]
    notes += [f"{name}: left out: it stood in another" for name in traffic.overlapping]
    _print_notes(notes)
    return 0


def add_trajectories_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Takes trajectories of others into a site: SUMO's floating car data (.xml, .gz), a .csv "
        "of boxes, or the folder of a LiDAR with labels. Resampled to 10 Hz, gaps up to 1 s "
        "filled, smoothed where they jump; without ids boxes are linked."
    )
    parser.epilog = (
        "example: pyinfra site trajectories tracks.csv --columns x=center_x,y=center_y "
        "--rate-hz 25 --degrees --out sites/corner"
    )
    parser.add_argument("file", type=Path, metavar="FILE")
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="SITE", help="folder of the site")
    add("--columns", type=_pairs, default={}, metavar="x=NAME,...", help="a CSV's own names")
    add("--class-of", type=_pairs, default={}, metavar="NAME=Car,...", help="its own classes")
    add("--rate-hz", type=float, help="frames a second: time is the column `frame`")
    add("--world", action="store_true", help="positions are the site's, not those of its map")
    add("--degrees", action="store_true", help="a CSV's headings are in degrees")


def run_trajectories(args: argparse.Namespace) -> int:
    import numpy as np

    from pyinfra.kitti import FormatError
    from pyinfra.site import fcd, recorded_boxes, site_folder
    from pyinfra.site.trajectory_file import NAME, write_trajectories
    from pyinfra.site.trajectory_import import import_boxes, import_fcd

    if args.rate_hz is not None and not 0.1 <= args.rate_hz <= 10_000:
        raise ValueError(f"--rate-hz: found {args.rate_hz:g}, allowed 0.1 to 10000")
    if not args.out.is_dir():
        raise FileNotFoundError(f"{args.out}: found no folder, allowed that of a site")
    offset = np.zeros(3) if args.world else site_folder.offset(args.out)
    try:
        if args.file.suffix in (".xml", ".gz"):
            imported = import_fcd(fcd.read_fcd(args.file), args.class_of, offset)
        elif args.file.is_dir():
            imported = import_boxes(recorded_boxes.read_frames(args.file), np.zeros(3))
        else:
            how = recorded_boxes.BoxColumns(args.columns, args.class_of, args.rate_hz, args.degrees)
            imported = import_boxes(recorded_boxes.read_boxes(args.file, how), offset)
    except FormatError as error:
        text = str(error)
        named = text if text.startswith(str(args.file)) else f"{args.file}: {text}"
        raise FormatError(named) from error
    write_trajectories(args.out / NAME, imported.tracks)
    has_scene = (args.out / site_folder.SCENE).exists()
    feet = site_folder.feet(args.out) if has_scene else np.zeros((1, 2))
    _print_figures(args.out / NAME, imported.tracks, feet)
    _print_notes(imported.notes)
    return 0


def _pairs(text: str) -> dict[str, str]:
    """`a=b,c=d` as a mapping."""
    pairs = [part.split("=") for part in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise argparse.ArgumentTypeError(f"found '{text[:60]}', allowed NAME=OTHER,...")
    return {pair[0]: pair[1] for pair in pairs}


def _print_figures(file: Path, tracks: list[Track], feet: FloatArray) -> None:
    from pyinfra.site.traffic_figures import traffic_figures

    print(file)
    for name, value in traffic_figures(tracks, feet).rows():
        print(f"  {name:45} {value}")


def _print_notes(notes: Sequence[str]) -> None:
    for note in notes[:_MOST_NOTES]:
        print(f"  {note}")
    if len(notes) > _MOST_NOTES:
        print(f"  and {len(notes) - _MOST_NOTES} more")
