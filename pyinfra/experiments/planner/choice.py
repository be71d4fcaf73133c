"""Chooses the LiDARs of an option: one or two by an exact search, more by a greedy search.

An option is a set of units. A unit is one LiDAR at one pose. Units find an object independently of
each other: P(found) = 1 - product of (1 - p), where p is the probability of each unit. The value of
an option is the weighted share of all present objects, visible or not, that it finds.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pyinfra.core.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pyinfra.experiments.planner.candidates import FOOT, given_places
from pyinfra.experiments.planner.costs import NOTHING, Costs, PlanLidar, Range
from pyinfra.experiments.planner.observe import Observed, Setting
from pyinfra.experiments.planner.predict import detection_probabilities
from pyinfra.experiments.planner.request import Request

BEST_PAIRS = 200  # number of best pairs of units whose exact value is computed
SHOWN = 12  # number of best options that are kept for one unit, and for two units


@dataclass(frozen=True, eq=False)
class Units:
    """The properties of n units on which a choice depends."""

    probability: Float32Array  # (n, objects) probability that the unit finds the object
    weight: FloatArray  # (objects,) weight of each object in the choice
    place: IntArray  # (n,) number of each unit's pole
    existing: BoolArray  # (n,) whether the pole exists already
    lidars: Sequence[PlanLidar]  # (n,) LiDAR of each unit
    costs: Costs
    given: IntArray | None = None  # (n,) number of the user's position or -1; None if all are -1

    def given_at(self, unit: int) -> int:
        """Returns the number of the user's position of a unit; -1 if the plan made the position."""
        return -1 if self.given is None else int(self.given[unit])

    def names(self, units: Sequence[int]) -> list[str]:
        """Returns the names of the LiDARs of an option."""
        return [self.lidars[u].name for u in units]

    def poles(self, units: Sequence[int]) -> dict[int, bool]:
        """Returns the numbers of the poles of an option, and whether each exists already."""
        return {int(self.place[u]): bool(self.existing[u]) for u in units}

    def parts(self, units: Sequence[int]) -> dict[str, Range]:
        """Returns the items of the price of an option over the years of use, by name."""
        there = self.poles(units).values()
        return self.costs.parts(
            [self.lidars[u] for u in units], len(there) - sum(there), len(there)
        )

    def latency_ms(self, units: Sequence[int]) -> float:
        """Returns the detection time per frame of an option on one core, over all its LiDARs."""
        return self.costs.latency_ms * sum(self.lidars[u].units for u in units)

    def price(self, units: Sequence[int]) -> Range:
        """Returns the price of an option over the years of use."""
        return sum(self.parts(units).values(), NOTHING)

    def value(self, units: Sequence[int]) -> float:
        """Returns the weighted share of the objects that an option finds."""
        missed = np.prod(1 - self.probability[list(units)].astype(float), axis=0)
        return float(((1 - missed) * self.weight).sum() / self.total)

    @property
    def total(self) -> float:
        """The sum of the weights, above 0."""
        return max(float(self.weight.sum()), 1e-12)


@dataclass(frozen=True)
class Choice:
    """A set of units. Within the budget, no set of this size has a `value` above `bound`."""

    units: tuple[int, ...]
    value: float
    price: Range
    bound: float
    method: str  # search method, `exact` or `greedy`

    @property
    def gap(self) -> float:
        return max(0.0, self.bound - self.value)

    @property
    def key(self) -> tuple[int, ...]:
        """The units in ascending order."""
        return tuple(sorted(self.units))


def units_of(observed: Observed, setting: Setting) -> Units:
    """Returns the pairs of pose and LiDAR that the race has not left out, as units of a choice."""
    stayed, objects = observed.stayed, observed.objects
    probability = detection_probabilities(
        observed.seen, stayed, objects, setting.law, setting.request
    )
    of_pose = setting.poses.iloc[stayed.pose.to_numpy()]
    return Units(
        probability,
        objects.weight,
        of_pose.groupby(FOOT, sort=False).ngroup().to_numpy(),
        of_pose.existing.to_numpy(bool),
        [setting.lidars[i] for i in stayed.lidar],
        setting.costs,
        given_places(of_pose),
    )


def choice_of(units: Units, some: Sequence[int], method: str, bound: float | None = None) -> Choice:
    """Returns an option. bound: by default its value."""
    value = units.value(some)
    return Choice(tuple(some), value, units.price(some), value if bound is None else bound, method)


def considered(units: Units, request: Request) -> list[Choice]:
    """Returns the best options of one, of two and of more units, each once."""
    alone = singles(units, request.budget_usd)
    if not alone:
        return []
    options = [
        *first_at_each_place(alone, units)[:SHOWN],
        *first_of_each(alone, lambda one: units.names(one.units)[0]),
        *first_of_each(
            (one for one in alone if units.given_at(one.units[0]) >= 0),
            lambda one: units.given_at(one.units[0]),
        ),
    ]
    if request.units >= 2:
        options += first_at_each_place(pairs(units, request), units)[:SHOWN]
    if min(request.units, most_units(units, request.budget_usd)) > 2:
        options += filter(None, [greedy(units, request)])
    return merged(options)


def merged(options: Iterable[Choice]) -> list[Choice]:
    """Returns each option once. Of options with the same units, the last one is returned."""
    return list({one.key: one for one in options}.values())


def first_of_each(options: Iterable[Choice], key: Callable[[Choice], Hashable]) -> list[Choice]:
    """Returns the first option of each key."""
    first: dict[Hashable, Choice] = {}
    for one in options:
        first.setdefault(key(one), one)
    return list(first.values())


def first_at_each_place(options: Iterable[Choice], units: Units) -> list[Choice]:
    """Returns the first of the options that have the same LiDARs at the same positions.

    The options that are left out differ from the first in height, pitch or yaw only.
    """
    return first_of_each(options, lambda one: stands(one, units))


def stands(one: Choice, units: Units) -> tuple[tuple[int, int, str], ...]:
    """Returns (pole number, number of the position that the user gave, LiDAR) of each unit."""
    return tuple(
        sorted((int(units.place[u]), units.given_at(u), units.lidars[u].name) for u in one.units)
    )


def listed(
    order: Sequence[Choice], best: Sequence[Choice], units: Units, first: int
) -> tuple[list[Choice], int]:
    """Returns the options, those of the table first, and the number of options in the table.

    The table has the first `first` options, and all of `best`. Of options with the same LiDARs at
    the same positions, it has only the first.
    """
    always = {stands(one, units) for one in best}
    each = first_at_each_place(order, units)
    some = {one.key for k, one in enumerate(each) if k < first or stands(one, units) in always}
    return sorted(order, key=lambda one: one.key not in some), len(some)


def singles(units: Units, budget_usd: float) -> list[Choice]:
    """Returns all options of one unit within the budget, best first."""
    values = units.probability @ units.weight / units.total
    prices = {
        u: price for u in range(len(values)) if (price := units.price([u])).middle <= budget_usd
    }
    order = sorted(prices, key=lambda u: (-float(values[u]), prices[u].middle))
    best = float(values[order[0]]) if order else 0.0
    return [Choice((u,), float(values[u]), prices[u], best, "exact") for u in order]


def pairs(units: Units, request: Request) -> list[Choice]:
    """Returns the best options of two units within the budget, over all pairs; best first."""
    first, second, missed = allowed_pairs(units, request)
    if not len(first):
        return []
    most = min(BEST_PAIRS, len(first))
    best = np.argpartition((missed - units.total) / units.total, most - 1)[:most]
    made = [choice_of(units, (int(first[k]), int(second[k])), "exact") for k in best]
    made.sort(key=lambda one: (-one.value, one.price.middle))
    return [replace(one, bound=made[0].value) for one in made]


def allowed_pairs(units: Units, request: Request) -> tuple[IntArray, IntArray, Float32Array]:
    """Returns first and second unit of each allowed pair, and the weight of the objects it misses.

    Each array is (n,).
    """
    count = len(units.probability)
    missed = 1 - units.probability
    both = (missed * units.weight.astype(np.float32)) @ missed.T
    same = units.place[:, None] == units.place[None, :]
    allowed = np.triu(np.ones((count, count), bool), 1)
    allowed &= np.where(same, request.lidars_per_pole >= 2, request.poles >= 2)
    allowed &= pair_prices(units, same) <= request.budget_usd
    first, second = np.nonzero(allowed)
    return first, second, both[first, second]


def pair_prices(units: Units, same: BoolArray) -> FloatArray:
    """Returns the middle of the price range of each pair of units, (n, n).

    same: whether the two units are on one pole, (n, n).

    Pairs of the same LiDARs on new or existing poles have the same price.
    """
    each = list(zip(units.names(range(len(units.lidars))), units.existing.tolist(), strict=True))
    kinds, lidars = list(dict.fromkeys(each)), {one.name: one for one in units.lidars}
    prices = np.zeros((len(kinds), len(kinds), 2))
    for (i, (a, old_a)), (j, (b, old_b)) in product(enumerate(kinds), repeat=2):
        for k, (new, poles) in enumerate(((2 - old_a - old_b, 2), (1 - old_a, 1))):
            prices[i, j, k] = units.costs.price([lidars[a], lidars[b]], new, poles).middle
    number = np.array([kinds.index(kind) for kind in each])
    return np.asarray(prices[number[:, None], number, same.astype(int)])


def greedy(units: Units, request: Request) -> Choice | None:
    """Returns an option of any number of units, with an upper bound of the best value.

    Two greedy searches are made, by gain and by gain per dollar, and the better one is returned.
    The bound is value + the largest sum of gains that the limits of number and price allow. Gains
    only shrink as units are added, so that no option can exceed the bound.
    """
    options = [_search(units, request, per_dollar=per_dollar) for per_dollar in (False, True)]
    best = max(options, key=units.value)
    if not best:
        return None
    bounds = [upper_bound(units, one, request.budget_usd, request.units) for one in options]
    return choice_of(units, best, "greedy", min(bounds))


def _search(units: Units, request: Request, *, per_dollar: bool) -> list[int]:
    chosen: list[int] = []
    missed = np.ones(len(units.weight))
    while len(chosen) < request.units:
        gains = units.probability @ (missed * units.weight)
        before = units.price(chosen).middle if chosen else 0.0
        best, score = -1, 0.0
        for u in np.argsort(-gains, kind="stable"):
            if gains[u] <= 0 or (not per_dollar and best >= 0):
                break
            if u in chosen or not _fits(units, [*chosen, int(u)], request):
                continue
            price = units.price([*chosen, int(u)]).middle
            worth = gains[u] / max(price - before, 1e-9) if per_dollar else gains[u]
            if price <= request.budget_usd and worth > score:
                best, score = int(u), float(worth)
        if best < 0:
            break
        chosen.append(best)
        missed = missed * (1 - units.probability[best])
    return chosen


def _fits(units: Units, chosen: list[int], request: Request) -> bool:
    places, counts = np.unique(units.place[chosen], return_counts=True)
    return len(places) <= request.poles and int(counts.max()) <= request.lidars_per_pole


def upper_bound(units: Units, chosen: list[int], budget_usd: float, most: int) -> float:
    """Returns a share that no option of at most `most` units within the budget exceeds."""
    missed = np.prod(1 - units.probability[chosen].astype(float), axis=0)
    found = float(((1 - missed) * units.weight).sum())
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
    return min(1.0, (found + min(by_number, by_price)) / units.total)


def least_prices(units: Units, budget_usd: float) -> tuple[FloatArray, float]:
    """Returns the minimum that each unit adds to a price (n,), and the budget for all units.

    A unit adds at least its LiDAR and cable. The other costs of an option, such as a pole and a
    computer, are at least those of the cheapest option of one unit. The budget is without them.
    """
    cable_usd = units.costs.lines["cable_usd"].middle
    least = np.array([one.price_usd.middle + cable_usd * one.units for one in units.lidars])
    alone = np.array([units.price([u]).middle for u in range(len(least))])
    return least, budget_usd - float((alone - least).min())


def most_units(units: Units, budget_usd: float) -> int:
    """Returns how many units the budget can pay for at most."""
    least, left_usd = least_prices(units, budget_usd)
    return int(max(0.0, left_usd) // max(float(least.min()), 1e-9))
