"""Predicts the shares of found objects, the false boxes and the AP of an option, with intervals.

An interval is for the mean over an hour of other traffic. It is computed from the sum of
three variances: of the fit of the detectability (replicates over generated sites), of its error at
sites that the fit has not used, and of the figure over the frames of the plan.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray
from pyinfra.experiments.planner.detectability import (
    CUTS,
    Detectability,
    Law,
    ap_of_counts,
    cut_of,
    detection_probability,
    false_per_frame,
    object_terms,
)
from pyinfra.experiments.planner.observe import Objects, Observed
from pyinfra.experiments.planner.request import Request, can_be_found, of_name
from pyinfra.metrics.comparison import UNKNOWN, Interval, clipped

Z95 = 1.959964
SIMULATED, PREDICTED = "simulated", "predicted"


@dataclass(frozen=True, eq=False)
class Standing:
    """The figures of an option by which it is chosen. Shares are 0 to 1."""

    recall: Interval  # recall of vehicles within the distance of the request
    people: Interval  # recall of pedestrians within this distance
    shares: Mapping[str, Interval]  # share of each goal's objects that is found, by column
    weighted: float  # weighted share of all objects that is found
    false_per_frame: Interval
    ap: Interval  # AP of all vehicles of the region, 0 to 100
    position_m: float  # 95th percentile of the position error of found vehicles; NaN if predicted
    source: str  # source of the figures, SIMULATED or PREDICTED


@dataclass(frozen=True, eq=False)
class Prediction:
    """The figures of an option that are predicted by the detectability."""

    standing: Standing
    areas: dict[str, Interval]  # share of the objects in each area of the request that is found
    false_per_frame: Interval
    keeps_false: bool  # whether some minimum score keeps the requested rate of false boxes
    cut: float  # minimum score of a box
    probability: FloatArray  # (objects,) probability that the option finds each object


@dataclass(frozen=True, eq=False)
class _Seen:
    """The objects of a class that one unit sees: their row numbers, and their terms."""

    object: IntArray
    terms: FloatArray


def detection_probabilities(
    seen: pd.DataFrame, pairs: pd.DataFrame, objects: Objects, law: Detectability, request: Request
) -> Float32Array:
    """Returns the probability (pairs, objects) that each pair finds each object.

    The minimum score of a box is CUT or, if the request limits false boxes, the lowest score at
    which the pair keeps this limit.
    """
    out = np.zeros((len(pairs), len(objects.table)), np.float32)
    pair, at = seen.pair.to_numpy(), seen.object.to_numpy()
    person = objects.table.person.to_numpy(bool)[at]
    per_frame = np.bincount(pair[~person], minlength=len(pairs)) / max(objects.frames, 1)
    false = law.vehicles.false[0]
    cuts = np.array(
        [
            cut_of(false, float(n), float(spins), request.most_false)[0]
            for n, spins in zip(per_frame, pairs.spinning, strict=True)
        ]
    )
    terms = object_terms(seen)
    for of_class, rows in ((law.vehicles, ~person), (law.people, person)):
        for cut in np.unique(cuts):
            if of_class is not None:
                some = rows & (cuts[pair] == cut)
                law_0, here = of_class.detection[0], (pair[some], at[some])
                out[here] = detection_probability(law_0, terms[some], float(cut))
    return out


def predict(
    observed: Observed,
    units: Sequence[int],
    law: Detectability,
    request: Request,
    more: Mapping[str, BoolArray] = MappingProxyType({}),
) -> Prediction:
    """Predicts an option. units: numbers of pairs that the race kept, as in `observed.seen`.

    more: further sets of objects by name, (objects,) bool, whose share is predicted as well.
    """
    objects, names = observed.objects, dict.fromkeys(area.name for area in request.areas)
    person = objects.table.person.to_numpy(bool)
    of_vehicles = _seen(observed, units, ~person)
    # The detector runs on the fused points, so that an object that several units see is one object.
    every = {number for one in of_vehicles for number in one.object.tolist()}
    per_frame = len(every) / max(objects.frames, 1)
    spinning = float(observed.stayed.spinning.iloc[[*units]].mean())
    cut, keeps = cut_of(law.vehicles.false[0], per_frame, spinning, request.most_false)
    probability = _either(of_vehicles, law.vehicles, cut, len(person))
    if law.people is not None and person.any():
        of_people = _either(_seen(observed, units, person), law.people, cut, len(person))
        count = min(probability.shape[1], of_people.shape[1])
        probability = np.where(person[:, None], of_people[:, :count], probability[:, :count])
    known = can_be_found(objects.table, law)
    std = np.where(person, law.unseen.people, law.unseen.recall)

    def share(counted: BoolArray) -> Interval:
        return _share(probability, counted & known, objects, std)

    rates = false_per_frame(law.vehicles.false.T, cut, per_frame, spinning)[0]
    logs, rate = np.log(np.maximum(rates, 1e-9)), float(rates[0])
    factor = float(np.exp(_half_width(logs, law.unseen.log_false**2)))
    false = Interval(rate, rate / factor, rate * factor)  # symmetric interval of the logarithm
    standing = Standing(
        recall=share(objects.near_vehicles),
        people=share(objects.near & person),  # computed even if people have no weight in the choice
        shares={name: share(counted) for name, counted in more.items()},
        weighted=float(probability[:, 0] @ objects.weight / objects.total),
        # If no score keeps the requested rate, the interval begins at the predicted rate.
        false_per_frame=false if keeps else replace(false, low=rate),
        ap=_limited(
            _aps(of_vehicles, law.vehicles, per_frame, spinning, objects), 100, law.unseen.ap**2
        ),
        position_m=float("nan"),
        source=PREDICTED,
    )
    areas = {name: share(of_name(request.areas, name, objects.table)) for name in names}
    return Prediction(standing, areas, false, keeps, cut, probability[:, 0])


def _seen(observed: Observed, units: Sequence[int], counted: BoolArray) -> list[_Seen]:
    rows = observed.seen[counted[observed.seen.object]]
    parts = (rows[rows.pair == u] for u in units)
    return [_Seen(one.object.to_numpy(), object_terms(one)) for one in parts]


def _either(seen: Sequence[_Seen], law: Law, cut: float, objects: int) -> FloatArray:
    """Returns the probability (objects, 1 + replicates) that any of the units finds the object."""
    missed = np.ones((objects, len(law.detection)))
    for one in seen:
        missed[one.object] *= 1 - detection_probability(law.detection.T, one.terms, cut)
    return 1 - missed


def _aps(
    seen: Sequence[_Seen], law: Law, seen_per_frame: float, spinning: float, objects: Objects
) -> list[float]:
    """Returns the AP (0 to 100) over all present vehicles, for the fit and its replicates."""
    every, count = int((~objects.table.person).sum()), len(objects.table)
    true_positives = np.array([_either(seen, law, cut, count).sum(0) for cut in CUTS])
    rates = false_per_frame(law.false.T, np.array(CUTS), seen_per_frame, spinning)
    return [
        ap_of_counts(detected, objects.frames * rate, every)
        for detected, rate in zip(true_positives.T, rates.T, strict=True)
    ]


def _share(
    probability: FloatArray, counted: BoolArray, objects: Objects, std: FloatArray
) -> Interval:
    """Returns the share of the counted objects that is found, with its interval.

    probability: (objects, 1 + replicates). std: (objects,) error at unseen sites.
    """
    total = int(counted.sum())
    if total == 0:
        return UNKNOWN
    shares = (probability[counted].sum(0) / total).tolist()
    moved = moved_by_frame(
        probability[counted, 0], objects.frame[counted], objects.frames, shares[0]
    )
    by_frames = float(moved.var(ddof=1)) * len(moved) / total**2
    return _limited(shares, 1, by_frames + float(std[counted].mean()) ** 2)


def moved_by_frame(found: AnyArray, frame: IntArray, frames: int, share: float) -> FloatArray:
    """Returns the found objects of each frame minus `share` times its objects: (frames,).

    The variance of the share, with frames as clusters, is computed from these differences.
    found: (n,) 0 to 1, whether each object is found. frame: (n,) its frame, 0 to frames - 1.
    """
    sums, counts = np.bincount(frame, found, frames), np.bincount(frame, minlength=frames)
    return np.asarray(sums - share * counts)


def _limited(values: Sequence[float], most: float, variance: float) -> Interval:
    """Returns the first value with its interval, which is clipped to 0 and `most`."""
    half = _half_width(values, variance)
    return clipped(Interval(values[0], values[0] - half, values[0] + half), 0, most)


def _half_width(values: Sequence[float] | FloatArray, variance: float) -> float:
    """Returns the half-width of an interval. values: of the fit, then of its replicates."""
    of_fit = float(np.var(values[1:], ddof=1)) if len(values) > 2 else 0.0
    return Z95 * float(np.sqrt(of_fit + variance))
