"""`pyinfra statistics DATA --out DIR`."""

import argparse
import sys
from pathlib import Path

from pyinfra.folders import statistics
from pyinfra.models.ops.kernels import kernels


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Computes scanning statistics of data sets, such as points per vehicle, and writes tables "
        "and figures."
    )
    parser.epilog = "example: pyinfra statistics data/highway data/curve --out out/statistics"
    parser.add_argument("data", nargs="+", type=Path, help="data sets written by `infrasim run`")
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and figures")
    parser.add_argument(
        "--above-road",
        action="store_true",
        help="leave out points below road level; needs frames of `infrasim run --fields`",
    )
    parser.add_argument(
        "--accumulate",
        type=int,
        default=1,
        metavar="N",
        help="merge the points of N consecutive frames into one frame; default: 1",
    )


def run(args: argparse.Namespace) -> int:
    tables = statistics(args.data, args.out, above_road=args.above_road, accumulate=args.accumulate)
    if kernels is None:
        print("the extension is not built: no lit_share, no angular_density", file=sys.stderr)
    for name in tables:
        print(args.out / f"{name}.csv")
    return 0
