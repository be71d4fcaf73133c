"""The static surroundings of a sensor: roads with lanes and a vertical profile, and buildings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, Floats
from pyinfra.dataset.roads import Road, locate, offset_curve, read_roads
from pyinfra.formats import kitti
from pyinfra.formats.yaml_file import YamlNode


@dataclass(frozen=True, eq=False)
class Profile:
    """The height of the road as a polyline over the station, constant beyond the polyline's ends.

    A parabola of length `curve_m` replaces each corner of the polyline.
    """

    start: FloatArray  # (2,) x, y of station 0, metres
    heading: float  # direction of increasing stations, radians
    points: FloatArray  # (n, 2) station and rise, metres
    curve_m: float

    def rise_m(self, xy: FloatArray) -> FloatArray:
        """Returns the rise in metres at positions (..., 2) in the world frame."""
        axis = np.array([np.cos(self.heading), np.sin(self.heading)])
        beyond = ((xy - self.start) @ axis)[..., None] - self.points[:, 0]
        steps = np.diff(self.points, axis=0)
        changes = np.diff(steps[:, 1] / steps[:, 0], prepend=0, append=0)
        on_curve = np.clip(beyond + self.curve_m / 2, 0, self.curve_m)
        after = np.maximum(beyond - self.curve_m / 2, 0)
        lifted = (on_curve**2 / (2 * self.curve_m) + after) @ changes
        return np.asarray(self.points[0, 1] + lifted)


def profile_of(node: YamlNode) -> Profile:
    """Reads a profile. Raises FormatError with file, line and key."""
    return Profile(
        start=np.array([node.at("x_m").number(), node.at("y_m").number()]),
        heading=float(np.radians(node.at("heading_deg").number())),
        points=np.array([_station_and_rise(pair) for pair in node.at("points_m").items()]),
        curve_m=node.at("vertical_curve_m").number(),
    )


def _station_and_rise(node: YamlNode) -> list[float]:
    pair = [number.number() for number in node.items()]
    if len(pair) != 2:
        node.fail(f"expected 2 numbers (station and rise), got {len(pair)}")
    return pair


@dataclass(frozen=True)
class Lanes:
    """Lanes of a road, as `dataset.yaml` stores them."""

    each_way: int
    width_m: float
    median_m: float
    one_way: bool = False

    def lines(self) -> dict[float, bool]:
        """Maps the offset of each lane line to whether the line is solid.

        Offsets are in metres to the left of the centreline, ascending.
        """
        solid = [i in (0, self.each_way) for i in range(self.each_way + 1)]
        if self.one_way:
            return {(i - (self.each_way / 2)) * self.width_m: s for i, s in enumerate(solid)}
        aside = [self.median_m / 2 + i * self.width_m for i in range(self.each_way + 1)]
        one_side = dict(zip(aside, solid, strict=True))
        return {-a: s for a, s in reversed(one_side.items())} | one_side


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Roads of the region, lanes, buildings and mounts, in the world frame, metres and radians."""

    roads: tuple[Road, ...]
    lanes: dict[str, Lanes]  # maps road names to lanes; empty for a recording
    buildings: FloatArray  # (k, 7) boxes of the buildings
    further_mounts: FloatArray  # (k, 3) positions of a fused data set's mounts, except the first


@dataclass(frozen=True, eq=False)
class RoadLine:
    """A line along a road: an edge of the road, or a painted lane line."""

    kind: Literal["edge", "solid", "dashed"]
    xyz: FloatArray  # (n, 3) points in the world frame; NaN where another road crosses


def read_surroundings(data_set: Path) -> Surroundings:
    """Reads the surroundings of a data set.

    The surroundings of a folder without dataset.yaml are empty. Raises OSError, and FormatError
    with file and line.
    """
    file, roads = data_set / "dataset.yaml", data_set / "roads.csv"
    if not file.is_file():
        return Surroundings((), {}, np.zeros((0, 7)), np.zeros((0, 3)))
    top = kitti.read_yaml(file)
    known = roads.is_file() or bool(list(top.entries("roads")))
    return surroundings_of(top, read_roads(roads) if known else [])


def surroundings_of(top: YamlNode, roads: Sequence[Road]) -> Surroundings:
    """Builds the surroundings from a scene's keys and its roads. Raises FormatError."""
    lanes = {road.at("name").text(): _lanes(road.at("lanes")) for road in top.entries("roads")}
    buildings = np.array([_building(node) for node in top.entries("buildings")]).reshape(-1, 7)
    mounts = [_position(mount) for mount in top.values("mounts")]
    if (profile := top.maybe("profile")) is not None:
        buildings[:, 2] += profile_of(profile).rise_m(buildings[:, :2])
    return Surroundings(
        roads=tuple(roads),
        lanes=lanes,
        buildings=buildings,
        further_mounts=np.array(mounts[1:]).reshape(-1, 3),
    )


def _position(node: YamlNode) -> list[float]:
    return [node.at(key).number() for key in ("x_m", "y_m", "z_m")]


def _lanes(node: YamlNode) -> Lanes:
    return Lanes(
        each_way=int(node.at("each_way").number()),
        width_m=node.at("width_m").number(),
        median_m=node.at("median_m").number(),
        one_way=(one_way := node.maybe("one_way")) is not None and one_way.text() == "true",
    )


def _building(node: YamlNode) -> list[float]:
    """Returns a building as a box x y z dx dy dz heading."""
    keys = ("x_m", "y_m", "base_m", "length_m", "width_m", "height_m", "heading_deg")
    x, y, base, length, width, height, heading = (node.at(key).number() for key in keys)
    return [x, y, base + height / 2, length, width, height, np.radians(heading)]


def road_lines(around: Surroundings) -> Iterator[RoadLine]:
    """Yields the edges and lane lines of all roads."""
    for road in around.roads:
        lanes = around.lanes.get(road.name)
        painted = lanes.lines() if lanes else {}
        for side in (-1, 1):
            yield RoadLine("edge", _aside(around, road, side * road.half_width))
        for left_m, solid in painted.items():
            yield RoadLine("solid" if solid else "dashed", _aside(around, road, left_m))


def pieces(line: FloatArray, good: BoolArray, step: int) -> Iterator[FloatArray]:
    """Yields each run of two or more points of a line (n, m) in which the mask `good` (n,) is True.

    Each run is thinned by `step`, as in `thinned`.
    """
    edges = np.flatnonzero(np.diff(good)) + 1
    for part in np.split(np.arange(len(line)), edges):
        if good[part[0]] and len(part) > 1:
            yield thinned(line[part], step)


def thinned(line: FloatArray, step: int) -> FloatArray:
    """Returns every `step`-th point of a line (n, m), from the first, and the last point."""
    return np.append(line[:-1:step], line[-1:], axis=0)


def _aside(around: Surroundings, road: Road, left_m: Floats | float) -> FloatArray:
    """Returns a line (n, 3) at `left_m` to the left of a road's centreline.

    x and y are NaN where another road crosses.
    """
    line = offset_curve(road.xy, road.heading, left_m)
    others = [other for other in around.roads if other is not road]
    line[locate(line, others).inside] = np.nan
    return np.column_stack([line, road.z])
