"""`pyinfra statistics DATA --out DIR`."""

import argparse
import sys
from pathlib import Path

from pyinfra.cli.parser import argument, usage
from pyinfra.folders import statistics
from pyinfra.models.ops.kernels import kernels

add_arguments = usage(
    "Computes scanning statistics of data sets, such as points per vehicle, and writes tables "
    "and figures.",
    "example: pyinfra statistics data/highway data/curve --out out/statistics",
    argument("data", nargs="+", type=Path, help="data sets written by `infrasim run`"),
    argument("--out", type=Path, required=True, help="folder for tables and figures"),
    argument(
        "--above-road",
        action="store_true",
        help="leave out points below road level; needs frames of `infrasim run --fields`",
    ),
    argument(
        "--accumulate",
        type=int,
        default=1,
        metavar="N",
        help="merge the points of N consecutive frames into one frame; default: 1",
    ),
)


def run(args: argparse.Namespace) -> int:
    tables = statistics(args.data, args.out, above_road=args.above_road, accumulate=args.accumulate)
    if kernels is None:
        print(
            "lit_share, angular_density: not computed, because the C++ extension is not built; run "
            "`make build` or install the wheel",
            file=sys.stderr,
        )
    for name in tables:
        print(args.out / f"{name}.csv")
    return 0
