"""Counts and findings of an import, and the field of view that its returns show."""

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, Points
from pyinfra.dataset.health import FrameHealth, HealthMonitor
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
        """Returns the estimated field of view of one or more returns."""
        rows = np.flatnonzero(self.elevation)
        low, high = float(rows[0] - 90), float(rows[-1] + 1 - 90)
        return FieldOfView(
            yaw=0.0,
            pitch=0.0,
            azimuth=_seen(np.flatnonzero(self.azimuth)),
            elevation=(math.radians(low), math.radians(high)),
            range_m=(0.0, float(math.ceil(self.farthest_m))),
        )


@dataclass
class ImportSummary:
    """Counts of an import, collected while the frames are written."""

    frames: int = 0
    points: int = 0
    without_return: int = 0  # number of dropped points, which are not finite or 0 0 0
    without_intensity: int = 0  # number of points whose intensity, which is not finite, is set to 0
    empty: list[str] = field(default_factory=list)  # names of frames without a return
    # Names of frames with the same points as another frame.
    doubled: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # objects that could not be read, and why
    bad: list[str] = field(default_factory=list)  # frames that could not be read, and why
    assumed: tuple[str, ...] = ()
    not_read: list[str] = field(default_factory=list)  # parts of the recording that are not read
    unread_keys: set[str] = field(default_factory=set)  # keys of labels that are not read
    types: Counter[str] = field(default_factory=Counter)
    tracked: int = 0  # number of labels whose track is known
    wide: int = 0  # number of labelled vehicles that are wider than long
    bottoms: list[FloatArray] = field(default_factory=list)  # z of the vehicles' bottoms
    coverage: Coverage = field(default_factory=Coverage)
    monitor: HealthMonitor = field(default_factory=HealthMonitor)
    health: list[FrameHealth] = field(default_factory=list)

    @property
    def below_m(self) -> float | None:
        """Median depth of the labelled vehicles' bottoms below the sensor, in metres.

        The depth is None if there is no labelled vehicle.
        """
        bottoms = np.concatenate([np.empty(0), *self.bottoms])
        return -float(np.median(bottoms)) if len(bottoms) else None


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
