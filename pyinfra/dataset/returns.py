"""Computes points from hits with a function of the user, for models of returns in Python."""

from collections.abc import Callable
from typing import Any

import numpy as np

from pyinfra.core.arrays import AnyArray, Float32Array, IntArray, Records
from pyinfra.core.errors import Error
from pyinfra.formats import kitti

XYZI = ("x", "y", "z", "intensity")
MARGIN_M = 0.01  # points on a face count as inside their box, as in the simulator
HITS = np.dtype([*((name, "<f4") for name in XYZI), *kitti.FIELDS.descr])


def returned(
    function: Callable[..., Any], number: int, points: Float32Array, fields: Records
) -> tuple[Float32Array, Records]:
    """Returns the points (m, 4) and fields (m,) that a function computes from n hits.

    The function gets records (n,) of HITS, and a NumPy generator that depends only on the frame
    number. Raises Error if the function returns anything other than records of HITS.
    """
    hits = np.empty(len(points), HITS)
    for name, column in zip(XYZI, points.T, strict=True):
        hits[name] = column
    for name in fields.dtype.names or ():
        hits[name] = fields[name]
    made = function(hits, np.random.default_rng(number))
    if not isinstance(made, np.ndarray) or made.dtype != HITS or made.ndim != 1:
        raise Error(
            f"returns: expected an array (m,) with the fields of the hits, got "
            f"{type(made).__name__} {getattr(made, 'shape', '')}"
        )
    cloud = np.stack([made[name] for name in XYZI], axis=1)
    return cloud, made[list(kitti.FIELDS.names or ())].astype(kitti.FIELDS)


def counted(rows: AnyArray, points: Float32Array, object_ids: IntArray) -> AnyArray:
    """Returns object rows with the numbers of points (n, 4) on objects. object_ids: (n,)."""
    out = with_points_in_boxes(rows, points, object_ids)
    row, _ = _rows_of(rows, object_ids)
    out["points"] = np.bincount(row, minlength=len(rows))
    return out


def ids_once_per_ray(fields: Records) -> IntArray:
    """Returns the object id of each point of a fused frame: (n,).

    If two points of a ray lie on one object, the id of the second point is -1. The two points then
    count once, as in the simulator.
    """
    ids: IntArray = fields["object_id"].astype(np.int64)
    again = fields["echo"][1:] == 1
    for name in ("object_id", "ring", "time_s", "mount"):
        again &= fields[name][1:] == fields[name][:-1]
    ids[1:][again] = -1
    return ids


def with_points_in_boxes(rows: AnyArray, points: Float32Array, object_ids: IntArray) -> AnyArray:
    """Returns object rows with the numbers of an object's points (n, 4) in its boxes.

    object_ids: (n,) of the points. On grades, boxes are level here, but inclined in the simulator.
    """
    out = rows.copy()
    row, on_object = _rows_of(rows, object_ids)
    xyz, box = points[on_object, :3].astype(np.float64), rows[row]
    for at, column in (("", "points_in_box"), ("scan_", "points_in_scan_box")):
        x, y, z = (xyz[:, i] - box[f"{at}{axis}"] for i, axis in enumerate("xyz"))
        cos, sin = np.cos(box[f"{at}heading"]), np.sin(box[f"{at}heading"])
        inside = np.abs(cos * x + sin * y) <= box["dx"] / 2 + MARGIN_M
        inside &= np.abs(cos * y - sin * x) <= box["dy"] / 2 + MARGIN_M
        inside &= np.abs(z) <= box["dz"] / 2 + MARGIN_M
        out[column] = np.bincount(row[inside], minlength=len(rows))
    return out


def _rows_of(rows: AnyArray, object_ids: IntArray) -> tuple[IntArray, IntArray]:
    """Returns the object row (m,) of each point on an object, and the indices (m,) of the points.

    The ids of `rows` must ascend.
    """
    if not len(rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    row = np.searchsorted(rows["id"], object_ids).clip(max=len(rows) - 1)
    on_object = np.flatnonzero(rows["id"][row] == object_ids)
    return row[on_object], on_object
