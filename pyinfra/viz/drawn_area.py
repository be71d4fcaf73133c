"""The area that a picture shows, in the plane of its axes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, Floats

MARGIN_M = 12.0
HALF_HEIGHT_M = 32.0  # minimum half-height of a picture, above and below its middle


@dataclass(frozen=True)
class DrawnArea:
    """The drawn part of a plane."""

    x: tuple[float, float]
    y: tuple[float, float]

    def shape(self) -> tuple[float, float]:
        return self.x[1] - self.x[0], self.y[1] - self.y[0]

    def holds(self, xy: Floats) -> BoolArray:
        """Returns whether positions (n, 2) lie in the area: (n,) bool."""
        low, high = np.transpose([self.x, self.y])
        return np.asarray(((xy >= low) & (xy <= high)).all(axis=1))


def window_around(outlines: Sequence[FloatArray]) -> DrawnArea:
    """Returns an area around road outlines (n, 2), with a margin and a minimum height."""
    x, y = np.concatenate(outlines).T
    middle = (y.min() + y.max()) / 2
    half = max((y.max() - y.min()) / 2 + MARGIN_M, HALF_HEIGHT_M)
    return DrawnArea(
        (float(x.min() - MARGIN_M), float(x.max() + MARGIN_M)),
        (float(middle - half), float(middle + half)),
    )
