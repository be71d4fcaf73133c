"""Predicts what an option finds: shares, false boxes and AP, each with an interval.

An interval is for the mean over an hour of other traffic. It has three parts: the fit of the
detectability (replicates over generated sites), its error at a site that the fit has not seen, and
the frames of the plan (their spread). They are added as variances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

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
from pyinfra.experiments.planner.race import Objects, Race
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
    shares: dict[str, Interval]  # share of the objects of each further set
    probability: FloatArray  # (objects,) probability that the option finds each object
    weighted: float  # share of all objects by their weights in the request


@dataclass(frozen=True, eq=False)
class _Unit:
    """The objects that one unit sees."""

    object: np.ndarray
    terms: FloatArray


def predict(
    race: Race,
    units: Sequence[int],
    law: Detectability,
    request: Request,
    more: Mapping[str, BoolArray] = MappingProxyType({}),
) -> Prediction:
    """Predicts an option of some pairs of a race that stayed.

    more: further sets of objects by name, (objects,) bool, whose share is predicted as well.
    """
    seen = [race.seen[race.seen.pair == u] for u in units]
    objects = race.objects
    near = objects.near  # people count in the answer even where they do not in the choice
    person = objects.table.person.to_numpy(bool)
    seen_per_frame = _seen_per_frame(seen, ~person, objects)
    cut, keeps = _cut(seen_per_frame, law.vehicles, request)
    of_vehicles = _units(seen, ~person)
    probability = _either(of_vehicles, law.vehicles.detection, cut, len(person))
    if law.people is not None and person.any():
        of_people = _either(_units(seen, person), law.people.detection, cut, len(person))
        count = min(probability.shape[1], of_people.shape[1])
        probability = np.where(person[:, None], of_people[:, :count], probability[:, :count])
    known = ~person | (law.people is not None)
    rates = false_per_frame(law.vehicles.false.T, cut, seen_per_frame)[0].tolist()
    std = np.where(person, law.unseen.people, law.unseen.recall)
    return Prediction(
        recall=_interval(probability, objects.near_vehicles, objects, std),
        people=_interval(probability, near & person & known, objects, std),
        areas={
            name: _interval(
                probability, of_name(request.areas, name, objects.table) & known, objects, std
            )
            for name in dict.fromkeys(area.name for area in request.areas)
        },
        false_per_frame=_rate(rates, law.unseen.log_false),
        keeps_false=keeps,
        cut=cut,
        ap=_spread(
            _aps(of_vehicles, law.vehicles, seen_per_frame, objects), 0, 100, law.unseen.ap**2
        ),
        shares={
            name: _interval(probability, counted & known, objects, std)
            for name, counted in more.items()
        },
        probability=probability[:, 0],
        weighted=float(probability[:, 0] @ objects.weight / max(objects.weight.sum(), 1e-12)),
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
    most = request.false_per_minute / request.frames_per_minute
    return highest_recall_cut(law.false[0], seen_per_frame, most)


def _units(seen: Sequence[pd.DataFrame], counted: BoolArray) -> list[_Unit]:
    some = [one[counted[one.object.to_numpy()]] for one in seen]
    return [_Unit(one.object.to_numpy(), object_terms(one)) for one in some]


def _either(units: Sequence[_Unit], detection: FloatArray, cut: float, objects: int) -> FloatArray:
    """Returns the probability (objects, 1 + replicates) that one of the units finds the object."""
    missed = np.ones((objects, len(detection)))
    for unit in units:
        missed[unit.object] *= 1 - detection_probability(detection.T, unit.terms, cut)
    return 1 - missed


def _aps(units: Sequence[_Unit], law: Law, seen_per_frame: float, objects: Objects) -> list[float]:
    """Returns the AP (0 to 100) over all present vehicles, for the fit and its replicates."""
    count = len(objects.table)
    every = int((~objects.table.person).sum())
    true_positives = np.array([_either(units, law.detection, cut, count).sum(0) for cut in CUTS])
    rates = false_per_frame(law.false.T, np.array(CUTS), seen_per_frame)
    pairs = zip(true_positives.T, rates.T, strict=True)
    return [ap_of_counts(detected, objects.frames * rate, every) for detected, rate in pairs]


def _interval(
    probability: FloatArray, counted: BoolArray, objects: Objects, std: FloatArray
) -> Interval:
    """Returns the share of the counted objects that is found, with its interval.

    probability: (objects, 1 + replicates). std: (objects,) error at unseen sites.
    """
    total = int(counted.sum())
    if total == 0:
        return UNKNOWN
    shares = (probability[counted].sum(0) / total).tolist()
    frame = objects.frame[counted]
    sums = np.bincount(frame, probability[counted, 0], objects.frames)
    counts = np.bincount(frame, minlength=objects.frames)
    residual = sums - shares[0] * counts
    frames = max(objects.frames, 2)
    by_frames = float(residual.var(ddof=1)) * frames / total**2
    return _spread(shares, 0, 1, by_frames + float(std[counted].mean()) ** 2)


def _rate(values: Sequence[float], log_std: float) -> Interval:
    """Returns the first rate with an interval from the others and from its error at unseen sites.

    The interval is symmetric in the logarithm.
    """
    logs = np.log(np.maximum(values, 1e-9))
    variance = float(logs[1:].var(ddof=1)) if len(values) > 2 else 0.0
    factor = float(np.exp(Z95 * np.sqrt(variance + log_std**2)))
    return Interval(values[0], values[0] / factor, values[0] * factor)


def _spread(values: Sequence[float], low: float, high: float, more: float = 0.0) -> Interval:
    """Returns the first value with an interval from the others and a further variance."""
    variance = float(np.var(values[1:], ddof=1)) if len(values) > 2 else 0.0
    half = Z95 * float(np.sqrt(variance + more))
    return Interval(values[0], max(low, values[0] - half), min(high, values[0] + half))
