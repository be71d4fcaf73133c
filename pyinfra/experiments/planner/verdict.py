"""What decides about the options of a plan: one share with its interval, and what follows from it.

The share is measured where an option was simulated in full, and predicted elsewhere. Verdict,
order, tables, page and sentences all use it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pyinfra.experiments.planner.choice import Choice
from pyinfra.experiments.planner.predict import Prediction
from pyinfra.experiments.planner.request import Request
from pyinfra.metrics.comparison import Interval

Verdict = Literal["met", "not known", "not met"]
SIMULATED, PREDICTED = "simulated", "predicted"


@dataclass(frozen=True, eq=False)
class Standing:
    """The figures of an option that decide. Shares are 0 to 1."""

    recall: Interval  # of the vehicles within the distance of the request
    people: Interval
    shares: Mapping[str, Interval]  # of each goal, by its column
    weighted: float  # share of all objects by their weights
    false_per_frame: Interval
    ap: Interval  # of all vehicles of the region, 0 to 100
    position_m: float  # 95 % of the positions of found vehicles are within this; NaN if predicted
    source: str  # SIMULATED or PREDICTED

    @staticmethod
    def predicted(one: Prediction) -> Standing:
        false = one.false_per_frame if one.keeps_false else _above(one.false_per_frame)
        return Standing(
            one.recall, one.people, one.shares, one.weighted, false, one.ap, float("nan"), PREDICTED
        )


def _above(rate: Interval) -> Interval:
    """Returns a rate of false boxes that no score makes lower: its low end is the rate."""
    return Interval(rate.value, rate.value, rate.high)


def most_false(request: Request) -> float:
    """Returns the most false boxes of a frame."""
    return request.false_per_minute / request.frames_per_minute


def verdict(one: Standing, request: Request) -> Verdict:
    """Returns whether an option meets the request: by its interval, not by its value alone."""
    if not one.recall.is_known:
        return "not known"
    most, false = most_false(request), one.false_per_frame
    if one.recall.high < request.find or false.low > most:
        return "not met"
    return "met" if one.recall.low >= request.find and false.high <= most else "not known"


def in_order(
    options: Sequence[Choice], standings: Mapping[tuple[int, ...], Standing], request: Request
) -> list[Choice]:
    """Returns the options, the chosen one first.

    Options that meet the request come first, then those that may meet it and whose own values do;
    both from the cheapest, and by the weighted share at one price. The others follow from the
    largest weighted share. An option that was simulated does not come before a simulated one that
    is cheaper and finds as much.
    """

    def key(choice: Choice) -> tuple[float, float, float]:
        one = standings[choice.units]
        met = verdict(one, request)
        enough = one.recall.value >= request.find
        enough &= one.false_per_frame.value <= most_false(request)
        if met == "met" or (met == "not known" and enough):
            return met != "met", choice.price.middle, -one.weighted
        return 2, -one.weighted, choice.price.middle

    left = sorted(options, key=key)
    out: list[Choice] = []
    while left:
        first = left[0]
        better = [one for one in left if _beats(one, first, standings)]
        first = min(better, key=lambda one: one.price.middle, default=first)
        left.remove(first)
        out.append(first)
    return out


def _beats(one: Choice, other: Choice, standings: Mapping[tuple[int, ...], Standing]) -> bool:
    """Returns whether an option is cheaper than another and finds as much, both simulated."""
    a, b = standings[one.units], standings[other.units]
    return (
        a.source == b.source == SIMULATED
        and one.price.middle < other.price.middle
        and a.recall.value >= b.recall.value
        and a.weighted >= b.weighted
        and a.false_per_frame.value <= b.false_per_frame.value
    )
