"""Points from hits by a function of the user, for models of returns in Python."""

from collections.abc import Callable
from typing import Any

import numpy as np

from pyinfra.core.arrays import AnyArray, Float32Array, IntArray, Records
from pyinfra.core.errors import Error
from pyinfra.formats import kitti

XYZI = ("x", "y", "z", "intensity")
HITS = np.dtype([*((name, "<f4") for name in XYZI), *kitti.FIELDS.descr])


def returned(
    function: Callable[..., Any], number: int, points: Float32Array, fields: Records
) -> tuple[Float32Array, Records]:
    """Returns the points (m, 4) and fields (m,) that a function makes of hits (n,) of HITS.

    The function also gets a NumPy generator, which depends on the number of the frame alone. Raises
    Error if it returns something else than records of HITS.
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


def counted(rows: AnyArray, object_ids: IntArray) -> AnyArray:
    """Returns object rows whose `points` are the number of their id in `object_ids` (n,)."""
    out = rows.copy()
    ids, counts = np.unique(object_ids, return_counts=True)
    of_id = dict(zip(ids.tolist(), counts.tolist(), strict=True))
    out["points"] = [of_id.get(number, 0) for number in rows["id"].tolist()]
    return out
