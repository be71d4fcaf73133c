"""The roads of a site, and the free space beside them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.boxes import bev_overlap, footprints
from pyinfra.dataset.roads import offset_curve
from pyinfra.scenes.generator.random_stream import RandomStream
from pyinfra.scenes.generator.ranges import Ranges, RingRanges
from pyinfra.scenes.generator.road_types import RoadType

Keys = dict[str, Any]
Stretch = tuple[float, float]  # first and last station of a section of a road

SIDES = ((1, "left"), (-1, "right"))
STEP_M = 1.0  # distance between stations
STOP_LINE_M = 3.0  # distance of a stop line from the crossing road's footway, as in the simulator
# At a T-junction, the distance of the stop lines increases by this length times the cosine of the
# angle between the roads.
SHARP_TURN_M = 8.0
RING_FLARE_M = 10.0  # distance from a roundabout's stop line to its ring, as in the simulator
# Maximum number of lanes each way of a road that ends at a T-junction. One lane turns left, and one
# turns right.
T_LANES = 2
SHORTEST_M = 6.0  # minimum length of a row of objects
WHOLE: Stretch = (0.0, np.inf)


@dataclass(frozen=True)
class PlannedRoad:
    """A generated road with its scene keys, and stations about every metre."""

    keys: Keys

    @property
    def name(self) -> str:
        return str(self.keys["name"])

    @cached_property
    def lanes_half_m(self) -> float:
        lanes = self.keys["lanes"]
        one_side = lanes["each_way"] * lanes["width_m"]
        return float(one_side / 2 if lanes.get("one_way") else lanes["median_m"] / 2 + one_side)

    @cached_property
    def carriageway_half_m(self) -> float:
        return self.lanes_half_m + float(self.keys["lanes"]["shoulder_m"])

    @cached_property
    def outer_half_m(self) -> float:
        return self.carriageway_half_m + float(self.keys["lanes"]["sidewalk_m"])

    @cached_property
    def radius_m(self) -> float:
        """Radius of the tightest bend. It is infinite if the road has no bend."""
        return min(float(piece.get("radius_m", np.inf)) for piece in self.keys["centreline"])

    @cached_property
    def stations(self) -> FloatArray:
        """Stations (n, 4): s, x, y, heading."""
        return self._line(STEP_M, STEP_M)

    def _line(self, arc_step_m: float, line_step_m: float = np.inf) -> FloatArray:
        start = self.keys["start"]
        rows = [np.array([[0.0, start["x_m"], start["y_m"], np.radians(start["heading_deg"])]])]
        for piece in self.keys["centreline"]:
            step_m = arc_step_m if "radius_m" in piece else line_step_m
            rows.append(_along(rows[-1][-1], piece, step_m))
        return np.concatenate(rows)

    @property
    def length_m(self) -> float:
        return float(self.stations[-1, 0])

    def pose_at(self, s: float, left_m: float) -> tuple[float, float, float]:
        """Returns x, y and heading (rad) at `left_m` to the left of a station."""
        x, y, heading = (
            float(np.interp(s, self.stations[:, 0], column)) for column in self.stations.T[1:]
        )
        return x - left_m * math.sin(heading), y + left_m * math.cos(heading), heading

    def beside(self, left_m: float) -> FloatArray:
        """Returns the line (n, 2) at `left_m` to the left of all stations."""
        return offset_curve(self.stations[:, 1:3], self.stations[:, 3], left_m)

    @cached_property
    def _corners(self) -> FloatArray:
        """Points (m, 2) of a polyline that deviates from the centreline by at most 2 cm."""
        step = np.sqrt(8 * 0.02 * self.radius_m)
        return self._line(step)[:, 1:3]

    def distance(self, points: FloatArray) -> FloatArray:
        """Returns the distances (n,) of points (n, 2) from the centreline, exact to 2 cm."""
        line = self._corners
        edge = line[1:] - line[:-1]
        away = points[:, None] - line[:-1]  # vectors (n, m - 1, 2) from line corners to points
        share = np.clip((away * edge).sum(2) / (edge**2).sum(1), 0, 1)
        gap = away - share[:, :, None] * edge
        return np.asarray(np.sqrt((gap**2).sum(2).min(1)))


def _along(last: FloatArray, piece: Keys, step_m: float) -> FloatArray:
    """Returns the stations (n, 4) of a line or arc that begins at `last`, without `last` itself."""
    s, x, y, heading = last
    bend = np.radians(piece.get("turn_deg", 0.0))
    length = piece.get("line_m") or piece["radius_m"] * abs(bend)
    share = np.linspace(0, 1, max(1, int(np.ceil(length / step_m))) + 1)[1:]
    half = share * bend / 2
    chord = share * length * np.sinc(half / np.pi)
    ahead = [x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)]
    return np.stack([s + share * length, *ahead, heading + 2 * half], axis=1)


@dataclass(frozen=True)
class Layout:
    """Roads, their junctions, and the focus around which the sensor and objects are placed."""

    roads: tuple[PlannedRoad, ...]
    focus: tuple[float, float]  # station and left offset on the first road
    junctions: tuple[Keys, ...] = ()
    junction_m: float = 0.0  # radius around the focus that contains the junction
    corner_m: float = 0.0  # minimum distance of sensors from the focus along the road


def straight(stream: RandomStream, road_type: RoadType, ranges: Ranges) -> Layout:
    half = stream.within(ranges.half_length_m, 0)
    road = _road("main", -half, 0, 0, [{"line_m": 2 * half}], _lanes(stream, road_type, ranges))
    return Layout((road,), (half, 0.0))


def curve(stream: RandomStream, road_type: RoadType, ranges: Ranges) -> Layout:
    lanes = _lanes(stream, road_type, ranges)
    half = stream.within(ranges.half_length_m, 0)
    outer = lanes["median_m"] / 2 + lanes["each_way"] * lanes["width_m"]
    outer += lanes["shoulder_m"] + lanes["sidewalk_m"]
    radius = max(stream.within(road_type.radius_m, 1), round(outer + 8, 1))
    turn = stream.within(road_type.turn_deg, 1)
    arc = radius * np.radians(turn)
    pieces = [{"line_m": half}, {"radius_m": radius, "turn_deg": stream.side() * turn}]
    road = _road("main", -half, 0, 0, [*pieces, {"line_m": half}], lanes)
    return Layout((road,), (half + arc / 2, 0.0))


def crossing(stream: RandomStream, road_type: RoadType, ranges: Ranges) -> Layout:
    """Returns a crossing of two straight roads with signals, which the simulator requires."""
    half = stream.within(ranges.half_length_m, 0)
    angle_deg = stream.within(ranges.crossing_deg, 1) if stream.chance(0.5) else 90.0
    angle = np.radians(angle_deg)
    main = _road("main", -half, 0, 0, [{"line_m": 2 * half}], _lanes(stream, road_type, ranges))
    start = (round(float(-half * np.cos(angle)), 3), round(float(-half * np.sin(angle)), 3))
    side = _road(
        "side", *start, angle_deg, [{"line_m": 2 * half}], _lanes(stream, road_type, ranges)
    )
    signal = {"green_s": stream.within(ranges.signal_green_s, 0), "all_red_s": 2.0}
    shares = {key: stream.within(ranges.turns) for key in ("left_share", "right_share")}
    junction = {"roads": ["main", "side"], "signal": signal} | shares
    reach = max(_stop_line(main, side, angle), _stop_line(side, main, angle))
    return Layout((main, side), (half, 0.0), (junction,), reach, reach)


def varied(layout: Layout, stream: RandomStream, ranges: Ranges) -> Layout:
    """Turns some crossings into T-junctions or roundabouts, and makes some side roads one-way."""
    if not layout.junctions:
        return layout
    one_way, t = stream.chance(ranges.one_way), stream.chance(ranges.t_junctions)
    main, side = layout.roads
    t = t and side.keys["lanes"]["each_way"] <= T_LANES
    if t:
        side = _ending(side, in_the_middle=stream.chance(0.5))
    if stream.chance(ranges.roundabouts):
        return _roundabout(layout, main, side, stream, ranges.ring)
    if one_way:
        side = _with_lanes(side, median_m=0.0, one_way=True)
    angle = np.radians(side.keys["start"]["heading_deg"])
    more_m = SHARP_TURN_M * abs(np.cos(angle)) if t else 0.0
    reach = max(_stop_line(main, side, angle, more_m), _stop_line(side, main, angle, more_m))
    return replace(layout, roads=(main, side), junction_m=reach, corner_m=reach)


def _with_lanes(road: PlannedRoad, **lanes: float) -> PlannedRoad:
    return PlannedRoad(road.keys | {"lanes": road.keys["lanes"] | lanes})


def _ending(side: PlannedRoad, in_the_middle: bool) -> PlannedRoad:
    """Shortens a side road so that it ends at the main road.

    With `in_the_middle`, the side road begins at the main road instead.
    """
    half = side.keys["centreline"][0]["line_m"] / 2
    keys = side.keys | {"centreline": [{"line_m": half}]}
    if in_the_middle:
        keys["start"] = keys["start"] | {"x_m": 0.0, "y_m": 0.0}
    return PlannedRoad(keys)


def _roundabout(
    layout: Layout, main: PlannedRoad, side: PlannedRoad, stream: RandomStream, ring: RingRanges
) -> Layout:
    """Returns a layout with a single-lane roundabout, whose roads have one lane each way."""
    keys = {
        "radius_m": stream.within(ring.radius_m, 1),
        "width_m": stream.within(ring.width_m, 1),
        "island_m": stream.within(ring.island_m),
    }
    junction = {k: v for k, v in layout.junctions[0].items() if k != "signal"}
    roads = tuple(_with_lanes(road, each_way=1, median_m=0.0) for road in (main, side))
    half = keys["radius_m"] + keys["width_m"] / 2 + RING_FLARE_M
    reach = float(np.hypot(half, max(road.lanes_half_m for road in roads))) + 1.0
    return replace(
        layout,
        roads=roads,
        junctions=(junction | {"roundabout": keys},),
        junction_m=reach,
        corner_m=half - RING_FLARE_M / 2,
    )


Builder = Callable[[RandomStream, RoadType, Ranges], Layout]
LAYOUTS: Mapping[str, Builder] = {"straight": straight, "curve": curve, "crossing": crossing}


def _stop_line(road: PlannedRoad, other: PlannedRoad, angle: float, more_m: float = 0.0) -> float:
    """Returns the distance from the middle of a crossing to the outer end of the stop line."""
    along = road.carriageway_half_m * abs(np.cos(angle))
    half = (other.outer_half_m + along) / np.sin(angle) + STOP_LINE_M + more_m
    return float(np.hypot(half, road.lanes_half_m)) + 1.0


def _lanes(stream: RandomStream, road_type: RoadType, ranges: Ranges) -> Keys:
    parking = stream.chance(road_type.kerb_parking)
    return {
        "each_way": stream.one_of(road_type.each_way),
        "width_m": stream.within(road_type.lane_m),
        "median_m": stream.within(road_type.median_m) if stream.chance(road_type.median) else 0.0,
        "shoulder_m": stream.within(ranges.parking.lane_m if parking else road_type.shoulder_m),
        "sidewalk_m": stream.within(road_type.sidewalk_m)
        if stream.chance(road_type.sidewalk)
        else 0.0,
    }


def _road(
    name: str, x_m: float, y_m: float, heading_deg: float, pieces: list[Keys], lanes: Keys
) -> PlannedRoad:
    start = {"x_m": x_m, "y_m": y_m, "heading_deg": heading_deg}
    return PlannedRoad({"name": name, "start": start, "centreline": pieces, "lanes": lanes})


class FreeSpace:
    """The space of a site outside all roads, junctions, and objects that were already placed."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.taken = np.zeros((0, 7))  # boxes of placed objects; z and height are not used
        x, y, _ = layout.roads[0].pose_at(*layout.focus)
        self.centre = np.array([x, y])

    def nearest_station(self, road: PlannedRoad) -> float:
        """Returns the station of a road that is nearest to the focus."""
        away = road.stations[:, 1:3] - self.centre
        return float(road.stations[np.hypot(*away.T).argmin(), 0])

    def take(self, box: Sequence[float]) -> None:
        self.taken = np.vstack([self.taken, np.asarray(box, np.float64)])

    def holds(self, box: Sequence[float], margin_m: float = 1.0) -> bool:
        """Returns whether a box (x y z dx dy dz heading) with a margin around it is free."""
        grown = np.array([box], np.float64)
        grown[:, 3:5] += 2 * margin_m
        if bev_overlap(np.repeat(grown, len(self.taken), axis=0), self.taken).any():
            return False
        corners = footprints(grown)[0]
        edge = np.concatenate(
            [corners + share * (np.roll(corners, -1, axis=0) - corners) for share in _SHARES]
        )
        return bool(self.off_roads(np.vstack([edge, grown[:, :2]]), 0.0).all())

    def rows(
        self, road: PlannedRoad, left_m: float, half_width_m: float, part: Stretch = WHOLE
    ) -> list[Stretch]:
        """Returns the sections of a road where a row of objects at `left_m` has free space."""
        middle = road.beside(left_m)
        free = self.off_roads(middle, half_width_m, host=(road, left_m))
        for side in (-half_width_m, half_width_m):
            for box in self.taken:
                free &= ~within(road.beside(left_m + side), box, 0.5)
        return runs(road.stations[:, 0], free, part)

    def off_roads(
        self, points: FloatArray, margin_m: float, host: tuple[PlannedRoad, float] | None = None
    ) -> BoolArray:
        """Returns which points (n, 2) lie outside all junctions and roads.

        `host` is a pair: the road along which the points lie, and the distance of the points to the
        left of the road's centreline.
        """
        free = np.hypot(*(points - self.centre).T) >= self.layout.junction_m + margin_m
        for road in self.layout.roads:
            away = road.distance(points)
            if host is not None and road is host[0]:
                # Points nearer to the centreline than host[1] are close to another part of a bend.
                free &= away >= abs(host[1]) - 0.3
            else:
                free &= away >= road.outer_half_m + margin_m + 0.3
        return np.asarray(free)


_SHARES = np.linspace(0, 1, 8, endpoint=False)


def within(points: FloatArray, box: FloatArray, margin_m: float) -> BoolArray:
    """Returns which points (n, 2) lie in the footprint of a box with a margin."""
    dx, dy = (points - box[:2]).T
    cos, sin = np.cos(box[6]), np.sin(box[6])
    inside = np.abs(cos * dx + sin * dy) <= box[3] / 2 + margin_m
    return np.asarray(inside & (np.abs(cos * dy - sin * dx) <= box[4] / 2 + margin_m))


def runs(s: FloatArray, free: BoolArray, part: Stretch = WHOLE) -> list[Stretch]:
    """Returns the free sections of stations `s` (n,), each shortened by a metre at both ends.

    `free` is a mask (n,). Sections shorter than SHORTEST_M are left out.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    intervals = []
    for first, end in edges.reshape(-1, 2):
        low, high = max(s[first] + STEP_M, part[0]), min(s[end - 1] - STEP_M, part[1])
        if high - low >= SHORTEST_M:
            intervals.append((round(float(low), 1), round(float(high), 1)))
    return intervals
