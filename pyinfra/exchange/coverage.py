"""Estimates the field of view of a LiDAR from its returns."""

import math
from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import IntArray, Points
from pyinfra.core.errors import Error
from pyinfra.formats.kitti import FieldOfView

MOST_POINTS = 20_000  # maximum number of points used per frame, evenly distributed
ROUNDING_DEG = 1e-4  # added to angles, so that rounding does not turn 0 into a negative angle
FULL_GAP_DEG = 30  # minimum width of an azimuth gap that limits the field of view


@dataclass
class Coverage:
    """Numbers of returns per degree of azimuth and elevation (sensor frame), and longest range."""

    azimuth: IntArray = field(default_factory=lambda: np.zeros(360, dtype=np.int64))
    elevation: IntArray = field(default_factory=lambda: np.zeros(180, dtype=np.int64))
    farthest_m: float = 0.0

    def add(self, points: Points) -> None:
        """Adds points (n, 3 or more) in the sensor frame."""
        x, y, z = points[:: 1 + len(points) // MOST_POINTS, :3].T.astype(np.float64)
        azimuth = np.floor(np.degrees(np.arctan2(y, x)) + ROUNDING_DEG).astype(np.int64) % 360
        elevation = (
            np.floor(np.degrees(np.arctan2(z, np.hypot(x, y))) + ROUNDING_DEG).astype(np.int64) + 90
        )
        self.azimuth += np.bincount(azimuth, minlength=360)
        self.elevation += np.bincount(np.clip(elevation, 0, 179), minlength=180)
        slant = np.sqrt(np.einsum("ij,ij->i", points[:, :3], points[:, :3]))
        self.farthest_m = max(self.farthest_m, float(slant.max(initial=0)))

    def measured(self) -> FieldOfView:
        """Returns the estimated field of view. Raises Error if there was no return."""
        rows = np.flatnonzero(self.elevation)
        if len(rows) == 0:
            raise Error("frames: expected one or more frames with a return, got none")
        low, high = float(rows[0] - 90), float(rows[-1] + 1 - 90)
        return FieldOfView(
            yaw=0.0,
            pitch=0.0,
            azimuth=_seen(np.flatnonzero(self.azimuth)),
            elevation=(math.radians(low), math.radians(high)),
            range_m=(0.0, float(math.ceil(self.farthest_m))),
        )


def _seen(cells: IntArray) -> tuple[float, float]:
    """Returns the azimuth interval (radians) outside the widest gap between cells with returns.

    cells: numbers of the 1 degree cells with returns, ascending. If no gap has FULL_GAP_DEG, the
    interval is the full circle. The interval may begin below -pi.
    """
    gaps = np.diff(np.append(cells, cells[0] + 360)) - 1
    widest = int(gaps.argmax())
    if gaps[widest] < FULL_GAP_DEG:
        return -math.pi, math.pi
    first = cells[(widest + 1) % len(cells)]
    width = 360 - gaps[widest]
    low = first - 360 if first + width > 360 or first >= 180 else first
    return math.radians(float(low)), math.radians(float(low + width))
