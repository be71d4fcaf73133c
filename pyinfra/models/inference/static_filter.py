"""Vehicles that come back where nothing ever moves: hedges and rails, found without a label."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import BoolArray, FloatArray, Points
from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.ground import Ground
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.background import DEFAULT, Background
from pyinfra.models.training.sources import spread
from pyinfra.models.training.train import BACKGROUND_FRAMES

LEAST_S = 60.0  # of frames that tell what stands
SAME_POSITION_M = 0.7  # boxes whose centres are as near are at one place
COMES_BACK = 3  # boxes at a place, and more
MOVING_SHARE = 0.2  # of a box's points: leaves that flutter are fewer
LEAST_SCORE = 0.1  # of boxes that tell something, and that may go


def without_standing(
    clouds: Sequence[Callable[[], Points]],
    detections: Sequence[Detections],
    region: Region | None,
    road: Ground | None = None,
) -> list[Detections]:
    """The detections of each cloud without vehicles that come back where nothing ever moves.

    clouds: each gives (n, 4) points when it is called, which happens once or twice. The background
    is learnt from them, so they should be of LEAST_S or more: what stands for most of it where
    nothing drives past goes as well. People who wait stay. Raises Error without a point.
    """
    chosen = spread(range(len(clouds)), BACKGROUND_FRAMES)
    learnt = [clouds[i]() for i in chosen]
    background = Background.learn(learnt, DEFAULT, region, road)
    moves = [
        _moves(background, cloud(), d.boxes) for cloud, d in zip(clouds, detections, strict=True)
    ]
    boxes = np.concatenate([np.empty((0, 7)), *(d.boxes for d in detections)])
    vehicles = np.concatenate([np.empty(0, np.bool_), *(_are_vehicles(d) for d in detections)])
    keep = np.ones(len(boxes), np.bool_)
    keep[vehicles] = ~standing(
        boxes[vehicles], np.concatenate([np.empty(0, np.bool_), *moves])[vehicles]
    )
    ends = np.cumsum([len(d) for d in detections])[:-1]
    return [_only(d, mask) for d, mask in zip(detections, np.split(keep, ends), strict=True)]


def length_warning(numbers: Sequence[int], period_s: float) -> str:
    """What to say of frames of these numbers that are few; nothing if they are enough."""
    seconds = (max(numbers) - min(numbers)) * period_s
    if seconds >= LEAST_S:
        return ""
    return (
        f"drop_standing: found {seconds:g} s, meant for {LEAST_S:g} s or more: who waits is left "
        "out as well"
    )


def standing(boxes: FloatArray, moves: BoolArray) -> BoolArray:
    """(n,) which boxes come back where none moves, nor drives past: queues stand on lanes.

    boxes: (n, 7) of all frames; moves: (n,).
    """
    tree = cKDTree(boxes[:, :2])
    comes_back = (
        tree.query_ball_point(boxes[:, :2], SAME_POSITION_M, return_length=True) >= COMES_BACK
    )
    moving = boxes[moves]
    reach_m = max(SAME_POSITION_M, float(np.hypot(*moving[:, 3:5].T).max(initial=0)) / 2)
    near = cKDTree(moving[:, :2]).query_ball_point(boxes[:, :2], reach_m)
    driven = [
        _hold(moving[some], box[:2]).any() if len(some) else False
        for box, some in zip(boxes, near, strict=True)
    ]
    return np.asarray(comes_back & ~np.array(driven, np.bool_))


def _hold(boxes: FloatArray, point: FloatArray) -> BoolArray:
    """(k,) whether a point (2,) is in a box (k, 7) seen from above, or at its middle."""
    dx, dy = (point - boxes[:, :2]).T
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    ahead, left = np.abs(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
    inside = (ahead <= boxes[:, 3] / 2) & (left <= boxes[:, 4] / 2)
    return np.asarray(inside | (np.hypot(dx, dy) <= SAME_POSITION_M))


def _moves(background: Background, points: Points, boxes: FloatArray) -> BoolArray:
    """(k,) whether something moves in each box."""
    moving = points_in_boxes(background.moving(points), boxes)
    return (moving > 0) & (moving > MOVING_SHARE * points_in_boxes(points, boxes))


def _are_vehicles(detections: Detections) -> BoolArray:
    likely = detections.scores >= LEAST_SCORE
    return np.asarray(likely & ~np.isin(detections.names, PERSON_TYPES))


def _only(detections: Detections, keep: BoolArray) -> Detections:
    return replace(
        detections,
        boxes=detections.boxes[keep],
        scores=detections.scores[keep],
        names=detections.names[keep],
    )
