"""How good predictions are, how they err, and what each error costs.

Everything is of class vehicle, BEV IoU 0.5, ground truth `captured`, as `pyinfra evaluate` has it.
Forgiving follows TIDE (Bolya et al., ECCV 2020); docs/conventions.md, "Stress", has the rules.
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
PARTNER_M = 2.0  # between centres, or half the vehicle's length
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
    """COLUMNS of the detections in each frame of truth, and the draws of their fine AP.

    nan where there is nothing to measure. types: KITTI types that count as vehicle. forgiven_*:
    fine AP gained when that error is forgiven.
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
    """The detections of each frame, one after another."""
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
    """Fine AP gained for each of ERRORS when it alone is forgiven."""
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
    """The vehicle that each wrong prediction may have meant: (p,), -1 for none."""
    one = judgement.contest
    v, p = one.vehicles, one.predictions
    free = np.ones(len(v), dtype=np.bool_)
    free[judgement.matches[judgement.matches >= 0]] = False
    partner = np.full(len(p), -1, dtype=np.int64)
    for i, j in pairs_of_frames(p.frame, v.frame):
        apart = np.hypot(*(p.boxes[i, :2] - v.boxes[j, :2]).T)
        near = judgement.wrong[i] & (apart <= np.maximum(PARTNER_M, v.boxes[j, 3] / 2))
        # The nearest is written last.
        order = np.flatnonzero(near)[np.argsort(-apart[near], kind="stable")]
        partner[i[order]] = j[order]
    return np.where(np.append(free, False)[partner], partner, -1)


def _judgement(one: Contest) -> Judgement:
    return judged(one, "captured", one.match(IOU, strict=False), 1)


def _ap(judgement: Judgement) -> float:
    return float(ap.average_precision(judgement.ranking(), ap.FINE_RECALLS)[0])


def _distance(one: Contest) -> FloatArray:
    """Horizontal, sensor to the vehicles' centres: (v,)."""
    return np.asarray(np.hypot(one.vehicles.mid_frame[:, 0], one.vehicles.mid_frame[:, 1]))


def _recall(judgement: Judgement, ends: tuple[float, float]) -> float:
    distance = _distance(judgement.contest)
    counted = judgement.counted & (distance >= ends[0]) & (distance < ends[1])
    hit = np.zeros(len(counted), dtype=np.bool_)
    hit[judgement.matches[judgement.hit]] = True
    return float(hit[counted].mean()) if counted.any() else math.nan


def box_errors(judgement: Judgement) -> dict[str, float]:
    """Medians over the hits; heading to the nearer of the two ways along the vehicle."""
    p = judgement.contest.predictions.boxes[judgement.hit]
    v = judgement.contest.vehicles.boxes[judgement.matches[judgement.hit]]
    apart = np.hypot(p[:, 0] - v[:, 0], p[:, 1] - v[:, 1])
    turn = np.abs((np.degrees(p[:, 6] - v[:, 6]) + 90) % 180 - 90)
    some = len(p) > 0
    return {
        "position_error_m": float(np.median(apart)) if some else math.nan,
        "heading_error_deg": float(np.median(turn)) if some else math.nan,
    }
