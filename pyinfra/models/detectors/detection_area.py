"""The area around a sensor that a network uses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors.batch import Area

MARGIN_M = 1.0
REGION_MARGIN_M = 8.0  # half a long vehicle, so that vehicles centred at the border are included


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
    every = np.concatenate([np.empty((0, 7)), *boxes])
    if len(every) == 0:
        raise Error("expected a vehicle in the training frames, got none")
    cos, sin = np.abs(np.cos(every[:, 6])), np.abs(np.sin(every[:, 6]))
    half = (
        np.stack(
            [cos * every[:, 3] + sin * every[:, 4], sin * every[:, 3] + cos * every[:, 4]], axis=1
        )
        / 2
    )
    bottom = every[:, 2] - every[:, 5] / 2
    low = [*(every[:, :2] - half).min(axis=0), bottom.min()]
    high = [*(every[:, :2] + half).max(axis=0), (bottom + every[:, 5]).max()]
    x0, y0, z0 = (float(v) - MARGIN_M for v in low)
    x1, y1, z1 = (float(v) + MARGIN_M for v in high)
    if regions:
        (x0, y0), (x1, y1) = _ends(regions)
    return Site(Area((x0, y0, z0), (x1, y1, z1)))


def around(region: Region, site: Site) -> Site:
    """Returns the site with x and y of a region; z is unchanged."""
    low, high = _ends([region])
    area = Area((*low, site.area.low[2]), (*high, site.area.high[2]))
    return Site(area, site.floor_z)


def _ends(regions: Sequence[Region]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Returns the lowest and the highest x, y of regions with the margin."""
    corners = np.concatenate([region.corners for region in regions])
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    margin = REGION_MARGIN_M
    return (float(x0) - margin, float(y0) - margin), (float(x1) + margin, float(y1) + margin)
