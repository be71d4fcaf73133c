"""`pyinfra recommend RESULTS --budget 8000 --min-ap 85 --range 100`: an answer in words.

Every figure is of the tables of `pyinfra benchmark` in RESULTS. Road counts as covered where the AP
of the ground truth `all` in a window of 20 m is above what is asked.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from pyinfra.benchmark.options import Option, Wish
from pyinfra.statistics.compare import Measured

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


def with_interval(ap: Measured) -> str:
    if not is_known(ap):
        return f"{ap.value:.1f} (no interval)"
    return f"{ap.value:.1f} [{ap.low:.1f}, {ap.high:.1f}]"


def names(options: Iterable[Option]) -> str:
    return ", ".join(option.name for option in options)


def is_known(figure: Measured) -> bool:
    """Whether it has an interval."""
    return math.isfinite(figure.low) and math.isfinite(figure.high)


def overlap(a: Measured, b: Measured) -> bool:
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
