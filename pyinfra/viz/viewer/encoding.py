"""Packs the points of a frame into a short text that viewer/src/decode.js reads.

A coordinate is a 16-bit number of steps above the minimum of the frame. Points are sorted so that
neighbouring cells follow each other. Each coordinate is stored as the difference to the previous
point, with all low bytes first, then all high bytes. The bytes are compressed with DEFLATE. A point
needs 2 to 3 bytes instead of 7 to 10 (docs/decisions/0006).
"""

import base64
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from pyinfra.core.arrays import Floats, IntArray
from pyinfra.core.errors import Error
from pyinfra.viz.viewer.frames import ViewFrame

STEP_M = 0.01  # coordinate step; it is larger if a frame is wider than 65,535 steps
CELL_M = 2.0
_LARGEST = 2**16 - 1
_LEVEL = 6  # compression level; level 9 takes four times as long and saves 2 %


def pack_points(view: ViewFrame, most_points: int | None = None) -> dict[str, Any]:
    """Returns the page's JSON data for the points of a frame.

    most_points: largest number of points. If a frame has more, a random sample is returned, which
    is the same in each run. The key `of` of the result is the number before sampling. Raises Error
    for a frame with more than 65,535 objects.
    """
    keep = _kept(len(view.points), most_points)
    points = view.points[keep].astype(np.float64)
    origin = points.min(axis=0, initial=np.inf) if len(points) else np.zeros(3)
    step = max(STEP_M, float((points - origin).max(initial=0)) / _LARGEST)
    coordinates = np.rint((points - origin) / step).astype(np.uint16)
    cells = coordinates[:, 1:] // np.uint16(CELL_M / STEP_M)
    order = np.lexsort((coordinates[:, 0], *cells.T))
    keep, coordinates = keep[order], coordinates[order]
    steps = np.diff(coordinates, axis=0, prepend=np.zeros((1, 3), np.uint16))
    columns = [*map(_split, steps.T), _byte(view.intensity[keep])]
    packed: dict[str, Any] = {"count": len(keep), "of": len(view.points), "step_m": step}
    packed["origin"] = origin.tolist()
    if view.time_s is not None:
        columns.append(_byte(view.time_s[keep] / view.period_s))
        packed["time"] = True
    if view.object_id is not None:
        ids, index = np.unique(view.object_id[keep], return_inverse=True)
        if len(ids) > _LARGEST:
            raise Error(f"frame {view.frame}: expected up to {_LARGEST} objects, got {len(ids)}")
        columns.append(_split(index.astype(np.uint16)))
        packed["objects"] = ids.tolist()
    packed["data"] = base64.b64encode(zlib.compress(b"".join(columns), _LEVEL)).decode()
    return packed


def _kept(count: int, most: int | None) -> IntArray:
    """Returns the indices of at most `most` of `count` points, ascending."""
    if most is None or count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, most, replace=False))


def _byte(share: Floats) -> bytes:
    """Returns values of [0, 1] as bytes, in 255 steps."""
    steps = np.asarray(np.rint(255 * np.clip(share, 0, 1)), dtype=np.uint8)
    return steps.tobytes()


def _split(words: npt.NDArray[np.uint16]) -> bytes:
    """Returns the low bytes, then the high bytes."""
    return (words & 255).astype(np.uint8).tobytes() + (words >> 8).astype(np.uint8).tobytes()
