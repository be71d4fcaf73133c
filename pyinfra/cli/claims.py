"""`pyinfra claims DATA...`."""

import argparse
from pathlib import Path

from pyinfra.core.files import replacing
from pyinfra.metrics.scanning_claims import claims_table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Tests the paper's claims on data sets, each of one preset."
    parser.epilog = "example: pyinfra claims data/highway_paper data/highway_paper_instant"
    parser.add_argument("data", nargs="+", type=Path, help="data sets of `infrasim run`")
    usual = Path("results/claims.csv")
    parser.add_argument("--out", type=Path, default=usual, help="CSV; default: %(default)s")


def run(args: argparse.Namespace) -> int:
    table = claims_table(args.data)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(args.out) as beside:
        table.to_csv(beside, index=False, float_format="%.4g")
    shown = table[["claim", "preset", "value", "low", "high", "verdict", "statement"]]
    print(shown.to_string(index=False, float_format=lambda v: f"{v:.3g}", max_colwidth=90))
    return 0
