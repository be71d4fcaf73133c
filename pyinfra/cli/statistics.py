"""`pyinfra statistics DATA --out DIR`."""

import argparse
import sys
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.metrics.scanning_statistics import statistics, write
from pyinfra.viz import scanning_plots

MOST_FRAMES = 100  # highest value of --accumulate


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
    if not 1 <= args.accumulate <= MOST_FRAMES:
        raise Error(f"--accumulate: expected 1 to {MOST_FRAMES}, got {args.accumulate}")
    patterns = _extension_is_there()
    if not patterns:
        print("the extension is not built: no lit_share, no angular_density", file=sys.stderr)
    tables = statistics(
        args.data, above_road=args.above_road, patterns=patterns, accumulate=args.accumulate
    )
    files = write(tables, args.out)
    for name, table in tables.items():
        scanning_plots.save(scanning_plots.draw(name, table), args.out / name)
    for file in files:
        print(file)
    return 0


def _extension_is_there() -> bool:
    try:
        from pyinfra.dataset import simulation  # noqa: F401
    except ImportError:
        return False
    return True
