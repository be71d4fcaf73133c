"""`pyinfra site STEP`: sites out of maps and traffic of others; a step is a module beside this."""

import argparse
import importlib

STEPS = {
    "import": ("pyinfra.cli.site_import", "a map as a site"),
    "draw": ("pyinfra.cli.site_draw", "the plan of a site"),
    "mesh": ("pyinfra.cli.site_mesh", "a surface of others in it"),
    "traffic": ("pyinfra.cli.site_traffic", "traffic of a site by SUMO"),
    "trajectories": ("pyinfra.cli.site_trajectories", "others' trajectories as its traffic"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Sites out of maps and traffic of others; needs the extra `site`."
    parser.epilog = "example: pyinfra site import town.xodr --out sites/town"
    steps = parser.add_subparsers(title="steps", metavar="STEP", required=True)
    for name, (module, summary) in STEPS.items():
        step = importlib.import_module(module)
        one = steps.add_parser(name, help=summary)
        step.add_arguments(one)
        one.set_defaults(step=step)


def run(args: argparse.Namespace) -> int:
    return int(args.step.run(args))
