"""A training frame of networks: points and boxes. This module needs no PyTorch."""

from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, Points
from pyinfra.core.boxes import points_in_box
from pyinfra.core.errors import Error


@dataclass(frozen=True, eq=False)
class Sample:
    """One training frame."""

    points: Points  # (n, 4 or 5) points x y z intensity [age]
    boxes: FloatArray  # (k, 7) boxes of the objects with a point of this LiDAR
    classes: IntArray | None = None  # (k,) class numbers of the boxes; None if all are 0
    height_m: float = field(default=0.0, kw_only=True)  # height of the sensor above z = 0
    # points (m, 4 or 5) in each box, if they were selected before
    objects: tuple[Points, ...] | None = field(default=None, kw_only=True)

    @property
    def numbers(self) -> IntArray:
        """(k,) class numbers of the boxes."""
        return np.zeros(len(self.boxes), np.int64) if self.classes is None else self.classes

    def points_of(self, i: int) -> Points:
        """Returns the points of the object in box i: (m, 4 or 5)."""
        if self.objects is not None:
            return self.objects[i]
        return self.points[points_in_box(self.points, self.boxes[i])]


def with_columns(points: Points, columns: int) -> Points:
    """Returns the first `columns` columns of points, which a network uses.

    Raises Error for a cloud without ages.
    """
    if points.shape[1] < columns:
        raise Error(
            f"points: expected {columns} columns, got {points.shape[1]}; the network uses the age "
            "of points in stacked frames"
        )
    return points[:, :columns]
