"""The verdict on the options of a plan, which follows from one share and its interval.

The share is measured where an option was simulated in full, and predicted elsewhere. Verdict,
order, tables, page and sentences all use it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.observe import Observed
from pyinfra.experiments.planner.predict import SIMULATED, Prediction, Standing
from pyinfra.experiments.planner.request import Goal, Request

Standings = Mapping[tuple[int, ...], Standing]
Verdict = Literal["met", "not known", "not met"]
Condition = Literal["find", "false_per_minute"]  # names of fields of Request
LISTED = 3  # number of options that are described in full


@dataclass(frozen=True, eq=False)
class Compared:
    """The options of a plan, the chosen one first, and the figures that decide the verdict."""

    options: Sequence[Choice]
    best: Sequence[Choice]  # options that are best for this request, not for others
    listed: int  # number of options in the table; the other options are those of the front
    units: Units
    goals: tuple[Goal, ...]  # goals, counted over the objects of `unseen`
    standings: Standings
    predicted: Callable[[tuple[int, ...]], Prediction]
    unseen: Observed  # observations in traffic other than that of the choice

    @property
    def first(self) -> Choice:
        return self.options[0]

    def number(self, choice: Choice) -> int:
        """Returns the number of an option, from 1."""
        return 1 + [one.units for one in self.options].index(choice.units)

    @property
    def stands(self) -> list[tuple[Choice, Standing]]:
        return [(one, self.standings[one.units]) for one in self.options]


def conditions(one: Standing, request: Request) -> dict[Condition, Verdict]:
    """Returns whether the whole interval of each figure of an option meets the request."""
    share, false, most = one.recall, one.false_per_frame, request.most_false
    misses, exceeds = share.high < request.find, false.low > most
    is_found, is_rare = share.low >= request.find, false.high <= most
    return {
        "find": "met" if is_found else "not met" if misses else "not known",
        "false_per_minute": "met" if is_rare else "not met" if exceeds else "not known",
    }


def verdict(one: Standing, request: Request) -> Verdict:
    """Returns whether an option meets the request: by its interval, not by its value alone."""
    if not one.recall.is_known:
        return "not known"
    of_each = conditions(one, request).values()
    worst: tuple[Verdict, ...] = ("not met", "not known")
    return next((verdict for verdict in worst if verdict in of_each), "met")


def frames_needed(one: Standing, request: Request, frames: int) -> dict[Condition, float]:
    """Returns how many simulated frames may decide each condition that is not known.

    frames: number of frames from which the intervals were computed. Their width is proportional to
    the inverse of the root of this number.
    """
    needed: dict[Condition, float] = {}
    for name, held in conditions(one, request).items():
        if held == "not known":
            figure, limit = one.recall, request.find
            if name == "false_per_minute":
                figure, limit = one.false_per_frame, request.most_false
            away = abs(figure.value - limit)
            # One end of the interval may be clipped, so the longer side is used.
            half = max(figure.high - figure.value, figure.value - figure.low)
            needed[name] = frames * (half / away) ** 2 if away else math.inf
    return needed


def in_order(options: Sequence[Choice], standings: Standings, request: Request) -> list[Choice]:
    """Returns the options, the chosen one first.

    Options that meet the request come first. Options with the verdict "not known" whose values meet
    the request follow. Both groups are ordered by price, then by weighted share. All others are
    ordered by weighted share, largest first. An option that was simulated does not come before a
    simulated option that is cheaper and finds as much.
    """

    def key(choice: Choice) -> tuple[float, float, float]:
        one = standings[choice.units]
        met = verdict(one, request)
        enough = one.recall.value >= request.find
        enough &= one.false_per_frame.value <= request.most_false
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


def _beats(one: Choice, other: Choice, standings: Standings) -> bool:
    """Returns whether two options are simulated, and `one` is cheaper and no worse than `other`."""
    a, b = standings[one.units], standings[other.units]
    return (
        a.source == b.source == SIMULATED
        and one.price.middle < other.price.middle
        and a.recall.value >= b.recall.value
        and a.weighted >= b.weighted
        and a.false_per_frame.value <= b.false_per_frame.value
    )
