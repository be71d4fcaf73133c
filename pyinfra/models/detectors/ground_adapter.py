"""Adapts a network, whose z is measured from the road, to the levelled LiDAR frame of a site."""

from dataclasses import dataclass, replace

from pyinfra.core.arrays import Points
from pyinfra.dataset.ground import Ground
from pyinfra.models.detectors import Detections, Detector


@dataclass(frozen=True, eq=False)
class OnRoad:
    """A `Detector` in the levelled LiDAR frame.

    It wraps a detector whose z is measured from the road.
    """

    detector: Detector
    ground: Ground

    def predict(self, points: Points) -> Detections:
        detections = self.detector.predict(self.ground.above(points))
        return replace(detections, boxes=self.ground.back(detections.boxes))
