"""Matching of predictions with vehicles.

Matching is greedy, in order of descending score. Each prediction is matched with the unmatched
vehicle that it overlaps most, if the overlap reaches the threshold. Metric `centre` uses closeness
instead of overlap: 1 minus the horizontal distance of the centres in metres, similar to nuScenes.
Predictions of equal score are ordered by descending overlap, then by the values of their boxes.
Therefore their order in the files does not matter. All vehicles of a frame can be matched, even
vehicles that the evaluation does not count.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pyinfra.core import boxes as overlap
from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, Rows, concatenated

Metric = Literal["bev", "3d", "centre"]

# An IoU that differs from the threshold by at most TIE is taken as equal to the threshold. TIE is
# larger than the numerical error of an IoU, and smaller than the rounding of labels.
TIE = 1e-9
IOU = 0.5  # minimum IoU of footprints for a match with a vehicle
PERSON_IOU = 0.25  # minimum IoU for pedestrians and cyclists, whose footprints are small
CENTRE_M = 0.5  # largest distance of centres for a match by metric `centre`
LEAST_OVERLAP = 0.1  # minimum overlap of a pair; a lower overlap is taken as 0
_PAIRS = 500_000  # number of pairs that are processed together


@dataclass(frozen=True, eq=False)
class Pairs(Rows):
    """n pairs of a prediction and a vehicle of the same frame that overlap."""

    prediction: IntArray  # (n,) index of the prediction
    vehicle: IntArray  # (n,) index of the vehicle
    iou: FloatArray  # (n,) IoU of the pair, or closeness of the centres


def overlapping_pairs(
    prediction_frame: IntArray,
    predictions: FloatArray,
    vehicle_frame: IntArray,
    vehicles: FloatArray,
    metric: Metric = "bev",
) -> Pairs:
    """Returns the pairs with an IoU (or closeness of centres) of LEAST_OVERLAP or more.

    prediction_frame, vehicle_frame: (p,) and (v,), ascending. predictions, vehicles: boxes, (p, 7)
    and (v, 7).
    """
    measure = _MEASURES[metric]
    chunks = [Pairs(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    for p, v in pairs_of_frames(prediction_frame, vehicle_frame):
        if metric != "centre":
            near = _may_overlap(predictions, vehicles, p, v)
            p, v = p[near], v[near]
        iou = measure(predictions[p], vehicles[v])
        much = iou >= LEAST_OVERLAP - TIE
        chunks.append(Pairs(p[much], v[much], iou[much]))
    return concatenated(chunks)


def _closeness(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the closeness of the centres of boxes a and b, (n, 7) each: (n,), 1 if equal."""
    return np.asarray(1 - np.hypot(a[:, 0] - b[:, 0], a[:, 1] - b[:, 1]))


_MEASURES = {"bev": overlap.pair_bev_iou, "3d": overlap.pair_iou_3d, "centre": _closeness}


def threshold_of(metric: Metric, iou: float) -> float:
    """Returns the threshold of a metric: `iou`, or for `centre` the closeness at CENTRE_M."""
    return 1 - CENTRE_M if metric == "centre" else iou


def in_order(
    pairs: Pairs, scores: FloatArray, predictions: FloatArray, vehicles: FloatArray
) -> Pairs:
    """Returns the pairs in the order in which they are matched.

    scores: (p,). predictions: (p, 7) and vehicles: (v, 7) boxes.
    """
    keys = (
        _rank(vehicles)[pairs.vehicle],
        _rank(predictions)[pairs.prediction],
        -pairs.iou,
        -scores[pairs.prediction],
    )
    return pairs.select(np.lexsort(keys))


def match(
    pairs: Pairs, predictions: int, vehicles: int, threshold: float, *, strict: bool = False
) -> IntArray:
    """Returns the vehicle that each prediction is matched with: (predictions,), -1 for none.

    pairs: the result of in_order(), or a part of it in the same order. strict: whether the overlap
    must be above the threshold, as in KITTI; otherwise it may be equal to the threshold.
    """
    enough = reaches(pairs.iou, threshold, strict=strict)
    taken = [-1] * predictions
    free = bytearray(b"\1") * vehicles
    columns = (pairs.prediction[enough].tolist(), pairs.vehicle[enough].tolist())
    for p, v in zip(*columns, strict=True):
        if free[v] and taken[p] < 0:
            taken[p] = v
            free[v] = 0
    return np.array(taken, dtype=np.int64)


def true_positives(
    prediction_frame: IntArray,
    predictions: FloatArray,
    scores: FloatArray,
    vehicle_frame: IntArray,
    vehicles: FloatArray,
    metric: Metric = "bev",
    iou: float = IOU,
) -> BoolArray:
    """Returns which predictions are matched: (p,). Arguments are as in overlapping_pairs."""
    pairs = overlapping_pairs(prediction_frame, predictions, vehicle_frame, vehicles, metric)
    pairs = in_order(pairs, scores, predictions, vehicles)
    return np.asarray(match(pairs, len(predictions), len(vehicles), threshold_of(metric, iou)) >= 0)


def reaches(iou: FloatArray, threshold: float, *, strict: bool) -> BoolArray:
    """Returns whether an overlap reaches the threshold. Values within TIE are equal.

    strict: whether the overlap must be above the threshold, not equal to it.
    """
    return np.asarray(iou > threshold + TIE if strict else iou >= threshold - TIE)


def best_overlap(pairs: Pairs, predictions: int) -> FloatArray:
    """Returns the highest IoU of each prediction with any vehicle: (p,), 0 if not in `pairs`."""
    best = np.zeros(predictions)
    np.maximum.at(best, pairs.prediction, pairs.iou)
    return best


def holding_centres(
    prediction_frame: IntArray, predictions: FloatArray, frame: IntArray, boxes: FloatArray
) -> BoolArray:
    """Returns which predictions contain the centre of a box (n, 7) of their frame: (p,).

    Only footprints are compared. Frames are ascending, as in overlapping_pairs. The function is
    used for pedestrians and cyclists, because the IoU of their small boxes with a vehicle box is
    always low.
    """
    holding = np.zeros(len(predictions), dtype=np.bool_)
    for p, b in pairs_of_frames(prediction_frame, frame):
        offset, heading = boxes[b, :2] - predictions[p, :2], predictions[p, 6]
        cos, sin = np.cos(heading), np.sin(heading)
        ahead = np.abs(cos * offset[:, 0] + sin * offset[:, 1])
        left = np.abs(cos * offset[:, 1] - sin * offset[:, 0])
        inside = (ahead <= predictions[p, 3] / 2) & (left <= predictions[p, 4] / 2)
        holding[p[inside]] = True
    return holding


def _rank(boxes: FloatArray) -> IntArray:
    """Returns the rank of each box in an order that depends only on the boxes' values: (n,)."""
    rank = np.empty(len(boxes), dtype=np.int64)
    rank[np.lexsort(boxes.T[::-1])] = np.arange(len(boxes))
    return rank


def pairs_of_frames(
    prediction_frame: IntArray, vehicle_frame: IntArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yields all pairs of a prediction and a vehicle of its frame, in chunks."""
    first = np.searchsorted(vehicle_frame, prediction_frame, "left")
    count = np.searchsorted(vehicle_frame, prediction_frame, "right") - first
    upto = np.cumsum(count)
    start = 0
    while start < len(count):
        done = upto[start - 1] if start > 0 else 0
        stop = max(start + 1, int(np.searchsorted(upto, done + _PAIRS, "right")))
        here = count[start:stop]
        p = np.repeat(np.arange(start, stop), here)
        nth = np.arange(len(p)) - np.repeat(upto[start:stop] - here - done, here)
        yield p, first[p] + nth
        start = stop


def _may_overlap(
    predictions: FloatArray, vehicles: FloatArray, p: IntArray, v: IntArray
) -> BoolArray:
    """Returns False for pairs whose centres are too far apart for their footprints to overlap."""
    half_p = np.hypot(predictions[:, 3], predictions[:, 4]) / 2
    half_v = np.hypot(vehicles[:, 3], vehicles[:, 4]) / 2
    dx = predictions[p, 0] - vehicles[v, 0]
    dy = predictions[p, 1] - vehicles[v, 1]
    reach = half_p[p] + half_v[v]
    return np.asarray(dx * dx + dy * dy <= reach * reach)
