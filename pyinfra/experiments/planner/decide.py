"""Decides among the pairs that stayed in the race, with the prices as asked and with others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from pyinfra.core.arrays import BoolArray
from pyinfra.experiments.planner.answer import LISTED
from pyinfra.experiments.planner.choice import (
    Choice,
    Units,
    greedy,
    most_units,
    pairs,
    singles,
    upper_bound,
)
from pyinfra.experiments.planner.costs import Costs
from pyinfra.experiments.planner.detectability import Detectability, Law
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.predict import Prediction, predict
from pyinfra.experiments.planner.race import Race, detection_probabilities
from pyinfra.experiments.planner.request import Request

SHOWN = 12  # options in the table, besides the best of each LiDAR
PERCENT = (-20, 20)
PER_POLE = ("pole_usd", "installation_usd", "upkeep_usd")
OTHERS = ("cable_usd", "computer_usd", "usd_per_kwh")
# Kinds of prices that may change: whether those of LiDARs do, and which lines of the costs do.
PRICES: dict[str, tuple[bool, tuple[str, ...]]] = {
    "LiDAR prices": (True, ()),
    "costs per pole": (False, PER_POLE),
    "all prices": (True, PER_POLE + OTHERS),
}


@dataclass(frozen=True)
class Move:
    """The choice with other prices; None if no option is within the budget then."""

    prices: str  # a key of PRICES
    percent: int
    choice: Choice | None


@dataclass(frozen=True, eq=False)
class Decision:
    """The options, the chosen one first, and the choice with other prices."""

    options: list[Choice]  # those that are listed, then the others of the front
    listed: int  # number of options that are listed
    in_choice: list[Prediction]  # what each option finds in the frames of the choice
    moves: list[Move]


def decide(
    race: Race,
    units: Units,
    front: Sequence[Choice],
    law: Detectability,
    request: Request,
    more: Mapping[str, BoolArray],
) -> Decision:
    """Orders the options by what they find in the frames of the race.

    front: options that are best for other settings. The first LISTED options are listed, and all
    that `considered` returns. Of options with the same LiDARs at the same positions, only the first
    is listed. more: further sets of objects, as in `predict`.
    """
    known: dict[tuple[int, ...], Prediction] = {}
    values = replace(
        law,
        vehicles=_without_replicates(law.vehicles),
        people=None if law.people is None else _without_replicates(law.people),
    )

    def prediction(units: tuple[int, ...]) -> Prediction:
        if units not in known:
            known[units] = predict(race, units, values, request, more)
        return known[units]

    first = considered(units, request)
    others = [with_bound(one, first, units, request) for one in front]
    order = in_order(merged(others, first), prediction, request)
    always = {_stands(one, units) for one in first}
    best = first_at_each_place(order, units)
    listed = {
        _key(one) for k, one in enumerate(best) if k < LISTED or _stands(one, units) in always
    }
    is_listed = [_key(one) in listed for one in order]
    options = [one for one, here in zip(order, is_listed, strict=True) if here]
    options += [one for one, here in zip(order, is_listed, strict=True) if not here]
    moves = []
    for prices in PRICES:
        for percent in PERCENT:
            changed = with_prices(units, prices, 1 + percent / 100)
            again = [replace(one, price=changed.price(one.units)) for one in order]
            within = [one for one in again if one.price.middle <= request.budget_usd]
            every = merged(within, considered(changed, request))
            then = in_order(every, prediction, request)
            moves.append(Move(prices, percent, then[0] if then else None))
    return Decision(options, sum(is_listed), [prediction(one.units) for one in options], moves)


def merged(some: Sequence[Choice], others: Sequence[Choice]) -> list[Choice]:
    """Returns the options of both, each once; those of `others` replace the same of `some`."""
    return list({_key(one): one for one in (*some, *others)}.values())


def _key(one: Choice) -> tuple[int, ...]:
    return tuple(sorted(one.units))


def first_at_each_place(options: Sequence[Choice], units: Units) -> list[Choice]:
    """Returns the options without those that have the LiDARs and positions of an earlier one.

    The others differ from an earlier one in height, pitch or yaw only.
    """
    first: dict[tuple[tuple[int, str], ...], Choice] = {}
    for one in options:
        first.setdefault(_stands(one, units), one)
    return list(first.values())


def _stands(one: Choice, units: Units) -> tuple[tuple[int, str], ...]:
    """Returns the number of the pole and the LiDAR of each unit."""
    return tuple(sorted((int(units.place[u]), units.lidars[u].name) for u in one.units))


def with_bound(one: Choice, options: Sequence[Choice], units: Units, request: Request) -> Choice:
    """Returns an option of the front with its value for the plan's weights, and their bound."""
    value, count = units.value(one.units), len(one.units)
    bounds = [other.bound for other in options if len(other.units) == count]
    bound = bounds[0] if bounds else upper_bound(units, [*one.units], request.budget_usd, count)
    return replace(one, value=value, bound=bound)


def _without_replicates(law: Law) -> Law:
    return Law(law.detection[:1], law.false[:1])


def considered(units: Units, request: Request) -> list[Choice]:
    """Returns the best options of one, of two and of more units, each once."""
    alone = singles(units, request.budget_usd)
    if not alone:
        return []
    options = first_at_each_place(alone, units)[:SHOWN] + best_of_each_lidar(alone, units)
    if request.units >= 2:
        two = pairs(units, request.budget_usd, request.poles, request.lidars_per_pole)
        options += first_at_each_place(two, units)[:SHOWN]
    if min(request.units, most_units(units, request.budget_usd)) > 2:
        more = greedy(units, request.budget_usd, request.poles, request.lidars_per_pole)
        options += [more] if more else []
    return merged([], options)


def in_order(
    options: Sequence[Choice],
    prediction: Callable[[tuple[int, ...]], Prediction],
    request: Request,
) -> list[Choice]:
    """Returns the options, the chosen one first.

    Options that find enough vehicles come first, the cheapest first. Of options of one price, and
    of those that do not find enough, the one with the largest weighted share comes first.
    """

    def key(choice: Choice) -> tuple[float, float, float]:
        one = prediction(choice.units)
        if one.recall.value >= request.find and one.keeps_false:
            return 0, choice.price.middle, -one.weighted
        return 1, -one.weighted, choice.price.middle

    return sorted(options, key=key)


def with_prices(units: Units, prices: str, factor: float) -> Units:
    """Returns the units with one kind of prices multiplied by a factor."""
    of_lidars, items = PRICES[prices]
    lidars = units.lidars
    if of_lidars:
        changed = {one.name: one.with_price(factor) for one in lidars}
        lidars = [changed[one.name] for one in lidars]
    lines = {
        item: line * factor if item in items else line for item, line in units.costs.lines.items()
    }
    return replace(units, lidars=lidars, costs=replace(units.costs, lines=lines))


def best_of_each_lidar(alone: Sequence[Choice], units: Units) -> list[Choice]:
    """Returns the best option of each LiDAR alone."""
    first: dict[str, Choice] = {}
    for one in alone:
        first.setdefault(units.lidars[one.units[0]].name, one)
    return list(first.values())


def units_of(
    race: Race,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    costs: Costs,
    law: Detectability,
    request: Request,
) -> Units:
    """Returns the pairs that stayed as the units of a choice."""
    stayed = race.stayed
    probability = detection_probabilities(race.seen, len(stayed), race.objects, law, request)
    of_pose = poses.iloc[stayed.pose.to_numpy()]
    place = of_pose.groupby(["x_m", "y_m"], sort=False).ngroup().to_numpy()
    existing = of_pose.existing.to_numpy(bool)
    return Units(
        probability, race.objects.weight, place, existing, [lidars[i] for i in stayed.lidar], costs
    )


def few_positions(poses: pd.DataFrame, request: Request) -> Iterator[str]:
    """Yields a line if fewer positions are possible than poles are asked for."""
    count = len(poses.drop_duplicates(["x_m", "y_m"]))
    if count < request.poles:
        are = "position is" if count == 1 else "positions are"
        yield f"Only {count} {are} possible, fewer than the {request.poles} poles of the request."
