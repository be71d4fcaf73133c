"""Checks of predictions where nothing is labelled."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.frame_tables import Predictions, read_cameras, read_predictions
from pyinfra.dataset.frames import PERIOD_S, frame_numbers
from pyinfra.dataset.ground import ground_of
from pyinfra.dataset.regions import Region, region_of
from pyinfra.formats import kitti
from pyinfra.metrics.label_free_quality import BoxSeries, Trust, trust
from pyinfra.metrics.prediction_checks import find_files
from pyinfra.models.detectors.background import DEFAULT, Background
from pyinfra.models.training.sources import spread
from pyinfra.models.training.train import BACKGROUND_FRAMES

CLUSTER_SCORE = 0.3  # of what moves: less is a few points
OFF_M = 1.0  # a box's centre may lie so far off the region


def trust_of(
    folder: Path, pred: Path, split: str | None = None, *, allow_missing: bool = False
) -> list[Trust]:
    """How far to believe predictions of a folder's vehicles; its labels are not looked at.

    split: all frames by default. The background is learnt from the same frames. Raises
    FileNotFoundError, FormatError for files that are none, and Error without a point.
    """
    frames = frame_numbers(folder, split or "all")
    files = find_files(
        pred,
        frames,
        frame_numbers(folder, "all"),
        lidar_folder=folder,
        allow_missing=allow_missing,
    )
    predictions = read_predictions(files.files, read_cameras(folder, frames))
    predictions = predictions.select(~np.isin(predictions.names, PERSON_TYPES))
    lidar = kitti.read_lidar(folder) if (folder / "lidar.yaml").is_file() else None
    region = region_of(folder, lidar.T_world_levelled) if lidar else None
    clouds = [kitti.frame_file(folder, "velodyne", k) for k in frames]
    chosen = spread(range(len(clouds)), BACKGROUND_FRAMES)
    learnt = [kitti.read_points(clouds[i]) for i in chosen]
    background = Background.learn(learnt, DEFAULT, region, ground_of(folder) if lidar else None)
    moving, clusters = _second_opinion(background, clouds, frames, predictions)
    detections = BoxSeries(
        np.asarray(frames)[predictions.frame], predictions.boxes, predictions.scores
    )
    return trust(
        frames,
        lidar.period_s if lidar else PERIOD_S,
        detections,
        moving,
        _off(region, predictions.boxes),
        clusters,
    )


def _second_opinion(
    background: Background, clouds: Sequence[Path], frames: Sequence[int], predictions: Predictions
) -> tuple[IntArray, BoxSeries]:
    """Points that move in each predicted box, and the clusters of what moves."""
    moving = np.zeros(len(predictions), dtype=np.int64)
    numbers, boxes, scores = [np.empty(0, np.int64)], [np.empty((0, 7))], [np.empty(0)]
    for i, file in enumerate(clouds):
        points = kitti.read_points(file)
        rows = np.flatnonzero(predictions.frame == i)
        moving[rows] = points_in_boxes(background.moving(points), predictions.boxes[rows])
        clusters = background.predict(points)
        keep = clusters.scores >= CLUSTER_SCORE
        numbers.append(np.full(int(keep.sum()), frames[i]))
        boxes.append(clusters.boxes[keep])
        scores.append(clusters.scores[keep])
    return moving, BoxSeries(np.concatenate(numbers), np.concatenate(boxes), np.concatenate(scores))


def _off(region: Region | None, boxes: FloatArray) -> BoolArray | None:
    return None if region is None else ~region.holds(boxes, OFF_M)
