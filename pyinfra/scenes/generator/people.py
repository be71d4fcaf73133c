"""Places rows of walking pedestrians and cyclists in free space beside the roads of a site."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.scenes.generator.layout import (
    SIDES,
    FreeSpace,
    Keys,
    PlannedRoad,
    Stretch,
    runs,
    within,
)
from pyinfra.scenes.generator.parking import KERB_ROW_M
from pyinfra.scenes.generator.random_stream import RandomStream
from pyinfra.scenes.generator.road_types import RoadType, WalkRanges
from pyinfra.scenes.generator.roadside_ranges import WayRanges

HALF_WAY_M = 1.35  # free width on each side of a row; the simulator requires 1.2
STEP_M = 0.25  # distance between successive candidate lines for a row
Things = Mapping[str, Sequence[Keys]]


class Walks:
    """Places the rows of pedestrians and cyclists of a site.

    Each row uses the longest free line beside its road. Of equally long lines, it uses the line
    nearest to the road.
    """

    def __init__(
        self, free_space: FreeSpace, road_type: RoadType, how: WayRanges, things: Things
    ) -> None:
        self.free_space, self.road_type, self.how = free_space, road_type, how
        self.roads = {road.name: road for road in free_space.layout.roads}
        self.boxes = np.array([*free_space.taken, *_boxes(things)])
        standing = [*self._lines(things)]
        self.lines = [cKDTree(np.concatenate(standing))] if standing else []
        self.rows: list[Keys] = []

    def add(self, road: PlannedRoad, seed: int) -> None:
        """Adds pedestrians and cyclists on both sides of a road, with a separate line per class."""
        for side, word in SIDES:
            for name, walk in self.road_type.walks.items():
                stream = RandomStream(seed, f"{road.name} {word} {name}")
                if stream.chance(walk.share):
                    self._row(stream, road, side, name, walk)

    def _row(
        self, stream: RandomStream, road: PlannedRoad, side: int, name: str, walk: WalkRanges
    ) -> None:
        speed = stream.within(walk.speed_km_h, 1)
        keys = {
            "per_km": stream.within(walk.per_km, 0),
            "class": name,
            "speed": {
                "mean_km_h": speed,
                "std_km_h": round(speed * stream.within(walk.speed_spread), 1),
            },
        }
        left_m, stretches = self._longest(road, side)
        for start, end in stretches:
            stretch = {"road": road.name, "offset_m": left_m, "from_m": start, "to_m": end}
            self.rows.append(stretch | keys)
        if stretches:
            line = np.concatenate([road.beside(left_m)[_along(road, part)] for part in stretches])
            self.lines.append(cKDTree(_widened(line, HALF_WAY_M)))

    def _longest(self, road: PlannedRoad, side: int) -> tuple[float, list[Stretch]]:
        """Returns the line beside a road with most free length: left offset, and free sections."""
        best: tuple[float, float, list[Stretch]] = (self.how.shortest_m, 0.0, [])
        last_m = road.outer_half_m + self.how.verge_m
        if "embankment" in road.keys:
            last_m = road.outer_half_m - HALF_WAY_M
        for out_m in np.arange(road.lanes_half_m + HALF_WAY_M, last_m + 1e-9, STEP_M):
            left_m = round(float(side * out_m), 2)
            stretches = self._stretches(road, left_m)
            long_m = sum(end - start for start, end in stretches)
            if long_m > best[0] + 1:
                best = long_m, left_m, stretches
        return best[1], best[2]

    def _stretches(self, road: PlannedRoad, left_m: float) -> list[Stretch]:
        line = road.beside(left_m)
        near = np.hypot(*(line - self.free_space.centre).T) <= self.how.within_m
        free = near & self.free_space.off_roads(line, HALF_WAY_M, host=(road, left_m))
        for box in self.boxes[_reached(self.boxes, line[near])]:
            free &= ~within(line, box, HALF_WAY_M + 0.2)
        for tree in self.lines:
            rows = np.flatnonzero(free)
            away = tree.query(line[rows], distance_upper_bound=HALF_WAY_M)[0]
            free[rows] = away > HALF_WAY_M  # the query returns inf for distances beyond its bound
        intervals = runs(road.stations[:, 0], free)
        return [(a, b) for a, b in intervals if b - a >= self.how.shortest_m]

    def is_free(self, position: FloatArray, radius_m: float) -> bool:
        """Returns whether no object and no row is within a radius of a position (1, 2)."""
        boxes = self.boxes[_reached(self.boxes, position, radius_m)]
        if any(within(position, box, radius_m)[0] for box in boxes):
            return False
        return all(tree.query(position)[0][0] > radius_m for tree in self.lines)

    def _lines(self, things: Things) -> Iterator[FloatArray]:
        """Yields points (n, 2), about a metre apart, that cover the objects along roads."""
        rows = [(row, row["width_m"] / 2) for row in things["barriers"]]
        rows += [(row, KERB_ROW_M) for row in things["parked"] if row.get("turn_deg", 0) == 0]
        rows += [
            (plant[kind], plant[kind][width] / 2)
            for plant in things["vegetation"]
            for kind, width in (("hedge_along", "width_m"), ("trees_along", "trunk_width_m"))
            if kind in plant
        ]
        for row, half_m in rows:
            road = self.roads[row["road"]]
            part = _along(road, (row["from_m"], row["to_m"]))
            for side in np.linspace(-half_m, half_m, 2 + int(2 * half_m)):
                yield road.beside(row["offset_m"] + side)[part]


def _along(road: PlannedRoad, part: Stretch) -> BoolArray:
    s = road.stations[:, 0]
    return np.asarray((s >= part[0] - 1) & (s <= part[1] + 1))


def _widened(line: FloatArray, half_m: float) -> FloatArray:
    """Returns points on circles with radius `half_m` around the points (n, 2) of a line."""
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    around = half_m * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.asarray((line[:, None] + around).reshape(-1, 2))


def _boxes(things: Things) -> Iterator[list[float]]:
    """Yields boxes x y z dx dy dz heading of single objects. z and height are not used."""
    plants = [thing for plant in things["vegetation"] for word, thing in plant.items()
              if word in ("hedge", "tree")]  # fmt: skip
    for thing in [*things["buildings"], *plants]:
        wide_m = thing.get("trunk_width_m", 0.0)
        size = thing.get("length_m", wide_m), thing.get("width_m", wide_m)
        heading = np.radians(thing.get("heading_deg", 0.0))
        yield [thing["x_m"], thing["y_m"], 0, *size, 1, heading]


def _reached(boxes: FloatArray, line: FloatArray, more_m: float = 2 * HALF_WAY_M) -> BoolArray:
    """Returns which boxes lie within `more_m` of the bounding rectangle of a line."""
    if len(line) == 0:
        return np.zeros(len(boxes), np.bool_)
    reach = boxes[:, 3:5].sum(axis=1)[:, None] / 2 + more_m
    inside = (boxes[:, :2] > line.min(0) - reach) & (boxes[:, :2] < line.max(0) + reach)
    return np.asarray(inside.all(axis=1))
