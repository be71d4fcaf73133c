"""Fits a quadratic surface to a road that is not a plane, for example at a crest, dip or crown.

Only ground under traffic is certain to be road. Therefore the surface is fitted to the ground in
the 1 m wide vertical columns in which an object moved. Static objects beside the road have no
effect.
"""

from collections.abc import Sequence

import numpy as np

from pyinfra.core.arrays import FloatArray, Floats
from pyinfra.dataset.ground import SHAPE_REACH_M, shape_heights
from pyinfra.dataset.road_plane import SOFT_M, lowest_points
from pyinfra.formats.kitti import RoadShape

LEAST_COLUMNS = 100  # minimum number of vertical columns of 1 m x 1 m in which an object moved
GATES_M = (1.5, 0.8, 0.5, 0.3, 0.3, 0.3)  # maximum distance of points from the surface in each fit
# Points higher than ABOVE_M above the surface may be a vehicle that hides the road. Their weight is
# ABOVE_WEIGHT.
ABOVE_M = 0.05
ABOVE_WEIGHT = 0.3
STEADY_M4 = 1e4  # ridge term of the quadratic coefficients: (0.05 m / 5e-4 per m) squared
# Compared with the plane, the surface must reduce the mean distance of the ground points by at
# least GAIN_M. Each distance is limited to MOST_M.
GAIN_M = 0.03
MOST_M = 0.3
WORTH_M = 0.15  # minimum of the 90 % quantile of the surface's deviation from the plane
FOOT_M = 0.5  # maximum deviation of the surface from the plane below the sensor
STEEPEST = 0.2  # maximum slope at the radius where the surface becomes linear


def shape_of(clouds: Sequence[Floats], height_m: float) -> RoadShape | None:
    """Fits the road shape to clouds (k, 3) of a levelled sensor, `height_m` above the road plane.

    Returns None if the plane fits about as well, if there are too few columns with traffic, or if
    the surface is implausible.
    """
    ground = lowest_points(clouds)
    xyz = ground.xyz[ground.moved]
    if len(xyz) < LEAST_COLUMNS:
        return None
    above = xyz[:, 2] + height_m
    shape = _fitted(xyz[:, :2], above, height_m)
    heights = shape_heights(shape, xyz[:, :2]) + height_m
    better = _mean_off(above) - _mean_off(above - heights) >= GAIN_M
    leaves = float(np.quantile(np.abs(heights), 0.9)) >= WORTH_M
    return shape if better and leaves and _is_road(shape, height_m) else None


def _mean_off(off: FloatArray) -> float:
    return float(np.minimum(np.abs(off), MOST_M).mean())


def _fitted(xy: FloatArray, above: FloatArray, height_m: float) -> RoadShape:
    x, y = xy.T
    terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    steady = np.diag([1e-6] * 3 + [STEADY_M4] * 3)
    coefficients = np.zeros(6)
    for gate in GATES_M:
        off = above - terms @ coefficients
        weight = (np.abs(off) < gate) / (1 + (off / SOFT_M) ** 2)
        weight *= np.where(off > ABOVE_M, ABOVE_WEIGHT, 1.0)
        weighted = terms.T * weight
        coefficients = np.linalg.solve(weighted @ terms + steady, weighted @ above)
    return RoadShape(float(coefficients[0]) - height_m, *(float(v) for v in coefficients[1:]))


def _is_road(shape: RoadShape, height_m: float) -> bool:
    angles = np.radians(np.arange(0, 360, 10))
    rim = np.column_stack([np.cos(angles), np.sin(angles)])
    step = shape_heights(shape, (SHAPE_REACH_M + 1) * rim) - shape_heights(
        shape, SHAPE_REACH_M * rim
    )
    return bool(abs(shape.level_m + height_m) <= FOOT_M and np.abs(step).max() <= STEEPEST)
