"""`pyinfra recommend RESULTS --budget 8000 --min-ap 85 --range 100`."""

import argparse
from pathlib import Path

from pyinfra.cli.messages import with_options
from pyinfra.cli.number_option import usd
from pyinfra.cli.parser import argument, usage
from pyinfra.core.vocabulary import TIERS
from pyinfra.experiments.options import read_options
from pyinfra.experiments.recommend import answer_lines, recommend
from pyinfra.experiments.requirements import Requirements, checked_requirements, place_of
from pyinfra.metrics.row_selection import COUNTED

add_arguments = usage(
    "Ranks the LiDARs and detectors of a benchmark that meet your requirements, by the AP of "
    "all vehicles in the region. Brackets after an AP contain its 95 % interval. Brackets "
    "after metres of road contain the metres for the low end and for the high end of the AP "
    "of each window.",
    "example: pyinfra recommend results --scene highway --budget 8000 --min-ap 85",
    argument("results", type=Path, help="output folder of `pyinfra benchmark`"),
    argument(
        "--budget",
        dest="budget_usd",
        type=usd,
        metavar="USD",
        required=True,
        help="highest price of LiDAR and site, in US dollars",
    ),
    argument(
        "--min-ap",
        type=float,
        default=Requirements.min_ap,
        help="minimum AP of all vehicles, 0 to 100; a road is covered where the AP exceeds this; "
        f"default: {Requirements.min_ap:g}",
    ),
    argument(
        "--range",
        dest="range_m",
        type=float,
        default=Requirements.range_m,
        help="maximum distance, one of 10, 20 ... 100 m; AP, recall and coverage include "
        "only vehicles and roads within it; it is measured along the road or, at a site from a "
        "map, from the sensor; with 100, AP and recall are those of the whole region; "
        f"default: {Requirements.range_m:g}",
    ),
    argument(
        "--latency",
        dest="latency_ms",
        type=float,
        help="maximum median time per frame, in milliseconds; "
        "default: the frame period of the LiDAR, 100 at 10 frames per second",
    ),
    argument("--scene", default="", help="scene; required if several were measured"),
    argument(
        "--preset",
        default="",
        help="preset of the LiDARs; default: the first of datasheet, equal and paper that has "
        "results of two LiDARs or more, as in the report",
    ),
    argument(
        "--tier", choices=TIERS, default="quick", help="tier of the benchmark; default: quick"
    ),
)


def run(args: argparse.Namespace) -> int:
    requirements = checked_requirements(args.budget_usd, args.min_ap, args.range_m, args.latency_ms)
    options = read_options(args.results, args.tier, args.scene, args.preset, requirements)
    first = options[0]
    answer = recommend(options, requirements)
    asked = (
        f"{first.scene}, preset {first.preset}, {args.tier} tier: at most "
        f"{requirements.budget_usd:,.0f} USD, AP {requirements.min_ap:g} of "
        f"{COUNTED[first.whole]} {place_of(requirements.range_m)}, "
        f"{requirements.limits_text(option.frame_ms for option in options)} a frame."
    )
    print(f"{asked} {answer.caveat}".rstrip())
    if names := ", ".join(sorted({option.detector for option in options if option.hardly_learnt})):
        text = "The smoke tier trains networks too little; do not use the AP of "
        print(f"{text}{names}.")
    for line in answer_lines(answer, requirements):
        print(with_options(line, args.options))
    return 0
