"""Changes of a point cloud: functions of points, a severity and a random generator.

points: (n, 4) float32, x y z intensity, levelled LiDAR frame. Each function returns (m, 4) float32.
With the same random numbers, points that are lost at one severity are also lost at every higher
severity. The section "Stress" of docs/conventions/detectors.md has the formulas and their sources.
"""

import math

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.dataset.world_frame import rotation
from pyinfra.models.training.sensor_faults import Rng, ranges_of, scaled

DROPS_SHARE = 0.1  # share of lost points that are replaced by a return from a drop (assumed)
DROPS_FROM_M = 1.0  # minimum range of returns from drops
DROPS_INTENSITY = 0.05  # intensity of returns from drops


def rain(points: Points, mm_per_h: float, replicates: Rng) -> Points:
    return _attenuated(points, 3.65e-4 * mm_per_h**0.63, replicates)


def fog(points: Points, extinction_per_km: float, replicates: Rng) -> Points:
    return _attenuated(points, extinction_per_km / 1000, replicates)


def blocked_sector(points: Points, width_deg: float, _: Rng) -> Points:
    """Removes the points in a sector of azimuth that is `width_deg` wide, centred on the x axis."""
    azimuth_deg = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    return points[np.abs(azimuth_deg) >= width_deg / 2]


def height_error(points: Points, height_m: float, _: Rng) -> Points:
    """Returns points as if the sensor were higher than assumed: all points appear lower."""
    return moved(points, np.eye(3), height_m)


def angle_error(points: Points, degrees: float, _: Rng, axis: str) -> Points:
    """Returns points as if the sensor were rotated by an angle that the user does not know.

    axis: `roll` to the right (objects on the left appear lower), `pitch` downwards (objects ahead
    appear higher) or `yaw` to the left (objects ahead appear further right).
    """
    return moved(points, rotation(**{axis: math.radians(degrees)}))


def moved(points: Points, R_true_known: FloatArray, height_m: float = 0.0) -> Points:
    """Transforms points from the true levelled frame to the assumed levelled frame.

    R_true_known: (3, 3) rotation from the assumed to the true frame. height_m: true height of the
    sensor less its assumed height.
    """
    out = points.copy()
    out[:, :3] = points[:, :3].astype(np.float64) @ R_true_known - [0, 0, height_m]
    return out


def _attenuated(points: Points, extinction_per_m: float, replicates: Rng) -> Points:
    """Returns the points that rain or fog leaves, followed by returns from drops.

    The intensity of the remaining points is reduced.
    """
    ranges = ranges_of(points)
    stays, drop, fraction = replicates.random((3, len(points)))
    transmission = np.exp(-2 * extinction_per_m * ranges)
    through = stays < transmission
    kept = points[through]
    kept[:, 3] *= transmission[through]
    drops = ~through & (drop < DROPS_SHARE) & (ranges > DROPS_FROM_M)
    # Ranges z of drops have density 1/z^2 between DROPS_FROM_M and the range of the lost point.
    near, far = 1 / DROPS_FROM_M, 1 / ranges[drops]
    fallen = scaled(points[drops], 1 / (near - fraction[drops] * (near - far)) / ranges[drops])
    fallen[:, 3] = DROPS_INTENSITY
    return np.concatenate([kept, fallen])
