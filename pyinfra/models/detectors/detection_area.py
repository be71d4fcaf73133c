"""The area around a sensor that a network uses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, Points
from pyinfra.core.errors import Error
from pyinfra.dataset.regions import Region

MARGIN_M = 1.0
REGION_MARGIN_M = 8.0  # half the length of a long vehicle that is centred at the region's border


@dataclass(frozen=True)
class Area:
    """The part of the levelled LiDAR frame that a detector uses, in metres."""

    low: tuple[float, float, float]  # lowest x, y and z
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise Error(f"area: expected low below high, got {self.low} to {self.high}")

    @property
    def size(self) -> tuple[float, float, float]:
        x, y, z = (b - a for a, b in zip(self.low, self.high, strict=True))
        return x, y, z

    def holds(self, xyz: Floats) -> BoolArray:
        """Returns which points xyz (n, 3) are finite and inside: (n,) bool. `high` is excluded."""
        low, high = np.array(self.low, xyz.dtype), np.array(self.high, xyz.dtype)
        inside = np.ones(len(xyz), dtype=np.bool_)
        for axis in range(3):  # column by column, which is five times as fast as all(axis=1)
            inside &= (xyz[:, axis] >= low[axis]) & (xyz[:, axis] < high[axis])
        return inside

    def crop(self, points: Points) -> Points:
        """Returns the points (n, 4 or more) that are inside and have finite intensities."""
        keep = self.holds(points[:, :3]) & np.isfinite(points[:, 3])
        return points[keep]

    def grown(self, step: float) -> Area:
        """Returns the area enlarged around its middle, so that x and y are multiples of `step`."""
        low, high = list(self.low), list(self.high)
        for axis in (0, 1):
            size = high[axis] - low[axis]
            more = (np.ceil(size / step - 1e-6) * step - size) / 2
            low[axis], high[axis] = float(low[axis] - more), float(high[axis] + more)
        return Area((low[0], low[1], low[2]), (high[0], high[1], high[2]))


@dataclass(frozen=True)
class Site:
    """An area with x, y of the levelled LiDAR frame and z measured from the local road; metres."""

    area: Area
    floor_z: float = 0.0


def site_of(boxes: Iterable[FloatArray], regions: Sequence[Region] = ()) -> Site:
    """Returns the area of some regions and boxes.

    x and y include the regions with a margin of 8 m, so the area is the same for all LiDARs of a
    site. If there is no region, x and y include the boxes with a margin of 1 m. z includes the
    boxes with a margin of 1 m. boxes: (k, 7) each, with z measured from the road. Raises Error if
    there is no box.
    """
    all_boxes = np.concatenate([np.empty((0, 7)), *boxes])
    if len(all_boxes) == 0:
        raise Error("expected one or more labelled vehicles in the training frames, got none")
    cos, sin = np.abs(np.cos(all_boxes[:, 6])), np.abs(np.sin(all_boxes[:, 6]))
    half = (
        np.stack(
            [
                cos * all_boxes[:, 3] + sin * all_boxes[:, 4],
                sin * all_boxes[:, 3] + cos * all_boxes[:, 4],
            ],
            axis=1,
        )
        / 2
    )
    bottom = all_boxes[:, 2] - all_boxes[:, 5] / 2
    low = [*(all_boxes[:, :2] - half).min(axis=0), bottom.min()]
    high = [*(all_boxes[:, :2] + half).max(axis=0), (bottom + all_boxes[:, 5]).max()]
    x0, y0, z0 = (float(v) - MARGIN_M for v in low)
    x1, y1, z1 = (float(v) + MARGIN_M for v in high)
    if regions:
        (x0, y0), (x1, y1) = _ends(regions)
    return Site(Area((x0, y0, z0), (x1, y1, z1)))


def around(region: Region, site: Site) -> Site:
    """Returns the site with its x and y limits replaced by those of a region."""
    low, high = _ends([region])
    area = Area((*low, site.area.low[2]), (*high, site.area.high[2]))
    return Site(area, site.floor_z)


def _ends(regions: Sequence[Region]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Returns the lowest and the highest x, y of regions with the margin."""
    corners = np.concatenate([region.corners for region in regions])
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    margin = REGION_MARGIN_M
    return (float(x0) - margin, float(y0) - margin), (float(x1) + margin, float(y1) + margin)
