"""Predicts what an option finds: shares, false boxes and AP, each with an interval.

An interval has two parts: the fit of the detectability (replicates over generated sites) and the
frames of the plan (their spread). Both are added as variances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.experiments.planner.areas import of_name
from pyinfra.experiments.planner.detectability import (
    CUT,
    CUTS,
    Detectability,
    Law,
    ap_of_counts,
    detection_probability,
    false_per_frame,
    highest_recall_cut,
    object_terms,
)
from pyinfra.experiments.planner.race import FRAMES_PER_MINUTE, Objects, Race
from pyinfra.experiments.planner.request import Request
from pyinfra.metrics.comparison import Interval

Z95 = 1.959964
UNKNOWN = Interval(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True, eq=False)
class Prediction:
    """What an option finds by the detectability, in shares (0 to 1) and AP (0 to 100)."""

    recall: Interval  # share of the vehicles within the distance of the request
    people: Interval  # share of the pedestrians within it; unknown without any
    areas: dict[str, Interval]  # share of the objects that count in each area of the request
    false_per_frame: Interval
    keeps_false: bool  # whether the asked rate of false boxes can be kept at any score
    cut: float  # score above which a box counts
    ap: Interval  # AP of all present vehicles of the region


@dataclass(frozen=True, eq=False)
class _Unit:
    """The objects that one unit sees."""

    object: np.ndarray
    terms: FloatArray


def predict(race: Race, units: Sequence[int], law: Detectability, request: Request) -> Prediction:
    """Predicts an option of some pairs of a race that stayed."""
    seen = [race.seen[race.seen.pair == u] for u in units]
    objects = race.objects
    near = objects.near  # people count in the answer even where they do not in the choice
    person = objects.table.person.to_numpy(bool)
    seen_per_frame = _seen_per_frame(seen, ~person, objects)
    cut, keeps = _cut(seen_per_frame, law.vehicles, request)
    replicates = len(law.vehicles.detection)
    of_vehicles = _units(seen, ~person)
    detected = [
        _either(of_vehicles, law.vehicles.detection[r], cut, len(person)) for r in range(replicates)
    ]
    if law.people is not None and person.any():
        of_people = _units(seen, person)
        for r in range(replicates):
            detected[r][person] = _either(of_people, law.people.detection[r], cut, len(person))[
                person
            ]
    known = ~person | (law.people is not None)
    rates = [
        float(false_per_frame(law.vehicles.false[r], cut, seen_per_frame)[0])
        for r in range(replicates)
    ]
    every = int((~person).sum())
    aps = [
        _ap(of_vehicles, law.vehicles, r, every, seen_per_frame, objects) for r in range(replicates)
    ]
    return Prediction(
        recall=_interval(detected, near & ~person, objects),
        people=_interval(detected, near & person & known, objects),
        areas={
            name: _interval(detected, of_name(request.areas, name, objects.table) & known, objects)
            for name in dict.fromkeys(area.name for area in request.areas)
        },
        false_per_frame=_spread(rates, 0, np.inf),
        keeps_false=keeps,
        cut=cut,
        ap=_spread(aps, 0, 100),
    )


def _seen_per_frame(seen: Sequence[pd.DataFrame], counted: BoolArray, objects: Objects) -> float:
    """Returns the number of counted objects in a frame that a unit sees.

    The detector runs on the fused points, so that an object that several units see counts once.
    """
    every = np.zeros(len(counted), bool)
    for one in seen:
        every[one.object.to_numpy()] = True
    return float((every & counted).sum()) / max(objects.frames, 1)


def _cut(seen_per_frame: float, law: Law, request: Request) -> tuple[float, bool]:
    """Returns the score above which a box counts, and whether false boxes are as rare as asked."""
    if not np.isfinite(request.false_per_minute):
        return CUT, True
    most = request.false_per_minute / FRAMES_PER_MINUTE
    return highest_recall_cut(law.false[0], seen_per_frame, most)


def _units(seen: Sequence[pd.DataFrame], counted: BoolArray) -> list[_Unit]:
    some = [one[counted[one.object.to_numpy()]] for one in seen]
    return [_Unit(one.object.to_numpy(), object_terms(one)) for one in some]


def _either(units: Sequence[_Unit], law: FloatArray, cut: float, objects: int) -> FloatArray:
    """Returns the probability (objects,) that one of the units finds the object."""
    missed = np.ones(objects)
    for unit in units:
        missed[unit.object] *= 1 - detection_probability(law, unit.terms, cut)
    return 1 - missed


def _ap(
    units: Sequence[_Unit],
    law: Law,
    replicate: int,
    every: int,
    seen_per_frame: float,
    objects: Objects,
) -> float:
    """Returns the AP (0 to 100) over all present vehicles of the region."""
    count, coefficients = len(objects.table), law.detection[replicate]
    true_positives = np.array([_either(units, coefficients, cut, count).sum() for cut in CUTS])
    rates = false_per_frame(law.false[replicate], np.array(CUTS), seen_per_frame)
    return ap_of_counts(true_positives, objects.frames * rates, every)


def _interval(detected: Sequence[FloatArray], counted: BoolArray, objects: Objects) -> Interval:
    """Returns the share of the counted objects that is found, with its interval."""
    total = int(counted.sum())
    if total == 0:
        return UNKNOWN
    shares = [float(one[counted].sum() / total) for one in detected]
    frame = objects.frame[counted]
    sums = np.bincount(frame, detected[0][counted], objects.frames)
    counts = np.bincount(frame, minlength=objects.frames)
    residual = sums - shares[0] * counts
    frames = max(objects.frames, 2)
    by_frames = float(residual.var(ddof=1)) * frames / total**2
    return _spread(shares, 0, 1, by_frames)


def _spread(values: Sequence[float], low: float, high: float, more: float = 0.0) -> Interval:
    """Returns the first value with an interval from the others and a further variance."""
    variance = float(np.var(values[1:], ddof=1)) if len(values) > 2 else 0.0
    half = Z95 * float(np.sqrt(variance + more))
    return Interval(values[0], max(low, values[0] - half), min(high, values[0] + half))
