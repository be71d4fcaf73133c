"""`pyinfra recommend RESULTS --budget 8000 --min-ap 85 --range 100`: an answer in words.

Every figure is of the tables of `pyinfra benchmark` in RESULTS. Road counts as covered where the AP
of the ground truth `all` in a window of 20 m is above what is asked.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from pyinfra.benchmark.options import Option, Wish, read_options
from pyinfra.benchmark.value import REGION_M
from pyinfra.statistics.compare import Figure
from pyinfra.training.sources import TIERS

MOST = 5


def answer(options: Sequence[Option], wish: Wish) -> list[str]:
    """Sentences: what to take, what cannot be told apart, what was left out and why."""
    good = [option for option in options if not shortfalls(option, wish)]
    if not good:
        return ["No option meets this.", *left_out(options, wish)]
    named, more = good[:MOST], good[MOST:]
    lines = [f"{i}. {sentence(option, wish)}" for i, option in enumerate(named, 1)]
    if more:
        meet = "meets" if len(more) == 1 else "meet"
        lines.append(f"And {len(more)} more that {meet} this: {names(more)}.")
    return [*lines, *doubts(named, wish), *left_out(options, wish)]


def shortfalls(option: Option, wish: Wish) -> list[str]:
    """Why an option does not meet the wish; nothing if it does."""
    found = []
    if option.price_usd > wish.budget_usd:
        found.append(f"costs {price(option, wish)}")
    if option.ap.value < wish.min_ap:
        found.append(f"AP {option.ap.value:.1f}")
    if option.latency_ms > wish.latency_ms:
        found.append(f"{option.latency_ms:.0f} ms a frame")
    return found


def sentence(option: Option, wish: Wish) -> str:
    road = option.covered_m
    return (
        f"{option.name}: {price(option, wish)}; AP {with_interval(option.ap)} of the vehicles it "
        f"captures, {option.ap_all:.1f} of all; AP above {wish.min_ap:g} of all on "
        f"{road.value:.0f} [{road.low:.0f} to {road.high:.0f}] of {option.road_m:.0f} m of road; "
        f"{option.latency_ms:.0f} ms a frame on one core"
    )


def price(option: Option, wish: Wish) -> str:
    """With the range of prices, if there is one, and whether a price too high may be within it."""
    text = f"{option.price_usd:,.0f} USD"
    if option.price_low_usd == option.price_high_usd:
        return text
    may = option.price_low_usd <= wish.budget_usd < option.price_usd
    return f"{text} ({price_range(option)}{': may be within the budget' if may else ''})"


def price_range(option: Option) -> str:
    return f"{option.price_low_usd:,.0f} to {option.price_high_usd:,.0f}"


def with_interval(ap: Figure) -> str:
    if not is_known(ap):
        return f"{ap.value:.1f} (no interval)"
    return f"{ap.value:.1f} [{ap.low:.1f}, {ap.high:.1f}]"


def names(options: Iterable[Option]) -> str:
    return ", ".join(option.name for option in options)


def is_known(figure: Figure) -> bool:
    """Whether it has an interval."""
    return math.isfinite(figure.low) and math.isfinite(figure.high)


def overlap(a: Figure, b: Figure) -> bool:
    """Whether the intervals do; not if one is not known."""
    return a.low <= b.high and b.low <= a.high


def doubts(named: Sequence[Option], wish: Wish) -> Iterator[str]:
    """What the data does not decide about the options that are named."""
    first, *others = named
    yield from doubts_of_order(first, others)
    yield from doubts_of_ap(named, wish)
    yield from doubts_of_price(named, wish)
    if first.covered_m.value < first.road_m:
        more = "several LiDARs, a higher budget or a lower AP might"
        yield f"None of these covers the whole of the road; {more}."


def doubts_of_order(first: Option, others: Sequence[Option]) -> Iterator[str]:
    """Which others may be as good as the first."""
    equal = [o for o in others if overlap(o.ap, first.ap)]
    if equal:
        yield f"AP does not tell {first.name} from {names(equal)}: 95 % intervals overlap."
    unknown = [o for o in others if not (is_known(o.ap) and is_known(first.ap))]
    if unknown:
        text = f"Whether AP tells {first.name} from {names(unknown)} cannot be told"
        yield f"{text}: there is no interval."
    as_far = [o for o in others if overlap(o.covered_m, first.covered_m)]
    if as_far:
        text = f"The road covered does not tell {first.name} from {names(as_far)}"
        yield f"{text}; {cheapest([first, *as_far])}."


def cheapest(options: Sequence[Option]) -> str:
    least = min(option.price_usd for option in options)
    found = [option for option in options if option.price_usd == least]
    if len(found) == len(options):
        return f"each costs {least:,.0f} USD"
    verb = "is" if len(found) == 1 else "are"
    return f"the cheapest of these {verb} {names(found)} ({least:,.0f} USD)"


def doubts_of_ap(named: Sequence[Option], wish: Wish) -> Iterator[str]:
    """Which may miss the AP that is asked."""
    unsure = f"Not sure to reach AP {wish.min_ap:g}"
    below = [o for o in named if is_known(o.ap) and o.ap.low < wish.min_ap]
    if below:
        yield f"{unsure}: {names(below)}: the interval begins below it."
    unknown = [o for o in named if not is_known(o.ap)]
    if unknown:
        yield f"{unsure}: {names(unknown)}: there is no interval."


def doubts_of_price(named: Sequence[Option], wish: Wish) -> Iterator[str]:
    """Which may cost more than the budget; those of one range of prices in one sentence."""
    dear = [option for option in named if option.price_high_usd > wish.budget_usd]
    for span in dict.fromkeys(map(price_range, dear)):
        own = names(option for option in dear if price_range(option) == span)
        yield f"{own} may cost more than the budget: {span} USD."


def left_out(options: Sequence[Option], wish: Wish) -> Iterator[str]:
    """The options that fall short, with the reasons."""
    for option in options:
        reasons = shortfalls(option, wish)
        if reasons:
            yield f"Left out: {option.name}: {', '.join(reasons)}."


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
