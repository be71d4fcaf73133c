"""A network where it stands: it is given points above the local road."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pyinfra.core.arrays import Points
from pyinfra.dataset.ground import Ground
from pyinfra.models.detectors import Detections, Detector


@dataclass(frozen=True, eq=False)
class OnRoad:
    """A detector (`pyinfra.models.detectors.Detector`) out of one whose z is from the road."""

    detector: Detector
    ground: Ground

    def predict(self, points: Points) -> Detections:
        detections = self.detector.predict(self.ground.above(points))
        return replace(detections, boxes=self.ground.back(detections.boxes))
