"""How many points of a cloud lie in each box."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pyinfra.kitti import FloatArray
from pyinfra.kitti.layout import IntArray

AROUND_M = 0.05  # outside a side, and above the bottom, where the road still is


def points_in_boxes(points: npt.NDArray[np.float32], boxes: FloatArray) -> IntArray:
    """Points (n, 3 or more) in each of the boxes (k, 7): (k,).

    In a box: up to 5 cm outside its sides and top, and 5 cm or more above its bottom, because the
    road that it stands on does not belong to it.
    """
    x, y, z = (np.ascontiguousarray(points[:, i]) for i in range(3))
    counts = np.zeros(len(boxes), dtype=np.int64)
    for i, (bx, by, bz, dx, dy, dz, heading) in enumerate(boxes):
        reach = np.float32(np.hypot(dx, dy) / 2 + AROUND_M)
        near = np.flatnonzero(np.abs(x - np.float32(bx)) <= reach)
        ox, oy, oz = x[near] - bx, y[near] - by, z[near] - bz
        cos, sin = np.cos(heading), np.sin(heading)
        inside = np.abs(cos * ox + sin * oy) <= dx / 2 + AROUND_M
        inside &= np.abs(cos * oy - sin * ox) <= dy / 2 + AROUND_M
        inside &= (oz >= AROUND_M - dz / 2) & (oz <= dz / 2 + AROUND_M)
        counts[i] = np.count_nonzero(inside)
    return counts
