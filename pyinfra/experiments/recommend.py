"""Which LiDAR and detector meet some requirements: an answer in words.

Every figure is of the tables of `pyinfra benchmark` in RESULTS. Options are compared by every
vehicle of the region, seen or not (ground truth `present`); of tables of version 0.3, which have
none, by those that the mount can see. Road counts as covered where their AP in a window of 20 m is
above what is asked.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pyinfra.core.machine_load import load_text
from pyinfra.dataset.regions import REGION_M
from pyinfra.experiments.options import ROAD, Option, Wish
from pyinfra.experiments.value import SITE_ITEMS
from pyinfra.metrics.comparison import Measured
from pyinfra.metrics.intervals import FEW_BLOCKS
from pyinfra.metrics.row_selection import COUNTED

MOST = 5  # options that are told in full
NEAREST = 3  # of those that fall short, if none meets the wish


@dataclass(frozen=True)
class Shortfall:
    """A limit that an option breaks."""

    of: Literal["price", "ap", "latency"]
    reason: str
    relax: str  # what would let it in, by the argument of `recommend`; nothing if none does
    share: float  # of the limit, by which it is broken


@dataclass(frozen=True)
class Answer:
    """What to take, or what is nearest to it, best first; and what is to be known about it."""

    meets: bool  # or the options named are the nearest to a wish that none meets
    named: Sequence[Option]
    remarks: Sequence[str]


def recommend(options: Sequence[Option], wish: Wish) -> Answer:
    """options: one or more, of one scene and preset, best first."""
    good = [option for option in options if not shortfalls(option, wish)]
    if not good:
        near = nearest(options, wish)
        rest = [option for option in options if option not in near]
        return Answer(False, near, [*general_notes(options, wish), *left_out(rest, wish)])
    named, more = good[:MOST], good[MOST:]
    before = options[: options.index(named[0])]  # of a higher AP
    slow = [option for option in before if misses(option, wish) == ["latency"]]
    rest = [option for option in options if option not in slow]
    remarks = [*too_slow(slow, wish), *general_notes(options, wish), *doubts(named, wish)]
    remarks += left_out(rest, wish)
    if more:
        meet = "meets" if len(more) == 1 else "meet"
        remarks.insert(0, f"And {len(more)} more that {meet} this: {names(more)}.")
    return Answer(True, named, remarks)


def answer_lines(answer: Answer, wish: Wish) -> Iterator[str]:
    """An answer line by line."""
    if not answer.meets:
        near = " The nearest, and what to relax:" if answer.named else ""
        yield f"No option meets this.{near}"
    for rank, option in enumerate(answer.named, 1):
        relaxed = "" if answer.meets else f"; meets it with {relaxation(option, wish)}"
        yield f"{rank}. {sentence(option, wish)}{relaxed}"
    yield from answer.remarks


def shortfalls(option: Option, wish: Wish) -> list[Shortfall]:
    """Why an option does not meet the wish; nothing if it does. What is not known does not meet."""
    missed = []
    if option.price_usd > wish.budget_usd:
        over = option.price_usd / wish.budget_usd - 1
        relax = f"`budget_usd` {math.ceil(option.price_usd)}"
        missed.append(Shortfall("price", f"costs {price(option, wish)}", relax, over))
    ap, counted = option.ap_whole.value, COUNTED[option.whole]
    if not ap >= wish.min_ap:
        relax = f"`min_ap` {math.floor(10 * ap) / 10:g}" if ap >= 2 else ""
        reason = f"AP {ap:.1f} of {counted}" if math.isfinite(ap) else f"no AP of {counted}"
        missed.append(Shortfall("ap", reason, relax, 1 - ap / wish.min_ap))
    if not option.latency_ms <= wish.latency_ms:
        known = math.isfinite(option.latency_ms)
        relax = f"`latency_ms` {math.ceil(option.latency_ms)}" if known else ""
        share = option.latency_ms / wish.latency_ms - 1 if known else math.inf
        missed.append(Shortfall("latency", latency(option), relax, share))
    return missed


def misses(option: Option, wish: Wish) -> list[str]:
    """Which limits an option breaks."""
    return [one.of for one in shortfalls(option, wish)]


def nearest(options: Iterable[Option], wish: Wish) -> list[Option]:
    """Those that break budget and AP by the least share in sum, and among equals the latency.

    A detector can be made faster, or run on another computer; its AP stays. An option of which no
    AP or price would be enough is not near.
    """
    broken = [(shortfalls(option, wish), option) for option in options]
    can = [
        (missed, option)
        for missed, option in broken
        if all(one.relax for one in missed if one.of != "latency")
    ]

    def away(pair: tuple[list[Shortfall], Option]) -> tuple[float, float]:
        missed = pair[0]
        first = sum(one.share for one in missed if one.of != "latency")
        return first, next((one.share for one in missed if one.of == "latency"), 0.0)

    return [option for _, option in sorted(can, key=away)[:NEAREST]]


def relaxation(option: Option, wish: Wish) -> str:
    """What would let an option in, by the argument of `recommend`, and what is to be measured."""
    missed = shortfalls(option, wish)
    words = " ".join(one.relax for one in missed if one.relax)
    unknown = any(not one.relax for one in missed)
    measured = f"a measured latency of {wish.latency_ms:g} ms or less" if unknown else ""
    return " and ".join(text for text in (words, measured) if text)


def sentence(option: Option, wish: Wish) -> str:
    visible, recall_text = "", ""
    if option.detected is not None and not option.recall.value >= 0:
        recall_text = f"finds {option.detected.value:.0f} % of them, "
    if option.whole == "present":
        hidden = f" ({100 * option.hidden:.0f} % are hidden)" if option.hidden >= 0 else ""
        visible = f"of those visible from the mount {with_interval(option.ap_visible)}{hidden}, "
    near = f" within {option.range_m:g} m" if option.range_m >= 0 else ""
    recall = option.recall
    ends = f" [{recall.low:.0f}, {recall.high:.0f}]" if recall.is_known else ""
    of = "all vehicles" if option.whole == "present" else COUNTED[option.whole]
    recalled = f"finds {recall.value:.0f} %{ends} of {of}, at any score; "
    return (
        f"{option.name}: {option.ap_name} of {COUNTED[option.whole]}{near} "
        f"{with_interval(option.ap_whole)}, {recall_text}{visible}of the vehicles it captures "
        f"{with_interval(option.ap)}; {recalled if recall.value >= 0 else ''}"
        f"{price(option, wish)}; {covered_road(option, wish)}{latency(option)}"
    )


def latency(option: Option) -> str:
    if math.isnan(option.latency_ms):
        return "no latency was measured"
    return f"{option.latency_ms:.0f} ms a frame"


def covered_road(option: Option, wish: Wish) -> str:
    """Nothing of a site of lanes in a table of an earlier version."""
    road = option.covered_m
    if math.isnan(option.road_m):
        return ""
    span = f"[{road.low:.0f} to {road.high:.0f}] " if road.is_known else ""
    reason = "" if road.is_known else f" (no interval: {option.no_interval})"
    return (
        f"AP above {wish.min_ap:g} of {COUNTED[option.whole]} on {road.value:.0f} "
        f"{span}of {option.road_m:.0f} {option.covered_in}{reason}; "
    )


def price(option: Option, wish: Wish) -> str:
    """With the range of prices, if there is one, and whether a price too high may be within it."""
    text = f"{option.price_usd:,.0f} USD"
    noun = f"{option.mounts} LiDARs" if option.mounts > 1 else "LiDAR"
    lidar = f"{noun} {option.price_usd - option.site_usd:,.0f}" if option.site_usd else ""
    span, may = "", ""
    if option.price_low_usd != option.price_high_usd:
        span = price_range(option)
        within = option.price_low_usd <= wish.budget_usd < option.price_usd
        may = ": may be within the budget" if within else ""
    remark = "; ".join(word for word in (f"{span}{may}", lidar) if word)
    return f"{text} ({remark})" if remark else text


def price_range(option: Option) -> str:
    return f"{option.price_low_usd:,.0f} to {option.price_high_usd:,.0f}"


def general_notes(options: Sequence[Option], wish: Wish) -> Iterator[str]:
    """What prices and latencies are of, the same for every option."""
    if options[0].whole == "all":
        yield (
            "These results were measured without ground truth `present`: vehicles that the mount "
            "cannot see are not counted; `pyinfra benchmark` of this version counts them."
        )
    if math.isnan(options[0].range_m) and wish.range_m < REGION_M:
        yield (
            "These results hold no AP within ranges: AP is of the whole region; `pyinfra "
            "benchmark` of this version measures it."
        )
    unknown = [option for option in options if not option.ap_whole.is_known]
    if unknown:
        why = f"{FEW_BLOCKS}, or the table has none"
        yield f"No interval is available for the AP of {names(unknown)}: {why}."
    yield from cost_notes(options[0])
    yield latency_note(options)


def latency_note(options: Iterable[Option]) -> str:
    """Where and under which load latencies were measured."""
    timed = [option for option in options if math.isfinite(option.latency_ms)]
    if not timed:
        return "No latency was measured; a benchmark with `latency` measures it."
    machines = ", ".join(sorted({option.machine for option in timed} - {""}))
    where = f"one core of {machines}" if machines else "one core"
    load = load_text([option.other_cores for option in timed])
    return f"Latency is of {where} ({load}); a benchmark with `latency` measures yours."


def too_slow(slow: Iterable[Option], wish: Wish) -> Iterator[str]:
    """Options that meet budget and AP, but not the latency that is asked."""
    for option in slow:
        what = "not timed" if math.isnan(option.latency_ms) else "too slow"
        relaxed = relaxation(option, wish)
        yield f"More accurate, but {what}: {sentence(option, wish)}; meets it with {relaxed}."


def cost_notes(option: Option) -> Iterator[str]:
    """What the prices hold beside the LiDAR, the same for every option, and what they do not."""
    if not option.site_usd:
        items = ", ".join(map(item_name, SITE_ITEMS))
        lidars = f"{option.mounts} LiDARs, a mount each," if option.mounts > 1 else "LiDARs alone"
        yield f"Prices are of {lidars}: {items} are missing (`costs` of the benchmark)."
        return
    mounts = f" with {option.mounts} mounts" if option.mounts > 1 else ""
    text = f"In every price are {option.site_usd:,.0f} USD of the site{mounts}"
    if not option.site_items:
        yield f"{text}; this table does not say for what."
        return
    paid = [f"{item_name(i)} {usd:,.0f}" for i, usd in option.site_items.items() if usd]
    free = [item_name(item) for item in SITE_ITEMS if not option.site_items.get(item)]
    missing = f"; missing: {', '.join(free)} (`costs` of the benchmark)" if free else ""
    yield f"{text}: {', '.join(paid)}{missing}."


def item_name(column: str) -> str:
    """computer_usd: computer."""
    return column.removesuffix("_usd")


def with_interval(ap: Measured) -> str:
    if not ap.is_known:
        return f"{ap.value:.1f} (no interval)"
    return f"{ap.value:.1f} [{ap.low:.1f}, {ap.high:.1f}]"


def names(options: Iterable[Option]) -> str:
    return ", ".join(option.name for option in options)


def doubts(named: Sequence[Option], wish: Wish) -> Iterator[str]:
    """What the data does not decide about the options that are named."""
    first, *others = named
    yield from doubts_of_order(first, others)
    yield from doubts_of_ap(named, wish)
    yield from doubts_of_price(named, wish)
    yield from doubts_of_latency(named, wish)
    if first.covered_m.value < first.road_m:
        more = "several LiDARs, a higher budget or a lower AP might"
        what = "the road" if first.covered_in == ROAD else "the region"
        yield f"The first does not cover the whole of {what}; {more}."


def doubts_of_order(first: Option, others: Sequence[Option]) -> Iterator[str]:
    """Which others may be as good as the first."""
    apart = [(o, first.less(o)) for o in others]
    equal = [o for o, interval in apart if interval.is_known and not interval.is_significant]
    if equal:
        text = f"The AP of {first.name} does not differ significantly from that of {names(equal)}"
        yield f"{text} (the 95 % intervals include 0); {cheapest([first, *equal])}."
    unknown = [o for o, interval in apart if not interval.is_known]
    if unknown:
        text = f"Whether {first.name} is better than {names(unknown)} is not known: no interval of "
        yield f"{text}the difference (too short a test, or a table of an earlier version)."


def cheapest(options: Sequence[Option]) -> str:
    least = min(option.price_usd for option in options)
    lowest = [option for option in options if option.price_usd == least]
    if len(lowest) == len(options):
        return f"each costs {least:,.0f} USD"
    verb = "is" if len(lowest) == 1 else "are"
    return f"the cheapest of these {verb} {names(lowest)} ({least:,.0f} USD)"


def doubts_of_ap(named: Sequence[Option], wish: Wish) -> Iterator[str]:
    """Which may miss the AP that is asked."""
    unsure = f"Not sure to reach AP {wish.min_ap:g} of {COUNTED[named[0].whole]}"
    below = [o for o in named if o.ap_whole.is_known and o.ap_whole.low < wish.min_ap]
    if below:
        yield f"{unsure}: {names(below)}: the interval begins below it."
    unknown = [o for o in named if not o.ap_whole.is_known]
    if unknown:
        yield f"{unsure}: {names(unknown)}: without an interval."


def doubts_of_price(named: Sequence[Option], wish: Wish) -> Iterator[str]:
    """Which may cost more than the budget; those of one range of prices in one sentence."""
    dear = [option for option in named if option.price_high_usd > wish.budget_usd]
    for span in dict.fromkeys(map(price_range, dear)):
        listed = names(option for option in dear if price_range(option) == span)
        yield f"{listed} may cost more than the budget: {span} USD."


def doubts_of_latency(named: Sequence[Option], wish: Wish) -> Iterator[str]:
    """Which are too late in more than one frame of twenty."""
    late = [option for option in named if option.latency_p95_ms > wish.latency_ms]
    if late:
        text = f"Above {wish.latency_ms:g} ms in more than 5 % of the frames: {names(late)}"
        yield f"{text}; the median is below."


def left_out(options: Iterable[Option], wish: Wish) -> Iterator[str]:
    """The options that fall short, with the reasons."""
    for option in options:
        missed = shortfalls(option, wish)
        if missed:
            yield f"Left out: {option.name}: {', '.join(one.reason for one in missed)}."
