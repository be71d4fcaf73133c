"""The graph of a SUMO network, with permitted classes and lengths, for computing routes."""

import heapq
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError

TURN_LIMIT_M_S2 = 2.5  # maximum lateral acceleration in junctions
_MARK_M = 5.0  # maximum distance between points along an edge


@dataclass(frozen=True)
class Edge:
    """A road in one direction.

    `shape` (n, 2) is x y of the first lane that is not only for pedestrians.
    """

    name: str
    start: str
    end: str
    shape: FloatArray
    speed_m_s: float
    lanes: tuple[frozenset[str] | None, ...]  # permitted classes of each lane; None permits all

    def lanes_for(self, sumo_class: str) -> int:
        """Returns the number of lanes that permit a class."""
        return sum(lane is None or sumo_class in lane for lane in self.lanes)

    @cached_property
    def length_m(self) -> float:
        """Length of the shape in metres."""
        return float(np.linalg.norm(np.diff(self.shape, axis=0), axis=1).sum())

    @cached_property
    def marks(self) -> FloatArray:
        """Points (n, 2) along the shape, at most 5 m apart."""
        pieces = []
        for a, b in zip(self.shape, self.shape[1:], strict=False):
            count = int(np.ceil(np.linalg.norm(b - a) / _MARK_M)) + 1
            pieces.append(a + np.linspace(0, 1, count)[:, None] * (b - a))
        return np.concatenate(pieces)


@dataclass(frozen=True)
class RoadNet:
    """Edges by name, and the links between them.

    `links` maps each edge to the edges that follow it, with the permitted classes. None permits all
    classes.
    """

    edges: dict[str, Edge]
    links: dict[str, dict[str, frozenset[str] | None]]
    walkable: bool  # whether sidewalks and crossings are connected
    turn_speed_limited: bool  # whether lateral acceleration in junctions is limited

    def sources(self, sumo_class: str) -> list[Edge]:
        """Returns the edges where traffic enters the map: only a U-turn may lead to them."""
        return [e for e in self._of(sumo_class) if not self._leads_on(e.name)]

    def sinks(self, sumo_class: str) -> list[Edge]:
        """Returns the edges where traffic leaves the map."""
        return [e for e in self._of(sumo_class) if not self._goes_on(e)]

    def routes_from(self, source: Edge, sumo_class: str) -> dict[str, list[str]]:
        """Returns the fastest route, as edge names, to each edge that can be reached."""
        best: dict[str, list[str]] = {}
        heap: list[tuple[float, list[str]]] = [(0.0, [source.name])]
        while heap:
            seconds, way = heapq.heappop(heap)
            edge = self.edges[way[-1]]
            if edge.name in best:
                continue
            best[edge.name] = way
            seconds += edge.length_m / edge.speed_m_s
            for to, permitted in sorted(self.links.get(edge.name, {}).items()):
                if to not in best and (permitted is None or sumo_class in permitted):
                    heapq.heappush(heap, (seconds, [*way, to]))
        return best

    def _of(self, sumo_class: str) -> list[Edge]:
        return [e for e in self.edges.values() if e.lanes_for(sumo_class)]

    def _goes_on(self, edge: Edge) -> bool:
        return any(self.edges[to].end != edge.start for to in self.links.get(edge.name, ()))

    def _leads_on(self, name: str) -> bool:
        into = [e for e, targets in self.links.items() if name in targets]
        return any(self.edges[e].start != self.edges[name].end for e in into)


def read_road_net(file: Path) -> RoadNet:
    """Reads a .net.xml. Raises FormatError, OSError."""
    try:
        root = ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        raise FormatError(f"{file}: expected a SUMO network, got broken XML ({error})") from error
    if root.tag != "net":
        raise FormatError(f"{file}: expected the element <net>, got <{root.tag[:40]}>")
    try:
        return _net(root)
    except (KeyError, ValueError) as error:
        raise FormatError(
            f"{file}: expected a SUMO network, got a missing or invalid attribute: {error}"
        ) from error


def _net(root: ElementTree.Element) -> RoadNet:
    edges = {e.name: e for node in root.findall("edge") if (e := _edge(node)) is not None}
    links: dict[str, dict[str, frozenset[str] | None]] = {}
    for link in root.findall("connection"):
        if link.attrib["from"] in edges and link.attrib["to"] in edges:
            start, end = edges[link.attrib["from"]], edges[link.attrib["to"]]
            classes = _led(link, start, end)
            before = links.setdefault(start.name, {}).get(end.name, frozenset())
            permitted = None if classes is None or before is None else before | classes
            links[start.name][end.name] = permitted
    slow_turns = 0 < float(root.get("limitTurnSpeed", "0")) <= TURN_LIMIT_M_S2
    functions = {node.get("function") for node in root.findall("edge")}
    return RoadNet(edges, links, "walkingarea" in functions, slow_turns)


def _edge(node: ElementTree.Element) -> Edge | None:
    """Reads an edge, or returns None for an edge inside a junction or without a lane."""
    lanes = node.findall("lane")
    if node.get("function", "normal") not in ("normal", "connector") or not lanes:
        return None
    driven = [lane for lane in lanes if lane.get("allow") != "pedestrian"] or lanes
    points = [p.split(",")[:2] for p in driven[0].attrib["shape"].split()]
    return Edge(
        node.attrib["id"],
        node.attrib["from"],
        node.attrib["to"],
        np.array(points, dtype=float),
        max(float(driven[0].attrib["speed"]), 0.1),
        tuple(_borne(lane) for lane in lanes),
    )


def _led(link: ElementTree.Element, start: Edge, end: Edge) -> frozenset[str] | None:
    """Returns the classes that a connection permits, or None if it permits all.

    Pedestrians are permitted if both edges permit them.
    """
    lanes = [_lane(start, link.get("fromLane")), _lane(end, link.get("toLane")), _borne(link)]
    walks = start.lanes_for("pedestrian") and end.lanes_for("pedestrian")
    restricted = [lane for lane in lanes if lane is not None]
    if not restricted:
        return None
    permitted = frozenset.intersection(*restricted)
    return permitted | {"pedestrian"} if walks else permitted


def _lane(edge: Edge, index: str | None) -> frozenset[str] | None:
    number = int(index or 0)
    return edge.lanes[number] if 0 <= number < len(edge.lanes) else frozenset()


# SUMO classes of objects for which routes can be computed.
_ASKED = {"passenger", "delivery", "truck", "bus", "motorcycle", "bicycle", "pedestrian"}


def _borne(lane: ElementTree.Element) -> frozenset[str] | None:
    if "allow" in lane.attrib:
        names = set(lane.attrib["allow"].split())
        return None if "all" in names else frozenset(_ASKED & names)
    barred = set(lane.get("disallow", "").split())
    return frozenset() if "all" in barred else frozenset(_ASKED - barred)
