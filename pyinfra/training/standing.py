"""Vehicles that come back where nothing ever moves: hedges and rails, found without a label."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pyinfra import kitti
from pyinfra.arrays import BoolArray, FloatArray
from pyinfra.boxes import points_in_boxes
from pyinfra.data.ground import Ground
from pyinfra.data.regions import Region
from pyinfra.detectors import Detections
from pyinfra.detectors.background import DEFAULT, Background
from pyinfra.training.sources import spread
from pyinfra.training.train import BACKGROUND_FRAMES

PLACE_M = 0.7  # boxes whose centres are as near are at one place
COMES_BACK = 3  # boxes at a place, and more
MOVING_SHARE = 0.2  # of a box's points: leaves that flutter are fewer


def without_standing(
    clouds: Sequence[Path],
    found: Sequence[Detections],
    region: Region | None,
    road: Ground | None = None,
) -> list[Detections]:
    """The detections of each cloud without vehicles that come back where nothing ever moves.

    The background is learnt from the same clouds, so they should be of a minute or more: what
    stands for most of it, parked or at a red light, goes as well. People who wait stay. Raises
    ValueError without a point.
    """
    chosen = spread(range(len(clouds)), BACKGROUND_FRAMES)
    learnt = [kitti.read_points(clouds[i]) for i in chosen]
    background = Background.learn(learnt, DEFAULT, region, road)
    moves = [_moves(background, cloud, d.boxes) for cloud, d in zip(clouds, found, strict=True)]
    centres = np.concatenate([np.empty((0, 2)), *(d.boxes[:, :2] for d in found)])
    vehicles = np.concatenate([np.empty(0, np.bool_), *(_are_vehicles(d) for d in found)])
    keep = np.ones(len(centres), np.bool_)
    keep[vehicles] = ~standing(
        centres[vehicles], np.concatenate([np.empty(0, np.bool_), *moves])[vehicles]
    )
    ends = np.cumsum([len(d) for d in found])[:-1]
    return [_only(d, own) for d, own in zip(found, np.split(keep, ends), strict=True)]


def standing(centres: FloatArray, moves: BoolArray) -> BoolArray:
    """(n,) which boxes come back where none moves; centres: (n, 2) of all frames, moves: (n,)."""
    boxes, moving = (
        cKDTree(places).query_ball_point(centres, PLACE_M, return_length=True)
        for places in (centres, centres[moves])
    )
    return np.asarray((boxes >= COMES_BACK) & (moving == 0))


def _moves(background: Background, cloud: Path, boxes: FloatArray) -> BoolArray:
    """(k,) whether something moves in each box."""
    points = kitti.read_points(cloud)
    moving = points_in_boxes(background.moving(points), boxes)
    return (moving > 0) & (moving > MOVING_SHARE * points_in_boxes(points, boxes))


def _are_vehicles(found: Detections) -> BoolArray:
    return ~np.isin(found.names, kitti.PERSON_TYPES)


def _only(found: Detections, keep: BoolArray) -> Detections:
    return replace(
        found, boxes=found.boxes[keep], scores=found.scores[keep], names=found.names[keep]
    )
