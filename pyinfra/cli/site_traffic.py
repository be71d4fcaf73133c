"""`pyinfra site traffic SITE`: simulates the traffic of a site with SUMO."""

import argparse
from pathlib import Path

from pyinfra.cli.parser import argument, usage

add_arguments = usage(
    "Simulates traffic on SITE/map.net.xml with SUMO, including signals and right of way, and "
    "writes SITE/trajectories.csv. Boxes move as vehicles with two axles do. Sets duration_s "
    "of the scene to the length of the trajectories.",
    "example: pyinfra site traffic sites/corner --vehicles-per-hour 1200",
    argument("site", type=Path, metavar="SITE", help="folder of the site"),
    argument(
        "--vehicles-per-hour",
        type=float,
        default=1000,
        help="vehicles that enter the region in an hour; default: 1000",
    ),
    argument(
        "--pedestrians-per-hour",
        type=float,
        default=0,
        help="pedestrians that enter the region in an hour; default: 0",
    ),
    argument(
        "--bicycles-per-hour",
        type=float,
        default=0,
        help="cyclists that enter the region in an hour; default: 0",
    ),
    argument(
        "--seconds",
        type=float,
        default=500,
        help="length of the trajectories, in seconds; default: 500",
    ),
    argument("--seed", type=int, default=1, help="seed of the traffic; default: 1"),
)


def run(args: argparse.Namespace) -> int:
    from pyinfra.scenes.maps.site_traffic import write_traffic
    from pyinfra.scenes.maps.traffic_demand import Demand

    demand = Demand(args.vehicles_per_hour, args.pedestrians_per_hour, args.bicycles_per_hour)
    print(*write_traffic(args.site, demand, args.seconds, args.seed), sep="\n")
    return 0
