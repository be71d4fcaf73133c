"""Windows: sections of the region whose detection quality is measured separately."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.dataset.outlines import in_any
from pyinfra.dataset.roads import Places, Road, offset_curve

REGION_M = 100.0  # a requested range of this value or more selects the whole region
WINDOW_M = 20.0  # length of a window along its road
WINDOW_STEP_M = 5.0  # distance between the centres of successive windows
EVERY_ROAD = -1


@dataclass(frozen=True)
class Window:
    """A section of one road, or of all roads: stations s in [middle - 10 m, middle + 10 m)."""

    road: int  # index of the road, or EVERY_ROAD for all roads
    middle: float

    def holds(self, places: Places) -> BoolArray:
        """Returns a mask (n,) of the positions in the window."""
        ahead = places.s - self.middle
        near = (ahead >= -WINDOW_M / 2) & (ahead < WINDOW_M / 2)
        return np.asarray(near & ((places.road == self.road) | (self.road == EVERY_ROAD)))


@dataclass(frozen=True)
class GridCell:
    """A 20 m square of a grid in the world frame, used for sites of lanes.

    Grid lines are at multiples of 20 m.
    """

    x: float  # x and y of the middle of the square
    y: float

    def holds(self, places: Places) -> BoolArray:
        """Returns a mask (n,) of the positions in the square and in the region."""
        ahead = places.xy - (self.x, self.y)
        near = (ahead >= -WINDOW_M / 2) & (ahead < WINDOW_M / 2)
        return np.asarray(near.all(axis=1) & places.inside)


@dataclass(frozen=True)
class Near:
    """The part of the region within a distance of the sensor.

    The distance is measured along the road, or horizontally at a site of lanes. A distance of
    REGION_M or more selects the whole region.
    """

    range_m: float
    # Position x y of the sensor in the world frame if the site consists of lanes, else None.
    centre: tuple[float, float] | None = None

    def holds(self, places: Places) -> BoolArray:
        """Returns a mask (n,) of the positions in this part."""
        if self.range_m >= REGION_M:
            return places.inside
        if self.centre is None:
            return np.asarray(places.inside & (np.abs(places.s) <= self.range_m))
        away = np.linalg.norm(places.xy - np.array(self.centre), axis=1)
        return np.asarray(places.inside & (away <= self.range_m))


def road_windows(roads: Sequence[Road]) -> list[Window]:
    """Returns windows of 20 m on each road, with centres at all multiples of 5 m."""
    return [window for i, road in enumerate(roads) for window in _windows(i, road.s[0], road.s[-1])]


def lane_windows(roads: Sequence[Road]) -> list[Window]:
    """Returns windows of 20 m that cover all roads together, with centres at multiples of 5 m.

    These windows are used at sites of lanes, which have hundreds of lanes. Some lanes are only a
    few metres long.
    """
    low, high = min(road.s[0] for road in roads), max(road.s[-1] for road in roads)
    return _windows(EVERY_ROAD, low, high)


def _windows(road: int, low: float, high: float) -> list[Window]:
    first, last = np.ceil(low / WINDOW_STEP_M - 1e-9), np.floor(high / WINDOW_STEP_M + 1e-9)
    return [Window(road, float(WINDOW_STEP_M * step)) for step in np.arange(first, last + 1)]


def region_cells(roads: Sequence[Road], outlines: Sequence[FloatArray]) -> list[GridCell]:
    """Returns the grid cells that contain a part of the region, sorted by x, then y."""
    sides = [
        offset_curve(road.xy, road.heading, side * road.half_width)
        for road in roads
        for side in (1, 0, -1)
    ]
    points = np.concatenate(sides)
    points = points[in_any(outlines, points, 0.0)]
    cells = np.unique(np.floor(points / WINDOW_M), axis=0)
    return [GridCell(float(x), float(y)) for x, y in WINDOW_M * (cells + 0.5)]


def distance_windows(farthest: float) -> list[Window]:
    """Returns windows of 20 m at steps of 5 m, from the sensor to the farthest object.

    There is at least one window.
    """
    middles = np.arange(WINDOW_M / 2, max(farthest, 1e-9) + WINDOW_M / 2, WINDOW_STEP_M)
    return [Window(0, float(middle)) for middle in middles]
