"""Which prediction found which vehicle; pure functions over arrays.

Predictions take vehicles greedily: in order of falling score, each takes the vehicle it overlaps
most among those that no other took, if the overlap reaches the threshold. By centres, closeness
stands in place of overlap: 1 less the horizontal distance in metres, as nuScenes matches.
Predictions of equal score come in order of falling overlap, then by the numbers of their boxes: the
order in the files has no influence. It is done against all vehicles of a frame, also those that are
not counted later.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pyinfra.core import boxes as overlap
from pyinfra.core.arrays import BoolArray, FloatArray, IntArray

Metric = Literal["bev", "3d", "centre"]

# An IoU this close to the threshold equals it: more than its error, less than a label's digits.
TIE = 1e-9
IOU = 0.5  # of footprints: from here on a vehicle is found
PERSON_IOU = 0.25  # the same of people, whose footprints are as small as the errors of boxes
CENTRE_M = 0.5  # between centres: up to here something is found by metric `centre`
LEAST_OVERLAP = 0.1  # with less, a false positive has nothing to do with a vehicle
_PAIRS = 500_000  # looked at together


@dataclass(frozen=True, eq=False)
class Pairs:
    """Predictions and vehicles of one frame that overlap: n of them."""

    prediction: IntArray  # (n,)
    vehicle: IntArray  # (n,)
    iou: FloatArray  # (n,)

    def select(self, keep: BoolArray | IntArray) -> Pairs:
        return Pairs(self.prediction[keep], self.vehicle[keep], self.iou[keep])


def overlapping_pairs(
    prediction_frame: IntArray,
    predictions: FloatArray,
    vehicle_frame: IntArray,
    vehicles: FloatArray,
    metric: Metric = "bev",
) -> Pairs:
    """Pairs with an IoU, or by centres a closeness, of LEAST_OVERLAP or more.

    frames: (p,) and (v,), ascending; boxes: (p, 7) and (v, 7).
    """
    measure = _MEASURES[metric]
    chunks = []
    for p, v in pairs_of_frames(prediction_frame, vehicle_frame):
        if metric != "centre":
            near = _may_overlap(predictions, vehicles, p, v)
            p, v = p[near], v[near]
        iou = measure(predictions[p], vehicles[v])
        much = iou >= LEAST_OVERLAP - TIE
        chunks.append((p[much], v[much], iou[much]))
    if not chunks:
        return Pairs(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    return Pairs(*(np.concatenate(column) for column in zip(*chunks, strict=True)))


def _closeness(a: FloatArray, b: FloatArray) -> FloatArray:
    """Of the centres of row i of a and of b, (n, 7) each: (n,), 1 where they are one."""
    return np.asarray(1 - np.hypot(a[:, 0] - b[:, 0], a[:, 1] - b[:, 1]))


_MEASURES = {"bev": overlap.pair_bev_iou, "3d": overlap.pair_iou_3d, "centre": _closeness}


def threshold_of(metric: Metric, iou: float) -> float:
    """What a pair must reach: the IoU, or the closeness of centres that are CENTRE_M apart."""
    return 1 - CENTRE_M if metric == "centre" else iou


def in_order(
    pairs: Pairs, scores: FloatArray, predictions: FloatArray, vehicles: FloatArray
) -> Pairs:
    """The pairs in the order in which they are tried.

    scores: (p,); predictions: (p, 7) and vehicles: (v, 7) boxes.
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
    """The vehicle that each prediction took: (predictions,), -1 for none.

    pairs: as from in_order(), or some of them in that order; strict: the overlap must pass the
    threshold, as KITTI has it, not just reach it.
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


def hits(
    prediction_frame: IntArray,
    predictions: FloatArray,
    scores: FloatArray,
    vehicle_frame: IntArray,
    vehicles: FloatArray,
    metric: Metric = "bev",
    iou: float = IOU,
) -> BoolArray:
    """(p,) which predictions take a vehicle; arguments as of overlapping_pairs."""
    pairs = overlapping_pairs(prediction_frame, predictions, vehicle_frame, vehicles, metric)
    pairs = in_order(pairs, scores, predictions, vehicles)
    threshold = threshold_of(metric, iou)
    return np.asarray(match(pairs, len(predictions), len(vehicles), threshold) >= 0)


def reaches(iou: FloatArray, threshold: float, *, strict: bool) -> BoolArray:
    """Whether an overlap is enough; a difference below TIE is none."""
    return np.asarray(iou > threshold + TIE if strict else iou >= threshold - TIE)


def best_overlap(pairs: Pairs, predictions: int) -> FloatArray:
    """Highest IoU of each prediction with any vehicle: (p,), 0 below LEAST_OVERLAP."""
    best = np.zeros(predictions)
    np.maximum.at(best, pairs.prediction, pairs.iou)
    return best


def holding_centres(
    prediction_frame: IntArray, predictions: FloatArray, frame: IntArray, boxes: FloatArray
) -> BoolArray:
    """(p,) whose footprints hold the centre of one of some boxes (n, 7) of their frame.

    Frames ascending, as of overlapping_pairs. Boxes of people are too small to overlap a vehicle's.
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
    """Place of each box in an order that depends on its numbers alone: (n,)."""
    rank = np.empty(len(boxes), dtype=np.int64)
    rank[np.lexsort(boxes.T[::-1])] = np.arange(len(boxes))
    return rank


def pairs_of_frames(
    prediction_frame: IntArray, vehicle_frame: IntArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Every prediction with every vehicle of its frame, some at a time."""
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
    """False where the centres are too far apart for footprints to touch."""
    half_p = np.hypot(predictions[:, 3], predictions[:, 4]) / 2
    half_v = np.hypot(vehicles[:, 3], vehicles[:, 4]) / 2
    dx = predictions[p, 0] - vehicles[v, 0]
    dy = predictions[p, 1] - vehicles[v, 1]
    reach = half_p[p] + half_v[v]
    return np.asarray(dx * dx + dy * dy <= reach * reach)
