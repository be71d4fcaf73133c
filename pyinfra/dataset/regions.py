"""Positions along roads, the evaluation region, and windows of distance.

Roads are the polylines of `roads.csv` in the world frame, with one point per metre. The station s
is 0 at the foot of the sensor. Lanes of a file also have their end points, and s = 0 where a lane
is nearest to the foot.

A position is inside the region if it lies within the width of a road and between the road's first
and last s. If outlines restrict the region, it must also lie in one of them. Where no roads are
known, a user's outline may define the region.
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

REGION_FILE = "region.yaml"  # in a LiDAR's folder: an outline drawn by the user
REGION_M = 100.0  # a range of this or more selects the whole region
WINDOW_M = 20.0  # length of a window along its road
WINDOW_STEP_M = 5.0  # distance between the middles of successive windows
EVERY_ROAD = -1
FOOTWAYS_M = 6.0  # beside a carriageway, pedestrians and cyclists count too, as in the simulator
AXES_MARGIN_M = 2.0  # beside a carriageway; vehicles at its edge still have the road's axis
_CHUNK = 20_000

ROAD_COLUMNS = ["road", "s", "x", "y", "z", "heading", "half_width"]
_RULES = (
    between(["s", "x", "y", "z"], -1e6, 1e6),
    ColumnRule(("half_width",), lambda v: (v > 0) & (v <= 1000), "more than 0 to 1000"),
)


@dataclass(frozen=True, eq=False)
class Region:
    """The evaluation region, in the levelled LiDAR frame."""

    # Arguments: positions (n, 2 or more) and a margin in metres. Returns (n,) whether each position
    # lies in the region, or outside by at most the margin.
    holds: Callable[[FloatArray, float], BoolArray]
    corners: FloatArray  # (k, 2) points whose extent encloses the region
    # Maps positions (n, 2) to sine and cosine (n, 2) of twice the heading of the roads there. The
    # vector has length 1 on one road, is shorter where several roads cross, and 0 off the roads.
    # None if no roads are known.
    axes: Callable[[FloatArray], FloatArray] | None = None


@dataclass(frozen=True, eq=False)
class Road:
    """Centreline of a road within the region; world frame, metres, radians."""

    name: str
    s: FloatArray  # (n,) increasing
    xy: FloatArray  # (n, 2)
    z: FloatArray  # (n,)
    heading: FloatArray  # (n,)
    half_width: FloatArray  # (n,)


@dataclass(frozen=True, eq=False)
class Places:
    """Road and station of n points: the nearest road that contains each, and s along it."""

    road: IntArray  # (n,) index into the roads; -1 outside the region
    s: FloatArray  # (n,) metres; NaN outside the region
    xy: FloatArray  # (n, 2) world frame if roads are known, else levelled frame

    @property
    def inside(self) -> BoolArray:
        return self.road >= 0


@dataclass(frozen=True)
class Outline:
    """A region outline drawn by the user, in the levelled LiDAR frame; a YAML file."""

    outline_m: tuple[tuple[float, float], ...] = ruled(low=-1e4, high=1e4)  # corners x y, in order

    def __post_init__(self) -> None:
        if len(self.outline_m) < 3:
            raise Error(f"outline_m: expected 3 or more corners, got {len(self.outline_m)}")
        x, y = np.transpose(self.outline_m)
        if abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) == 0:
            raise Error("outline_m: expected an outline with an area, got none")
        if (crossing := first_crossing(np.array(self.outline_m))) is not None:
            a, b = crossing
            raise Error(
                f"outline_m: expected sides that do not cross, got side {a + 1} across side {b + 1}"
            )


@dataclass(frozen=True)
class Window:
    """A section of one road, or of all roads: s in [middle - 10 m, middle + 10 m)."""

    road: int  # EVERY_ROAD, or an index into the roads
    middle: float

    def holds(self, places: Places) -> BoolArray:
        """Returns (n,) whether each position lies in the window."""
        ahead = places.s - self.middle
        near = (ahead >= -WINDOW_M / 2) & (ahead < WINDOW_M / 2)
        return np.asarray(near & ((places.road == self.road) | (self.road == EVERY_ROAD)))


@dataclass(frozen=True)
class GridCell:
    """A 20 m square of a world-frame grid with lines at multiples of 20 m; used for lane sites."""

    x: float  # of the square's middle
    y: float

    def holds(self, places: Places) -> BoolArray:
        """Returns (n,) whether each position lies in the square and in the region."""
        ahead = places.xy - (self.x, self.y)
        near = (ahead >= -WINDOW_M / 2) & (ahead < WINDOW_M / 2)
        return np.asarray(near.all(axis=1) & places.inside)


@dataclass(frozen=True)
class Near:
    """The part of the region within a distance of the sensor.

    The distance is measured along the road, or horizontally at a site of lanes. REGION_M or more
    selects the whole region.
    """

    range_m: float
    centre: tuple[float, float] | None = None  # x y of the sensor in the world; only with lanes

    def holds(self, places: Places) -> BoolArray:
        """Returns (n,) whether each position lies in this part."""
        if self.range_m >= REGION_M:
            return places.inside
        if self.centre is None:
            return np.asarray(places.inside & (np.abs(places.s) <= self.range_m))
        away = np.linalg.norm(places.xy - np.array(self.centre), axis=1)
        return np.asarray(places.inside & (away <= self.range_m))


def read_roads(file: Path) -> list[Road]:
    """Reads the roads of a data set, in file order. Raises FormatError with file and line."""
    return roads_of(lines_of(file, whole=True), file)


def roads_of(lines: Sequence[str], file: Path) -> list[Road]:
    """Parses roads from lines of text; messages show `file`. Raises FormatError."""
    try:
        rows = list(csv.reader(lines))
    except csv.Error as error:
        raise FormatError(f"{file}: {error}") from None
    if not rows or rows[0] != ROAD_COLUMNS:
        header = ",".join(rows[0]) if rows else ""
        raise FormatError(f"{file}:1: expected '{','.join(ROAD_COLUMNS)}', got '{header}'")
    table = NamedRows(file, range(2, 1 + len(rows)), rows[1:], ROAD_COLUMNS, "road")
    table.check(_RULES)
    if len(rows) == 1:
        raise FormatError(f"{file}:1: expected a road, got none")
    names = dict.fromkeys(table.names.tolist())
    return [_road(name, table.values[table.names == name], file) for name in names]


def _road(name: str, values: FloatArray, file: Path) -> Road:
    if len(values) < 2 or not (np.diff(values[:, 0]) > 0).all():
        raise FormatError(f"{file}: road {name}: s: expected ascending values, got others")
    s, x, y, z, heading, half_width = values.T
    return Road(name, s, np.column_stack([x, y]), z, heading, half_width)


def offset_curve(centre: FloatArray, heading: FloatArray, left_m: Floats | float) -> FloatArray:
    """Returns the curve (n, 2) at `left_m` (scalar or (n,)) to the left of a centreline (n, 2)."""
    aside = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    return np.asarray(centre + aside * np.reshape(left_m, (-1, 1)))


def to_world(points: FloatArray, pose: WorldPose) -> FloatArray:
    """Transforms points (n, 2 or more) of a levelled frame to x y (n, 2) in the world frame."""
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    x, y = points[:, 0], points[:, 1]
    return np.stack([pose.x + cos * x - sin * y, pose.y + sin * x + cos * y], axis=1)


def to_levelled(points: FloatArray, pose: WorldPose) -> FloatArray:
    """Transforms world-frame points (n, 2) to x y (n, 2) in a levelled frame."""
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    x, y = points[:, 0] - pose.x, points[:, 1] - pose.y
    return np.stack([cos * x + sin * y, -sin * x + cos * y], axis=1)


def roads_region(roads: list[Road], pose: WorldPose, outlines: Sequence[FloatArray] = ()) -> Region:
    """Returns the evaluation region in the levelled frame at `pose`; outlines: world frame."""
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
    """Returns the corners (2, 2) of the intersection of both axis-parallel bounding boxes."""
    return np.stack([np.maximum(a.min(0), b.min(0)), np.minimum(a.max(0), b.max(0))])


def road_axes(roads: list[Road], pose: WorldPose, positions: FloatArray) -> FloatArray:
    """Returns the axes (n, 2) as described at `Region.axes`.

    Each road extends AXES_MARGIN_M beyond its carriageway on both sides.
    """
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
    """Returns the evaluation region of a LiDAR's folder, or None if it is unknown.

    It follows the data set's roads, else the outline in the LiDAR's folder. Raises FormatError for
    roads, and ConfigError for an outline.
    """
    data_set = data_set_of(lidar_folder)
    if (roads := data_set / "roads.csv").is_file():
        return roads_region(read_roads(roads), pose, read_outlines(data_set))
    corners = drawn_outline(lidar_folder)
    return None if corners is None else region_within(corners)


def outline_region(file: Path) -> Region:
    """Returns the region of an `Outline` file. Raises ConfigError with file, line and key."""
    return region_within(read_outline(file))


def region_within(corners: FloatArray) -> Region:
    """Returns the region inside an outline with corners (m, 2), metres, levelled LiDAR frame."""
    return Region(partial(in_outline, corners), corners)


def drawn_outline(lidar_folder: Path) -> FloatArray | None:
    """Reads the user's outline (m, 2) in a LiDAR's folder, levelled frame; None without the file.

    Raises ConfigError with file, line and key.
    """
    file = lidar_folder / REGION_FILE
    return read_outline(file) if file.is_file() else None


def read_outline(file: Path) -> FloatArray:
    """Reads the corners (m, 2) of an `Outline` file. Raises ConfigError with file, line and key."""
    return np.array(read_config(file, Outline).outline_m, dtype=np.float64)


def locate(
    points: FloatArray,
    roads: list[Road],
    outlines: Sequence[FloatArray] = (),
    *,
    margin_m: float = 0.0,
) -> Places:
    """Assigns world-frame points (n, 2) to roads; points outside all outlines are outside.

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
    """Returns which points (n, 2) lie in the bounding rectangle of a road with its margin."""
    reach = road.half_width.max() + 2 * margin_m + 1e-6
    low, high = road.xy.min(axis=0) - reach, road.xy.max(axis=0) + reach
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def by_distance(
    points: FloatArray, outline: FloatArray | None = None, *, margin_m: float = 0.0
) -> Places:
    """Assigns points to a single unnamed road whose s is the distance from the sensor.

    points: (n, 2 or more), levelled frame. Points outside the outline (m, 2) by more than the
    margin are outside the region.
    """
    xy = points[:, :2]
    inside = in_any(() if outline is None else (outline,), xy, margin_m)
    s = np.where(inside, np.hypot(xy[:, 0], xy[:, 1]), np.nan)
    return Places(np.where(inside, 0, -1), s, xy)


def road_windows(roads: list[Road]) -> list[Window]:
    """Returns windows of 20 m on each road, with middles at all multiples of 5 m."""
    windows = []
    for index, road in enumerate(roads):
        first = np.ceil(road.s[0] / WINDOW_STEP_M - 1e-9)
        last = np.floor(road.s[-1] / WINDOW_STEP_M + 1e-9)
        middles = WINDOW_STEP_M * np.arange(first, last + 1)
        windows += [Window(index, float(middle)) for middle in middles]
    return windows


def lane_windows(roads: Sequence[Road]) -> list[Window]:
    """Returns windows of 20 m across all roads together, with middles at multiples of 5 m.

    Used for lanes, of which a site has hundreds, some only a few metres long.
    """
    low, high = min(road.s[0] for road in roads), max(road.s[-1] for road in roads)
    steps = np.arange(np.ceil(low / WINDOW_STEP_M - 1e-9), high / WINDOW_STEP_M + 1e-9)
    return [Window(EVERY_ROAD, float(WINDOW_STEP_M * step)) for step in steps]


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
    """Returns windows of 20 m, every 5 m from the sensor to the farthest object; at least one."""
    middles = np.arange(WINDOW_M / 2, max(farthest, 1e-9) + WINDOW_M / 2, WINDOW_STEP_M)
    return [Window(0, float(middle)) for middle in middles]


def _project(points: FloatArray, road: Road) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns station, distance from the centreline, and the road's half width there, (n,) each.

    The first and last segments are extended as straight lines, so that s is also defined beyond the
    ends.
    """
    base = road.xy[0]
    line, points = road.xy - base, points - base
    # |p - v|^2 without the term |p|^2, which is the same for all v.
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
