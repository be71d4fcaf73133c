"""Removes vehicle boxes that recur where no box ever moves, such as boxes on hedges and rails."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import BoolArray, FloatArray, Points, concatenated
from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.ground import Ground
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.background import Background, background_of
from pyinfra.models.detectors.suppression import empty

LEAST_S = 60.0  # minimum duration of the frames for a reliable result
SAME_POSITION_M = 0.7  # boxes whose centres are at most this far apart have the same position
COMES_BACK = 3  # boxes recur at a position if at least this many boxes are at the position
MOVING_SHARE = 0.2  # a box moves if a larger share of its points moves; leaves have a lower share
LEAST_SCORE = 0.1  # boxes with a lower score are neither used nor removed


def without_standing(
    clouds: Sequence[Callable[[], Points]],
    detections: Sequence[Detections],
    region: Region | None,
    road: Ground | None = None,
) -> list[Detections]:
    """Returns the detections without vehicle boxes that recur where no box ever moves.

    clouds: functions that return points (n, 4). Each function is called once or twice. The
    background is learnt from these clouds, so they should span LEAST_S or more. A vehicle that
    stands for most of the time is also removed, unless another vehicle drives through its position.
    Pedestrians and cyclists are never removed. Raises Error if there is no point.
    """
    background = background_of(clouds, region, road)
    moves = [
        _moves(background, cloud(), d.boxes) for cloud, d in zip(clouds, detections, strict=True)
    ]
    every = concatenated([empty(), *detections])
    vehicles = (every.scores >= LEAST_SCORE) & ~np.isin(every.names, PERSON_TYPES)
    keep = np.ones(len(every), np.bool_)
    keep[vehicles] = ~standing(
        every.boxes[vehicles], np.concatenate([np.empty(0, np.bool_), *moves])[vehicles]
    )
    ends = np.cumsum([len(d) for d in detections])[:-1]
    return [d.select(mask) for d, mask in zip(detections, np.split(keep, ends), strict=True)]


def length_warning(numbers: Sequence[int], period_s: float) -> str:
    """Returns a warning if frames span less than LEAST_S; else an empty text."""
    seconds = (max(numbers) - min(numbers)) * period_s
    if seconds >= LEAST_S:
        return ""
    return (
        f"drop_standing: expected frames that span {LEAST_S:g} s or more, got {seconds:g} s; in a "
        "shorter time, boxes of waiting vehicles may be removed too"
    )


def standing(boxes: FloatArray, moves: BoolArray) -> BoolArray:
    """Returns which boxes recur at positions where no box ever moves: (n,) bool.

    A position that a moving box covers is on a lane, where vehicles may queue. Boxes at this
    position are not returned. boxes: (n, 7) of all frames. moves: (n,) whether a box moves.
    """
    tree = cKDTree(boxes[:, :2])
    comes_back = (
        tree.query_ball_point(boxes[:, :2], SAME_POSITION_M, return_length=True) >= COMES_BACK
    )
    moving = boxes[moves]
    reach_m = max(SAME_POSITION_M, float(np.hypot(*moving[:, 3:5].T).max(initial=0)) / 2)
    near = cKDTree(moving[:, :2]).query_ball_point(boxes[:, :2], reach_m)
    driven = [
        _hold(moving[neighbours], box[:2]).any() if len(neighbours) else False
        for box, neighbours in zip(boxes, near, strict=True)
    ]
    return np.asarray(comes_back & ~np.array(driven, np.bool_))


def _hold(boxes: FloatArray, point: FloatArray) -> BoolArray:
    """Returns which boxes (k, 7) contain a point (2,) in their footprint: (k,) bool.

    Boxes whose centre is within SAME_POSITION_M of the point are also included.
    """
    dx, dy = (point - boxes[:, :2]).T
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    ahead, left = np.abs(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
    inside = (ahead <= boxes[:, 3] / 2) & (left <= boxes[:, 4] / 2)
    return np.asarray(inside | (np.hypot(dx, dy) <= SAME_POSITION_M))


def _moves(background: Background, points: Points, boxes: FloatArray) -> BoolArray:
    """Returns in which boxes (k, 7) points move: (k,) bool."""
    moving = points_in_boxes(background.moving(points), boxes)
    return (moving > 0) & (moving > MOVING_SHARE * points_in_boxes(points, boxes))
