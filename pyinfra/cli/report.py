"""`pyinfra report RESULTS --out report.html`."""

from __future__ import annotations

import argparse
from pathlib import Path

from pyinfra.cli.number_option import usd
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import TIERS
from pyinfra.experiments.requirements import Requirements, checked_requirements
from pyinfra.viz.page_file import check_file
from pyinfra.viz.plan_page.files import is_plan
from pyinfra.viz.plan_page.page import rewrite_plan_page
from pyinfra.viz.report.contents import page, read_sections
from pyinfra.viz.report.page import write_page
from pyinfra.viz.report.report_data import read_material

SECTIONS = "pyinfra.viz.report.contents"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Writes the results of a benchmark as one HTML page that opens from disk: a "
        "recommendation, and the figures that it is based on. For the folder of `pyinfra plan` it "
        "writes the page of the plan again."
    )
    parser.epilog = (
        "example: pyinfra report results --data data/highway --runs runs/* --out report.html"
    )
    parser.add_argument(
        "results", type=Path, help="output folder of `pyinfra benchmark` or `pyinfra plan`"
    )
    parser.add_argument(
        "--data", nargs="+", type=Path, default=[], help="data sets whose frames are shown"
    )
    parser.add_argument(
        "--runs",
        nargs="+",
        type=Path,
        default=[],
        help="folders of trained detectors whose predictions are shown",
    )
    parser.add_argument(
        "--sections",
        default=SECTIONS,
        metavar="MODULE",
        help="Python module whose list SECTIONS holds the functions that write the sections; "
        "default: %(default)s",
    )
    parser.add_argument(
        "--tier", choices=TIERS, help="tier of the benchmark; default: the most complete"
    )
    group = parser.add_argument_group(
        "requirements of the recommendation, as in `pyinfra recommend`"
    )
    group.add_argument(
        "--budget",
        dest="budget_usd",
        type=usd,
        metavar="USD",
        default=Requirements.budget_usd,
        help="highest price of LiDAR and site, in US dollars; default: no limit",
    )
    group.add_argument(
        "--min-ap",
        type=float,
        default=Requirements.min_ap,
        help=f"minimum AP of all vehicles, 0 to 100; default: {Requirements.min_ap:g}",
    )
    group.add_argument(
        "--range",
        dest="range_m",
        type=float,
        default=Requirements.range_m,
        help=(
            "maximum distance of the vehicles and roads that count, in metres; default: "
            f"{Requirements.range_m:g}"
        ),
    )
    group.add_argument(
        "--latency",
        dest="latency_ms",
        type=float,
        help=(
            "maximum median time per frame, in milliseconds; default: the frame period of the LiDAR"
        ),
    )
    parser.add_argument("--out", type=Path, required=True, help="HTML file to write")


def run(args: argparse.Namespace) -> int:
    check_file(args.out)
    if is_plan(args.results):
        check_only_out(args)
        print(rewrite_plan_page(args.results, args.out))
        return 0
    requirements = checked_requirements(args.budget_usd, args.min_ap, args.range_m, args.latency_ms)
    sections, tables = read_sections(args.sections)
    material = read_material(args.results, args.data, args.runs, args.tier, requirements, tables)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    print(write_page(page(material, sections), args.out))
    return 0


def check_only_out(args: argparse.Namespace) -> None:
    """Raises Error for an option that the page of a plan does not have."""
    given = {
        "data": args.data,
        "runs": args.runs,
        "sections": args.sections != SECTIONS,
        "tier": args.tier,
        "budget_usd": args.budget_usd != Requirements.budget_usd,
        "min_ap": args.min_ap != Requirements.min_ap,
        "range_m": args.range_m != Requirements.range_m,
        "latency_ms": args.latency_ms is not None,
    }
    for name, value in given.items():
        if value:
            raise Error(
                f"{name}: expected a benchmark's results for it, got the plan {args.results}; the "
                "page of a plan has its own controls"
            )
