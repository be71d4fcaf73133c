"""What can happen to a cloud: pure functions of points, a dial and draws.

points: (n, 4) float32, x y z intensity, levelled LiDAR frame; each returns (m, 4) float32. With the
same draws a stronger dial keeps no point that a weaker one lost. The formulas and their sources
stand in docs/conventions.md, "Stress".
"""

from __future__ import annotations

import math

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.models.training.sensor_faults import Draws, ranges_of, scaled

DROPS_SHARE = 0.1  # of the points lost in rain or fog: they come back as a drop (assumed)
DROPS_FROM_M = 1.0
DROPS_INTENSITY = 0.05


def rain(points: Points, mm_per_h: float, draws: Draws) -> Points:
    return _attenuated(points, 3.65e-4 * mm_per_h**0.63, draws)


def fog(points: Points, extinction_per_km: float, draws: Draws) -> Points:
    return _attenuated(points, extinction_per_km / 1000, draws)


def blocked_sector(points: Points, width_deg: float, _: Draws) -> Points:
    """No point within half the width of the x axis."""
    azimuth_deg = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    return points[np.abs(azimuth_deg) >= width_deg / 2]


def height_error(points: Points, height_m: float, _: Draws) -> Points:
    """The sensor stands higher than is known: everything seems lower."""
    return moved(points, np.eye(3), height_m)


def roll_error(points: Points, roll_deg: float, _: Draws) -> Points:
    """The sensor leans to the right, unknown: what is on its left seems lower."""
    return moved(points, rotation(roll=math.radians(roll_deg)))


def pitch_error(points: Points, pitch_deg: float, _: Draws) -> Points:
    """The sensor looks down, unknown: what is ahead seems higher."""
    return moved(points, rotation(pitch=math.radians(pitch_deg)))


def yaw_error(points: Points, yaw_deg: float, _: Draws) -> Points:
    """The sensor is turned to the left, unknown: what is ahead seems to the right."""
    return moved(points, rotation(yaw=math.radians(yaw_deg)))


def moved(points: Points, R_true_known: FloatArray, height_m: float = 0.0) -> Points:
    """Points as a sensor has them whose true levelled frame differs from the known one."""
    out = points.copy()
    out[:, :3] = points[:, :3].astype(np.float64) @ R_true_known - [0, 0, height_m]
    return out


def rotation(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> FloatArray:
    """(3, 3): Rz(yaw) Ry(pitch) Rx(roll), radians; as the simulator's, a positive pitch looks down
    and a positive roll lifts the left side."""
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a), math.sin(a)) for a in (yaw, pitch, roll))
    yaw_matrix = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch_matrix = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll_matrix = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(yaw_matrix @ pitch_matrix @ roll_matrix)


def _attenuated(points: Points, extinction_per_m: float, draws: Draws) -> Points:
    """What comes through, fainter, and then the drops that some lost rays hit."""
    ranges = ranges_of(points)
    stays, drop, fraction = draws.random((3, len(points)))
    transmission = np.exp(-2 * extinction_per_m * ranges)
    through = stays < transmission
    kept = points[through]
    kept[:, 3] *= transmission[through]
    drops = ~through & (drop < DROPS_SHARE) & (ranges > DROPS_FROM_M)
    # Inverse of the distribution with density 1/z^2 between DROPS_FROM_M and the range.
    near, far = 1 / DROPS_FROM_M, 1 / ranges[drops]
    fallen = scaled(points[drops], 1 / (near - fraction[drops] * (near - far)) / ranges[drops])
    fallen[:, 3] = DROPS_INTENSITY
    return np.concatenate([kept, fallen])
