"""The Pareto front of price and recall: the options that may be the best choice.

The choice depends on the budget, the wanted share, the number of poles and the LiDARs that are
allowed. The front holds the best option for each of these settings. It is exact for one and two
LiDARs over all pairs of pose and LiDAR that were not left out. Beyond two it is greedy.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.experiments.planner.answer import sentence
from pyinfra.experiments.planner.choice import (
    Choice,
    Units,
    allowed_pairs,
    choice_of,
    considered,
    first_of_each,
    greedy,
    merged,
    most_units,
    units_of,
    upper_bound,
)
from pyinfra.experiments.planner.observe import Objects, Observed, Setting, observed_again
from pyinfra.experiments.planner.predict import Prediction, Standing, predict
from pyinfra.experiments.planner.request import (
    Goal,
    Request,
    distances,
    goals_of,
    masks_of,
    with_objects,
)
from pyinfra.experiments.planner.site import other_traffic
from pyinfra.experiments.planner.verdict import Compared
from pyinfra.metrics.comparison import UNKNOWN

UNSEEN_FRAMES = 48  # number of frames for predictions, in traffic other than that of the choice
CELL_M = 5.0  # side of a square in which vehicles are counted


@dataclass(frozen=True, eq=False)
class Cells:
    """The vehicles of the plan's frames in squares of CELL_M, and which options find them."""

    corner_m: FloatArray  # (cells, 2) x, y of the lower left corner
    vehicles: IntArray  # (cells,) number of vehicles in all frames
    recall: FloatArray  # (options, cells) share of the vehicles that an option finds


@dataclass(frozen=True, eq=False)
class Front:
    """The options of the front and of the plan's table, and what a page shows of each.

    The first options are those of Plan.options, with the same numbers.
    """

    table: pd.DataFrame  # a row for each LiDAR of each option, as in Plan.options
    goals: tuple[Goal, ...]
    sentences: tuple[tuple[str, ...], ...]  # a sentence for each option and distance of the goals
    costs: pd.DataFrame  # table with the columns option, item, low_usd and high_usd
    cells: Cells
    frames: int
    pilot: bool  # whether the detectability was fitted to fewer sites than a decision needs
    unconfirmed: tuple[str, ...]  # LiDARs and items of the costs whose price is unconfirmed


def choose(setting: Setting, raced: Observed) -> Compared:
    """Returns options of the pairs that the race kept, with predictions for other traffic."""
    site, request, law = setting.site, setting.request, setting.law
    units = units_of(raced, setting)
    goals = goals_of(site, raced.objects.table, law, request)
    best = considered(units, request)
    front = front_options(units, goals, request)
    options = merged([*(with_bound(one, best, units, request) for one in front), *best])
    other = other_traffic(site, min(request.frames, UNSEEN_FRAMES))
    unseen = observed_again(setting, other, raced.stayed, [u for one in options for u in one.units])
    if not unseen.objects.near_vehicles.any():
        unseen = raced
    goals = with_objects(goals, site, unseen.objects.table, law, request)

    @cache
    def predicted(some: tuple[int, ...]) -> Prediction:
        return predict(unseen, some, law, request, masks_of(goals))

    standings = {one.units: predicted(one.units).standing for one in options}
    return Compared(options, best, len(best), units, goals, standings, predicted, unseen)


def front_options(units: Units, goals: Sequence[Goal], request: Request) -> list[Choice]:
    """Returns the options that are best for some goal, budget, number of poles and set of LiDARs.

    An option is left out if another option with no more poles and no other LiDAR models finds at
    least as many objects for the same or a lower price.
    """
    kept: list[Choice] = []
    for goal in goals:
        part = replace(units, weight=goal.counted.astype(float))
        model = np.unique(units.names(range(len(units.lidars))), return_inverse=True)[1]
        every = [*_best_singles(part, model, request), *_best_pairs(part, model, request)]
        kept += undominated([*every, *_best_sets(part, model, request)], part)
    return first_of_each(kept, lambda one: one.key)


def with_bound(one: Choice, best: Sequence[Choice], units: Units, request: Request) -> Choice:
    """Returns an option of the front with value and bound for the plan's weights of objects."""
    count = len(one.units)
    bounds = [other.bound for other in best if len(other.units) == count] or [
        upper_bound(units, [*one.units], request.budget_usd, count)
    ]
    return replace(one, value=units.value(one.units), bound=bounds[0])


def undominated(options: Sequence[Choice], units: Units) -> list[Choice]:
    """Returns the options that no other option dominates, by the rule of `front_options`."""
    rows = [
        (one.price.middle, -one.value, len(units.poles(one.units)), {*units.names(one.units)}, one)
        for one in options
    ]
    kept: list[tuple[float, float, int, set[str], Choice]] = []
    for row in sorted(rows, key=lambda row: row[:3]):
        _, value, poles, models, _ = row
        if not any(v <= value and p <= poles and m <= models for _, v, p, m, _ in kept):
            kept.append(row)
    return [one for *_, one in kept]


def _best_of_each(key: IntArray, value: FloatArray) -> IntArray:
    """Returns for each distinct key the index of its largest value."""
    order = np.lexsort((-value, key))
    return order[np.unique(key[order], return_index=True)[1]]


def _best_singles(units: Units, model: IntArray, request: Request) -> Iterator[Choice]:
    """Yields each LiDAR's best option of one unit on a new pole, and on an existing pole."""
    for u in _best_of_each(2 * model + units.existing, units.probability @ units.weight):
        one = choice_of(units, [int(u)], "exact")
        if one.price.middle <= request.budget_usd:
            yield one


def _best_pairs(units: Units, model: IntArray, request: Request) -> Iterator[Choice]:
    """Yields the best pair for each two LiDAR models, number of poles and of existing poles."""
    i, j, missed = allowed_pairs(units, request)
    low, high = np.minimum(model[i], model[j]), np.maximum(model[i], model[j])
    same = units.place[i] == units.place[j]
    existing = units.existing[i].astype(int) + units.existing[j]
    key = ((low * (model.max(initial=0) + 1) + high) * 2 + same) * 3 + existing
    for k in _best_of_each(key, -missed.astype(float)):
        yield choice_of(units, (int(i[k]), int(j[k])), "exact")


def _best_sets(units: Units, model: IntArray, request: Request) -> list[Choice]:
    """Returns greedy options of over two units: of all LiDAR models, and of each model alone."""
    if min(request.units, most_units(units, request.budget_usd)) <= 2:
        return []
    options = [
        greedy(
            replace(units, probability=np.where(some[:, None], units.probability, 0)),
            replace(request, poles=poles),
        )
        for some in [np.ones(len(model), bool), *(model == m for m in np.unique(model))]
        for poles in range(1, request.poles + 1)
        if poles * request.lidars_per_pole > 2
    ]
    return [one for one in options if one is not None]


def front_of(compared: Compared, rows: pd.DataFrame, setting: Setting) -> Front:
    """Returns the front. rows: result of `option_table` for all options."""
    units, request, law = compared.units, setting.request, setting.law
    numbered = list(enumerate(compared.stands, start=1))
    probability = [compared.predicted(one.units).probability for one in compared.options]
    costs = pd.DataFrame(
        {"option": n, "item": item, "low_usd": span.low, "high_usd": span.high}
        for n, (choice, _) in numbered
        for item, span in units.parts(choice.units).items()
    )
    doubtful = dict.fromkeys(one.name for one in units.lidars if not one.confirmed)
    return Front(
        rows,
        compared.goals,
        tuple(
            tuple(_sentences(one, rows[rows.option == n], compared.goals, request))
            for n, one in numbered
        ),
        costs,
        _cells(probability, compared.unseen.objects),
        compared.unseen.objects.frames,
        law.pilot,
        (*doubtful, *units.costs.unconfirmed),
    )


def _sentences(
    option: tuple[Choice, Standing],
    rows: pd.DataFrame,
    goals: Sequence[Goal],
    request: Request,
) -> Iterator[str]:
    """Yields a sentence on an option for each distance of the goals."""
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
    """Returns the share of the vehicles in each cell that each option finds.

    probability: for each option (objects,), the probability that it finds each object.
    """
    vehicles = ~objects.table.person.to_numpy(bool)
    cells = np.floor(objects.table[["x", "y"]].to_numpy(float)[vehicles] / CELL_M)
    corners, at, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sums = [np.bincount(at.ravel(), one[vehicles], len(corners)) for one in probability]
    return Cells(CELL_M * corners, counts, np.array(sums) / counts)
