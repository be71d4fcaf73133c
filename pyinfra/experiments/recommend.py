"""The recommendation as text: which LiDARs and detectors meet the requirements.

All figures come from the tables of `pyinfra benchmark`. Options are compared by the AP of all
vehicles in the region, visible or not (ground truth `present`). Tables of version 0.3 do not have
this ground truth, so the AP of the vehicles that are visible from the mount is used for them. Road
is covered where this AP in a window of 20 m is above the required AP.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyinfra.core.machine_load import load_text
from pyinfra.dataset.lidars import UNCONFIRMED
from pyinfra.dataset.windows import REGION_M
from pyinfra.experiments.coverage import ROAD
from pyinfra.experiments.fairness import caveat_of_results
from pyinfra.experiments.option import Option
from pyinfra.experiments.option_table import latency, option_table, price, price_range
from pyinfra.experiments.requirements import Requirements, place_of
from pyinfra.experiments.value import SITE_ITEMS
from pyinfra.metrics.comparison import Interval
from pyinfra.metrics.intervals import FEW_BLOCKS
from pyinfra.metrics.row_selection import AP_R1000, COUNTED

MOST = 5  # maximum number of options that are described in full
NEAREST = 3  # number of options that are described if none meets the requirements


@dataclass(frozen=True)
class Answer:
    """The recommended options, best first.

    If no option meets the requirements, these are the options that miss them least.
    """

    meets: bool  # whether the options in `named` meet the requirements
    named: Sequence[Option]
    relax: Sequence[str]  # for each option, the requirements to change; empty if all are met
    remarks: Sequence[str]
    caveat: str  # caveat about ranking LiDARs by the pretrained detector; empty if not needed


def recommend(options: Sequence[Option], requirements: Requirements) -> Answer:
    """Returns the options that meet the requirements or, if there are none, the nearest options.

    options: one or more, of one scene and preset, ordered by AP.
    """
    table = option_table(options, requirements)
    caveat = caveat_of_results((option.lidar, option.detector) for option in options)
    good = table[table.meets]
    if good.empty:
        near = nearest(table)
        rest = table.drop(near.index)
        remarks = [*general_notes(options, requirements), *left_out(options, rest)]
        return Answer(False, [options[i] for i in near.index], [*near.relax], remarks, caveat)
    named, more = good[:MOST], good[MOST:]
    before = table[: named.index[0]]  # options with a higher AP than the first recommended option
    slow = before[before.meets_price & before.meets_ap & ~before.meets_latency]
    remarks = [*too_slow(options, slow, requirements), *general_notes(options, requirements)]
    remarks += [*doubts(options, named, requirements), *left_out(options, table.drop(slow.index))]
    if len(more):
        others = names(options[i] for i in more.index)
        remarks.insert(0, f"Further options that meet the requirements: {others}.")
    return Answer(True, [options[i] for i in named.index], [*named.relax], remarks, caveat)


def answer_lines(answer: Answer, requirements: Requirements) -> Iterator[str]:
    """Yields a recommendation line by line."""
    if not answer.meets:
        near = " The nearest options, each with the requirement to relax:" if answer.named else ""
        yield f"No option meets the requirements.{near}"
    for rank, (option, relax) in enumerate(zip(answer.named, answer.relax, strict=True), 1):
        relaxed = f"; meets the requirements with {relax}" if relax else ""
        yield f"{rank}. {sentence(option, requirements)}{relaxed}"
    yield from answer.remarks


def nearest(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows with the smallest sum of relative violations of budget and AP.

    Rows with equal sums are ordered by how far they miss the latency. The latency has the least
    weight, because a detector can run on a faster computer with the same AP. Options that would not
    meet the requirements with any budget and AP are left out.
    """
    reachable = table[np.isfinite(table.share_over)]
    return reachable.sort_values(["share_over", "latency_over"], kind="stable")[:NEAREST]


def sentence(option: Option, requirements: Requirements) -> str:
    visible, recall_text = "", ""
    if option.detected is not None and not option.recall.value >= 0:
        recall_text = f"finds {option.detected.value:.0f} % of them, "
    if option.whole == "present":
        hidden = f" ({100 * option.hidden:.0f} % are hidden)" if option.hidden >= 0 else ""
        visible = f"of those visible from the mount {with_interval(option.ap_visible)}{hidden}, "
    near = f" {place_of(option.range_m)}" if option.range_m >= 0 else ""
    recall = option.recall
    ends = f" [{recall.low:.0f}, {recall.high:.0f}]" if recall.is_known else ""
    of = "all vehicles" if option.whole == "present" else COUNTED[option.whole]
    recalled = f"finds {recall.value:.0f} %{ends} of {of}, at any score; "
    return (
        f"{option.name}: {AP_R1000} of {COUNTED[option.whole]}{near} "
        f"{with_interval(option.ap_whole)}, {recall_text}{visible}of the vehicles it captures "
        f"{with_interval(option.ap)}; {recalled if recall.value >= 0 else ''}"
        f"{price(option, requirements)}; {covered_road(option, requirements)}"
        f"{latency(option, requirements)}"
    )


def covered_road(option: Option, requirements: Requirements) -> str:
    """Returns the covered road as text; empty if the table does not have it.

    Tables of earlier versions do not have the covered road for sites of lanes.
    """
    road = option.covered_m
    if math.isnan(option.road_m):
        return ""
    span = f"[{road.low:.0f} to {road.high:.0f}] " if road.is_known else ""
    reason = "" if road.is_known else f" (no interval: {option.no_interval})"
    return (
        f"AP above {requirements.min_ap:g} of {COUNTED[option.whole]} on {road.value:.0f} "
        f"{span}of {option.road_m:.0f} {option.covered_in}{reason}; "
    )


def those_that_hold(*remarks: tuple[object, str]) -> Iterator[str]:
    """Returns the texts of the remarks whose condition holds."""
    return (text for holds, text in remarks if holds)


def general_notes(options: Sequence[Option], requirements: Requirements) -> Iterator[str]:
    """Yields remarks that hold for all options: on AP, prices and latencies."""
    unknown = [option for option in options if not option.ap_whole.is_known]
    yield from those_that_hold(
        (
            options[0].whole == "all",
            "These results have no AP of the subset `present`: vehicles that are not visible from "
            "the mount do not count. Run `pyinfra benchmark` again to count them.",
        ),
        (
            math.isnan(options[0].range_m) and requirements.range_m < REGION_M,
            "These results have no AP within ranges, so AP is of the whole region. Run `pyinfra "
            "benchmark` again to compute AP within ranges.",
        ),
        (
            unknown,
            f"No interval is available for the AP of {names(unknown)}: {FEW_BLOCKS}, or the table "
            "has no intervals.",
        ),
    )
    yield from replicates_note(options)
    yield from (f"{text}." for text in dict.fromkeys(o.other_frames for o in options) if text)
    yield from cost_notes(options[0])
    yield from price_notes(options)
    yield latency_note(options)


def replicates_note(options: Iterable[Option]) -> Iterator[str]:
    """Yields a remark on the two options that a benchmark compared in replicates."""
    for option in options:
        for other, difference in option.replicated.items():
            if difference.value >= 0:
                yield (
                    f"In replicates with other traffic, the AP of {option.name} "
                    f"minus that of {other} is {with_interval(difference)}."
                )


def latency_note(options: Iterable[Option]) -> str:
    """Returns a remark on the computer and the load under which latencies were measured."""
    timed = [option for option in options if math.isfinite(option.latency_ms)]
    if not timed:
        return "These results have no latency; repeat the benchmark for the latency only."
    machines = ", ".join(sorted({option.machine for option in timed} - {""}))
    where = f"one core of {machines}" if machines else "one core"
    load = load_text([option.other_cores for option in timed])
    return (
        f"Latencies were measured on {where} ({load}). To measure them on your computer, "
        "repeat the benchmark for the latency only."
    )


def too_slow(
    options: Sequence[Option], slow: pd.DataFrame, requirements: Requirements
) -> Iterator[str]:
    """Yields a remark for each option that meets budget and minimum AP, but not the latency."""
    for i, row in slow.iterrows():
        problem = "not timed" if math.isnan(row.latency_ms) else "too slow"
        text = sentence(options[int(i)], requirements)
        yield f"More accurate, but {problem}: {text}; meets the requirements with {row.relax}."


def cost_notes(option: Option) -> Iterator[str]:
    """Yields a remark on the costs besides LiDARs: which of them the prices include."""
    if not option.site_usd:
        items = ", ".join(map(item_name, SITE_ITEMS))
        lidars = f"{option.mounts} LiDARs, one per mount" if option.mounts > 1 else "LiDARs only"
        yield f"Prices include {lidars}, without {items} (`costs` of the benchmark adds them)."
        return
    mounts = f" with {option.mounts} mounts" if option.mounts > 1 else ""
    text = f"Every price includes {option.site_usd:,.0f} USD for the site{mounts}"
    if not option.site_items:
        yield f"{text}; these results do not list its items."
        return
    paid = [f"{item_name(i)} {usd:,.0f}" for i, usd in option.site_items.items() if usd]
    free = [item_name(item) for item in SITE_ITEMS if not option.site_items.get(item)]
    missing = f"; not included: {', '.join(free)} (`costs` of the benchmark)" if free else ""
    yield f"{text}: {', '.join(paid)}{missing}."


def price_notes(options: Iterable[Option]) -> Iterator[str]:
    """Yields a remark on the LiDARs whose price is unconfirmed."""
    unsure = dict.fromkeys(o.lidar for o in options if UNCONFIRMED in o.price_source)
    if unsure:
        yield (
            f"Unconfirmed prices: {', '.join(unsure)}. Enter a quotation as `price_usd` of the "
            "LiDAR's file."
        )


def item_name(column: str) -> str:
    """Returns the name of a cost item: `computer` for the column `computer_usd`."""
    return column.removesuffix("_usd")


def with_interval(ap: Interval) -> str:
    if not ap.is_known:
        return f"{ap.value:.1f} (no interval)"
    return f"{ap.value:.1f} [{ap.low:.1f}, {ap.high:.1f}]"


def names(options: Iterable[Option]) -> str:
    return ", ".join(option.name for option in options)


def doubts(
    options: Sequence[Option], good: pd.DataFrame, requirements: Requirements
) -> Iterator[str]:
    """Yields remarks on what is uncertain about the recommended options."""
    named = [options[i] for i in good.index]
    first = named[0]
    yield from doubts_of_order(first, named[1:], good[1:])
    yield from doubts_of_ap(named, requirements)
    yield from doubts_of_price(named, requirements)
    yield from doubts_of_latency(named, requirements)
    if first.covered_m.value < first.road_m:
        area = "the road" if first.covered_in == ROAD else "the region"
        yield (
            f"The first option does not cover the whole of {area}; several LiDARs, a higher budget "
            "or a lower required AP might do so."
        )


def doubts_of_order(first: Option, others: Sequence[Option], table: pd.DataFrame) -> Iterator[str]:
    """Returns remarks on which other options may be as good as the first."""
    ends = zip(table.difference_low, table.difference_high, strict=True)
    differences = [(o, Interval(0, *pair)) for o, pair in zip(others, ends, strict=True)]
    equal = [o for o, interval in differences if interval.is_known and not interval.is_significant]
    unknown = [o for o, interval in differences if not interval.is_known]
    return those_that_hold(
        (
            equal,
            f"The AP of {first.name} does not differ significantly from that of {names(equal)} "
            f"(the 95 % intervals include 0); {cheapest([first, *equal])}.",
        ),
        (
            unknown,
            f"It is not known whether {first.name} is better than {names(unknown)}: the difference "
            f"has no interval ({FEW_BLOCKS}, or the table is older).",
        ),
    )


def cheapest(options: Sequence[Option]) -> str:
    least = min(option.price_usd for option in options)
    lowest = [option for option in options if option.price_usd == least]
    if len(lowest) == len(options):
        return f"each costs {least:,.0f} USD"
    verb = "is" if len(lowest) == 1 else "are"
    return f"the cheapest of these {verb} {names(lowest)} ({least:,.0f} USD)"


def doubts_of_ap(named: Sequence[Option], requirements: Requirements) -> Iterator[str]:
    """Returns remarks on options that may miss the required AP."""
    unsure = f"May have less than AP {requirements.min_ap:g} of {COUNTED[named[0].whole]}"
    below = [o for o in named if o.ap_whole.is_known and o.ap_whole.low < requirements.min_ap]
    unknown = [o for o in named if not o.ap_whole.is_known]
    return those_that_hold(
        (below, f"{unsure}: {names(below)} (the interval begins below)."),
        (unknown, f"{unsure}: {names(unknown)} (no interval is available)."),
    )


def doubts_of_price(named: Sequence[Option], requirements: Requirements) -> Iterator[str]:
    """Yields a remark for each range of prices that exceeds the budget, with its options."""
    dear = [option for option in named if option.price_high_usd > requirements.budget_usd]
    for span in dict.fromkeys(map(price_range, dear)):
        listed = names(option for option in dear if price_range(option) == span)
        yield f"{listed} may cost more than the budget: {span} USD."


def doubts_of_latency(named: Sequence[Option], requirements: Requirements) -> Iterator[str]:
    """Returns remarks on options that exceed the latency on a loaded machine or in some frames."""
    unsure = [o for o in named if o.latency_ms > requirements.limit_ms(o.frame_ms)]
    named = [option for option in named if option not in unsure]
    late = [o for o in named if o.latency_p95_ms > requirements.limit_ms(o.frame_ms)]
    load = load_text([option.other_cores for option in unsure])
    return those_that_hold(
        (
            unsure,
            f"Above {requirements.limits_text(option.frame_ms for option in unsure)}, but measured "
            f"while {load}: {names(unsure)}. Measure the latency again on an idle machine.",
        ),
        (
            late,
            f"Above {requirements.limits_text(option.frame_ms for option in late)} in more than "
            f"5 % of the frames: {names(late)}. Their median latency is lower.",
        ),
    )


def left_out(options: Sequence[Option], table: pd.DataFrame) -> Iterator[str]:
    """Yields a remark for each option that does not meet the requirements, with the reason."""
    for i, row in table[~table.meets].iterrows():
        yield f"Left out: {options[int(i)].name}: {row.reason}."
