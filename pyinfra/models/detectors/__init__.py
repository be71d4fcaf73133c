"""Detectors of vehicles in one frame of one LiDAR.

A detector is one file with a class that implements `Detector`, and one row of DETECTORS. The
docstring of the file names the paper that it follows and all deviations from it.
"""

from dataclasses import dataclass
from typing import Protocol

from pyinfra.core.arrays import FloatArray, NameArray, Points, Rows


@dataclass(frozen=True, eq=False)
class Detections(Rows):
    """The boxes that a detector finds in a frame, best first."""

    boxes: FloatArray  # (k, 7) boxes x y z dx dy dz heading, levelled LiDAR frame
    scores: FloatArray  # (k,) scores in [0, 1], descending
    names: NameArray  # (k,) class of each box


class Detector(Protocol):
    """Finds vehicles in a cloud."""

    def predict(self, points: Points) -> Detections:
        """Returns the boxes in a cloud.

        points: (n, 4) float32, x y z intensity, levelled LiDAR frame; n may be 0. For a detector of
        stacked frames the shape is (n, 5), and the last column is the age of each point in seconds.
        Points that are not finite, or outside the detector's range, are ignored.
        """
