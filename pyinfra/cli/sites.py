"""`pyinfra sites --seed S --count N --out DIR`: writes generated sites and draws their plans."""

import argparse
from pathlib import Path

from pyinfra.cli.messages import note
from pyinfra.cli.parser import argument, usage
from pyinfra.sites import make_sites
from pyinfra.viz.site_sheet import MOST_ON_A_SHEET, SHEET

add_arguments = usage(
    "Generates random sites, writes each as a scene file, and draws a sheet of their plans. "
    "`pyinfra train --sites` trains on such sites.",
    "example: pyinfra sites --seed 0 --count 24 --out out/sites",
    argument("--seed", type=int, default=0, help="seed of the first site; default: 0"),
    argument(
        "--count", type=int, default=24, help="number of sites; each has the next seed; default: 24"
    ),
    argument("--out", type=Path, required=True, help="folder for the files"),
)


def run(args: argparse.Namespace) -> int:
    for file in make_sites(args.out, args.count, seed=args.seed):
        print(file)
    if args.count > MOST_ON_A_SHEET:
        note(f"{SHEET} shows the first {MOST_ON_A_SHEET} of {args.count} sites", args)
    return 0
