"""The verdict on the options of a plan, which follows from one share and its interval.

The share is measured where an option was simulated in full, and predicted elsewhere. Verdict,
order, tables, page and sentences all use it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.observe import Observed
from pyinfra.experiments.planner.predict import SIMULATED, Prediction, Standing
from pyinfra.experiments.planner.request import Goal, Request

Standings = Mapping[tuple[int, ...], Standing]
Verdict = Literal["met", "not known", "not met"]
LISTED = 3  # options that are described in full


@dataclass(frozen=True, eq=False)
class Compared:
    """The options of a plan, the chosen one first, and the figures on which the verdict rests."""

    options: Sequence[Choice]
    best: Sequence[Choice]  # those of this request; the others are best for other settings
    listed: int  # options in the table; the others are those of the front
    units: Units
    goals: tuple[Goal, ...]  # with the objects of `unseen`
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


def verdict(one: Standing, request: Request) -> Verdict:
    """Returns whether an option meets the request: by its interval, not by its value alone."""
    if not one.recall.is_known:
        return "not known"
    most, false = request.most_false, one.false_per_frame
    if one.recall.high < request.find or false.low > most:
        return "not met"
    return "met" if one.recall.low >= request.find and false.high <= most else "not known"


def in_order(options: Sequence[Choice], standings: Standings, request: Request) -> list[Choice]:
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
    """Returns whether an option is cheaper and finds no less; both must be simulated."""
    a, b = standings[one.units], standings[other.units]
    return (
        a.source == b.source == SIMULATED
        and one.price.middle < other.price.middle
        and a.recall.value >= b.recall.value
        and a.weighted >= b.weighted
        and a.false_per_frame.value <= b.false_per_frame.value
    )
