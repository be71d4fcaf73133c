"""AP of predictions, the kinds of errors in them, and the AP that each kind costs.

All figures are for class vehicle, BEV IoU 0.5 and ground truth `captured`, as in `pyinfra
evaluate`. The cost of a kind of error is the gain in AP when these errors are corrected, as in TIDE
(Bolya et al., ECCV 2020). The section "Stress" of docs/conventions/detectors.md defines the rules.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.vocabulary import VEHICLE_TYPES
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.metrics import ap
from pyinfra.metrics.evaluation_tables import ap_r1000_of, ap_row
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.match_input import MatchInput, match_input
from pyinfra.metrics.match_results import MatchResult, causes, count_matches
from pyinfra.metrics.matching import IOU, pairs_of_frames
from pyinfra.metrics.replicates import replicate_rows, same_of
from pyinfra.metrics.settings import Settings
from pyinfra.models.detectors import Detections

BANDS_M = {"near": (0.0, 40.0), "mid": (40.0, 70.0), "far": (70.0, math.inf)}
ERRORS = ("background", *(f"misses_{band}" for band in BANDS_M), "position", "heading")
# Maximum distance between the centres of a false positive and an unmatched vehicle. For long
# vehicles it is half the length.
PARTNER_M = 2.0
COLUMNS = (
    "ap",
    "ap_low",
    "ap_high",
    "ap_r1000",
    "ap_r1000_low",
    "ap_r1000_high",
    "objects",
    "background_per_frame",
    *(f"recall_{band}" for band in BANDS_M),
    "position_error_m",
    "heading_error_deg",
    *(f"forgiven_{error}" for error in ERRORS),
)


def scored(
    truth: GroundTruth, detections: Sequence[Detections], types: Sequence[str] = VEHICLE_TYPES
) -> tuple[dict[str, float], pd.DataFrame]:
    """Returns the values of COLUMNS for detections, and the bootstrap replicates of their AP.

    detections: one element for each frame of `truth`. types: KITTI types that are vehicles. AP
    is AP (R1000). A value is NaN if nothing can be measured. Columns forgiven_* are the gain in AP
    when errors of this kind are corrected.
    """
    settings = Settings(classes={"vehicle": tuple(types)}, ground_truths=("captured",))
    inputs = match_input(truth, as_predictions(detections), "vehicle", settings, "bev")
    match_result = _match_result(inputs)
    row = ap_row(match_result, IOU, "definition")
    false_positive = causes(match_result, IOU, strict=False)
    gains = forgiven(match_result)
    same = same_of(truth, inputs.blocks, settings.seed)
    return {
        **{name: row[name] for name in COLUMNS[: COLUMNS.index("objects") + 1]},
        "background_per_frame": np.count_nonzero(false_positive == "background")
        / len(truth.frames),
        **{f"recall_{band}": _recall(match_result, ends) for band, ends in BANDS_M.items()},
        **box_errors(match_result),
        **{f"forgiven_{error}": gains[error] for error in ERRORS},
    }, replicate_rows(same, "captured", [("ap_r1000", ap_r1000_of(match_result))])


def as_predictions(detections: Sequence[Detections]) -> Predictions:
    """Returns the detections of all frames as one table."""
    counts = [len(frame) for frame in detections]
    boxes = np.concatenate([np.empty((0, 7)), *(frame.boxes for frame in detections)])
    return Predictions(
        frame=np.repeat(np.arange(len(detections)), counts),
        line=np.array([n + 1 for count in counts for n in range(count)], dtype=np.int64),
        names=np.concatenate([np.empty(0, "<U1"), *(frame.names for frame in detections)]),
        boxes=boxes,
        scores=np.concatenate([np.empty(0), *(frame.scores for frame in detections)]).astype(
            np.float64
        ),
        angle=boxes[:, 6],
    )


def forgiven(match_result: MatchResult) -> dict[str, float]:
    """Returns the gain in AP (R1000) from correcting all errors of a kind, for each kind in ERRORS.

    - background: false positives without a partner (see `partners`) are removed
    - misses_*: missed vehicles in a band of distance do not count
    - position, heading: false positives get the position or heading of their partner
    """
    inputs, partner = match_result.match_input, partners(match_result)
    paired = partner >= 0  # whether a prediction is a false positive near an unmatched vehicle
    detected = np.zeros(len(inputs.vehicles), dtype=np.bool_)
    detected[match_result.matches[match_result.matches >= 0]] = True
    detected[partner[paired]] = True
    distance = _distance(inputs)
    near_vehicle = match_result.false_positive & paired
    better = {"background": replace(match_result, false_positive=near_vehicle)}
    for band, (low, high) in BANDS_M.items():
        out = ~detected & (distance >= low) & (distance < high)
        better[f"misses_{band}"] = replace(match_result, counted=match_result.counted & ~out)
    for error, columns in (("position", slice(0, 2)), ("heading", slice(6, 7))):
        boxes = inputs.predictions.boxes.copy()
        boxes[paired, columns] = inputs.vehicles.boxes[partner[paired], columns]
        better[error] = _match_result(
            replace(inputs, predictions=replace(inputs.predictions, boxes=boxes))
        )
    now = _ap(match_result)
    return {error: _ap(better[error]) - now for error in ERRORS}


def partners(match_result: MatchResult) -> IntArray:
    """Returns the partner of each false positive: (p,) row of a vehicle, -1 for none.

    The partner is the vehicle with the nearest centre. Its distance must be at most PARTNER_M, or
    half the vehicle's length if that is larger. If a prediction is matched with this vehicle, the
    false positive has no partner.
    """
    v, p = match_result.match_input.vehicles, match_result.match_input.predictions
    free = np.ones(len(v), dtype=np.bool_)
    free[match_result.matches[match_result.matches >= 0]] = False
    partner = np.full(len(p), -1, dtype=np.int64)
    for i, j in pairs_of_frames(p.frame, v.frame):
        apart = np.hypot(*(p.boxes[i, :2] - v.boxes[j, :2]).T)
        near = match_result.false_positive[i] & (apart <= np.maximum(PARTNER_M, v.boxes[j, 3] / 2))
        # The nearest vehicle is written last, so it overwrites the others.
        order = np.flatnonzero(near)[np.argsort(-apart[near], kind="stable")]
        partner[i[order]] = j[order]
    return np.where(np.append(free, False)[partner], partner, -1)


def _match_result(one: MatchInput) -> MatchResult:
    return count_matches(one, "captured", one.match(IOU, strict=False), 1)


def _ap(match_result: MatchResult) -> float:
    return float(ap.average_precision(match_result.ranking(), ap.R1000_RECALLS)[0])


def _distance(one: MatchInput) -> FloatArray:
    """Returns the horizontal distance from the sensor to the vehicles' centres, (v,) in metres."""
    return np.asarray(np.hypot(one.vehicles.mid_frame[:, 0], one.vehicles.mid_frame[:, 1]))


def _recall(match_result: MatchResult, ends: tuple[float, float]) -> float:
    distance = _distance(match_result.match_input)
    counted = match_result.counted & (distance >= ends[0]) & (distance < ends[1])
    true_positive = np.zeros(len(counted), dtype=np.bool_)
    true_positive[match_result.matches[match_result.true_positive]] = True
    return float(true_positive[counted].mean()) if counted.any() else math.nan


def box_errors(match_result: MatchResult) -> dict[str, float]:
    """Returns the median errors of position (m) and heading (degrees) over all true positives.

    Headings are compared modulo 180 degrees.
    """
    p = match_result.match_input.predictions.boxes[match_result.true_positive]
    v = match_result.match_input.vehicles.boxes[match_result.matches[match_result.true_positive]]
    apart = np.hypot(p[:, 0] - v[:, 0], p[:, 1] - v[:, 1])
    turn = np.abs((np.degrees(p[:, 6] - v[:, 6]) + 90) % 180 - 90)
    has_matches = len(p) > 0
    return {
        "position_error_m": float(np.median(apart)) if has_matches else math.nan,
        "heading_error_deg": float(np.median(turn)) if has_matches else math.nan,
    }
