"""Lines across roads at which tracks are counted: drawn by the user, or made from roads."""

import itertools
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.names import path_of, repeated
from pyinfra.dataset.data_set import is_of_lanes
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.frames import data_set_of
from pyinfra.dataset.loading import one_lidar
from pyinfra.dataset.roads import Road, read_roads
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.dataset.world_frame import to_levelled, to_world
from pyinfra.formats.yaml_file import read_yaml

BEYOND_M = 5.0  # distance of a junction's counting lines from the crossing carriageway
BRIDGE_M = 4.5  # minimum height difference at which one road is a bridge over the other
AHEAD_M = 30.0  # distance ahead of the sensor of the counting line of a road without junctions
COMPASS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
FARTHEST_M = 1e4  # largest coordinate of a line


@dataclass(frozen=True)
class Line:
    """A line across a road, in the levelled LiDAR frame, metres.

    Attributes
    ----------
    name : name of the line
    start, end : the ends of the line. A track that crosses it from its right to its left, as seen
        from start to end, has direction +1
    forward, backward : names of the directions +1 and -1
    group : name of the junction of which the line is an arm; +1 then leads into the junction.
        Empty for a line that stands alone
    """

    name: str
    start: tuple[float, float]
    end: tuple[float, float]
    forward: str = "forward"
    backward: str = "backward"
    group: str = ""

    def __post_init__(self) -> None:
        ends = np.array([self.start, self.end], dtype=np.float64)
        if ends.shape != (2, 2) or not (np.abs(ends) <= FARTHEST_M).all():
            raise Error(
                f"{self.name}: expected two points x, y within {FARTHEST_M:g} m, got "
                f"{self.start} and {self.end}"
            )
        if self.length_m < 0.5:
            raise Error(f"{self.name}: expected a line of 0.5 m or more, got {self.length_m:.2f} m")

    @property
    def length_m(self) -> float:
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    def distance(self, xy: FloatArray) -> FloatArray:
        """Returns the distances (n,) of positions (n, 2) from the line."""
        start, along = np.array(self.start), np.subtract(self.end, self.start)
        share = np.clip((xy - start) @ along / self.length_m**2, 0, 1)
        return np.asarray(np.hypot(*(xy - start - share[:, None] * along).T))


AnyLines: TypeAlias = (
    "FrameSequence | str | os.PathLike[str] | Mapping[str, npt.ArrayLike] | list[Line]"
)


def lines_of(site: AnyLines) -> list[Line]:
    """Returns the lines of a site.

    site : frames or a LiDAR's folder, whose roads have lines; a YAML file with `lines_m: {name:
        [[x, y], [x, y]]}`; the same as a mapping; or lines. Raises Error if there is no line.
    """
    frames = frames_of(site)
    if isinstance(site, list):
        lines = site
    elif isinstance(site, Mapping):
        lines = drawn({name: _ends(name, ends) for name, ends in site.items()})
    elif frames is None:
        lines = read_lines(path_of(site, "site"))
    else:
        if frames.lidar is None:
            raise Error(
                "site: expected lines, or frames with lidar.yaml; got frames without lidar.yaml"
            )
        lines = of_roads(roads_of_frames(frames), frames)
    if not lines:
        raise Error(
            "site: expected one or more lines or roads, got none; give a file with `lines_m`"
        )
    if twice := repeated([line.name for line in lines]):
        raise Error(f"site: expected a different name for each line, got '{twice}' twice")
    return lines


def _ends(name: str, ends: npt.ArrayLike) -> FloatArray:
    """Returns the points of a line as an array. Raises Error for values that are not numbers."""
    try:
        return np.asarray(ends, np.float64)
    except (TypeError, ValueError):
        raise Error(f"{name}: expected two points [[x, y], [x, y]], got {ends!r}") from None


def frames_of(site: AnyLines) -> FrameSequence | None:
    """Returns the frames of a site; None for lines and for a file of lines."""
    if isinstance(site, (list, Mapping)):
        return None
    if not isinstance(site, FrameSequence) and path_of(site, "site").is_file():
        return None
    return one_lidar(site, "site")


def read_lines(file: Path) -> list[Line]:
    """Reads `lines_m: {name: [[x, y], [x, y]]}`. Raises FormatError with file, line and key."""
    ends = {}
    for node in read_yaml(file).values("lines_m"):
        points = [[v.number(-FARTHEST_M, FARTHEST_M) for v in p.items()] for p in node.items()]
        if [len(point) for point in points] != [2, 2]:
            node.fail(f"expected two points [x, y], got {points}")
        ends[node.key.partition(".")[2]] = np.array(points)
    return drawn(ends)


def drawn(ends: Mapping[str, FloatArray]) -> list[Line]:
    """Returns lines from names and end points. Directions are compass points: x is E, y is N."""
    lines = []
    for name, points in ends.items():
        if points.shape != (2, 2):
            raise Error(f"{name}: expected two points, an array (2, 2), got {points.shape}")
        left = np.arctan2(points[1, 0] - points[0, 0], -(points[1, 1] - points[0, 1]))
        start, end = ((float(x), float(y)) for x, y in points)
        lines.append(Line(name, start, end, compass(left), compass(left + np.pi)))
    return lines


def roads_of_frames(frames: FrameSequence) -> list[Road]:
    """Returns the roads of frames; none for a recording without roads."""
    if isinstance(frames, SimulatedFrames):
        return list(frames.roads)
    assert isinstance(frames, RecordedFrames)
    file = data_set_of(frames.folder) / "roads.csv"
    return read_roads(file) if file.is_file() else []


def of_roads(roads: list[Road], frames: FrameSequence) -> list[Line]:
    """Returns a line at each arm of a junction of two roads, and one across each other road.

    The line across a road without junction is at the station nearest to the point AHEAD_M before
    the sensor, because a sensor sees little of the road below it. Raises Error for a junction of
    lanes, whose arms are not known.
    """
    assert frames.lidar is not None
    pose = frames.lidar.T_world_levelled
    lines, joined, lanes = list[Line](), set[int](), _of_lanes(frames)
    for (i, a), (j, b) in itertools.combinations(enumerate(roads), 2):
        at = _crossing(a, b)
        if at is None:
            continue
        if lanes:
            raise Error(
                f"site: expected roads, got the lanes {a.name} and {b.name}, which cross; draw "
                "lines of your own (`lines_m`) for `site` of `count` or `lines` of "
                "`evaluate_tracks`"
            )
        joined |= {i, j}
        for road, other, index in ((a, b, at[0]), (b, a, at[1])):
            away = float(other.half_width.max()) + BEYOND_M
            for side in (-1, 1):
                s = road.s[index] + side * away
                if road.s[0] <= s <= road.s[-1]:
                    lines.append(_across(road, s, -side, pose, f"{a.name} x {b.name}"))
    for i, road in enumerate(roads):
        if i not in joined:
            ahead = to_world(np.array([[AHEAD_M, 0.0]]), pose)
            nearest = np.hypot(*(road.xy - ahead).T).argmin()
            lines.append(_across(road, float(road.s[nearest]), 1, pose, ""))
    times = Counter(line.name for line in lines)
    return [
        replace(line, name=f"{line.name} ({line.group})") if times[line.name] > 1 else line
        for line in lines
    ]


def _of_lanes(frames: FrameSequence) -> bool:
    """Returns whether the roads of frames are lanes from a file."""
    if isinstance(frames, RecordedFrames):
        return is_of_lanes(data_set_of(frames.folder))
    return isinstance(frames, SimulatedFrames) and frames.of_lanes


def _across(road: Road, s: float, sign: int, pose: object, group: str) -> Line:
    """Returns the line across a road at station s. With `sign` -1, its direction +1 opposes s."""
    index = int(np.abs(road.s - s).argmin())
    heading = float(road.heading[index]) + (0 if sign > 0 else np.pi)
    left = np.array([-np.sin(heading), np.cos(heading)]) * (road.half_width[index] + 1)
    # Seen along `heading`, the line runs from left to right, so `heading` points to its left side.
    ends = to_levelled(np.array([road.xy[index] + left, road.xy[index] - left]), pose)  # type: ignore[arg-type]
    start, end = ((float(x), float(y)) for x, y in ends)
    ahead, back = compass(heading), compass(heading + np.pi)
    name = f"{road.name} {back}" if group else road.name
    return Line(name, start, end, ahead, back, group)


def _crossing(a: Road, b: Road) -> tuple[int, int] | None:
    """Returns the indices of the nearest points of two roads that cross; None if they do not.

    A road also crosses another if it ends on the other's carriageway, as at a T.
    """
    apart = np.hypot(*(a.xy[:, None] - b.xy[None]).transpose(2, 0, 1))
    i, j = np.unravel_index(int(apart.argmin()), apart.shape)
    ends = i in (0, len(a.s) - 1), j in (0, len(b.s) - 1)
    if all(ends) or abs(a.z[i] - b.z[j]) >= BRIDGE_M:
        return None
    near_m = b.half_width[j] if ends[0] else a.half_width[i] if ends[1] else 1.0
    return (int(i), int(j)) if apart[i, j] < near_m else None


def compass(heading: float) -> str:
    """Returns the nearest of eight compass directions; 0 is east, and angles count to the left."""
    return COMPASS[round(heading / (np.pi / 4)) % 8]
