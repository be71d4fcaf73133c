"""The evaluation region of a LiDAR: the roads of its data set, or an outline drawn by the user.

A position is inside the region if it lies within the width of a road and between the road's first
and last station s. If outlines restrict the region, the position must also lie in one of the
outlines. If no roads are known, a user's outline may define the region.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.config import read_config, ruled
from pyinfra.core.errors import Error
from pyinfra.dataset.frames import data_set_of
from pyinfra.dataset.outlines import Drawn, area, first_crossing, read_outlines
from pyinfra.dataset.roads import Road, locate, offset_curve, read_roads
from pyinfra.dataset.world_frame import to_levelled, to_world
from pyinfra.formats.kitti import WorldPose

REGION_FILE = "region.yaml"  # file in a LiDAR's folder with an outline drawn by the user
# Width of the strip beside a carriageway that is part of the region of pedestrians and cyclists, as
# in the simulator.
FOOTWAYS_M = 6.0
# Width of the strip beside a carriageway in which `Region.axes` still returns the road's axis, so
# that vehicles at the edge of the road also have an axis.
AXES_MARGIN_M = 2.0


@dataclass(frozen=True, eq=False)
class Region:
    """The evaluation region, in the levelled LiDAR frame."""

    # Called with positions (n, 2 or more) and a margin in metres. Returns a mask (n,) of the
    # positions that lie in the region, or outside it by at most the margin.
    holds: Callable[[FloatArray, float], BoolArray]
    corners: FloatArray  # (k, 2) points whose bounding box encloses the region
    # Maps positions (n, 2) to axes (n, 2), which are sine and cosine of twice the heading of the
    # road at each position. The axis has length 1 on one road, is shorter where several roads
    # cross, and is 0 off the roads. `axes` is None if no roads are known.
    axes: Callable[[FloatArray], FloatArray] | None = None


Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Outline:
    """The content of a YAML file with an outline drawn by the user, in the levelled LiDAR frame."""

    # Corners x y, in order, of an area with one outline.
    outline_m: tuple[tuple[float, float], ...] = ruled(default=(), low=-1e4, high=1e4)
    # Corners of each outline of an area with several outlines.
    outlines_m: tuple[Corners, ...] = ruled(default=(), low=-1e4, high=1e4)
    # Corners of each hole in the area.
    holes_m: tuple[Corners, ...] = ruled(default=(), low=-1e4, high=1e4)

    def __post_init__(self) -> None:
        if not self.outline_m and not self.outlines_m:
            raise Error("expected `outline_m` or `outlines_m`, got neither")
        if self.outline_m:
            _check_outline("outline_m", self.outline_m)
        for key in ("outlines_m", "holes_m"):
            for i, corners in enumerate(getattr(self, key)):
                _check_outline(f"{key}.{i}", corners)

    @property
    def drawn(self) -> Drawn:
        outlines = (*((self.outline_m,) if self.outline_m else ()), *self.outlines_m)
        return Drawn(tuple(map(np.array, outlines)), tuple(map(np.array, self.holes_m)))


def _check_outline(key: str, corners: Corners) -> None:
    if len(corners) < 3:
        raise Error(f"{key}: expected 3 or more corners, got {len(corners)}")
    if area(np.array(corners)) == 0:
        raise Error(f"{key}: expected an outline with an area above 0, got an area of 0")
    if (crossing := first_crossing(np.array(corners))) is not None:
        a, b = crossing
        raise Error(
            f"{key}: expected sides that do not cross, got side {a + 1} across side {b + 1}"
        )


def drawn_of(value: object) -> Drawn:
    """Returns the area of corners (m, 2), a dict with the keys of `Outline`, or a polygon.

    A polygon is an object with `__geo_interface__` of type Polygon or MultiPolygon, such as those
    of shapely. Raises Error for another value.
    """
    geometry = getattr(value, "__geo_interface__", None)
    if isinstance(geometry, Mapping):
        value = _of_geometry(geometry)
    if not isinstance(value, Mapping):
        return Outline(outline_m=_pairs("corners", value)).drawn
    unknown = set(value) - {"outline_m", "outlines_m", "holes_m"}
    if unknown:
        raise Error(
            f"expected the keys outline_m, outlines_m and holes_m, got '{min(map(str, unknown))}'"
        )
    return Outline(
        _pairs("outline_m", value.get("outline_m", np.empty((0, 2)))),
        tuple(_pairs("outlines_m", ring) for ring in value.get("outlines_m", ())),
        tuple(_pairs("holes_m", ring) for ring in value.get("holes_m", ())),
    ).drawn


def _of_geometry(geometry: Mapping[str, Any]) -> dict[str, Any]:
    parts = {"Polygon": 1, "MultiPolygon": 2}.get(str(geometry.get("type")), 0)
    if not parts:
        raise Error(f"expected a Polygon or MultiPolygon, got {geometry.get('type')}")
    rings = geometry["coordinates"]
    polygons = [rings] if parts == 1 else list(rings)
    return {
        "outlines_m": [_open(polygon[0]) for polygon in polygons],
        "holes_m": [_open(ring) for polygon in polygons for ring in polygon[1:]],
    }


def _open(ring: Sequence[Sequence[float]]) -> list[tuple[float, ...]]:
    """Returns the corners of a ring without the last one, which repeats the first."""
    corners = [tuple(corner[:2]) for corner in ring]
    return corners[:-1] if len(corners) > 1 and corners[0] == corners[-1] else corners


def _pairs(name: str, value: object) -> Corners:
    try:
        corners = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise Error(
            f"{name}: expected an array (m, 2) of numbers, got {type(value).__name__}"
        ) from None
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise Error(f"{name}: expected an array (m, 2), got shape {corners.shape}")
    if not (finite := np.isfinite(corners).all(axis=1)).all():
        first = int(np.argmin(finite))
        raise Error(f"{name}: corner {first}: expected x and y, got {corners[first].tolist()}")
    return tuple((float(x), float(y)) for x, y in corners)


def roads_region(roads: list[Road], pose: WorldPose, outlines: Sequence[FloatArray] = ()) -> Region:
    """Returns the region in the levelled frame at `pose`. The outlines are in the world frame."""
    sides = [
        offset_curve(road.xy, road.heading, side * road.half_width)
        for road in roads
        for side in (1, -1)
    ]
    corners = to_levelled(np.concatenate(sides), pose)
    if outlines:
        drawn = to_levelled(np.concatenate(outlines), pose)
        # The new corners span the intersection of the bounding boxes of roads and outlines.
        corners = np.stack(
            [np.maximum(corners.min(0), drawn.min(0)), np.minimum(corners.max(0), drawn.max(0))]
        )
    return Region(
        partial(_on_roads, roads, pose, outlines), corners, partial(road_axes, roads, pose)
    )


def road_axes(roads: list[Road], pose: WorldPose, positions: FloatArray) -> FloatArray:
    """Returns the axes (n, 2) at positions (n, 2), as defined at `Region.axes`.

    Each road extends AXES_MARGIN_M beyond its carriageway on both sides.
    """
    total, count = np.zeros((len(positions), 2)), np.zeros((len(positions), 1))
    for road in roads:
        centre = to_levelled(road.xy, pose)
        reach = road.half_width.max() + AXES_MARGIN_M
        low, high = centre.min(axis=0) - reach, centre.max(axis=0) + reach
        rows = np.flatnonzero(((positions >= low) & (positions <= high)).all(axis=1))
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

    The roads of the data set define the region. Without roads, the outline in the LiDAR's folder
    defines it. Raises FormatError for roads, and ConfigError for an outline.
    """
    data_set = data_set_of(lidar_folder)
    if (roads := data_set / "roads.csv").is_file():
        return roads_region(read_roads(roads), pose, read_outlines(data_set))
    drawn = drawn_outline(lidar_folder)
    return None if drawn is None else region_within(drawn)


def outline_region(file: Path) -> Region:
    """Returns the region of an `Outline` file. Raises ConfigError with file, line and key."""
    return region_within(read_outline(file))


def region_within(drawn: Drawn) -> Region:
    """Returns the region inside an area, metres, levelled LiDAR frame."""
    return Region(drawn.holds, drawn.corners)


def drawn_outline(lidar_folder: Path) -> Drawn | None:
    """Reads the area that the user drew from a LiDAR's folder.

    The area is in the levelled frame. Returns None if the folder has no outline file. Raises
    ConfigError with file, line and key.
    """
    file = lidar_folder / REGION_FILE
    return read_outline(file) if file.is_file() else None


def read_outline(file: Path) -> Drawn:
    """Reads the area of an `Outline` file. Raises ConfigError with file, line and key."""
    return read_config(file, Outline).drawn
