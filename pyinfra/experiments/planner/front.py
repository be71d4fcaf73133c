"""The front of price against recall: the options among which a choice may fall.

A choice depends on the budget, the wanted share, the number of poles and the LiDARs that are
allowed. The front holds the best option for each of these settings. It is exact for one and two
LiDARs over all pairs of pose and LiDAR that stayed in the race. Beyond two it is greedy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.experiments.planner.answer import Options, sentence
from pyinfra.experiments.planner.areas import of_name
from pyinfra.experiments.planner.choice import Choice, Units, greedy, most_units, pair_prices
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.predict import UNKNOWN
from pyinfra.experiments.planner.race import Objects
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.planner.verdict import Standing

DISTANCES = (0.5, 1.0, 1.5)  # of the request's distance, for which the front is computed
CELL_M = 5.0


@dataclass(frozen=True, eq=False)
class Goal:
    """What is to be found: objects of a class within a distance, or the objects of an area."""

    column: str  # the column of its share
    what: str  # vehicles, pedestrians or the name of an area
    within_m: float | None  # None for an area
    counted: BoolArray  # (objects,)


@dataclass(frozen=True, eq=False)
class Cells:
    """Where the vehicles of the plan's frames are, in squares of CELL_M, and who finds them."""

    corner_m: FloatArray  # (cells, 2) x, y of the lower left corner
    vehicles: IntArray  # (cells,) number of vehicles in all frames
    recall: FloatArray  # (options, cells) share of them that an option finds


@dataclass(frozen=True, eq=False)
class Front:
    """The options of the front and of the plan's table, and what a page shows of each.

    The first options are those of Plan.options, with the same numbers.
    """

    table: pd.DataFrame  # a row for each LiDAR of each option, as in Plan.options
    goals: tuple[Goal, ...]
    sentences: tuple[tuple[str, ...], ...]  # for each option and each distance of the goals
    costs: pd.DataFrame  # option, item, low_usd, high_usd
    cells: Cells
    frames: int
    pilot: bool  # whether the detectability has fewer sites than a decision needs
    unconfirmed: tuple[str, ...]  # LiDARs and items of the costs whose price is unconfirmed


def masks_of(goals: Sequence[Goal]) -> dict[str, BoolArray]:
    """Returns the objects that count for each goal, by the column of the goal."""
    return {one.column: one.counted for one in goals}


def distances(goals: Sequence[Goal]) -> list[float]:
    return list(dict.fromkeys(one.within_m for one in goals if one.within_m is not None))


def goals_of(
    site: PlanSite, objects: Objects, law: Detectability, request: Request
) -> tuple[Goal, ...]:
    """Returns the goals of a plan; the first one is that of the request.

    A distance without a vehicle, or with the vehicles of another one, is left out.
    """
    goals, numbers = [], {0}
    for factor in sorted(DISTANCES, key=lambda f: f != 1):
        within = factor * request.within_m
        vehicles = int(_counted("vehicles", within, site, objects, law, request).sum())
        if vehicles in numbers:
            continue
        numbers.add(vehicles)
        distance = "" if factor == 1 else f"_within_{within:g}_m"
        for name, prefix in (("vehicles", ""), ("pedestrians", "people_")):
            counted = _counted(name, within, site, objects, law, request)
            if counted.any():
                goals.append(Goal(f"{prefix}recall{distance}", name, within, counted))
    for name in dict.fromkeys(area.name for area in request.areas):
        counted = _counted(name, None, site, objects, law, request)
        if counted.any():
            goals.append(Goal(f"recall_{name}", name, None, counted))
    return tuple(goals)


def with_objects(
    goals: Sequence[Goal], site: PlanSite, objects: Objects, law: Detectability, request: Request
) -> tuple[Goal, ...]:
    """Returns the same goals for the objects of other frames; a goal may have none there."""
    return tuple(
        replace(one, counted=_counted(one.what, one.within_m, site, objects, law, request))
        for one in goals
    )


def counted_of(
    goals: Sequence[Goal], site: PlanSite, law: Detectability, request: Request
) -> dict[str, Callable[[pd.DataFrame], BoolArray]]:
    """Returns, for each goal by its column, which objects of a table count for it."""
    return {
        one.column: partial(_of_table, one.what, one.within_m, site=site, law=law, request=request)
        for one in goals
    }


def _counted(
    what: str,
    within_m: float | None,
    site: PlanSite,
    objects: Objects,
    law: Detectability,
    request: Request,
) -> BoolArray:
    """Returns which objects count for a goal: (objects,)."""
    return _of_table(what, within_m, objects.table, site=site, law=law, request=request)


def _of_table(
    what: str,
    within_m: float | None,
    table: pd.DataFrame,
    *,
    site: PlanSite,
    law: Detectability,
    request: Request,
) -> BoolArray:
    person = table.person.to_numpy(bool)
    known = ~person | (law.people is not None)
    if within_m is None:
        return np.asarray(of_name(request.areas, what, table) & known)
    away = np.hypot(table.x - site.centre[0], table.y - site.centre[1]).to_numpy()
    of_class = person if what == "pedestrians" else ~person
    return np.asarray(of_class & known & (away <= within_m))


def front_options(units: Units, goals: Sequence[Goal], request: Request) -> list[Choice]:
    """Returns the options that are best for some goal, budget, number of poles and LiDARs.

    An option is left out if an option of the same or fewer poles and LiDAR models finds as much
    for the same or a lower price.
    """
    kept: dict[tuple[int, ...], Choice] = {}
    for goal in goals:
        part = replace(units, weight=goal.counted.astype(float))
        every = [*_best_singles(part, request), *_best_pairs(part, request)]
        every += _best_sets(part, request)
        for one in undominated(every, part):
            kept.setdefault(tuple(sorted(one.units)), one)
    return list(kept.values())


def undominated(options: Sequence[Choice], units: Units) -> list[Choice]:
    """Returns the options that no other one beats, with their poles and LiDARs or fewer."""
    models = [frozenset(units.lidars[u].name for u in one.units) for one in options]
    poles = [len({int(units.place[u]) for u in one.units}) for one in options]
    order = sorted(
        range(len(options)), key=lambda i: (options[i].price.middle, -options[i].value, poles[i])
    )
    kept: list[int] = []
    for i in order:
        beaten = any(
            options[k].value >= options[i].value and poles[k] <= poles[i] and models[k] <= models[i]
            for k in kept
        )
        if not beaten:
            kept.append(i)
    return [options[i] for i in kept]


def _model_numbers(units: Units) -> IntArray:
    return np.unique([one.name for one in units.lidars], return_inverse=True)[1]


def _best_of_each(key: IntArray, value: FloatArray) -> IntArray:
    """Returns the index of the largest value of each key."""
    order = np.lexsort((-value, key))
    return order[np.unique(key[order], return_index=True)[1]]


def _choice(units: Units, chosen: tuple[int, ...], method: str) -> Choice:
    value = units.value(chosen)
    return Choice(chosen, value, units.price(chosen), value, method)


def _best_singles(units: Units, request: Request) -> Iterator[Choice]:
    """Yields the best option of one unit of each LiDAR, on a new and on an existing pole."""
    value = np.asarray(units.probability @ units.weight)
    for u in _best_of_each(2 * _model_numbers(units) + units.existing, value):
        one = _choice(units, (int(u),), "exact")
        if one.price.middle <= request.budget_usd:
            yield one


def _best_pairs(units: Units, request: Request) -> Iterator[Choice]:
    """Yields the best pair of each two LiDARs, for each number of poles and of existing poles."""
    count = len(units.probability)
    missed = 1 - units.probability
    joint = (missed * units.weight.astype(np.float32)) @ missed.T
    same = units.place[:, None] == units.place[None, :]
    allowed = np.triu(np.ones((count, count), bool), 1)
    allowed &= np.where(same, request.lidars_per_pole >= 2, request.poles >= 2)
    allowed &= pair_prices(units, same) <= request.budget_usd
    i, j = np.nonzero(allowed)
    model = _model_numbers(units)
    low, high = np.minimum(model[i], model[j]), np.maximum(model[i], model[j])
    existing = units.existing[i].astype(int) + units.existing[j]
    key = ((low * (model.max(initial=0) + 1) + high) * 2 + same[i, j]) * 3 + existing
    for k in _best_of_each(key, -joint[i, j].astype(float)):
        yield _choice(units, (int(i[k]), int(j[k])), "exact")


def _best_sets(units: Units, request: Request) -> list[Choice]:
    """Returns greedy options of more than two units, of all LiDARs and of each one alone."""
    most = min(request.units, most_units(units, request.budget_usd))
    if most <= 2:
        return []
    model = _model_numbers(units)
    options = [
        greedy(
            replace(units, probability=np.where(some[:, None], units.probability, 0)),
            request.budget_usd,
            poles,
            request.lidars_per_pole,
        )
        for some in [np.ones(len(model), bool), *(model == m for m in np.unique(model))]
        for poles in range(1, request.poles + 1)
        if poles * request.lidars_per_pole > 2
    ]
    return [one for one in options if one is not None]


def front_of(
    options: Options,
    rows: pd.DataFrame,
    goals: Sequence[Goal],
    probability: Sequence[FloatArray],
    units: Units,
    objects: Objects,
    law: Detectability,
    request: Request,
) -> Front:
    """Returns the front.

    rows: the rows of the options in `option_table`. probability: of each option, (objects,) that it
    finds each object.
    """
    numbers = range(1, len(options) + 1)
    sentences = tuple(
        tuple(_sentences(one, rows[rows.option == n], goals, request))
        for n, one in zip(numbers, options, strict=True)
    )
    costs = pd.DataFrame(
        {"option": n, "item": item, "low_usd": span.low, "high_usd": span.high}
        for n, (choice, _) in zip(numbers, options, strict=True)
        for item, span in units.parts(choice.units).items()
    )
    doubtful = dict.fromkeys(one.name for one in units.lidars if not one.confirmed)
    return Front(
        rows,
        tuple(goals),
        sentences,
        costs,
        _cells(probability, objects),
        objects.frames,
        law.pilot,
        (*doubtful, *units.costs.unconfirmed),
    )


def _sentences(
    option: tuple[Choice, Standing],
    rows: pd.DataFrame,
    goals: Sequence[Goal],
    request: Request,
) -> Iterator[str]:
    """Yields the sentence of an option for each distance."""
    choice, standing = option
    for within in distances(goals):
        of = {g.what: standing.shares[g.column] for g in goals if g.within_m == within}
        near = replace(
            standing,
            recall=of.get("vehicles", UNKNOWN),
            people=of.get("pedestrians", UNKNOWN),
        )
        yield sentence((choice, near), rows, replace(request, within_m=within))


def _cells(probability: Sequence[FloatArray], objects: Objects) -> Cells:
    """Returns the share of the vehicles of each cell that each option finds.

    probability: (objects,) probability of each option that it finds each object.
    """
    vehicles = ~objects.table.person.to_numpy(bool)
    xy = objects.table[["x", "y"]].to_numpy(float)[vehicles]
    corners, at, counts = np.unique(
        np.floor(xy / CELL_M), axis=0, return_inverse=True, return_counts=True
    )
    sums = [np.bincount(at.ravel(), one[vehicles], len(corners)) for one in probability]
    return Cells(CELL_M * corners, counts, np.array(sums) / counts)
