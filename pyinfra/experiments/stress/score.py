"""AP of predictions, the kinds of errors in them, and the AP that each kind costs.

All figures are for class vehicle, BEV IoU 0.5 and ground truth `captured`, as in `pyinfra
evaluate`. The cost of a kind of error is the gain in AP when it is corrected, as in TIDE (Bolya et
al., ECCV 2020). docs/conventions.md, "Stress", defines the rules.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.vocabulary import VEHICLE_TYPES
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.metrics import ap
from pyinfra.metrics.evaluation_tables import ap_row, fine_ap
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.match_results import Contest, Judgement, Settings, causes, contest
from pyinfra.metrics.match_results import judge as judged
from pyinfra.metrics.matching import IOU, pairs_of_frames
from pyinfra.metrics.replicates import draw_rows, same_of
from pyinfra.models.detectors import Detections

BANDS_M = {"near": (0.0, 40.0), "mid": (40.0, 70.0), "far": (70.0, math.inf)}
ERRORS = ("ghosts", *(f"misses_{band}" for band in BANDS_M), "position", "heading")
PARTNER_M = 2.0  # largest distance between centres, unless half the vehicle's length is larger
COLUMNS = (
    "ap",
    "ap_low",
    "ap_high",
    "ap_fine",
    "ap_fine_low",
    "ap_fine_high",
    "objects",
    "ghosts_per_frame",
    *(f"recall_{band}" for band in BANDS_M),
    "position_error_m",
    "heading_error_deg",
    *(f"forgiven_{error}" for error in ERRORS),
)


def scored(
    truth: GroundTruth, detections: Sequence[Detections], types: Sequence[str] = VEHICLE_TYPES
) -> tuple[dict[str, float], pd.DataFrame]:
    """Returns COLUMNS for detections, and the bootstrap replicates of their AP (R1000).

    detections: one element for each frame of `truth`. types: KITTI types that count as vehicle.
    A figure is NaN if there is nothing to measure. forgiven_*: gain in AP (R1000) when errors of
    this kind are corrected.
    """
    settings = Settings(classes={"vehicle": tuple(types)}, ground_truths=("captured",))
    one = contest(truth, as_predictions(detections), "vehicle", settings, "bev")
    judgement = _judgement(one)
    row = ap_row(judgement, IOU, "definition")
    wrong = causes(judgement, IOU, strict=False)
    gains = forgiven(judgement)
    same = same_of(truth, one.blocks, settings.seed)
    return {
        **{name: row[name] for name in COLUMNS[: COLUMNS.index("objects") + 1]},
        "ghosts_per_frame": np.count_nonzero(wrong == "ghost") / len(truth.frames),
        **{f"recall_{band}": _recall(judgement, ends) for band, ends in BANDS_M.items()},
        **box_errors(judgement),
        **{f"forgiven_{error}": gains[error] for error in ERRORS},
    }, draw_rows(same, "captured", [("ap_fine", fine_ap(judgement))])


def as_predictions(detections: Sequence[Detections]) -> Predictions:
    """Returns the detections of all frames as one table."""
    counts = [len(one) for one in detections]
    boxes = np.concatenate([np.empty((0, 7)), *(one.boxes for one in detections)])
    return Predictions(
        frame=np.repeat(np.arange(len(detections)), counts),
        line=np.array([n + 1 for count in counts for n in range(count)], dtype=np.int64),
        names=np.concatenate([np.empty(0, "<U1"), *(one.names for one in detections)]),
        boxes=boxes,
        scores=np.concatenate([np.empty(0), *(one.scores for one in detections)]).astype(
            np.float64
        ),
        angle=boxes[:, 6],
    )


def forgiven(judgement: Judgement) -> dict[str, float]:
    """Returns for each of ERRORS the gain in AP (R1000) when errors of this kind are corrected.

    ghosts: false positives without a partner are removed. misses_*: missed vehicles in a band of
    distance no longer count. position, heading: false positives get this part of the box of their
    partner.
    """
    one, partner = judgement.contest, partners(judgement)
    has = partner >= 0
    reached = np.zeros(len(one.vehicles), dtype=np.bool_)
    reached[judgement.matches[judgement.matches >= 0]] = True
    reached[partner[has]] = True
    distance = _distance(one)
    better = {"ghosts": replace(judgement, wrong=judgement.wrong & has)}
    for band, (low, high) in BANDS_M.items():
        out = ~reached & (distance >= low) & (distance < high)
        better[f"misses_{band}"] = replace(judgement, counted=judgement.counted & ~out)
    for error, columns in (("position", slice(0, 2)), ("heading", slice(6, 7))):
        boxes = one.predictions.boxes.copy()
        boxes[has, columns] = one.vehicles.boxes[partner[has], columns]
        better[error] = _judgement(replace(one, predictions=replace(one.predictions, boxes=boxes)))
    now = _ap(judgement)
    return {error: _ap(better[error]) - now for error in ERRORS}


def partners(judgement: Judgement) -> IntArray:
    """Returns the vehicle that each false positive may have been meant for: (p,), -1 for none.

    It is an unmatched vehicle whose centre is at most PARTNER_M, or half its length, away.
    """
    one = judgement.contest
    v, p = one.vehicles, one.predictions
    free = np.ones(len(v), dtype=np.bool_)
    free[judgement.matches[judgement.matches >= 0]] = False
    partner = np.full(len(p), -1, dtype=np.int64)
    for i, j in pairs_of_frames(p.frame, v.frame):
        apart = np.hypot(*(p.boxes[i, :2] - v.boxes[j, :2]).T)
        near = judgement.wrong[i] & (apart <= np.maximum(PARTNER_M, v.boxes[j, 3] / 2))
        # The nearest vehicle is written last, so it stays.
        order = np.flatnonzero(near)[np.argsort(-apart[near], kind="stable")]
        partner[i[order]] = j[order]
    return np.where(np.append(free, False)[partner], partner, -1)


def _judgement(one: Contest) -> Judgement:
    return judged(one, "captured", one.match(IOU, strict=False), 1)


def _ap(judgement: Judgement) -> float:
    return float(ap.average_precision(judgement.ranking(), ap.FINE_RECALLS)[0])


def _distance(one: Contest) -> FloatArray:
    """Returns the horizontal distance from the sensor to the vehicles' centres, (v,) in metres."""
    return np.asarray(np.hypot(one.vehicles.mid_frame[:, 0], one.vehicles.mid_frame[:, 1]))


def _recall(judgement: Judgement, ends: tuple[float, float]) -> float:
    distance = _distance(judgement.contest)
    counted = judgement.counted & (distance >= ends[0]) & (distance < ends[1])
    hit = np.zeros(len(counted), dtype=np.bool_)
    hit[judgement.matches[judgement.hit]] = True
    return float(hit[counted].mean()) if counted.any() else math.nan


def box_errors(judgement: Judgement) -> dict[str, float]:
    """Returns the median errors of position (m) and heading (degrees) over all true positives.

    Headings are compared modulo 180 degrees.
    """
    p = judgement.contest.predictions.boxes[judgement.hit]
    v = judgement.contest.vehicles.boxes[judgement.matches[judgement.hit]]
    apart = np.hypot(p[:, 0] - v[:, 0], p[:, 1] - v[:, 1])
    turn = np.abs((np.degrees(p[:, 6] - v[:, 6]) + 90) % 180 - 90)
    some = len(p) > 0
    return {
        "position_error_m": float(np.median(apart)) if some else math.nan,
        "heading_error_deg": float(np.median(turn)) if some else math.nan,
    }
