"""The probability that a detector finds an object with points, and its rate of false boxes.

The probability that an object is found by a box of score s or above is a logistic function of s and
of a few terms of the object's points. False boxes per frame at score s or above are a log-linear
function of s and of the number of objects with points. Both have terms for LiDARs that do not spin,
because the points of their patterns lie differently on an object. Both are fitted by
`python -m reproduction detectability`. The file of the coefficients has replicates of the fit over
generated sites, for intervals.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.names import check_name
from pyinfra.dataset.frames_version import FIRST

FILE = Path(__file__).with_name("detectability.json")
CUTS = tuple(round(0.05 + 0.05 * i, 2) for i in range(19))  # possible minimum scores of boxes
CUT = 0.5  # minimum score of a box, if the user sets no maximum rate of false boxes
OBJECT_TERMS = (
    "constant", "log_points", "log_points_2", "log_along", "log_up", "distance", "log_distance",
    "visibility", "large", "small", "speed", "not_spinning", "score", "score_log_points",
)  # fmt: skip
FALSE_TERMS = ("constant", "score", "score_2", "log_seen", "not_spinning")
LARGE, SMALL = ("Truck", "Bus"), ("Motorcycle", "Pedestrian")


@dataclass(frozen=True, eq=False)
class Law:
    """Coefficients of a class: row 0 is from the fit, the others are from bootstrap replicates."""

    detection: FloatArray  # coefficients of detection probability, (1 + replicates, OBJECT_TERMS)
    false: FloatArray  # coefficients of the rate of false boxes, (1 + replicates, FALSE_TERMS)


@dataclass(frozen=True)
class UnseenErrors:
    """Standard deviations of the prediction errors at sites and LiDARs that no fit has used.

    recall and people are shares (0 to 1), ap is 0 to 100, and log_false is of the natural logarithm
    of the false boxes per frame. The standard deviations do not include the noise of the measured
    frames.
    """

    recall: float
    people: float
    ap: float
    log_false: float


@dataclass(frozen=True, eq=False)
class Detectability:
    """The laws (fitted functions) of one detector, and how they were measured."""

    detector: str
    pilot: bool  # whether the fit has fewer sites than a decision needs
    sites: int
    latency_ms: float  # CPU time per frame of one LiDAR
    vehicles: Law
    people: Law | None
    unseen: UnseenErrors
    gains: dict[str, float]  # AP that fine-tuning adds, for each measured LiDAR
    frames_version: str = FIRST  # version of the frames used for the detector and the fit


def read_detectability(detector: str, file: Path = FILE) -> Detectability:
    """Reads the laws of a detector. Raises Error for a detector without laws."""
    every = json.loads(file.read_text(encoding="utf-8"))
    check_name(detector, every, "detector")
    one = every[detector]
    people = one.get("people")
    return Detectability(
        detector,
        bool(one["pilot"]),
        int(one["sites"]),
        float(one["latency_ms"]),
        law_of(one["vehicles"], detector),
        law_of(people, detector) if people else None,
        UnseenErrors(**one["unseen_std"]),
        dict(one.get("fine_tuning_ap", {})),
        str(one.get("frames_version", FIRST)),
    )


def law_of(plain: dict[str, list[list[float]]], detector: str) -> Law:
    detection, false = np.array(plain["detection"]), np.array(plain["false"])
    if detection.shape[1:] != (len(OBJECT_TERMS),) or false.shape[1:] != (len(FALSE_TERMS),):
        terms = len(OBJECT_TERMS), len(FALSE_TERMS)
        got = detection.shape[1:], false.shape[1:]
        raise Error(
            f"detector: {detector}: expected rows of shapes ({terms[0]},) and ({terms[1]},), the "
            f"coefficients of this version, got rows of shapes {got[0]} and {got[1]}"
        )
    return Law(detection, false)


def score_term(cut: float | FloatArray) -> FloatArray:
    """Returns the log odds of a score."""
    return np.asarray(np.log(cut) - np.log1p(-np.asarray(cut)))


def object_terms(seen: pd.DataFrame) -> FloatArray:
    """Returns the terms (n, number of OBJECT_TERMS) of seen objects, for a score of 0.5.

    seen: columns points, along, up, distance, visibility, type, speed, spinning (whether the LiDAR
    spins).
    """
    log_points = np.log(seen.points.to_numpy(float))
    distance = seen.distance.to_numpy(float) / 50
    return np.column_stack(
        [
            np.ones(len(seen)),
            log_points,
            log_points**2 / 10,
            np.log(0.1 + seen.along.to_numpy(float)),
            np.log(0.1 + seen.up.to_numpy(float)),
            distance,
            np.log(0.1 + distance),
            seen.visibility.to_numpy(float),
            seen.type.isin(LARGE).to_numpy(float),
            seen.type.isin(SMALL).to_numpy(float),
            seen.speed.to_numpy(float) / 10,
            1 - seen.spinning.to_numpy(float),
            np.zeros(len(seen)),
            np.zeros(len(seen)),
        ]
    )


def with_score(terms: FloatArray, cut: float | FloatArray) -> FloatArray:
    """Returns the object terms for another score `cut`: one for all objects, or one per object."""
    out = terms.copy()
    out[:, -2] = score_term(cut)
    out[:, -1] = out[:, -2] * out[:, 1]
    return out


def detection_probability(coefficients: FloatArray, terms: FloatArray, cut: float) -> FloatArray:
    """Returns the probability (n,) that each object is found at a score of `cut` or above."""
    odds = np.clip(with_score(terms, cut) @ coefficients, -30, 30)
    return np.asarray(1 / (1 + np.exp(-odds)))


def false_terms(
    cut: float | FloatArray, seen_per_frame: float | FloatArray, spinning: float
) -> FloatArray:
    """Returns the terms (n, number of FALSE_TERMS) for scores, or for numbers of seen objects.

    spinning: share of the LiDARs that spin, 0 to 1.
    """
    score, seen = np.broadcast_arrays(score_term(cut), np.log1p(seen_per_frame))
    score, seen = np.atleast_1d(score), np.atleast_1d(seen)
    other = np.full(len(score), 1.0 - spinning)
    return np.column_stack([np.ones(len(score)), score, score**2 / 10, seen, other])


def false_per_frame(
    coefficients: FloatArray,
    cut: float | FloatArray,
    seen_per_frame: float | FloatArray,
    spinning: float,
) -> FloatArray:
    """Returns the expected number of false boxes in a frame at a score of `cut` or above."""
    return np.exp(np.clip(false_terms(cut, seen_per_frame, spinning) @ coefficients, -30, 10))


def cut_of(
    coefficients: FloatArray, seen_per_frame: float, spinning: float, most_per_frame: float
) -> tuple[float, bool]:
    """Returns the minimum score of a box, and whether false boxes are as rare as the user asks.

    The score is the lowest one with at most `most_per_frame` false boxes per frame, or CUT if the
    rate is unlimited.
    """
    if not np.isfinite(most_per_frame):
        return CUT, True
    rates = false_per_frame(coefficients, np.array(CUTS), seen_per_frame, spinning)
    good = np.flatnonzero(rates <= most_per_frame)
    return (CUTS[good[0]], True) if len(good) else (CUTS[-1], False)


def ap_of_counts(true_positives: FloatArray, false_positives: FloatArray, objects: int) -> float:
    """Returns the AP, 0 to 100; NaN without objects.

    true_positives, false_positives: expected numbers of boxes with at least each score of CUTS.
    """
    if objects == 0:
        return float("nan")
    recall = np.concatenate([[0], true_positives[::-1] / objects])
    precision = true_positives / np.maximum(true_positives + false_positives, 1e-12)
    envelope = np.maximum.accumulate(precision)[::-1]
    return float(100 * (np.diff(recall).clip(0) * envelope).sum())
