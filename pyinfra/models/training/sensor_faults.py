"""Sensor faults as functions of points, a severity and a random generator.

Training uses these functions for augmentation. The stress test uses them as stressors. points:
(n, 4) float32, x y z intensity, levelled LiDAR frame. Each function returns (m, 4) float32. With
the same random numbers, points that are lost at one severity are also lost at every higher
severity. The definitions are in the section "Stress" of docs/conventions/detectors.md.
"""

import numpy as np

from pyinfra.core.arrays import FloatArray, Points

Rng = np.random.Generator

ROW_DEG = 40 / 127  # height of a row in degrees, as for 128 even channels over 40 degrees
ROWS = 1024  # number of rows, more than fit into 180 degrees


def drop_out(points: Points, share: float, rng: Rng) -> Points:
    """Removes each point with probability `share`."""
    return points[rng.random(len(points)) >= share]


def range_noise(points: Points, sigma_m: float, rng: Rng) -> Points:
    """Adds normal noise along the rays; ranges are not negative."""
    ranges = ranges_of(points)
    noisy = np.maximum(ranges + sigma_m * rng.normal(size=len(points)), 0)
    return scaled(points, np.divide(noisy, ranges, out=np.ones_like(ranges), where=ranges > 0))


def lost_lines(points: Points, share: float, rng: Rng) -> Points:
    """Removes each row of elevation with probability `share`."""
    flat = np.hypot(points[:, 0].astype(np.float64), points[:, 1])
    elevation_deg = np.degrees(np.arctan2(points[:, 2], flat))
    row = np.floor(elevation_deg / ROW_DEG).astype(np.int64) + ROWS // 2
    return points[rng.random(ROWS)[row] >= share]


def scaled(points: Points, factor: FloatArray) -> Points:
    out = points.copy()
    out[:, :3] = points[:, :3] * factor[:, None]
    return out


def ranges_of(points: Points) -> FloatArray:
    return np.asarray(np.linalg.norm(points[:, :3].astype(np.float64), axis=1))
