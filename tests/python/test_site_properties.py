"""Maps and floating car data that are generated from known objects are read correctly.

The files are always the same, except in `make fuzz`, which tries other files for FUZZ_SECONDS per
format.
"""

from __future__ import annotations

import gzip
import itertools
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import EXAMPLES, LIMIT_S, SECONDS, tried
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.fcd import read_fcd
from pyinfra.scenes.maps.geographic import Projection
from pyinfra.scenes.maps.lane_map import SiteMap
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.opendrive import read_opendrive
from pyinfra.scenes.maps.openstreetmap import read_street_map
from pyinfra.scenes.maps.osm_buildings import add_surroundings
from pyinfra.scenes.maps.osm_levels import LEAST_M, find_levels
from pyinfra.scenes.maps.tracks import CLASSES
from pyinfra.scenes.maps.trajectory_import import import_fcd
from pyinfra.viz.site_plan import read_lanes

pytestmark = pytest.mark.timeout(LIMIT_S)
CENTRES = [(8.4, 49.0), (-122.4, 37.8), (151.2, -33.9), (18.1, 59.3), (0.01, 51.5), (-58.4, -34.6)]


def hundredths(low: float, high: float) -> st.SearchStrategy[float]:
    """Returns numbers with two decimals."""
    return st.integers(round(low * 100), round(high * 100)).map(lambda v: v / 100)


def lon_lat(xy: FloatArray, centre: tuple[float, float]) -> FloatArray:
    """Converts metres (n, 2) east and north to degrees (n, 2), with the ellipsoid's radii at this
    latitude."""
    e2 = 0.00669437999014
    sin = math.sin(math.radians(centre[1]))
    along = 6378137 * (1 - e2) / (1 - e2 * sin**2) ** 1.5
    across = 6378137 / math.sqrt(1 - e2 * sin**2)
    x, y = xy.T
    lat = centre[1] + np.degrees(
        (y - x**2 * math.tan(math.radians(centre[1])) / 2 / across) / along
    )
    lon = centre[0] + np.degrees(x / across / np.cos(np.radians(lat)))
    return np.stack([lon, lat], 1)


# --- floating car data

TYPES = {
    "": "Car", "Car": "Car", "passenger": "Car", "DEFAULT_VEHTYPE": "Car", "veh_passenger": "Car",
    "TRUCK": "Truck", "truck": "Truck", "bus": "Bus", "pt_bus": "Bus", "delivery": "Van",
    "DEFAULT_BIKETYPE": "Cyclist", "bicycle": "Cyclist", "motorcycle": "Motorcycle",
}  # fmt: skip


@dataclass(frozen=True)
class Moved:
    """A road user who moves straight on or stands. The position is that of the front at t = 0."""

    name: str
    kind: str
    type_name: str | None
    object_class: str
    start: tuple[float, float, float]
    heading: float
    speed: float
    first: int  # steps of the file
    count: int

    def front(self, t: FloatArray) -> FloatArray:
        way = np.array([math.cos(self.heading), math.sin(self.heading), 0])
        return np.asarray(np.array(self.start) + way * self.speed * t[:, None])

    def centre(self, t: FloatArray) -> FloatArray:
        length, _, height = CLASSES[self.object_class].mean_m
        back = 0.0 if self.kind == "person" else length / 2
        way = np.array([math.cos(self.heading), math.sin(self.heading), 0])
        return self.front(t) - back * way + np.array([0, 0, height / 2])


@dataclass(frozen=True)
class Drive:
    """A file, its objects, and the conversion of its positions to the world."""

    text: str
    objects: list[Moved]
    step_s: float
    start_s: float
    offset: tuple[float, float, float]
    centre: tuple[float, float] | None  # centre in degrees
    by_network: bool


@st.composite
def drives(draw: st.DrawFn) -> Drive:
    step_s = draw(st.sampled_from([0.1, 0.2, 0.5, 1.0]))
    start_s = draw(st.sampled_from([0.0, 25.0, 3600.0]))
    centre = draw(st.none() | st.sampled_from(CENTRES))
    offset = (0.0, 0.0, 0.0) if centre else (*draw(st.tuples(*[hundredths(-9000, 9000)] * 2)), 0.0)
    has = {k: draw(st.booleans()) for k in ("angle", "speed", "z", "more", "type")}
    objects = []
    for i in range(draw(st.integers(1, 5))):
        kind = draw(st.sampled_from(["vehicle", "vehicle", "person"]))
        person = kind == "person"
        type_name = draw(st.sampled_from(["DEFAULT_PEDTYPE"] if person else list(TYPES)))
        type_name = type_name if has["type"] else ""
        speed = draw(hundredths(0.8, 2) if person else hundredths(3, 30))
        if i and has["angle"] and draw(st.integers(0, 3)) == 0:
            speed = 0.0
        position = (*draw(st.tuples(*[hundredths(-200, 200)] * 2)), draw(hundredths(-3, 9)))
        objects.append(
            Moved(
                f"{kind[0]}{i}.{draw(st.integers(0, 9))}", kind, type_name or None,
                "Pedestrian" if person else TYPES[type_name],
                position if has["z"] else (*position[:2], 0),
                draw(hundredths(-3.14, 3.14)), speed, draw(st.integers(0, 5)),
                math.ceil(draw(hundredths(2, 8)) / step_s) + 1,
            )
        )  # fmt: skip
    steps: list[str] = []
    for k in range(max(o.first + o.count for o in objects) + draw(st.integers(0, 2))):
        rows = [row(o, k, step_s, has, offset, centre) for o in objects]
        clock = f"{start_s + k * step_s:.2f}"
        steps.append(f'<timestep time="{clock}">{"".join(rows)}</timestep>')
    head = draw(st.sampled_from(["", '<?xml version="1.0" encoding="UTF-8"?>\n<!-- by SUMO -->\n']))
    text = f"{head}<fcd-export>{''.join(steps)}</fcd-export>"
    return Drive(text, objects, step_s, start_s, offset, centre, draw(st.booleans()))


def row(
    o: Moved,
    k: int,
    step_s: float,
    has: dict[str, bool],
    offset: tuple[float, float, float],
    centre: tuple[float, float] | None,
) -> str:
    if not o.first <= k < o.first + o.count:
        return ""
    xyz = o.front(np.array([k * step_s]))
    x, y = (lon_lat(xyz[:, :2], centre) if centre else xyz[:, :2] + offset[:2])[0]
    words = f'<{o.kind} id="{o.name}" x="{x:.9f}" y="{y:.9f}"'
    words += f' z="{xyz[0, 2]:.2f}"' if has["z"] else ""
    words += f' angle="{(90 - math.degrees(o.heading)) % 360:.4f}"' if has["angle"] else ""
    words += f' type="{o.type_name}"' if o.type_name else ""
    words += f' speed="{o.speed:.2f}"' if has["speed"] else ""
    return words + (' lane="a_0" pos="1" slope="0"/>' if has["more"] else "/>")


def test_floating_car_data_are_boxes_where_the_vehicles_were(tmp_path: Path) -> None:
    @given(drives(), st.booleans())
    def holds(drive: Drive, packed: bool) -> None:
        file = tmp_path / ("a.xml.gz" if packed else "a.xml")
        data = drive.text.encode()
        file.write_bytes(gzip.compress(data) if packed else data)
        projection = Projection(drive.centre) if drive.centre and drive.by_network else None
        imported = import_fcd(read_fcd(file), {}, np.array(drive.offset), projection)
        tracks = {track.name: track for track in imported.tracks}
        assert tracks.keys() == {o.name for o in drive.objects}
        begin = min(o.first for o in drive.objects) * drive.step_s
        middle, tolerance = np.zeros(2), 0.01
        if drive.centre:
            tolerance = 0.03
            if projection is None:  # positions are in metres from the mean position
                ends = [
                    o.front(np.array([o.first, o.first + o.count - 1]) * drive.step_s)
                    for o in drive.objects
                ]
                degrees = lon_lat(np.concatenate(ends)[:, :2], drive.centre)
                middle = (degrees.min(0) + degrees.max(0)) / 2
                origin = lon_lat(np.zeros((1, 2)), drive.centre)[0]
                scale = lon_lat(np.array([[1.0, 1.0]]), drive.centre)[0] - origin
                middle, tolerance = (middle - origin) / scale, 0.2
        for o in drive.objects:
            track = tracks[o.name]
            assert track.object_class == o.object_class
            t = begin + (track.first + np.arange(len(track.states))) * 0.1
            assert (t[0], t[-1]) == pytest.approx(
                (o.first * drive.step_s, (o.first + o.count - 1) * drive.step_s), abs=0.11
            )
            want = o.centre(t)
            want[:, :2] -= middle
            np.testing.assert_allclose(track.states[:, :3], want, atol=tolerance)
            off = np.sin((track.states[:, 3] - o.heading) / 2)
            if o.kind == "vehicle" or o.speed:
                np.testing.assert_allclose(off, 0, atol=0.005)

    tried(holds)


# --- OpenDRIVE

FINE_M = 0.01


@dataclass
class Line:
    """A reference line with many points: s, x, y, heading."""

    xml: list[str] = field(default_factory=list)
    rows: list[FloatArray] = field(default_factory=list)

    @property
    def end(self) -> tuple[float, float, float, float]:
        s, x, y, heading = self.rows[-1][-1].tolist()
        return s, x, y, heading

    def add(self, shape: str, length: float, local: FloatArray) -> None:
        """Appends points to the line. local: (n, 4) s u v heading, relative to the end of the
        line."""
        s, x, y, h = self.end
        at = f's="{s!r}" x="{x!r}" y="{y!r}" hdg="{h!r}" length="{length!r}"'
        self.xml.append(f"<geometry {at}>{shape}</geometry>")
        ds, u, v, turn = local.T
        cos, sin = math.cos(h), math.sin(h)
        rows = np.stack([s + ds, x + cos * u - sin * v, y + sin * u + cos * v, h + turn], 1)
        self.rows.append(rows[1:])

    def places(self, s: FloatArray, t: FloatArray) -> FloatArray:
        table = np.concatenate(self.rows)
        x, y, heading = (np.interp(s, table[:, 0], table[:, k]) for k in (1, 2, 3))
        return np.stack([x - np.sin(heading) * t, y + np.cos(heading) * t], 1)


def bent(length: float, first: float, last: float) -> FloatArray:
    """Returns points of a curve whose curvature changes linearly from first to last, relative to
    its start."""
    s = np.linspace(0, length, round(length / FINE_M) + 1)
    heading = first * s + (last - first) * s**2 / (2 * length)
    middle = (s[1:] + s[:-1]) / 2
    ways = first * middle + (last - first) * middle**2 / (2 * length)
    steps = np.diff(s)
    u, v = (np.append(0, np.cumsum(f(ways) * steps)) for f in (np.cos, np.sin))
    return np.stack([s, u, v, heading], 1)


def cubic(us: list[float], vs: list[float], end: float) -> FloatArray:
    """Returns points of a curve whose u and v are cubics from 0 to `end`, relative to its start."""
    p = np.linspace(0, end, 20_001)
    u, v = (np.polyval(c[::-1], p) for c in (us, vs))
    s = np.append(0, np.cumsum(np.hypot(np.diff(u), np.diff(v))))
    du, dv = (np.polyval(np.polyder(c[::-1]), p) for c in (us, vs))
    return np.stack([s, u, v, np.arctan2(dv, du)], 1)


@st.composite
def lines(draw: st.DrawFn) -> Line:
    x, y = draw(st.tuples(*[hundredths(-500, 500)] * 2))
    line = Line(rows=[np.array([[0.0, x, y, draw(hundredths(-3.14, 3.14))]])])
    bend = st.integers(-25, 25).map(lambda v: v / 1000)
    kinds = ["line", "arc", "spiral", "normalized", "arcLength", "poly3"]
    for kind in draw(st.lists(st.sampled_from(kinds), min_size=1, max_size=4)):
        length = draw(hundredths(15, 60))
        if kind == "line":
            line.add("<line/>", length, bent(length, 0, 0))
        elif kind == "arc":
            k = draw(bend)
            line.add(f'<arc curvature="{k}"/>', length, bent(length, k, k))
        elif kind == "spiral":
            a, b = draw(bend), draw(bend)
            line.add(f'<spiral curvStart="{a}" curvEnd="{b}"/>', length, bent(length, a, b))
        elif kind == "normalized":
            us = [
                0,
                length,
                length * draw(hundredths(-0.2, 0.2)),
                length * draw(hundredths(0, 0.2)),
            ]
            vs = [0, 0, *(length * draw(hundredths(-0.1, 0.1)) for _ in "cd")]
            local = cubic(us, vs, 1.0)
            line.add(param_poly3(us, vs, kind), float(local[-1, 0]), local)
        else:
            vs = [0, 0, draw(hundredths(-0.02, 0.02)) / 100, draw(hundredths(-0.02, 0.02)) / 1e4]
            us = [0.0, 1.0, 0.0, 0.0]
            shape = f'<poly3 a="0" b="0" c="{vs[2]!r}" d="{vs[3]!r}"/>'
            local = cubic(us, vs, length)
            length = length if kind == "arcLength" else float(local[-1, 0])
            local[:, 0] *= length / local[-1, 0]
            line.add(shape if kind == "poly3" else param_poly3(us, vs, kind), length, local)
    return line


def param_poly3(us: list[float], vs: list[float], kind: str) -> str:
    sides = zip("UV", (us, vs), strict=True)
    words = [f'{k}{a}="{v!r}"' for a, row_ in sides for k, v in zip("abcd", row_, strict=True)]
    return f'<paramPoly3 {" ".join(words)} pRange="{kind}"/>'


@dataclass(frozen=True)
class Thing:
    """An object and its bodies. Each body has an outline (n, 2), a base and a top."""

    xml: str
    bodies: list[tuple[FloatArray, float, float]]
    tree: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Road:
    text: str
    line: Line
    # borders of each lane: inner and outer t as a + b s
    borders: dict[str, tuple[list[float], list[float]]]
    profile: list[float]  # z = a + b s + c s^2, and the roll
    things: list[Thing]

    def z(self, s: FloatArray, t: FloatArray) -> FloatArray:
        a, b, c, roll = self.profile
        return np.asarray(a + b * s + c * s**2 + t * math.sin(roll))

    def world(self, s: FloatArray, t: FloatArray) -> FloatArray:
        flat = self.line.places(s, t * math.cos(self.profile[3]))
        return np.column_stack([flat, self.z(s, t)])


@st.composite
def roads(draw: st.DrawFn) -> Road:
    line = draw(lines())
    end = line.end[0]
    profile = [
        draw(hundredths(-5, 5)),
        draw(hundredths(-0.06, 0.06)),
        draw(hundredths(-0.03, 0.03)) / 100,
    ]
    profile.append(draw(st.sampled_from([0.0, 0.0, 0.06, -0.03])))
    offset = [draw(hundredths(-2, 2)), draw(st.sampled_from([0.0, 0.01]))]
    left_hand, borders, sides = draw(st.booleans()), {}, {}
    for side, sign in (("left", 1), ("right", -1)):
        inner, rows = offset, []
        for n in range(1, draw(st.integers(0 if side == "left" else 1, 3)) + 1):
            width = [draw(hundredths(2, 4)), draw(st.sampled_from([0.0, 0.005]))]
            outer = [a + sign * b for a, b in zip(inner, width, strict=True)]
            kind = draw(st.sampled_from(["driving", "driving", "shoulder", "biking", "sidewalk"]))
            kind = "driving" if n == 1 else kind
            cubic_ = f'<width sOffset="0" a="{width[0]}" b="{width[1]}" c="0" d="0"/>'
            rows.append(f'<lane id="{sign * n}" type="{kind}">{cubic_}</lane>')
            borders[f"road1_0_{side}{n}"] = (inner, outer)
            inner = outer
        sides[side] = "".join(rows)
    road = Road("", line, borders, profile, [])
    road.things.extend(draw(st.lists(things(road, end), max_size=4)))
    rule = ' rule="LHT"' if left_hand else ""
    lanes = (
        f'<lanes><laneOffset s="0" a="{offset[0]}" b="{offset[1]}" c="0" d="0"/><laneSection s="0">'
        f'<left>{sides["left"]}</left><center><lane id="0" type="none"/></center>'
        f"<right>{sides['right']}</right></laneSection></lanes>"
    )
    a, b, c, roll = profile
    text = (
        f'<OpenDRIVE><header revMajor="1" revMinor="7"/><road id="1" length="{end!r}" '
        f'junction="-1"{rule}><planView>{"".join(line.xml)}</planView><elevationProfile>'
        f'<elevation s="0" a="{a}" b="{b}" c="{c}" d="0"/></elevationProfile><lateralProfile>'
        f'<superelevation s="0" a="{roll}" b="0" c="0" d="0"/></lateralProfile>{lanes}'
        f"<objects>{''.join(t.xml for t in road.things)}</objects></road></OpenDRIVE>"
    )
    return Road(text, line, borders, profile, road.things)


def turned(uv: FloatArray, angle: float) -> FloatArray:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.asarray(uv @ np.array([[cos, sin], [-sin, cos]]))


def shifted(uv: FloatArray, x: float, y: float) -> FloatArray:
    return np.asarray(uv + np.array([x, y]))


@st.composite
def things(draw: st.DrawFn, road: Road, end: float) -> Thing:
    s, t = draw(hundredths(3, 10)), draw(hundredths(-20, 20))
    turn, height = draw(hundredths(-3.1, 3.1)), draw(hundredths(0.5, 9))
    above = draw(st.sampled_from([0.0, 0.0, -0.3, 0.8, 4.5]))
    kind = draw(st.sampled_from(["building", "obstacle", "barrier", "pole", "streetLamp"]))
    head = f'type="{kind}" s="{s}" t="{t}" zOffset="{above}" hdg="{turn}" height="{height}"'
    what = draw(st.sampled_from(["box", "local", "road", "repeat", "wall", "tree"]))
    x, y, z = road.world(np.array([s]), np.array([t]))[0].tolist()
    heading = float(np.interp(s, *np.concatenate(road.line.rows)[:, [0, 3]].T))
    low, top = z + above, z + above + height
    half = np.array([draw(hundredths(0.2, 4)), draw(hundredths(0.2, 2))])
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    size = f'length="{2 * half[0]:.6g}" width="{2 * half[1]:.6g}"'
    if what == "tree":
        head = head.replace(f'type="{kind}"', 'type="tree"').replace(f' zOffset="{above}"', "")
        return Thing(f"<object {head}/>", [], (x, y, height if height > 1 else 9.0))
    if what == "box":
        xy = shifted(turned(corners, heading + turn), x, y)
        return Thing(f"<object {head} {size}/>", [(xy, low, top)])
    if what == "local":
        corners = corners[: draw(st.sampled_from([3, 4]))] + draw(hundredths(-2, 2))
        xy = shifted(turned(corners, heading + turn), x, y)
        rows = [
            f'<cornerLocal u="{u!r}" v="{v!r}" z="0" height="{height}"/>'
            for u, v in corners.tolist()
        ]
        return Thing(
            f'<object {head} length="1" width="1"><outline>{"".join(rows)}</outline></object>',
            [(xy, low, top)],
        )
    if what == "road":
        st_ = shifted(np.array([[0, 0], [5, 0], [5, 2], [0, 2]]), s, t)
        positions = road.world(*st_.T)
        rows = [
            f'<cornerRoad s="{a!r}" t="{b!r}" dz="0" height="{height}"/>' for a, b in st_.tolist()
        ]
        body = (
            positions[:, :2],
            float(positions[:, 2].min()),
            float(positions[:, 2].max()) + height,
        )
        return Thing(f"<object {head}><outline>{''.join(rows)}</outline></object>", [body])
    length = draw(hundredths(1, end - 12)) if end > 14 else 1.0
    to = t + draw(hundredths(-3, 3))
    span = f's="{s}" length="{length}" tStart="{t}" tEnd="{to!r}"'
    span += (
        f' zOffsetStart="{above}" zOffsetEnd="{above}" heightStart="{height}" heightEnd="{height}"'
    )
    if what == "wall":
        count = max(1, math.ceil(length / 2))
        at = np.linspace(s, s + length, count + 1)
        ts = t + (to - t) * (at - s) / length
        left, right = (road.world(at, ts + k * half[1]) for k in (1, -1))
        bodies = []
        for i in range(count):
            ring = np.stack([right[i], right[i + 1], left[i + 1], left[i]])
            bodies.append(
                (ring[:, :2], ring[:, 2].min() + above, ring[:, 2].max() + above + height)
            )
        return Thing(f'<object {head} {size}><repeat {span} distance="0"/></object>', bodies)
    apart = draw(hundredths(1, 8))
    bodies = []
    for k in range(math.floor(length / apart + 1e-9) + 1):
        one = s + k * apart
        ti = t + (to - t) * k * apart / length
        x, y, z = road.world(np.array([one]), np.array([ti]))[0].tolist()
        heading = float(np.interp(one, *np.concatenate(road.line.rows)[:, [0, 3]].T))
        bodies.append(
            (shifted(turned(corners, heading + turn), x, y), z + above, z + above + height)
        )
    return Thing(f'<object {head} {size}><repeat {span} distance="{apart}"/></object>', bodies)


def test_opendrive_lanes_and_objects_lie_where_the_file_says(tmp_path: Path) -> None:
    file = tmp_path / "a.xodr"

    @given(roads())
    def holds(road: Road) -> None:
        file.write_text(road.text)
        site_map = read_opendrive(file)
        check_lanes(road, site_map)
        bodies = [body for thing in road.things for body in thing.bodies]
        assert len(site_map.bodies) == len(bodies)
        for mine, (outline, low, top) in zip(site_map.bodies, bodies, strict=True):
            np.testing.assert_allclose(mine.outline, outline, atol=0.03)
            assert mine.base_m is not None
            assert (mine.base_m, mine.base_m + mine.height_m) == pytest.approx((low, top), abs=0.03)
        trees = [t.tree for t in road.things if t.tree]
        np.testing.assert_allclose(
            np.array([(t.x_m, t.y_m, t.height_m) for t in site_map.trees]).reshape(-1, 3),
            np.array(trees).reshape(-1, 3),
            atol=0.03,
        )
        assert site_map.not_understood == []

    tried(holds)


def check_lanes(road: Road, site_map: SiteMap) -> None:
    """Checks that each border has its t from the reference line and its z, over the whole length of
    the road."""
    table = np.concatenate(road.line.rows)
    tree = cKDTree(table[:, 1:3])
    assert {lane.name for lane in site_map.lanes} == road.borders.keys()
    for lane in site_map.lanes:
        inner, outer = road.borders[lane.name]
        ends = []
        for border in (lane.left, lane.right):
            s = table[tree.query(border[:, :2])[1], 0]
            off = [
                np.abs(road.world(s, np.array(t[0] + t[1] * s)) - border).max(1)
                for t in (inner, outer)
            ]
            which = int(off[1].mean() < off[0].mean())
            assert off[which].max() < 0.03, lane.name
            assert (s.min(), s.max()) == pytest.approx((0, road.line.end[0]), abs=0.03)
            ends.append(which)
        assert sorted(ends) == [0, 1], lane.name


# --- OpenStreetMap

HEIGHTS = [
    ({}, 6.0), ({"height": "12"}, 12.0), ({"height": "9.5 m"}, 9.5), ({"height": "40 ft"}, 12.192),
    ({"building:levels": "4"}, 12.0), ({"height": "8", "building:levels": "9"}, 8.0),
]  # fmt: skip
GONE = [' action="delete"', ' visible="false"']


@dataclass
class Streets:
    """Collects the elements of an OSM file and their true positions. Positions are in metres around
    the centre."""

    centre: tuple[float, float]
    nodes: list[str] = field(default_factory=list)
    ways: list[str] = field(default_factory=list)
    places: dict[str, tuple[float, float]] = field(default_factory=dict)
    houses: list[tuple[FloatArray, float]] = field(default_factory=list)
    trees: list[tuple[float, float]] = field(default_factory=list)
    # nodes, layer and ids of each road
    roads: list[tuple[list[str], int, list[str]]] = field(default_factory=list)
    sign: int = 1  # sign of the ids; editors write negative ids

    def node(self, x: float, y: float, tags: str = "", more: str = "") -> str:
        name = str(self.sign * (len(self.places) + 1))
        lon, lat = lon_lat(np.array([[x, y]]), self.centre)[0].tolist()
        self.places[name] = (x, y)
        self.nodes.append(f'<node id="{name}" lon="{lon!r}" lat="{lat!r}"{more}>{tags}</node>')
        return name

    def way(self, nodes: list[str], tags: dict[str, str], more: str = "") -> str:
        inner = "".join(f'<nd ref="{n}"/>' for n in nodes)
        inner += "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
        name = str(self.sign * (len(self.ways) + 1))
        self.ways.append(f'<way id="{name}"{more}>{inner}</way>')
        return name

    def text(self, nodes_behind: bool = False) -> str:
        parts = self.ways + self.nodes if nodes_behind else self.nodes + self.ways
        return f'<osm version="0.6">{"".join(parts)}</osm>'


@st.composite
def towns(draw: st.DrawFn) -> Streets:
    """Returns towns with straight roads on several layers, houses and trees. Some of each are
    deleted."""
    town = Streets(draw(st.sampled_from(CENTRES)), sign=draw(st.sampled_from([1, -1])))
    for k in range(draw(st.integers(1, 4))):
        angle = math.pi * (k + draw(hundredths(0.1, 0.6))) / 4
        away = draw(hundredths(-60, 60))
        layer = draw(st.sampled_from([0, 0, 1, 2, -1]))
        half = draw(hundredths(70, 150))
        way, side = (
            np.array([math.cos(angle), math.sin(angle)]),
            away * np.array([-math.sin(angle), math.cos(angle)]),
        )
        ends = [town.node(*(side + way * u).tolist()) for u in (-900, -half, half, 900)]
        tags = {"highway": draw(st.sampled_from(["primary", "residential", "motorway"]))}
        above = {0: {}, 1: {"bridge": "yes"}, -1: {"tunnel": "yes"}}.get(layer, {"bridge": "yes"})
        if abs(layer) > 1 or (layer and draw(st.booleans())):
            above = {**above, "layer": str(layer)}
        ids = [
            town.way(ends[:2], tags),
            town.way(ends[1:3], {**tags, **above}),
            town.way(ends[2:], tags),
        ]
        town.roads.append((ends, layer, ids))
        if draw(st.integers(0, 3)) == 0:  # an editor has deleted the road
            gone = [town.node(*(side + way * u + 30).tolist()) for u in (-900, 900)]
            town.way(gone, {**tags, "layer": "3"}, draw(st.sampled_from(GONE)))
    for _ in range(draw(st.integers(0, 5))):
        tags, height = draw(st.sampled_from(HEIGHTS))
        half = np.array([draw(hundredths(2, 12)), draw(hundredths(2, 12))])
        corners = turned(
            np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half, draw(hundredths(0, 3))
        )
        corners += np.array(draw(st.tuples(*[hundredths(-250, 250)] * 2)))
        nodes = [town.node(*c.tolist()) for c in corners]
        more = draw(st.sampled_from(["", "", *GONE]))
        town.way([*nodes, nodes[0]], {"building": "yes", **tags}, more)
        if not more:
            town.houses.append((corners, height))
    for _ in range(draw(st.integers(0, 3))):
        x, y = draw(st.tuples(*[hundredths(-200, 200)] * 2))
        more = draw(st.sampled_from(["", "", *GONE]))
        town.node(x, y, '<tag k="natural" v="tree"/>', more)
        if not more:
            town.trees.append((x, y))
    return town


def test_openstreetmap_houses_and_trees_stand_where_they_are(tmp_path: Path) -> None:
    file = tmp_path / "a.osm"

    @given(towns(), st.booleans())
    def holds(town: Streets, nodes_behind: bool) -> None:
        file.write_text(town.text(nodes_behind))
        site_map = SiteMap()
        add_surroundings(site_map, read_street_map(file), town.centre, 1000)
        assert len(site_map.bodies) == len(town.houses)
        for mine, (outline, height) in zip(site_map.bodies, town.houses, strict=True):
            np.testing.assert_allclose(mine.outline, outline, atol=0.02)
            assert mine.height_m == pytest.approx(height)
        trees = np.array([(t.x_m, t.y_m) for t in site_map.trees]).reshape(-1, 2)
        np.testing.assert_allclose(trees, np.array(town.trees).reshape(-1, 2), atol=0.02)

    tried(holds)


def test_openstreetmap_roads_on_two_layers_are_apart_or_named(tmp_path: Path) -> None:
    file = tmp_path / "a.osm"

    @given(towns())
    def holds(town: Streets) -> None:
        file.write_text(town.text())
        streets = read_street_map(file)
        levels = find_levels(streets, town.centre, 1000)
        lines = [profile(town, levels, ends, ids, streets) for ends, _, ids in town.roads]
        for i, (_, layer, ids) in enumerate(town.roads):
            for line in lines[i]:
                step = np.hypot(*np.diff(line[:, :2], axis=0).T)
                assert (np.abs(np.diff(line[:, 2])) <= 0.2 * step + 0.01).all()
            for j, (_, other, others) in enumerate(town.roads[:i]):
                meet = crossing(lines[i], lines[j])
                if meet is None:
                    continue
                (a, z), (b, w) = meet
                on = (layer if a == 1 else 0), (other if b == 1 else 0)
                named = any(f"way {ids[a]} " in n and f"way {others[b]} " in n for n in levels.flat)
                if on[0] != on[1] and not named:
                    assert (z - w) * np.sign(on[0] - on[1]) >= LEAST_M - 0.02

    tried(holds)


def profile(town: Streets, levels, ends, ids, streets) -> list[FloatArray]:  # type: ignore[no-untyped-def]
    """Returns the profile x y z (n, 3) of each way of a road."""
    nodes_of = {way.id: way.nodes for way in streets.ways}
    profiles = []
    for name in ids:
        nodes = levels.ways.get(name, nodes_of[name])
        rows = []
        for node in nodes:
            place = town.places.get(node)
            if place is None:
                degrees = np.array(levels.places[node])
                a, b = (np.array(town.places[nodes_of[name][k]]) for k in (0, -1))
                first, last = (np.array(streets.nodes[nodes_of[name][k]]) for k in (0, -1))
                k = int(np.abs(last - first).argmax())
                place = tuple(a + (b - a) * (degrees - first)[k] / (last - first)[k])
            rows.append((*place, levels.heights.get(node, 0.0)))
        profiles.append(np.array(rows))
    return profiles


def crossing(one: list[FloatArray], other: list[FloatArray]):  # type: ignore[no-untyped-def]
    """Returns the parts at which two straight roads cross, and z of each; None if they do not
    cross."""
    p, q = one[0][0, :2], other[0][0, :2]
    d, e = one[-1][-1, :2] - p, other[-1][-1, :2] - q
    u, v = np.linalg.solve(np.stack([d, -e], 1), q - p)
    if not (0 < u < 1 and 0 < v < 1):
        return None
    out = []
    for parts, at in ((one, p + u * d), (other, q + v * e)):
        along = [np.hypot(*(part[:, :2] - parts[0][0, :2]).T) for part in parts]
        way = math.dist(at, parts[0][0, :2])
        k = next(i for i, s in enumerate(along) if s[0] - 1e-6 <= way <= s[-1] + 1e-6)
        if min(abs(way - along[k][0]), abs(way - along[k][-1])) < 1:
            return None  # the crossing is at the end of a bridge
        out.append((k, float(np.interp(way, along[k], parts[k][:, 2]))))
    return out


@st.composite
def crossings(draw: st.DrawFn) -> tuple[Streets, list[tuple[float, int, float]]]:
    """Returns one road and possibly a road above it, with their angle, lanes and z."""
    town = Streets(draw(st.sampled_from(CENTRES)))
    angle = draw(hundredths(0, 3.1))
    roads_ = []
    for k in range(draw(st.integers(1, 2))):
        oneway = draw(st.booleans())
        lanes = draw(st.integers(1, 3)) * (1 if oneway else 2)
        tags = {"highway": "primary", "lanes": str(lanes), "oneway": "yes" if oneway else "no"}
        turn = angle + k * draw(hundredths(1.2, 1.9))
        way = np.array([math.cos(turn), math.sin(turn)])
        nodes = [town.node(*(way * u).tolist()) for u in (-400, -80, 80, 400)]
        above = {"bridge": "yes", "layer": "1"} if k else {}
        for i in range(3):
            town.way(nodes[i : i + 2], {**tags, **(above if i == 1 else {})})
        roads_.append((turn, lanes, 6.0 * k))
    gone = [town.node(-300, 40), town.node(300, 40)]
    town.way(gone, {"highway": "primary", "lanes": "4"}, draw(st.sampled_from(GONE)))
    return town, roads_


def test_openstreetmap_roads_have_their_lanes_and_heights(tmp_path: Path) -> None:
    """The test runs the whole import, and checks the middle of each road."""
    pytest.importorskip("sumo", reason="needs the extra `site`")
    count = iter(range(10**6))

    @given(crossings())
    def holds(drawn: tuple[Streets, list[tuple[float, int, float]]]) -> None:
        town, roads_ = drawn
        folder = tmp_path / str(next(count))
        folder.mkdir()
        (folder / "a.osm").write_text(town.text())
        import_map(folder / "a.osm", folder / "s", ImportOptions(town.centre, 300))
        points: list[list[tuple[float, float]]] = [[] for _ in roads_]
        for lane in read_lanes(folder / "s/lanes.csv").values():
            for a, b in itertools.pairwise(lane):
                way = (b - a)[:2] / math.dist(a[:2], b[:2])
                for k, (turn, _, _) in enumerate(roads_):
                    ahead = np.array([math.cos(turn), math.sin(turn)])
                    if abs(way @ ahead) < 0.99:
                        continue
                    u, v = a[:2] @ ahead, b[:2] @ ahead
                    if (u < 1) != (v < 1):  # the side depends on the middle of the road
                        position = a + (b - a) * (1 - u) / (v - u)
                        side = float(position[:2] @ [-ahead[1], ahead[0]])
                        points[k].append((side, float(position[2])))
        for (_, lanes, z), mine in zip(roads_, points, strict=True):
            sides = np.sort([side for side, _ in mine])
            assert len(mine) == lanes
            assert (np.diff(sides) > 2.4).all()
            assert np.abs(sides).max() < 3.6 * lanes
            np.testing.assert_allclose([each for _, each in mine], z, atol=0.1)

    tried(holds, most=EXAMPLES // 8 if SECONDS else 5)
