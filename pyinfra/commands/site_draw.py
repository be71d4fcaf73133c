"""`pyinfra site draw sites/NAME --out plan.svg`: the plan of a site."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = "example: pyinfra site draw sites/town --out plan.svg"
    parser.add_argument("site", type=Path, help="folder of the site")
    parser.add_argument("--out", type=Path, required=True, help=".svg, .png or .pdf")


def run(args: argparse.Namespace) -> int:
    from pyinfra.site.plan import save_plan  # Matplotlib is slow to load

    save_plan(args.site, args.out)
    print(args.out)
    return 0
