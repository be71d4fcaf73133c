"""Which boxes the sensor cannot see: behind other boxes, or outside its field of view."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.boxes import footprints, wrapped
from pyinfra.dataset.data_set import field_of_view_mask
from pyinfra.dataset.regions import Region
from pyinfra.formats import kitti

LEFT_M = 2.0  # distance outside the region from which a box has left the region


@dataclass(frozen=True, eq=False)
class View:
    """What the sensors of frames can see, in the levelled frame.

    sensors: positions (k, 3); by default one at the origin. lidar, tilt: their fields of view, if
    known. region: the area in which a detector returns vehicles, if known.
    """

    sensors: FloatArray = field(default_factory=lambda: np.zeros((1, 3)))
    lidar: kitti.Lidar | None = None
    tilt: kitti.Tilt | None = None
    region: Region | None = None

    def outside(self, boxes: FloatArray) -> BoolArray:
        """Returns which boxes (n, 7) have left the region."""
        if self.region is None:
            return np.zeros(len(boxes), dtype=bool)
        return ~self.region.holds(boxes, LEFT_M)

    def hidden(self, boxes: FloatArray, others: FloatArray) -> BoolArray:
        """Returns which boxes (n, 7) are hidden from every sensor, by one of the others (m, 7).

        A box that is partly outside the field of view is hidden too.
        """
        behind = [hidden_behind(boxes, others, sensor) for sensor in self.sensors]
        return np.asarray(np.all(behind, axis=0) | self.cut(boxes))

    def cut(self, boxes: FloatArray) -> BoolArray:
        """Returns which boxes (n, 7) are partly or wholly outside the field of view."""
        if self.lidar is None or self.tilt is None:
            return np.zeros(len(boxes), dtype=bool)
        bottom = np.repeat((boxes[:, 2] - boxes[:, 5] / 2)[:, None], 4, axis=1)
        corners = np.dstack([footprints(boxes), bottom]).reshape(-1, 3)
        in_view = field_of_view_mask(self.lidar, self.tilt, corners)[0].reshape(-1, 4)
        return np.asarray(~in_view.all(axis=1))


def hidden_behind(boxes: FloatArray, others: FloatArray, sensor: FloatArray) -> BoolArray:
    """Returns which boxes (n, 7) one of the others (m, 7) hides from a sensor (3,).

    A box counts as hidden if the ray from the sensor to the top of its centre passes through
    another box that is nearer.
    """
    at, blocker = boxes[:, :3] - sensor, others[:, :3] - sensor
    distance, nearer = np.hypot(at[:, 0], at[:, 1]), np.hypot(blocker[:, 0], blocker[:, 1])
    azimuth, middle = np.arctan2(at[:, 1], at[:, 0]), np.arctan2(blocker[:, 1], blocker[:, 0])
    corners = footprints(others) - sensor[:2]
    off = wrapped(np.arctan2(corners[:, :, 1], corners[:, :, 0]) - middle[:, None])
    turn = wrapped(azimuth[:, None] - middle)
    between = (turn >= off.min(axis=1, initial=0)) & (turn <= off.max(axis=1, initial=0))
    top = at[:, 2] + boxes[:, 5] / 2
    ray = top[:, None] * nearer / np.maximum(distance, 1e-6)[:, None]  # ray height at the blocker
    blocked = ray < blocker[:, 2] + others[:, 5] / 2
    return np.asarray((between & blocked & (nearer < distance[:, None] - 1)).any(axis=1))
