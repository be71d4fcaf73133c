"""`pyinfra site`: maps and traffic of others as site folders."""

import argparse

from pyinfra.commands.site_traffic import (
    add_traffic_arguments,
    add_trajectories_arguments,
    run_traffic,
    run_trajectories,
)

SUBCOMMANDS = {
    "traffic": (
        add_traffic_arguments,
        run_traffic,
        "traffic of a site by SUMO",
    ),
    "trajectories": (
        add_trajectories_arguments,
        run_trajectories,
        "others' trajectories as traffic of a site",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Makes site folders from maps and traffic of others."
    parser.epilog = "example: pyinfra site traffic sites/corner --vehicles-per-hour 1200"
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, (add, run_it, summary) in SUBCOMMANDS.items():
        sub = commands.add_parser(name, help=summary)
        add(sub)
        sub.set_defaults(run_it=run_it)


def run(args: argparse.Namespace) -> int:
    return int(args.run_it(args))
