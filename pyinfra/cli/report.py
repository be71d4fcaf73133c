"""`pyinfra report RESULTS --out report.html`."""

from __future__ import annotations

import argparse
from pathlib import Path

from pyinfra.experiments.options import Wish, checked_wish
from pyinfra.viz.report.contents import page, read_sections
from pyinfra.viz.report.page import write_page
from pyinfra.viz.report.report_data import read_material


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "One page that opens from disk: the answer, and the figures behind it."
    parser.epilog = (
        "example: pyinfra report results --data data/highway --runs runs/* --out report.html"
    )
    parser.add_argument("results", type=Path, help="folder of the tables of `pyinfra benchmark`")
    parser.add_argument(
        "--data", nargs="+", type=Path, default=[], help="data sets to draw pictures of"
    )
    parser.add_argument(
        "--runs", nargs="+", type=Path, default=[], help="runs whose predictions are drawn"
    )
    parser.add_argument(
        "--sections",
        default="pyinfra.viz.report.contents",
        metavar="MODULE",
        help="a module with a list SECTIONS of functions; default: %(default)s",
    )
    parser.add_argument("--tier", help="full, quick or smoke; by default the most complete")
    group = parser.add_argument_group("of the answer, as `pyinfra recommend` has them")
    group.add_argument("--budget", type=float, default=Wish.budget_usd, help="default: any price")
    group.add_argument("--min-ap", type=float, default=Wish.min_ap)
    group.add_argument("--range", type=float, default=Wish.range_m)
    group.add_argument("--latency", type=float, default=Wish.latency_ms)
    parser.add_argument("--out", type=Path, default=Path("report.html"), help="HTML file to write")


def run(args: argparse.Namespace) -> int:
    wish = checked_wish(args.budget, args.min_ap, args.range, args.latency)
    sections, tables = read_sections(args.sections)
    material = read_material(args.results, args.data, args.runs, args.tier, wish, tables)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    print(write_page(page(material, sections), args.out))
    return 0
