"""Selects the detections of a frame among its candidates; this module needs no PyTorch."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pyinfra.core.arrays import Floats, IntArray
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.calibration import calibrated
from pyinfra.models.ops.kernels import kernels

MIN_SCORE = 0.1  # minimum score of returned boxes, before calibration
NMS_IOU = 0.1  # maximum IoU of the footprints of two returned boxes, as vehicles do not overlap
CANDIDATES = 4096  # maximum number of boxes that enter the suppression, best first
MOST_BOXES = 200  # maximum number of returned boxes of a frame and class


def suppressed(
    boxes: Floats, scores: Floats, name: str, min_score: float = MIN_SCORE
) -> Detections:
    """Returns the boxes (n, 7) that remain after non-maximum suppression with NMS_IOU.

    Boxes with a score below `min_score` are left out. The extension must be installed.
    """
    assert kernels is not None
    good = np.flatnonzero(np.isfinite(boxes).all(axis=1) & (scores >= min_score))
    best = good[np.argsort(-scores[good], kind="stable")][:CANDIDATES]
    candidates = np.ascontiguousarray(boxes[best], np.float64)
    remaining: IntArray = kernels.suppress(candidates, NMS_IOU, MOST_BOXES)
    return Detections(
        candidates[remaining],
        scores[best][remaining].astype(np.float64),
        np.full(len(remaining), name),
    )


def of_classes(parts: Sequence[Detections], calibration: Sequence[float] | None) -> Detections:
    """Returns the detections of all classes, best first, with calibrated scores.

    calibration: a, b of each class (see `calibrated`). If it is None, scores do not change.
    """
    if calibration is not None:
        lines = [(calibration[2 * i], calibration[2 * i + 1]) for i in range(len(parts))]
        parts = [
            replace(part, scores=calibrated(part.scores, line))
            for part, line in zip(parts, lines, strict=True)
        ]
    return parts[0] if len(parts) == 1 else best_first(parts)


def best_first(parts: Sequence[Detections]) -> Detections:
    """Merges detections, best first. Boxes of equal score are in the order of `parts`."""
    order = np.argsort(np.concatenate([-part.scores for part in parts]), kind="stable")
    return Detections(
        boxes=np.concatenate([part.boxes for part in parts])[order],
        scores=np.concatenate([part.scores for part in parts])[order],
        names=np.concatenate([part.names for part in parts])[order],
    )


def empty() -> Detections:
    return Detections(np.empty((0, 7)), np.empty(0), np.empty(0, dtype=np.str_))
