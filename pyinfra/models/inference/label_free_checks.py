"""Quality measures of predictions on frames without labels."""

from functools import partial
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import IntArray, concatenated
from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.frame_readers import read_cameras, read_predictions
from pyinfra.dataset.frame_sequence import RecordedFrames
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.health import folder_health
from pyinfra.formats import kitti
from pyinfra.metrics.label_free_quality import BoxSeries, Trust, refusal, trust
from pyinfra.metrics.prediction_checks import find_files
from pyinfra.models.detectors.background import Background, background_of

CLUSTER_SCORE = 0.3  # clusters of moving points with a lower score are not used
OFF_M = 1.0  # a box is outside the region if its centre is more than this distance outside


class NoQuality(Error):
    """Raised if the measures would be meaningless for the frames."""


def trust_of(
    folder: Path, pred: Path, split: str | None = None, *, allow_missing: bool = False
) -> list[Trust]:
    """Returns label-free quality measures of the vehicle predictions for a folder.

    Labels are not used. The background is learnt from the same frames. split: by default all
    frames. Raises FileNotFoundError, FormatError for invalid files, Error if no cloud has a point
    in range, and NoQuality if the measures would say nothing about the frames.
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
    sequence = RecordedFrames(folder, tuple(frames))
    lidar, region, period_s = sequence.lidar, sequence.region, sequence.period_s
    is_recorded = lidar is None or lidar.preset == kitti.RECORDED
    health = folder_health(folder, frames, period_s) if is_recorded else []
    faulty = [row.frame for row in health if row.problems]
    if text := refusal(frames, period_s, faulty, has_region=region is not None):
        raise NoQuality(f"{folder}: predictions cannot be checked without labels: {text}")
    reads = [partial(sequence.points_of, k) for k in frames]
    background = background_of(reads, region, sequence.ground)
    moving, clusters = _second_opinion(background, sequence, predictions)
    detections = BoxSeries(
        np.asarray(frames)[predictions.frame], predictions.boxes, predictions.scores
    )
    return trust(
        frames,
        period_s,
        detections,
        moving,
        None if region is None else ~region.holds(predictions.boxes, OFF_M),
        clusters,
        faulty=faulty,
    )


def _second_opinion(
    background: Background, sequence: RecordedFrames, predictions: Predictions
) -> tuple[IntArray, BoxSeries]:
    """Returns the number of moving points in each predicted box, and clusters of moving points."""
    moving = np.zeros(len(predictions), dtype=np.int64)
    parts = []
    for i, number in enumerate(sequence.numbers):
        points = sequence.points_of(number)
        rows = np.flatnonzero(predictions.frame == i)
        moving[rows] = points_in_boxes(background.moving(points), predictions.boxes[rows])
        clusters = background.predict(points)
        clusters = clusters.select(clusters.scores >= CLUSTER_SCORE)
        numbers = np.full(len(clusters), number)
        parts.append(BoxSeries(numbers, clusters.boxes, clusters.scores))
    return moving, concatenated(parts)
