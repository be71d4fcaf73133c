"""`pyinfra recommend RESULTS --budget 8000 --min-ap 85 --range 100`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from pyinfra.benchmark.options import Wish, read_options
from pyinfra.benchmark.recommend import answer
from pyinfra.benchmark.value import REGION_M
from pyinfra.training.sources import TIERS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Says which LiDAR and detector suit a budget, by a benchmark's tables. Brackets behind AP "
        "are its 95 % interval; behind metres of road, the metres if every window's AP were at "
        "the low or at the high end of its own."
    )
    parser.epilog = "example: pyinfra recommend results --scene highway --budget 8000 --min-ap 85"
    parser.add_argument("results", type=Path, help="folder of `pyinfra benchmark`")
    parser.add_argument("--budget", type=float, required=True, help="USD for LiDAR and site")
    parser.add_argument(
        "--min-ap",
        type=float,
        default=85.0,
        help="AP of the vehicles that a LiDAR captured, 0 to 100, at least; also the AP of all "
        "vehicles above which road counts as covered; default: 85",
    )
    parser.add_argument(
        "--range", type=float, default=100.0, help="metres of road to either side; default: 100"
    )
    parser.add_argument("--latency", type=float, default=math.inf, help="milliseconds, at most")
    parser.add_argument("--scene", default="", help="needed if several were measured")
    parser.add_argument(
        "--preset",
        default="",
        help="default: that of the report, the nearest to LiDARs one can buy (datasheet, equal, "
        "paper) that has two LiDARs or more",
    )
    parser.add_argument("--tier", choices=TIERS, default="quick", help="default: quick")


def run(args: argparse.Namespace) -> int:
    for key, value, top in (
        ("--budget", args.budget, math.inf),
        ("--min-ap", args.min_ap, 100),
        ("--range", args.range, REGION_M),
        ("--latency", args.latency, math.inf),
    ):
        if not 0 < value <= top:
            raise ValueError(f"{key}: found {value:g}, allowed above 0 to {top:g}")
    wish = Wish(args.budget, args.min_ap, args.range, args.latency)
    options = read_options(args.results, args.tier, args.scene, args.preset, wish)
    first = options[0]
    print(
        f"{first.scene}, preset {first.preset}, {args.tier} tier: at most "
        f"{wish.budget_usd:,.0f} USD, AP {wish.min_ap:g}, {wish.range_m:g} m either way."
    )
    if args.tier == "smoke":
        print("Networks of the smoke tier have hardly learnt: nothing follows from their AP.")
    print(*answer(options, wish), sep="\n")
    return 0
