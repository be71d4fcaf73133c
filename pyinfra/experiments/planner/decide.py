"""The options of the pairs that stayed in the race, and the choice with other prices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from pyinfra.experiments.planner.answer import LISTED
from pyinfra.experiments.planner.candidates import FOOT, given_places
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
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.race import Race, detection_probabilities
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.verdict import Standing, in_order

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


def options_of(
    first: Sequence[Choice], front: Sequence[Choice], units: Units, request: Request
) -> list[Choice]:
    """Returns the options that are compared.

    first: the best ones of this request, as of `considered`. front: those that are best for other
    settings.
    """
    return merged([with_bound(one, first, units, request) for one in front], first)


def listed(
    order: Sequence[Choice], first: Sequence[Choice], units: Units
) -> tuple[list[Choice], int]:
    """Returns the options with those of the table in front, and the number of these.

    The table has the first LISTED options, and all of `first`. Of options with the same LiDARs at
    the same positions, it has only the first.
    """
    always = {_stands(one, units) for one in first}
    best = first_at_each_place(order, units)
    some = {_key(one) for k, one in enumerate(best) if k < LISTED or _stands(one, units) in always}
    here = [one for one in order if _key(one) in some]
    return here + [one for one in order if _key(one) not in some], len(here)


def kind_of(one: Choice, units: Units) -> tuple[tuple[str, ...], int]:
    """Returns the LiDARs of an option, and its number of poles."""
    names = tuple(sorted(units.lidars[u].name for u in one.units))
    return names, len({int(units.place[u]) for u in one.units})


def moves_of(
    order: Sequence[Choice],
    units: Units,
    standings: Mapping[tuple[int, ...], Standing],
    request: Request,
) -> list[Move]:
    """Returns the choice among the options with other prices."""
    moves = []
    for prices in PRICES:
        for percent in PERCENT:
            changed = with_prices(units, prices, 1 + percent / 100)
            again = [replace(one, price=changed.price(one.units)) for one in order]
            within = [one for one in again if one.price.middle <= request.budget_usd]
            then = in_order(within, standings, request)
            moves.append(Move(prices, percent, then[0] if then else None))
    return moves


def merged(some: Sequence[Choice], others: Sequence[Choice]) -> list[Choice]:
    """Returns the options of both, each once; those of `others` replace the same of `some`."""
    return list({_key(one): one for one in (*some, *others)}.values())


def _key(one: Choice) -> tuple[int, ...]:
    return tuple(sorted(one.units))


def first_at_each_place(options: Sequence[Choice], units: Units) -> list[Choice]:
    """Returns the options without those that have the LiDARs and positions of an earlier one.

    The others differ from an earlier one in height, pitch or yaw only.
    """
    first: dict[tuple[tuple[int, int, str], ...], Choice] = {}
    for one in options:
        first.setdefault(_stands(one, units), one)
    return list(first.values())


def _stands(one: Choice, units: Units) -> tuple[tuple[int, int, str], ...]:
    """Returns the numbers of the pole and of the user's position, and the LiDAR, of each unit."""
    return tuple(
        sorted((int(units.place[u]), units.given_at(u), units.lidars[u].name) for u in one.units)
    )


def with_bound(one: Choice, options: Sequence[Choice], units: Units, request: Request) -> Choice:
    """Returns an option of the front with its value for the plan's weights, and their bound."""
    value, count = units.value(one.units), len(one.units)
    bounds = [other.bound for other in options if len(other.units) == count]
    bound = bounds[0] if bounds else upper_bound(units, [*one.units], request.budget_usd, count)
    return replace(one, value=value, bound=bound)


def considered(units: Units, request: Request) -> list[Choice]:
    """Returns the best options of one, of two and of more units, each once."""
    alone = singles(units, request.budget_usd)
    if not alone:
        return []
    options = first_at_each_place(alone, units)[:SHOWN] + best_of_each_lidar(alone, units)
    options += best_at_given_places(alone, units)
    if request.units >= 2:
        two = pairs(units, request.budget_usd, request.poles, request.lidars_per_pole)
        options += first_at_each_place(two, units)[:SHOWN]
    if min(request.units, most_units(units, request.budget_usd)) > 2:
        more = greedy(units, request.budget_usd, request.poles, request.lidars_per_pole)
        options += [more] if more else []
    return merged([], options)


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


def best_at_given_places(alone: Sequence[Choice], units: Units) -> list[Choice]:
    """Returns the best option of one unit at each position that the user gave."""
    first: dict[int, Choice] = {}
    for one in alone:
        if (at := units.given_at(one.units[0])) >= 0:
            first.setdefault(at, one)
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
    place = of_pose.groupby(FOOT, sort=False).ngroup().to_numpy()
    existing, given = of_pose.existing.to_numpy(bool), given_places(of_pose)
    of_units = [lidars[i] for i in stayed.lidar]
    return Units(probability, race.objects.weight, place, existing, of_units, costs, given)
