"""How a road leaves its plane: over a crest, through a dip, to either side of its middle.

Only ground under traffic is road for sure, so the surface of the second order is fitted to columns
in which something moved; what stands beside the road has no say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pyinfra.core.arrays import FloatArray, Floats
from pyinfra.dataset.ground import SHAPE_REACH_M, shape_heights
from pyinfra.dataset.road_plane import SOFT_M, lowest_points
from pyinfra.formats.kitti import RoadShape

LEAST_COLUMNS = 100  # under traffic; of fewer a plane is surer
GATES_M = (1.5, 0.8, 0.5, 0.3, 0.3, 0.3)  # about the surface, ever closer
ABOVE_M = 0.05  # what lies higher than this may be a vehicle where no ray meets the road,
ABOVE_WEIGHT = 0.3  # and counts less
STEADY_M4 = 1e4  # of the second order: (5 cm of a column / 5e-4 per m, a radius of 1 km) squared
GAIN_M = 0.03  # by which that ground lies nearer to the surface than to the plane, in the mean,
MOST_M = 0.3  # of no more than this each
WORTH_M = 0.15  # by which a tenth of that ground leaves the plane
FOOT_M = 0.5  # by which the surface may miss the plane at the sensor's foot
STEEPEST = 0.2  # slope where it becomes straight


def shape_of(clouds: Sequence[Floats], height_m: float) -> RoadShape | None:
    """The road in clouds (k, 3) of a levelled sensor so high above its plane.

    None where the plane does as well, where too little moved, and for a surface that is no road.
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
