"""Rotated boxes: footprints, exact overlap in float64, and the points inside boxes.

A box is `x y z dx dy dz heading`: geometric centre, length, width, height, and yaw about +z, in
metres and radians. Functions that compare two sets of boxes expect both in the same frame.
"""

from collections.abc import Callable

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, IntArray
from pyinfra.core.errors import Error

# An overlap area up to this share of the squared longest side of both boxes is a rounding error and
# counts as 0.
_ROUNDING = 1e-14
# Typical length, width and height of a car, and of a truck or bus, in metres.
CAR_M, LONG_M = (4.3, 1.85, 1.6), (9.0, 2.5, 3.2)
AROUND_M = 0.05  # points up to this far outside a box still belong to its vehicle
_CHUNK = 8192  # pairs per batch, so that temporary arrays stay in the cache

# Corners of the unit box, counter-clockwise from front right.
_CORNERS = np.array([[0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])


def footprints(boxes: FloatArray) -> FloatArray:
    """Returns the footprint corners (k, 4, 2) of boxes (k, 7), counter-clockwise."""
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    ahead = np.stack([cos, sin], axis=1) * boxes[:, 3:4] / 2
    left = np.stack([-sin, cos], axis=1) * boxes[:, 4:5] / 2
    corners = [ahead + left, left - ahead, -ahead - left, ahead - left]
    return boxes[:, None, :2] + np.stack(corners, axis=1)


def wrapped(angle: FloatArray) -> FloatArray:
    """Returns angles in [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def bev_iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the intersection over union (n, m), in [0, 1], of the footprints of boxes.

    Boxes a (n, 7) and b (m, 7) are in the same frame. A pair with no overlap gives exactly 0.
    """
    return _all_pairs(a, b, pair_bev_iou)


def bev_overlap(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the overlap areas (n, m) of footprints in m2, for boxes a (n, 7) and b (m, 7)."""
    return _all_pairs(a, b, pair_bev_overlap)


def points_in_box(points: Floats, box: FloatArray, around_m: float = AROUND_M) -> BoolArray:
    """Returns a mask (n,) of the points (n, 3 or more) that belong to the vehicle in a box (7,).

    Such points lie at most `around_m` outside the sides and the top of the box. They also lie at
    least `around_m` above its bottom, which excludes returns from the road.
    """
    x, y, z = (points[:, i] - points.dtype.type(box[i]) for i in range(3))
    cos, sin = points.dtype.type(np.cos(box[6])), points.dtype.type(np.sin(box[6]))
    inside = np.abs(cos * x + sin * y) <= box[3] / 2 + around_m
    inside &= np.abs(cos * y - sin * x) <= box[4] / 2 + around_m
    inside &= (z >= around_m - box[5] / 2) & (z <= box[5] / 2 + around_m)
    return np.asarray(inside)


def points_in_boxes(points: Floats, boxes: FloatArray) -> IntArray:
    """Counts the points of the vehicle in each box (k, 7). Returns the counts (k,).

    `points` is (n, 3 or more). `points_in_box` defines which points belong to a vehicle.
    """
    x = np.ascontiguousarray(points[:, 0])
    return np.array([len(rows_in_box(points, x, box)) for box in boxes], dtype=np.int64)


def rows_in_box(points: Floats, x: Floats, box: FloatArray, around_m: float = AROUND_M) -> IntArray:
    """Returns the indices (k,) of the points that `points_in_box` marks, but is faster.

    x: (n,) the first column of the points, contiguous.
    """
    reach = x.dtype.type(np.hypot(box[3], box[4]) / 2 + 2 * AROUND_M)
    near = np.flatnonzero(np.abs(x - x.dtype.type(box[0])) <= reach)
    return np.asarray(near[points_in_box(points[near], box, around_m)])


def pair_bev_iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the IoU (n,) of the footprints of n pairs of boxes: row i of a and row i of b."""
    overlap = pair_bev_overlap(a, b)
    return _ratio(overlap, a[:, 3] * a[:, 4] + b[:, 3] * b[:, 4] - overlap)


def pair_iou_3d(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the IoU (n,) of the volumes of n pairs of boxes: row i of a and row i of b."""
    # Coordinates relative to the centre of a avoid rounding errors in the sums.
    between = b[:, 2] - a[:, 2]
    top = np.minimum(a[:, 5] / 2, between + b[:, 5] / 2)
    bottom = np.maximum(-a[:, 5] / 2, between - b[:, 5] / 2)
    shared = pair_bev_overlap(a, b) * np.maximum(top - bottom, 0)
    volumes = a[:, 3] * a[:, 4] * a[:, 5] + b[:, 3] * b[:, 4] * b[:, 5]
    return _ratio(shared, volumes - shared)


def pair_bev_overlap(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the overlap area (n,) in m2 of the footprints of row i of a (n, 7) and b (n, 7).

    The function applies Green's theorem along the edges of b, in the frame of a. The overlap area
    equals the integral of clip(x) dy along the border of b, within the y range of a. Here, clip(x)
    limits x to the x range of a. The method needs no sorting and no special cases. The areas of
    equal and of touching boxes are therefore as exact as all other areas.
    """
    _check(a)
    _check(b)
    area = np.zeros(len(a))
    near = np.flatnonzero(centres_within_reach(a, b))
    for start in range(0, len(near), _CHUNK):
        part = near[start : start + _CHUNK]
        area[part] = _overlap(a[part], b[part])
    return area


def centres_within_reach(a: FloatArray, b: FloatArray) -> BoolArray:
    """Returns whether the circumscribed circles of the footprints of boxes a and b meet.

    Where the result is False, the footprints neither touch nor overlap. Rows of a and b broadcast.
    """
    apart = (a[..., 0] - b[..., 0]) ** 2 + (a[..., 1] - b[..., 1]) ** 2
    reach = _half_diagonal(a) + _half_diagonal(b)
    return np.asarray(apart <= reach * reach)


def _half_diagonal(a: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(a[..., 3] ** 2 + a[..., 4] ** 2) / 2)


def _overlap(a: FloatArray, b: FloatArray) -> FloatArray:
    length, width = a[:, 3, None], a[:, 4, None]
    x, y = _corners_seen_from(a, b)
    x_step, y_step = np.roll(x, -1, axis=1) - x, np.roll(y, -1, axis=1) - y
    from_y = np.clip(y, -width / 2, width / 2)
    to_y = np.roll(from_y, -1, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        enters = np.where(y_step == 0, 0, (from_y - y) / y_step)
        leaves = np.where(y_step == 0, 0, (to_y - y) / y_step)
    mean_x = _mean_clipped(x + enters * x_step, x + leaves * x_step, length / 2)
    area = (mean_x * (to_y - from_y)).sum(1)
    smaller = np.minimum(a[:, 3] * a[:, 4], b[:, 3] * b[:, 4])
    size = np.maximum(a[:, 3:5], b[:, 3:5]).max(1)
    area[area <= _ROUNDING * size * size] = 0  # boxes that only touch have no overlap
    return np.asarray(np.minimum(area, smaller))


def _corners_seen_from(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns x and y, (n, 4) each, of the corners of b in the frame of a."""
    cos, sin = np.cos(a[:, 6]), np.sin(a[:, 6])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    x, y = (cos * dx + sin * dy)[:, None], (cos * dy - sin * dx)[:, None]
    turn = b[:, 6] - a[:, 6]
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    ahead, left = b[:, 3, None] * _CORNERS[:, 0], b[:, 4, None] * _CORNERS[:, 1]
    return x + cos * ahead - sin * left, y + sin * ahead + cos * left


def _mean_clipped(start: FloatArray, end: FloatArray, limit: FloatArray) -> FloatArray:
    """Returns the mean of clip(x, -limit, limit) for x from start to end."""
    first, last = np.minimum(start, end), np.maximum(start, end)
    low, high = np.clip(first, -limit, limit), np.clip(last, -limit, limit)
    below = np.minimum(last, -limit) - np.minimum(first, -limit)
    above = np.maximum(last, limit) - np.maximum(first, limit)
    moment = limit * (above - below) + (high - low) * (high + low) / 2
    span = last - first
    return np.asarray(np.divide(moment, span, out=low, where=span > 0))


def _ratio(part: FloatArray, whole: FloatArray) -> FloatArray:
    """Returns part / whole, or 0 where the whole is 0."""
    return np.asarray(np.divide(part, whole, out=np.zeros_like(part), where=whole > 0))


def _all_pairs(
    a: FloatArray, b: FloatArray, measure: Callable[[FloatArray, FloatArray], FloatArray]
) -> FloatArray:
    _check(a)
    _check(b)
    result = np.zeros((len(a), len(b)))
    i, j = np.nonzero(centres_within_reach(a[:, None], b[None]))
    result[i, j] = measure(a[i], b[j])
    return result


def _check(boxes: FloatArray) -> None:
    if boxes.ndim != 2 or boxes.shape[1] != 7:
        raise Error(f"boxes: expected an array of shape (n, 7), got shape {boxes.shape}")
    wrong = np.flatnonzero(~(np.isfinite(boxes).all(axis=1) & (boxes[:, 3:6] >= 0).all(axis=1)))
    if len(wrong):
        raise Error(
            f"boxes: row {wrong[0]}: expected finite values and sizes of 0 or more, got "
            f"{boxes[wrong[0]].tolist()}"
        )
