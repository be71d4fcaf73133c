"""`pyinfra report RESULTS --out report.html`."""

import argparse
from pathlib import Path

from pyinfra.cli.number_option import usd
from pyinfra.cli.parser import argument, group, usage
from pyinfra.core.vocabulary import TIERS
from pyinfra.experiments.requirements import Requirements
from pyinfra.viz.report.write import SECTIONS, write_report

add_arguments = usage(
    "Writes the results of a benchmark as one HTML page that opens from disk: a "
    "recommendation, and the figures that it is based on. For the folder of `pyinfra plan` it "
    "writes the page of the plan again.",
    "example: pyinfra report results --data data/highway --runs runs/* --out report.html",
    argument("results", type=Path, help="output folder of `pyinfra benchmark` or `pyinfra plan`"),
    argument("--data", nargs="+", type=Path, default=[], help="data sets whose frames are shown"),
    argument(
        "--runs",
        nargs="+",
        type=Path,
        default=[],
        help="folders of trained detectors whose predictions are shown",
    ),
    argument(
        "--sections",
        default=SECTIONS,
        metavar="MODULE",
        help="Python module whose list SECTIONS holds the functions that write the sections; "
        "default: %(default)s",
    ),
    argument("--tier", choices=TIERS, help="tier of the benchmark; default: the most complete"),
    group(
        "requirements of the recommendation, as in `pyinfra recommend`",
        argument(
            "--budget",
            dest="budget_usd",
            type=usd,
            metavar="USD",
            help="highest price of LiDAR and site, in US dollars; default: no limit",
        ),
        argument(
            "--min-ap",
            type=float,
            help=f"minimum AP of all vehicles, 0 to 100; default: {Requirements.min_ap:g}",
        ),
        argument(
            "--range",
            dest="range_m",
            type=float,
            help=(
                "maximum distance of the vehicles and roads that are included, in metres; default: "
                f"{Requirements.range_m:g}"
            ),
        ),
        argument(
            "--latency",
            dest="latency_ms",
            type=float,
            help=(
                "maximum median time per frame, in milliseconds; default: the frame period of the "
                "LiDAR"
            ),
        ),
    ),
    argument("--out", type=Path, required=True, help="HTML file to write"),
)


def run(args: argparse.Namespace) -> int:
    required = {name: getattr(args, name) for name in vars(Requirements())}
    out = write_report(
        *(args.results, args.out, args.data, args.runs, args.tier, args.sections, required)
    )
    print(out)
    return 0
