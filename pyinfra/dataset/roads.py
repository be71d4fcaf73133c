"""The roads of a data set, and the positions of points along them.

Roads are the polylines of `roads.csv` in the world frame, with one point per metre. The station s
of a road or lane is 0 at its point nearest to the sensor. Lanes from a file have two additional
points, one at each end.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, IntArray
from pyinfra.core.errors import FormatError
from pyinfra.dataset.outlines import Drawn, in_any
from pyinfra.formats.text_table import ColumnRule, between, lines_of, rows_by_name

_MOST_STEPS = 1.5  # longest step between points of a road, relative to the median step
_CHUNK = 20_000  # number of points that are processed together

ROAD_COLUMNS = ["road", "s", "x", "y", "z", "heading", "half_width"]
_RULES = (
    between(["s", "x", "y", "z"], -1e6, 1e6),
    ColumnRule(("half_width",), lambda v: (v > 0) & (v <= 1000), "more than 0, at most 1000"),
)


@dataclass(frozen=True, eq=False)
class Road:
    """The centreline of a road within the region, in the world frame, metres and radians."""

    name: str
    s: FloatArray  # (n,) station, increasing
    xy: FloatArray  # (n, 2) x y of the centreline
    z: FloatArray  # (n,) z of the centreline
    heading: FloatArray  # (n,) heading of the road
    half_width: FloatArray  # (n,) half width of the carriageway

    @property
    def outline(self) -> FloatArray:
        """Both edges of the carriageway as one ring (2 n, 2)."""
        return strip(self.xy, self.heading, self.half_width)


@dataclass(frozen=True, eq=False)
class Places:
    """Road and station of n points. Each point belongs to the nearest road that contains it."""

    road: IntArray  # (n,) index into the roads; -1 outside the region
    s: FloatArray  # (n,) station in metres; NaN outside the region
    xy: FloatArray  # (n, 2) x y, in the world frame if roads are known, else in the levelled frame

    @property
    def inside(self) -> BoolArray:
        return self.road >= 0


def read_roads(file: Path) -> list[Road]:
    """Reads the roads of a data set, in file order. Raises FormatError with file and line."""
    return roads_of(lines_of(file, whole=True), file)


def roads_of(lines: Sequence[str], file: Path) -> list[Road]:
    """Parses roads from lines of text. Raises FormatError, whose message names `file`."""
    roads = rows_by_name(lines, file, ROAD_COLUMNS, _RULES)
    return [_road(name, values, file) for name, values in roads.items()]


def _road(name: str, values: FloatArray, file: Path) -> Road:
    if len(values) < 2:
        raise FormatError(f"{file}: road {name}: expected two or more rows, got {len(values)}")
    steps = np.diff(values[:, 0])  # lanes from a file have shorter steps at their ends
    if not (steps > 0).all():
        at = int(np.flatnonzero(~(steps > 0))[0])
        raise FormatError(
            f"{file}: road {name}: s: expected ascending values, got {values[at + 1, 0]:g} after "
            f"{values[at, 0]:g}"
        )
    if steps.max() > _MOST_STEPS * max(1.0, np.median(steps)):
        raise FormatError(
            f"{file}: road {name}: s: expected even steps, got {steps.max():g} m after "
            f"{values[steps.argmax(), 0]:g}; are rows missing?"
        )
    s, x, y, z, heading, half_width = values.T
    return Road(name, s, np.column_stack([x, y]), z, heading, half_width)


def offset_curve(centre: FloatArray, heading: FloatArray, left_m: Floats | float) -> FloatArray:
    """Returns the curve (n, 2) that is `left_m` to the left of a centreline (n, 2).

    `left_m` is one number or (n,), in metres.
    """
    aside = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    return np.asarray(centre + aside * np.reshape(left_m, (-1, 1)))


def strip(centre: FloatArray, heading: FloatArray, half_width: FloatArray) -> FloatArray:
    """Returns both edges of a road with centreline (n, 2) as one ring (2 n, 2)."""
    left = offset_curve(centre, heading, half_width)
    return np.concatenate([left, offset_curve(centre, heading, -half_width)[::-1]])


def locate(
    points: FloatArray,
    roads: list[Road],
    outlines: Sequence[FloatArray] = (),
    *,
    margin_m: float = 0.0,
) -> Places:
    """Assigns world-frame points (n, 2) to roads. Points outside all outlines get no road.

    A margin widens and lengthens the roads, and widens the outlines.
    """
    nearest = np.full(len(points), np.inf)
    places = Places(np.full(len(points), -1), np.full(len(points), np.nan), points)
    counts = in_any(outlines, points, margin_m)
    for index, road in enumerate(roads):
        rows = np.flatnonzero(counts & _near(points, road, margin_m))
        for start in range(0, len(rows), _CHUNK):
            part = rows[start : start + _CHUNK]
            s, aside, half_width = _project(points[part], road)
            inside = (s >= road.s[0] - margin_m) & (s <= road.s[-1] + margin_m)
            inside &= aside <= half_width + margin_m
            better = inside & (aside < nearest[part])
            part, s, aside = part[better], s[better], aside[better]
            nearest[part] = aside
            places.road[part] = index
            places.s[part] = s
    return places


def _near(points: FloatArray, road: Road, margin_m: float) -> BoolArray:
    """Returns which points (n, 2) lie in the bounding rectangle of a road plus the margin."""
    reach = road.half_width.max() + 2 * margin_m + 1e-6
    low, high = road.xy.min(axis=0) - reach, road.xy.max(axis=0) + reach
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def by_distance(points: FloatArray, drawn: Drawn | None = None, *, margin_m: float = 0.0) -> Places:
    """Assigns points to a single unnamed road whose s is the distance from the sensor.

    The points (n, 2 or more) are in the levelled frame. Points that are outside the drawn area by
    more than the margin are outside the region.
    """
    xy = points[:, :2]
    inside = np.ones(len(xy), np.bool_) if drawn is None else drawn.holds(xy, margin_m)
    s = np.where(inside, np.hypot(xy[:, 0], xy[:, 1]), np.nan)
    return Places(np.where(inside, 0, -1), s, xy)


def _project(points: FloatArray, road: Road) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns station, distance from the centreline and half width of the road, (n,) each.

    The first and last segments of the road are extended as straight lines, so that s is also
    defined beyond the ends.
    """
    base = road.xy[0]
    line, points = road.xy - base, points - base
    # Squared distance |p - v|^2 of point p and vertex v, without |p|^2, which is equal for all v.
    nearest = ((line**2).sum(1) - 2 * points @ line.T).argmin(1)
    best_s = np.full(len(points), np.nan)
    best = np.full(len(points), np.inf)
    for first in (nearest - 1, nearest):
        piece = np.clip(first, 0, len(line) - 2)
        step = line[piece + 1] - line[piece]
        t = ((points - line[piece]) * step).sum(1) / (step**2).sum(1)
        t = np.maximum(t, np.where(piece == 0, -np.inf, 0))
        t = np.minimum(t, np.where(piece == len(line) - 2, np.inf, 1))
        gap = points - line[piece] - t[:, None] * step
        aside = np.hypot(gap[:, 0], gap[:, 1])
        s = road.s[piece] + t * (road.s[piece + 1] - road.s[piece])
        best_s = np.where(aside < best, s, best_s)
        best = np.minimum(aside, best)
    return best_s, best, np.interp(best_s, road.s, road.half_width)
