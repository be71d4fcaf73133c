"""`pyinfra compare PLACE PLACE ...`."""

import argparse
import math
from pathlib import Path
from typing import Any

import pandas as pd

from pyinfra.cli.parser import argument, usage
from pyinfra.core.errors import refuse
from pyinfra.core.files import check_output
from pyinfra.core.names import repeated
from pyinfra.core.vocabulary import SUBSETS
from pyinfra.formats.csv_table import write_csv
from pyinfra.metrics.intervals import FEW_BLOCKS
from pyinfra.metrics.places import compare_places, shared_subset

SHOWN = {"ap_r1000": "AP (R1000)", "recall_percent": "recall %", "hidden_percent": "hidden %"}
VISIBLE_ONLY = (
    "compares the ground-truth subset all, because not all folders have present; vehicles that are "
    "hidden from a mount are left out"
)


add_arguments = usage(
    "Compares mounts (pole positions, heights or numbers of poles) that see the same traffic. "
    "Prints the AP of each mount, the share of vehicles that are matched with a box of any "
    "score, and the share of vehicles that are hidden from the mount. Then prints paired "
    "differences with 95 % intervals. Each PLACE is one mount: an output folder of `pyinfra "
    "evaluate`, or a folder with one such folder for each traffic seed.",
    "example: pyinfra compare out/low out/high",
    argument("places", nargs="+", type=Path, metavar="PLACE", help="two folders or more"),
    argument(
        "--ground-truth",
        choices=SUBSETS,
        help="ground-truth subset; default: present, which contains every vehicle in the region, "
        "visible or not, and is therefore the same for all mounts; if not all folders have it: all",
    ),
    argument("--out", type=Path, metavar="FILE", help="CSV file to write the rows to"),
)


def run(args: argparse.Namespace) -> int:
    twice = repeated(list(map(str, args.places)))
    refuse(
        (len(args.places) < 2, f"PLACE: expected two folders or more, got {len(args.places)}"),
        (twice, f"PLACE: expected each folder once, got {twice} twice"),
    )
    which = args.ground_truth or shared_subset(args.places)
    table = compare_places(args.places, which)
    if args.out:
        check_output(args.out, ",".join(table.columns[:3]).encode())
        write_csv(args.out, table)
    text = table_text(table, which)
    print(text if args.ground_truth or which == "present" else f"{VISIBLE_ONLY}\n{text}")
    return 0


def table_text(table: pd.DataFrame, which: str) -> str:
    """Returns the rows of `compare_places` as a text table."""
    seeds, frames = int(table.seeds.iloc[0]), int(table.frames.iloc[0])
    seeded = f"{seeds} seeds of the traffic" if seeds > 1 else "one seed of the traffic"
    how = "Student's t over the seeds" if seeds > 1 else "a bootstrap over blocks of time"
    lines = [f"ground truth {which}, {seeded}, {frames} frames per place; 95 % intervals by {how}"]
    wide = max(len(_name(row)) for row in table.itertuples())
    titles = dict.fromkeys(table.measure)
    lines.append(" " * wide + "".join(f"  {SHOWN[name]:<20}" for name in titles).rstrip())
    for (_, _), rows in table.groupby(["place", "minus"], sort=False):
        cells = {row.measure: _cell(row) for row in rows.itertuples()}
        text = "".join(f"  {cells.get(name, ''):<20}" for name in titles)
        lines.append(f"{_name(rows.iloc[0]):<{wide}}{text}".rstrip())
    differences = table[(table.minus != "") & (table.measure == "ap_r1000")]
    lines += [_verdict(row) for row in differences.itertuples()]
    return "\n".join(lines)


def _name(row: Any) -> str:
    return f"{row.place} - {row.minus}" if row.minus else row.place


def _cell(row: Any) -> str:
    sign = "+" if row.minus else ""
    value = f"{row.value:{sign}.1f}"
    if math.isnan(row.low):
        return value
    return f"{value} [{row.low:{sign}.1f}, {row.high:{sign}.1f}]"


def _verdict(row: Any) -> str:
    if math.isnan(row.low):
        return f"{_name(row)}: no interval of the difference: {FEW_BLOCKS}"
    is_significant = row.low > 0 or row.high < 0
    return f"{_name(row)}: AP {'differs' if is_significant else 'does not differ'} significantly"
