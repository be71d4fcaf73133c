"""Where along which road something is, the evaluation region, and the windows of distance.

Roads are the polylines of `roads.csv` in the world frame: one point a metre, s = 0 at the foot of
the sensor; of lanes of a file also their ends, and s = 0 where a lane is nearest to the foot. A
place is inside the region if it lies within the width of a road and between the first and the last
s of its file, and in one of the outlines that narrow the region, if there are any. Where no roads
are known, a user's outline may stand for them.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, IntArray
from pyinfra.core.config import read_config, ruled
from pyinfra.core.errors import Error, FormatError
from pyinfra.dataset.frames import data_set_of
from pyinfra.dataset.outlines import first_crossing, in_any, in_outline, read_outlines
from pyinfra.formats.kitti import WorldPose
from pyinfra.formats.text_table import ColumnRule, NamedRows, between, lines_of

REGION_FILE = "region.yaml"  # in a LiDAR's folder: its user's Outline
REGION_M = 100.0  # to either side, or around a sensor: all of the region
WINDOW_M = 20.0  # length of a window along its road
WINDOW_STEP_M = 5.0  # from the middle of one to that of the next
EVERY_ROAD = -1
FOOTWAYS_M = 6.0  # beside a carriageway: people count there too, as in the simulator
AXES_MARGIN_M = 2.0  # beside a carriageway: vehicles at its edge have its axis too
_CHUNK = 20_000

ROAD_COLUMNS = ["road", "s", "x", "y", "z", "heading", "half_width"]
_RULES = (
    between(["s", "x", "y", "z"], -1e6, 1e6),
    ColumnRule(("half_width",), lambda v: (v > 0) & (v <= 1000), "more than 0 to 1000"),
)


@dataclass(frozen=True, eq=False)
class Region:
    """Where vehicles can be; levelled LiDAR frame."""

    # Which places (n, 2 or more) lie in it, or up to so many metres outside.
    holds: Callable[[FloatArray, float], BoolArray]
    corners: FloatArray  # (k, 2) that enclose it
    # Sine and cosine of twice the heading of the roads there (n, 2), of places (n, 2): of length 1
    # where there is one, shorter where several cross, 0 off the roads. None: no roads are known.
    axes: Callable[[FloatArray], FloatArray] | None = None


@dataclass(frozen=True, eq=False)
class Road:
    """Centreline of a road within the region; world frame, metres, radians."""

    name: str
    s: FloatArray  # (n,) rising
    xy: FloatArray  # (n, 2)
    z: FloatArray  # (n,)
    heading: FloatArray  # (n,)
    half_width: FloatArray  # (n,)


@dataclass(frozen=True, eq=False)
class Places:
    """Where n points are: the nearest of the roads that hold them, and the station along it."""

    road: IntArray  # (n,) index into the roads; -1 outside of the region
    s: FloatArray  # (n,) metres; nan outside
    xy: FloatArray  # (n, 2) world, if roads are known

    @property
    def inside(self) -> BoolArray:
        return self.road >= 0


@dataclass(frozen=True)
class Outline:
    """A file of a user's: where vehicles can be, in the levelled LiDAR frame."""

    outline_m: tuple[tuple[float, float], ...] = ruled(low=-1e4, high=1e4)  # corners x y, in order

    def __post_init__(self) -> None:
        if len(self.outline_m) < 3:
            raise Error(f"outline_m: found {len(self.outline_m)} corners, allowed 3 or more")
        x, y = np.transpose(self.outline_m)
        if abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) == 0:
            raise Error("outline_m: found no area, allowed an outline with one")
        if (crossing := first_crossing(np.array(self.outline_m))) is not None:
            a, b = crossing
            raise Error(f"outline_m: found side {a + 1} across side {b + 1}, allowed none")


@dataclass(frozen=True)
class Window:
    """A stretch of a road, or of every road: s in [middle - 10 m, middle + 10 m)."""

    road: int  # EVERY_ROAD, or an index
    middle: float

    def holds(self, places: Places) -> BoolArray:
        """(n,) bool: which of the places lie in it."""
        ahead = places.s - self.middle
        near = (ahead >= -WINDOW_M / 2) & (ahead < WINDOW_M / 2)
        return np.asarray(near & ((places.road == self.road) | (self.road == EVERY_ROAD)))


@dataclass(frozen=True)
class GridCell:
    """A square of 20 m in the world, cut along multiples of 20 m: an area of a site of lanes."""

    x: float  # of its middle
    y: float

    def holds(self, places: Places) -> BoolArray:
        """(n,) bool: which of the places lie in it."""
        ahead = places.xy - (self.x, self.y)
        near = (ahead >= -WINDOW_M / 2) & (ahead < WINDOW_M / 2)
        return np.asarray(near.all(axis=1) & places.inside)


@dataclass(frozen=True)
class Near:
    """What lies within a range: along a road to either side, at a site of lanes around the sensor.

    REGION_M is all of the region.
    """

    range_m: float
    centre: tuple[float, float] | None = None  # x y in the world, of a site of lanes

    def holds(self, places: Places) -> BoolArray:
        """(n,) bool: which of the places lie in it."""
        if self.range_m >= REGION_M:
            return places.inside
        if self.centre is None:
            return np.asarray(places.inside & (np.abs(places.s) <= self.range_m))
        away = np.linalg.norm(places.xy - np.array(self.centre), axis=1)
        return np.asarray(places.inside & (away <= self.range_m))


def read_roads(file: Path) -> list[Road]:
    """Roads of a data set, in the order of the file. Raises FormatError with file and line."""
    return roads_of(lines_of(file, whole=True), file)


def roads_of(lines: Sequence[str], file: Path) -> list[Road]:
    """The same from the lines of a file, or of a world that has none."""
    try:
        rows = list(csv.reader(lines))
    except csv.Error as error:
        raise FormatError(f"{file}: {error}") from None
    if not rows or rows[0] != ROAD_COLUMNS:
        header = ",".join(rows[0]) if rows else ""
        raise FormatError(f"{file}:1: found '{header}', allowed '{','.join(ROAD_COLUMNS)}'")
    table = NamedRows(file, range(2, 1 + len(rows)), rows[1:], ROAD_COLUMNS, "road")
    table.check(_RULES)
    if len(rows) == 1:
        raise FormatError(f"{file}:1: found no road, allowed one or more")
    names = dict.fromkeys(table.names.tolist())
    return [_road(name, table.values[table.names == name], file) for name in names]


def _road(name: str, values: FloatArray, file: Path) -> Road:
    if len(values) < 2 or not (np.diff(values[:, 0]) > 0).all():
        raise FormatError(f"{file}: road {name}: found s that does not rise, allowed rising s")
    s, x, y, z, heading, half_width = values.T
    return Road(name, s, np.column_stack([x, y]), z, heading, half_width)


def offset_curve(centre: FloatArray, heading: FloatArray, left_m: Floats | float) -> FloatArray:
    """The curve to the left of a centreline (n, 2), by metres that are one or (n,): (n, 2)."""
    aside = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    return np.asarray(centre + aside * np.reshape(left_m, (-1, 1)))


def to_world(points: FloatArray, pose: WorldPose) -> FloatArray:
    """Points (n, 2 or more) of a levelled frame as x y (n, 2) of the world."""
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    x, y = points[:, 0], points[:, 1]
    return np.stack([pose.x + cos * x - sin * y, pose.y + sin * x + cos * y], axis=1)


def to_levelled(points: FloatArray, pose: WorldPose) -> FloatArray:
    """Points (n, 2) of the world as x y (n, 2) of a levelled frame."""
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    x, y = points[:, 0] - pose.x, points[:, 1] - pose.y
    return np.stack([cos * x + sin * y, -sin * x + cos * y], axis=1)


def roads_region(roads: list[Road], pose: WorldPose, outlines: Sequence[FloatArray] = ()) -> Region:
    """The evaluation region in a levelled frame with that pose; outlines: in the world."""
    sides = [
        offset_curve(road.xy, road.heading, side * road.half_width)
        for road in roads
        for side in (1, -1)
    ]
    corners = to_levelled(np.concatenate(sides), pose)
    if outlines:
        corners = _common_corners(corners, to_levelled(np.concatenate(outlines), pose))
    return Region(
        partial(_on_roads, roads, pose, outlines), corners, partial(road_axes, roads, pose)
    )


def _common_corners(a: FloatArray, b: FloatArray) -> FloatArray:
    """(2, 2) of the rectangle along the axes in which both can have places."""
    return np.stack([np.maximum(a.min(0), b.min(0)), np.minimum(a.max(0), b.max(0))])


def road_axes(roads: list[Road], pose: WorldPose, positions: FloatArray) -> FloatArray:
    """See `Region.axes`; a road is as wide as its carriageway and AXES_MARGIN_M on both sides."""
    total, count = np.zeros((len(positions), 2)), np.zeros((len(positions), 1))
    for road in roads:
        centre = to_levelled(road.xy, pose)
        reach = road.half_width.max() + AXES_MARGIN_M
        low, high = centre.min(axis=0) - reach, centre.max(axis=0) + reach
        near = ((positions >= low) & (positions <= high)).all(axis=1)
        rows = np.flatnonzero(near)
        away, nearest = cKDTree(centre).query(positions[rows])
        on_it = away <= road.half_width[nearest] + AXES_MARGIN_M
        twice = 2 * (road.heading[nearest[on_it]] - pose.yaw)
        total[rows[on_it]] += np.stack([np.sin(twice), np.cos(twice)], axis=1)
        count[rows[on_it]] += 1
    return np.asarray(total / np.maximum(count, 1))


def _on_roads(
    roads: list[Road],
    pose: WorldPose,
    outlines: Sequence[FloatArray],
    points: FloatArray,
    margin_m: float,
) -> BoolArray:
    return locate(to_world(points, pose), roads, outlines, margin_m=margin_m).inside


def region_of(lidar_folder: Path, pose: WorldPose) -> Region | None:
    """Where vehicles can be: the data set's roads, else the LiDAR's outline; None if not known.

    Raises FormatError for roads, and ConfigError for an outline.
    """
    data_set = data_set_of(lidar_folder)
    if (roads := data_set / "roads.csv").is_file():
        return roads_region(read_roads(roads), pose, read_outlines(data_set))
    corners = drawn_outline(lidar_folder)
    return None if corners is None else region_within(corners)


def outline_region(file: Path) -> Region:
    """That of an `Outline` file. Raises ConfigError with file, line and key."""
    return region_within(read_outline(file))


def region_within(corners: FloatArray) -> Region:
    """That of an outline's corners (m, 2), metres, levelled LiDAR frame."""
    return Region(partial(in_outline, corners), corners)


def drawn_outline(lidar_folder: Path) -> FloatArray | None:
    """What its user drew, (m, 2), levelled; None without the file. Raises as `read_outline`."""
    file = lidar_folder / REGION_FILE
    return read_outline(file) if file.is_file() else None


def read_outline(file: Path) -> FloatArray:
    """The corners (m, 2) of an `Outline` file. Raises ConfigError with file, line and key."""
    return np.array(read_config(file, Outline).outline_m, dtype=np.float64)


def locate(
    points: FloatArray,
    roads: list[Road],
    outlines: Sequence[FloatArray] = (),
    *,
    margin_m: float = 0.0,
) -> Places:
    """Places of points (n, 2) in the world frame; outside of all outlines is outside of the region.

    A margin makes roads wider and longer, and outlines wider.
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
    """Which points (n, 2) are in a rectangle around a road that holds all of it."""
    reach = road.half_width.max() + 2 * margin_m + 1e-6
    low, high = road.xy.min(axis=0) - reach, road.xy.max(axis=0) + reach
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def by_distance(
    points: FloatArray, outline: FloatArray | None = None, *, margin_m: float = 0.0
) -> Places:
    """Places along one nameless road that leads away from the sensor: s is the distance.

    points: (n, 2 or more), levelled frame, of which those outside of an outline (m, 2) by more
    than the margin are outside of the region.
    """
    xy = points[:, :2]
    inside = in_any(() if outline is None else (outline,), xy, margin_m)
    s = np.where(inside, np.hypot(xy[:, 0], xy[:, 1]), np.nan)
    return Places(np.where(inside, 0, -1), s, xy)


def road_windows(roads: list[Road]) -> list[Window]:
    """Windows of 20 m whose middles are the multiples of 5 m on each road, its ends included."""
    windows = []
    for index, road in enumerate(roads):
        first = np.ceil(road.s[0] / WINDOW_STEP_M - 1e-9)
        last = np.floor(road.s[-1] / WINDOW_STEP_M + 1e-9)
        middles = WINDOW_STEP_M * np.arange(first, last + 1)
        windows += [Window(index, float(middle)) for middle in middles]
    return windows


def lane_windows(roads: Sequence[Road]) -> list[Window]:
    """The same of all roads at once, where these are lanes: hundreds, some of a few metres."""
    low, high = min(road.s[0] for road in roads), max(road.s[-1] for road in roads)
    steps = np.arange(np.ceil(low / WINDOW_STEP_M - 1e-9), high / WINDOW_STEP_M + 1e-9)
    return [Window(EVERY_ROAD, float(WINDOW_STEP_M * step)) for step in steps]


def region_cells(roads: Sequence[Road], outlines: Sequence[FloatArray]) -> list[GridCell]:
    """Those with some of the region, by x, then y."""
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
    """Windows of 20 m every 5 m from the sensor until the farthest object is in one, or one."""
    middles = np.arange(WINDOW_M / 2, max(farthest, 1e-9) + WINDOW_M / 2, WINDOW_STEP_M)
    return [Window(0, float(middle)) for middle in middles]


def _project(points: FloatArray, road: Road) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Station, distance from the centreline and half width there, (n,) each.

    The first and the last piece of the centreline go on straight, so that s tells what is beyond.
    """
    base = road.xy[0]
    line, points = road.xy - base, points - base
    # |p - v|^2 without |p|^2, which is the same for all v.
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
