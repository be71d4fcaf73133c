"""`pyinfra site traffic SITE`: who moves there, by SUMO."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Simulates traffic on SITE/map.net.xml by SUMO, with its signals and right of way, and "
        "writes it as SITE/trajectories.csv: boxes that move as vehicles on two axles. The "
        "scene's duration_s becomes the time that they fill."
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
    from pyinfra.scenes.maps.site_traffic import write_traffic
    from pyinfra.scenes.maps.traffic_demand import Demand

    demand = Demand(args.vehicles_per_hour, args.pedestrians_per_hour, args.bicycles_per_hour)
    print(*write_traffic(args.site, demand, args.seconds, args.seed), sep="\n")
    return 0
