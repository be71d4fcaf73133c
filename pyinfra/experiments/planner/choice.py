"""Chooses the LiDARs of an option: exactly for one or two, by a greedy search beyond.

An option is a set of units. A unit is one LiDAR at one pose. Units find an object independently of
each other: P(found) = 1 - product of (1 - p). The value of an option is the weighted share of all
present objects that it finds, seen or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pyinfra.experiments.planner.costs import NOTHING, Costs, Range
from pyinfra.experiments.planner.lidars import PlanLidar

BEST_PAIRS = 200  # options of two units that are kept for the table


@dataclass(frozen=True, eq=False)
class Units:
    """What a choice needs to know of n units."""

    probability: Float32Array  # (n, objects) probability that the unit finds the object
    weight: FloatArray  # (objects,)
    place: IntArray  # (n,) number of the pole
    existing: BoolArray  # (n,) whether the pole exists already
    lidars: Sequence[PlanLidar]  # (n,)
    costs: Costs
    given: IntArray | None = None  # (n,) number of the user's position, else -1; None: none is

    def given_at(self, unit: int) -> int:
        """Returns the number of the user's position of a unit, -1 for a pose that was made."""
        return -1 if self.given is None else int(self.given[unit])

    def parts(self, units: Sequence[int]) -> dict[str, Range]:
        """Returns the lines of the price of an option over the years."""
        poles = {int(self.place[u]): bool(self.existing[u]) for u in units}
        new = sum(not there for there in poles.values())
        return self.costs.parts([self.lidars[u] for u in units], new, len(poles))

    def latency_ms(self, units: Sequence[int]) -> float:
        """Returns the time of a frame of an option on one core. Each LiDAR of a bundle counts."""
        return self.costs.latency_ms * sum(self.lidars[u].units for u in units)

    def price(self, units: Sequence[int]) -> Range:
        """Returns the price of an option over the years."""
        return sum(self.parts(units).values(), NOTHING)

    def value(self, units: Sequence[int]) -> float:
        """Returns the weighted share of the objects that an option finds."""
        missed = np.prod(1 - self.probability[list(units)].astype(float), axis=0)
        return float(((1 - missed) * self.weight).sum() / max(self.weight.sum(), 1e-12))


@dataclass(frozen=True)
class Choice:
    """A set of units. `bound`: no set of as many units within the budget finds a larger share."""

    units: tuple[int, ...]
    value: float
    price: Range
    bound: float
    method: str  # `exact` or `greedy`

    @property
    def gap(self) -> float:
        return max(0.0, self.bound - self.value)


def singles(units: Units, budget_usd: float) -> list[Choice]:
    """Returns all options of one unit within the budget, best first."""
    total = max(float(units.weight.sum()), 1e-12)
    values = units.probability @ units.weight / total
    prices = [units.price([u]) for u in range(len(values))]
    within = [u for u in range(len(values)) if prices[u].middle <= budget_usd]
    best = max((float(values[u]) for u in within), default=0.0)
    order = sorted(within, key=lambda u: (-float(values[u]), prices[u].middle))
    return [Choice((u,), float(values[u]), prices[u], best, "exact") for u in order]


def pairs(units: Units, budget_usd: float, poles: int, per_pole: int) -> list[Choice]:
    """Returns the best options of two units within the budget, over all pairs; best first."""
    count = len(units.probability)
    missed = 1 - units.probability
    total = max(float(units.weight.sum()), 1e-12)
    both = total - (missed * units.weight.astype(np.float32)) @ missed.T
    same = units.place[:, None] == units.place[None, :]
    allowed = np.triu(np.ones((count, count), bool), 1)
    allowed &= np.where(same, per_pole >= 2, poles >= 2)
    allowed &= pair_prices(units, same) <= budget_usd
    at = np.flatnonzero(allowed)
    if not len(at):
        return []
    values = both.ravel()[at] / total
    most = min(BEST_PAIRS, len(at))
    best = at[np.argpartition(-values, most - 1)[:most]]
    made = []
    for flat in best:
        pair = (int(flat // count), int(flat % count))
        made.append(Choice(pair, units.value(pair), units.price(pair), 0.0, "exact"))
    made.sort(key=lambda one: (-one.value, one.price.middle))
    bound = made[0].value
    return [Choice(one.units, one.value, one.price, bound, "exact") for one in made]


def pair_prices(units: Units, same: BoolArray) -> FloatArray:
    """Returns the middle price of each pair of units: (n, n)."""
    costs, count = units.costs, len(units.probability)
    alone = np.array([units.price([u]).middle for u in range(count)])
    poles = np.array([costs.parts([], not there, 1)["pole_usd"].middle for there in units.existing])
    shared = costs.lines["installation_usd"].middle + costs.lines["upkeep_usd"].middle * costs.years
    out = alone[:, None] + alone[None, :] - np.where(same, poles[:, None] + shared, 0)
    # The computers of both are counted together; the number depends on the LiDARs alone.
    numbers = np.array([lidar.units for lidar in units.lidars])
    largest = int(numbers.max(initial=1)) * 2
    computers = np.array([costs.computers(n) for n in range(largest + 1)])
    excess = computers[numbers][:, None] + computers[numbers][None, :]
    excess = excess - computers[numbers[:, None] + numbers[None, :]]
    return np.asarray(out - excess * _computer_usd(costs))


def _computer_usd(costs: Costs) -> float:
    """Returns the middle price of a computer with its power."""
    line = costs.lines
    kwh = line["computer_w"] * line["usd_per_kwh"] * (8.766 * costs.years)
    return (line["computer_usd"] + kwh).middle


def greedy(units: Units, budget_usd: float, poles: int, per_pole: int) -> Choice | None:
    """Returns an option of any number of units, and a bound of the best one.

    Two greedy searches are made, by gain and by gain per dollar, and the better one is returned.
    The bound is value + the largest sum of gains that the limits of number and price allow. Gains
    only shrink as units are added, so that no option can exceed it.
    """
    options = [
        _search(units, budget_usd, poles, per_pole, per_dollar=per_dollar)
        for per_dollar in (False, True)
    ]
    best = max(options, key=units.value)
    if not best:
        return None
    bound = min(upper_bound(units, list(part), budget_usd, poles * per_pole) for part in options)
    return Choice(tuple(best), units.value(best), units.price(best), bound, "greedy")


def _search(
    units: Units, budget_usd: float, poles: int, per_pole: int, *, per_dollar: bool
) -> list[int]:
    chosen: list[int] = []
    missed = np.ones(len(units.weight))
    while len(chosen) < poles * per_pole:
        gains = units.probability @ (missed * units.weight)
        before = units.price(chosen).middle if chosen else 0.0
        best, score = -1, 0.0
        for u in np.argsort(-gains, kind="stable"):
            if gains[u] <= 0 or (not per_dollar and best >= 0):
                break
            if u in chosen or not _fits(units, [*chosen, int(u)], poles, per_pole):
                continue
            price = units.price([*chosen, int(u)]).middle
            worth = gains[u] / max(price - before, 1e-9) if per_dollar else gains[u]
            if price <= budget_usd and worth > score:
                best, score = int(u), float(worth)
        if best < 0:
            break
        chosen.append(best)
        missed = missed * (1 - units.probability[best])
    return chosen


def _fits(units: Units, chosen: Sequence[int], poles: int, per_pole: int) -> bool:
    places, counts = np.unique(units.place[list(chosen)], return_counts=True)
    return len(places) <= poles and int(counts.max()) <= per_pole


def upper_bound(units: Units, chosen: list[int], budget_usd: float, most: int) -> float:
    """Returns a share that no option of at most `most` units within the budget exceeds."""
    total = max(float(units.weight.sum()), 1e-12)
    missed = np.prod(1 - units.probability[chosen].astype(float), axis=0)
    value = float(((1 - missed) * units.weight).sum())
    gains = units.probability @ (missed * units.weight)
    least, left_usd = least_prices(units, budget_usd)
    by_number = float(np.sort(gains)[::-1][: min(most, most_units(units, budget_usd))].sum())
    order = np.argsort(-gains / np.maximum(least, 1e-9))
    spent = np.cumsum(least[order])
    whole = spent <= left_usd
    by_price = float(gains[order][whole].sum())
    if not whole.all():
        first = int(np.argmin(whole))
        left = max(0.0, left_usd - (spent[first - 1] if first else 0.0))
        by_price += float(gains[order][first]) * left / max(float(least[order][first]), 1e-9)
    return min(1.0, (value + min(by_number, by_price)) / total)


def least_prices(units: Units, budget_usd: float) -> tuple[FloatArray, float]:
    """Returns the least that each unit adds to a price (n,), and what is left for all of them.

    A unit adds at least its LiDAR and cable. Every option has at least one pole, one computer and
    the rest of the cheapest option of one unit.
    """
    cable = units.costs.lines["cable_usd"].middle
    least = np.array([lidar.price_usd + cable * lidar.units for lidar in units.lidars])
    alone = np.array([units.price([u]).middle for u in range(len(least))])
    return least, budget_usd - float((alone - least).min())


def most_units(units: Units, budget_usd: float) -> int:
    """Returns how many units the budget can pay for at most."""
    least, left_usd = least_prices(units, budget_usd)
    return int(max(0.0, left_usd) // max(float(least.min()), 1e-9))
