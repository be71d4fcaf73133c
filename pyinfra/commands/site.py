"""`pyinfra site traffic|trajectories`: traffic of others as that of a site."""

import argparse

from pyinfra.commands.site_traffic import (
    add_traffic_arguments,
    add_trajectories_arguments,
    run_traffic,
    run_trajectories,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Sites out of maps and traffic of others; needs the extra `site`."
    parser.epilog = "example: pyinfra site traffic sites/corner --vehicles-per-hour 1200"
    steps = parser.add_subparsers(title="steps", metavar="STEP", required=True, dest="step")
    for name, summary, add, step in STEPS:
        one = steps.add_parser(name, help=summary, description=summary)
        add(one)
        one.set_defaults(site_step=step)


def run(args: argparse.Namespace) -> int:
    return int(args.site_step(args))


STEPS = (
    ("traffic", "traffic of a site by SUMO", add_traffic_arguments, run_traffic),
    (
        "trajectories",
        "others' trajectories as traffic of a site",
        add_trajectories_arguments,
        run_trajectories,
    ),
)
