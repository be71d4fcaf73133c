"""Ids and visibility of labels, from the `objects` that this package writes beside them."""

from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.formats import kitti


def known_objects(file: Path, labels: kitti.Labels) -> tuple[IntArray, FloatArray] | None:
    """Returns ids and visibility (k,) of labels, whose objects are in `file` in the same order.

    The labels have all objects, or those with a point. Returns None if the file does not exist or
    has other objects. Raises FormatError.
    """
    if not file.is_file():
        return None
    objects = kitti.read_objects(file)
    rows = np.arange(len(objects))
    if len(rows) != len(labels):
        rows = np.flatnonzero(objects.points > 0)
    if not np.array_equal(objects.names[rows], labels.names):
        return None
    return objects.ids[rows], objects.visibility[rows]
