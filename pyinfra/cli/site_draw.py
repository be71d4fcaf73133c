"""`pyinfra site draw sites/NAME --out plan.svg`: the plan of a site."""

import argparse
from pathlib import Path

from pyinfra.core.errors import Error


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = "example: pyinfra site draw sites/town --out plan.svg"
    parser.add_argument("site", type=Path, help="folder of the site")
    parser.add_argument("--out", type=Path, required=True, help=".svg, .png or .pdf")
    parser.add_argument("--radius", type=float, help="metres around the pole; default: all")


def run(args: argparse.Namespace) -> int:
    from pyinfra.viz.site_plan import save_plan

    if args.radius is not None and not 10 <= args.radius <= 100_000:
        raise Error(f"--radius: found {args.radius:g}, allowed 10 to 100000")
    save_plan(args.site, args.out, args.radius)
    print(args.out)
    return 0
