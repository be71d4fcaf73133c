"""Computes heights of bridges and tunnels from the layers in OpenStreetMap.

A way on a higher layer is lifted if it crosses another way. The lifted way is level over its whole
length, with ramps along the roads on both sides. A tunnel is lowered in the same manner.
"""

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.scenes.maps.openstreetmap import (
    StreetMap,
    Way,
    all_elements,
    is_deleted,
    transverse_mercator,
)
from pyinfra.scenes.maps.osm_lanes import swap_sides
from pyinfra.scenes.maps.ramps import CLEARANCE_M, RAMP_M, ramp_shares
from pyinfra.scenes.maps.surfaces import side_of, to_segments

LEAST_M = 4.5  # height difference below which a crossing is reported
STEP_M = 15.0  # distance between the nodes of a ramp
NO_ROADS = frozenset("proposed construction planned abandoned razed disused platform".split())
APART_M = 3.0  # minimum distance between an added node and a crossing
COVERED_M = -4.0  # roads below this z have ground above them
_ROUNDS = 8  # maximum number of iterations


@dataclass
class Levels:
    """The heights of nodes, and the nodes added for ramps."""

    heights: dict[str, float] = field(default_factory=dict)  # height by node id, unless it is 0
    places: dict[str, tuple[float, float]] = field(default_factory=dict)  # lon, lat of added nodes
    ways: dict[str, list[str]] = field(default_factory=dict)  # node ids by id of a changed way
    crossings: int = 0  # number of crossings with enough clearance
    flat: list[str] = field(default_factory=list)  # texts about crossings with too little clearance


@dataclass(frozen=True)
class _Crossing:
    upper: Way
    lower: Way
    xy: tuple[float, float]
    on_upper: tuple[str, str]  # nodes of the upper way around the crossing
    on_lower: tuple[str, str]


def level(tags: dict[str, str]) -> int:
    """Returns the tag `layer`, or without the tag, 1 for a bridge, -1 for a tunnel, else 0."""
    match = re.match(r"\s*([+-]?\d{1,2})\b", tags.get("layer", ""))
    if match:
        return int(match[1])
    if _is(tags, "bridge"):
        return 1
    return -1 if _is(tags, "tunnel") and tags["tunnel"] != "building_passage" else 0


def _is(tags: dict[str, str], key: str) -> bool:
    return tags.get(key, "no") not in ("no", "false", "0", "")


def find_levels(map_: StreetMap, centre: tuple[float, float], radius_m: float) -> Levels:
    """Computes heights around the centre. Heights in the map take precedence."""
    out = Levels()
    if not any(level(way.tags) for way in map_.ways):
        return out
    net = _Net(map_, centre, radius_m)
    crossings = net.crossings()
    if crossings and any(i in map_.with_heights for way in map_.ways for i in way.nodes):
        out.flat = [f"{_name(c)}: heights of the map are kept" for c in crossings]
        return out
    if not crossings:
        return out
    net.divide(crossings)
    crossings = net.crossings()
    net.solve(crossings)
    for c in crossings:
        gap = net.gap(c)
        if gap < LEAST_M:
            why = f"because ramps of {RAMP_M:g} m do not fit"
            out.flat.append(f"{_name(c)}: the height difference is only {gap:.1f} m, {why}")
    out.crossings = len(crossings) - len(out.flat)
    out.heights = {i: round(z, 3) for i, z in net.z.items() if abs(z) > 1e-3}
    out.places = {i: place for i, place in net.new.items() if i in out.heights}
    out.ways = {
        way.id: [i for i in nodes if i in out.places or i not in net.new]
        for way, nodes in net.ways
        if not out.places.keys().isdisjoint(nodes)
    }
    return out


def write_levelled(
    file: Path, out: Path, map_: StreetMap, levels: Levels, *, swapped: bool = False
) -> None:
    """Writes the map with heights, without deleted elements; `swapped`: with `swap_sides`.

    Nodes are written first, because netconvert requires this order.
    """
    written, taken = set[str](), set[tuple[str, str]]()
    with out.open("w", encoding="utf-8") as stream:
        stream.write('<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">\n')
        for element in _kept(file, {"node"}):
            written.add(element.get("id", ""))
            if map_.ignores_heights:
                for tag in element.findall("tag[@k='ele']"):
                    element.remove(tag)
            height = levels.heights.get(element.get("id", ""))
            if height is not None or (element.get("lon"), element.get("lat")) not in taken:
                _place(element, taken)
            _set_height(element, height)
            stream.write(ElementTree.tostring(element, encoding="unicode"))
        more = {i: place for i, place in map_.nodes.items() if i not in written}
        for name, (lon, lat) in {**more, **levels.places}.items():
            element = Element("node", {"id": name, "lon": repr(lon), "lat": repr(lat)})
            _set_height(element, levels.heights.get(name))
            stream.write(ElementTree.tostring(element, encoding="unicode"))
        for element in _kept(file, {"way", "relation"}):
            if element.tag == "way":
                _set_nodes(element, levels.ways.get(element.get("id", "")), map_)
                for tag in element.iterfind("tag") if swapped else ():
                    swap_sides(tag)
            stream.write(ElementTree.tostring(element, encoding="unicode"))
        stream.write("</osm>\n")


def _place(element: Element, taken: set[tuple[str, str]]) -> None:
    """Moves a node by half a metre if another node has the same position.

    netconvert would merge nodes at the same position.
    """
    while (place := (element.get("lon", ""), element.get("lat", ""))) in taken:
        element.set("lat", repr(float(place[1]) + 5e-6))
    taken.add(place)


def _kept(file: Path, tags: set[str]) -> Iterator[Element]:
    return (e for e in all_elements(file) if e.tag in tags and not is_deleted(e))


def _set_height(node: Element, height: float | None) -> None:
    if height is not None:
        node.append(Element("tag", {"k": "ele", "v": f"{height:.3f}"}))


def _set_nodes(way: Element, nodes: list[str] | None, map_: StreetMap) -> None:
    """Replaces the node references of a way, and drops references to nodes without a position."""
    old = way.findall("nd")
    for nd in old:
        way.remove(nd)
    for name in nodes or [nd.get("ref", "") for nd in old]:
        if nodes or name in map_.nodes:
            way.append(Element("nd", {"ref": name}))


def _name(c: _Crossing) -> str:
    x, y = c.xy
    return f"way {c.upper.id} (bridge, layer) crosses above way {c.lower.id} at {x:.1f} {y:.1f}"


class _Net:
    """The ways as a graph of nodes with positions in metres."""

    def __init__(self, map_: StreetMap, centre: tuple[float, float], radius_m: float) -> None:
        built = [way for way in map_.ways if way.tags.get("highway") not in NO_ROADS]
        self.ways = [(way, [i for i in way.nodes if i in map_.nodes]) for way in built]
        used = sorted({i for _, nodes in self.ways for i in nodes})
        self.lon_lat = {i: map_.nodes[i] for i in used}
        coordinates = np.array([map_.nodes[i] for i in used])
        near = (
            np.abs(coordinates - centre).max(1) < 5
        )  # the projection is inaccurate beyond 5 degrees
        xy = np.where(near[:, None], coordinates, np.array(centre))
        xy = np.where(near[:, None], transverse_mercator(xy, centre), math.inf)
        self.xy: dict[str, tuple[float, float]] = dict(
            zip(used, map(tuple, xy.tolist()), strict=True)
        )
        self.reach_m = radius_m + 1000.0
        self.new: dict[str, tuple[float, float]] = {}
        self.z: dict[str, float] = {}
        ids = [int(i) for i in map_.nodes if i.lstrip("-").isdigit()]
        self._fresh = itertools.count(max(map(abs, ids), default=0) + 1)

    def crossings(self) -> list[_Crossing]:
        """Returns the crossings of ways on two levels, except where the ways share a node."""
        near = {i for i, xy in self.xy.items() if math.hypot(*xy) < self.reach_m}
        pieces = [
            (k, a, b)
            for k, (_, nodes) in enumerate(self.ways)
            for a, b in itertools.pairwise(nodes)
            if a in near and b in near
        ]
        nodes = [(a, b) for _, a, b in pieces]
        start, end = (np.array([self.xy[p[i]] for p in nodes]).reshape(-1, 2) for i in (0, 1))
        on = np.array([level(self.ways[p[0]][0].tags) for p in pieces], int)
        by_pair: dict[tuple[str, str, int, int], _Crossing] = {}
        for i in np.flatnonzero(on).tolist():
            for j in _crossed(start, end, i).tolist():
                if on[i] == on[j] or not set(pieces[i][1:]).isdisjoint(pieces[j][1:]):
                    continue
                u, v = (i, j) if on[i] > on[j] else (j, i)
                upper, lower = (self.ways[pieces[k][0]][0] for k in (u, v))
                xy = _meeting(start[u], end[u], start[v], end[v])
                segments = (pieces[u][1], pieces[u][2]), (pieces[v][1], pieces[v][2])
                key = (upper.id, lower.id, round(xy[0]), round(xy[1]))
                by_pair.setdefault(key, _Crossing(upper, lower, xy, *segments))
        return list(by_pair.values())

    def divide(self, crossings: list[_Crossing]) -> None:
        """Adds nodes to long segments that a ramp may reach."""
        at = np.array([c.xy for c in crossings])
        most = max(abs(level(way.tags)) for c in crossings for way in (c.upper, c.lower))
        reach = 2 * RAMP_M * (1 + min(most, 5))
        for _, nodes in self.ways:
            extended = nodes[:1]
            for a, b in itertools.pairwise(nodes):
                p, q = np.array(self.xy[a]), np.array(self.xy[b])
                if np.isfinite([p, q]).all() and to_segments(at, p, q).min() < reach:
                    count = math.ceil(math.dist(p, q) / STEP_M)
                    parts = np.arange(1, count) / count
                    apart = [np.hypot(*(p + (q - p) * u - at).T).min() for u in parts]
                    # No node is added close to a crossing, because netconvert merges such nodes.
                    extended += [
                        self._put(a, b, float(u))
                        for u, metres in zip(parts, apart, strict=True)
                        if metres > APART_M
                    ]
                extended.append(b)
            nodes[:] = extended

    def _put(self, a: str, b: str, part: float) -> str:
        name = str(next(self._fresh))
        for coordinates in (self.xy, self.lon_lat):
            (x0, y0), (x1, y1) = coordinates[a], coordinates[b]
            coordinates[name] = (x0 + (x1 - x0) * part, y0 + (y1 - y0) * part)
        self.new[name] = self.lon_lat[name]
        return name

    def solve(self, crossings: list[_Crossing]) -> None:
        """Computes heights that give all crossings enough clearance, as far as ramps fit."""
        ways = {way.id: nodes for way, nodes in self.ways}
        next_: dict[str, dict[str, float]] = {}
        for _, nodes in self.ways:
            for a, b in itertools.pairwise(nodes):
                metres = math.dist(self.xy[a], self.xy[b])
                next_.setdefault(a, {})[b] = next_.setdefault(b, {})[a] = metres
        goal: dict[str, float] = {}  # maps the id of each lifted or lowered way to its height
        pinned: dict[str, set[str]] = {}  # maps a way id to the nodes that its ramps keep
        for c in crossings:
            pinned.setdefault(c.upper.id, set()).update(c.on_lower)
            pinned.setdefault(c.lower.id, set()).update(c.on_upper)
        for _ in range(_ROUNDS):
            lacking = [c for c in crossings if CLEARANCE_M - self.gap(c) >= 0.01]
            if not lacking:
                return
            for c in sorted(lacking, key=lambda c: level(c.upper.tags)):
                if level(c.upper.tags) > 0:
                    name, z = c.upper.id, self.z_at(c.on_lower, c.xy) + CLEARANCE_M
                    goal[name] = max(goal.get(name, 0.0), z)
                else:
                    name, z = c.lower.id, self.z_at(c.on_upper, c.xy) - CLEARANCE_M
                    goal[name] = min(goal.get(name, 0.0), z)
            high, low = dict[str, float](), dict[str, float]()
            for name, z in goal.items():
                side, fixed = (high if z > 0 else low), pinned[name] - set(ways[name])
                for node, share in ramp_shares(next_, ways[name], fixed, abs(z)).items():
                    side[node] = max(side.get(node, 0.0), abs(z) * share)
            self.z = {i: high.get(i, 0.0) - low.get(i, 0.0) for i in {*high, *low}}

    def z_at(self, piece: tuple[str, str], xy: tuple[float, float]) -> float:
        """Returns the height of a segment of a way at a position."""
        a, b = piece
        part = math.dist(self.xy[a], xy) / max(math.dist(self.xy[a], self.xy[b]), 1e-9)
        return (1 - part) * self.z.get(a, 0.0) + part * self.z.get(b, 0.0)

    def gap(self, c: _Crossing) -> float:
        return self.z_at(c.on_upper, c.xy) - self.z_at(c.on_lower, c.xy)


def _crossed(start: FloatArray, end: FloatArray, i: int) -> IntArray:
    """Returns the indices of the segments that cross segment i or end at it."""
    a, b = start[i], end[i]
    low, high = np.minimum(a, b), np.maximum(a, b)
    near = ((np.minimum(start, end) <= high) & (np.maximum(start, end) >= low)).all(1)
    candidates = np.flatnonzero(near)
    p, q = start[candidates], end[candidates]
    across = (side_of(a, b, p) * side_of(a, b, q) <= 0) & (side_of(p, q, a) * side_of(p, q, b) <= 0)
    across &= side_of(p, q, a) != side_of(p, q, b)  # excludes collinear segments
    return np.asarray(candidates[across])


def _meeting(a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray) -> tuple[float, float]:
    """Returns the intersection of the line from a to b with the line from p to q."""
    before, behind = side_of(p, q, a), side_of(p, q, b)
    x, y = a + (b - a) * (before / (before - behind))
    return float(x), float(y)
