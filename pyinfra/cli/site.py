"""`pyinfra site STEP`: makes sites from maps and traffic files. Each step is one module."""

import argparse
import importlib

STEPS = {
    "import": ("pyinfra.cli.site_import", "import a map as a site"),
    "draw": ("pyinfra.cli.site_draw", "draw the plan of a site"),
    "mesh": ("pyinfra.cli.site_mesh", "add a 3-D model to a site"),
    "traffic": ("pyinfra.cli.site_traffic", "simulate traffic with SUMO"),
    "trajectories": ("pyinfra.cli.site_trajectories", "import recorded trajectories as traffic"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Makes sites from maps and traffic files; needs the extra `site`."
    parser.epilog = "example: pyinfra site import town.xodr --out sites/town"
    steps = parser.add_subparsers(title="steps", metavar="STEP", required=True)
    for name, (module, summary) in STEPS.items():
        step = importlib.import_module(module)
        step_parser = steps.add_parser(name, help=summary)
        step.add_arguments(step_parser)
        step_parser.set_defaults(step=step)


def run(args: argparse.Namespace) -> int:
    return int(args.step.run(args))
