"""Reads OpenStreetMap files, and converts positions to metres around a centre."""

import gzip
import math
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import MapError, number_or_nan
from pyinfra.scenes.maps.map_file import opened

BESIDE_DEG = 0.05  # maximum distance of a centre from the map's roads
_FLATTENING = 1 / 298.257223563  # flattening of the WGS 84 ellipsoid
_RADIUS_M = 6378137.0


def transverse_mercator(lon_lat: FloatArray, centre: tuple[float, float]) -> FloatArray:
    """Returns metres (n, 2) east and north of the centre, with scale 1 on its meridian.

    The function uses Krueger's series to the fourth order. Within 3 degrees of the meridian, its
    results agree with those of PROJ's tmerc to micrometres.
    """
    lon, lat = np.radians(np.atleast_2d(lon_lat)).T
    east, north = _kruger(lon - math.radians(centre[0]), lat)
    origin = _kruger(np.zeros(1), np.radians([centre[1]]))[1]
    return np.stack([east, north - origin], 1)


def _kruger(lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    n = _FLATTENING / (2 - _FLATTENING)
    e = math.sqrt(_FLATTENING * (2 - _FLATTENING))
    radius = _RADIUS_M / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    alpha = (
        n / 2 - 2 / 3 * n**2 + 5 / 16 * n**3 + 41 / 180 * n**4,
        13 / 48 * n**2 - 3 / 5 * n**3 + 557 / 1440 * n**4,
        61 / 240 * n**3 - 103 / 140 * n**4,
        49561 / 161280 * n**4,
    )
    tau = np.sinh(np.arctanh(np.sin(lat)) - e * np.arctanh(e * np.sin(lat)))
    xi = np.arctan2(tau, np.cos(lon))
    eta = np.arcsinh(np.sin(lon) / np.hypot(tau, np.cos(lon)))
    waves = [(2 * k, a) for k, a in enumerate(alpha, start=1)]
    north = xi + sum(a * np.sin(k * xi) * np.cosh(k * eta) for k, a in waves)
    east = eta + sum(a * np.cos(k * xi) * np.sinh(k * eta) for k, a in waves)
    return np.asarray(radius * east), np.asarray(radius * north)


Side = Literal["left", "right"]
ROUNDABOUTS = frozenset({"roundabout", "circular"})
AT_STREETS = frozenset("highway railway public_transport traffic_sign".split())
RAILWAYS = frozenset("rail light_rail tram subway narrow_gauge monorail".split())


@dataclass(frozen=True)
class Way:
    """A road, railway or platform. `nodes` are ids of nodes."""

    id: str
    nodes: list[str]
    tags: dict[str, str]


@dataclass(frozen=True)
class Multipolygon:
    """A building of one or more ways. `members` are ids of ways with their roles."""

    id: str
    members: list[tuple[str, str]]
    tags: dict[str, str]


@dataclass
class StreetMap:
    """The content of an OSM file. Positions are lon, lat in degrees."""

    nodes: dict[str, tuple[float, float]] = field(default_factory=dict)
    # Id, node ids and tags of each building.
    houses: list[tuple[str, list[str], dict[str, str]]] = field(default_factory=list)
    multipolygons: list[Multipolygon] = field(default_factory=list)
    outlines: dict[str, list[str]] = field(default_factory=dict)  # node ids of ways without traffic
    trees: list[tuple[str, dict[str, str]]] = field(default_factory=list)  # id and tags of trees
    ways: list[Way] = field(default_factory=list)
    # Ids and tags of nodes with street features, such as stops and signals.
    things: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    lines: list[Way] = field(default_factory=list)  # ways of platforms
    others: list[str] = field(default_factory=list)  # texts about ignored elements
    with_heights: set[str] = field(default_factory=set)  # ids of nodes with a number as `ele`
    ignores_heights: bool = False  # whether only some nodes of the ways have heights
    lanelets: int = 0  # number of relations of Lanelet2
    deleted: int = 0  # number of elements marked as deleted
    # Whether nodes come after or inside ways, as in some files of Overpass.
    rearranged: bool = False

    def of_highways(self) -> list[str]:
        """Returns the ids of the road nodes whose position is known."""
        return [i for w in self.ways if "highway" in w.tags for i in w.nodes if i in self.nodes]

    def place_of(self, centre: tuple[float, float] | None) -> tuple[tuple[float, float], bool]:
        """Returns the centre as lon, lat, and whether the user gave it as lat, lon.

        The default is the map's middle. The user's order is assumed to be lat, lon if only that
        order gives a position near the map's roads.
        """
        places = np.array([self.nodes[i] for i in self.of_highways()]).reshape(-1, 2)
        low, high = places.min(0), places.max(0)
        if centre is None:
            return (float((low + high)[0] / 2), float((low + high)[1] / 2)), False

        def is_in_map(place: tuple[float, float]) -> bool:
            return bool((place >= low - BESIDE_DEG).all() and (place <= high + BESIDE_DEG).all())

        swapped = (centre[1], centre[0])
        turned = is_in_map(swapped) and not is_in_map(centre)
        return (swapped if turned else centre), turned

    def traffic_side(self) -> Side | None:
        """Returns the side of the road on which vehicles drive; None if the map does not show it.

        Vehicles drive around a roundabout in the direction of its ways. With traffic on the left,
        they drive clockwise. A way may be a part of a roundabout.
        """
        turns = 0.0
        for way in self.ways:
            corners = [self.nodes[i] for i in way.nodes if i in self.nodes]
            if way.tags.get("junction") in ROUNDABOUTS and len(corners) > 2:
                corners = corners[:: -1 if way.tags.get("oneway") == "-1" else 1]
                xy = transverse_mercator(np.array(corners), corners[0])
                ahead = np.arctan2(*np.diff(xy, axis=0).T[::-1])
                turns += float(((np.diff(ahead) + np.pi) % (2 * np.pi) - np.pi).sum())
        if abs(turns) < 1:
            return None
        return "left" if turns < 0 else "right"

    def check_centre(self, centre: tuple[float, float], file: Path, radius_m: float) -> None:
        """Raises MapError if the centre is farther from the map's roads than the radius."""
        places = np.array([self.nodes[i] for i in self.of_highways()])
        metres = transverse_mercator(places, centre)
        if (metres.min(0) > radius_m).any() or (metres.max(0) < -radius_m).any():
            (west, south), (east, north) = places.min(0), places.max(0)
            raise MapError(
                f"{file}: `centre`: expected longitude {west:.4f} to {east:.4f} and latitude "
                f"{south:.4f} to {north:.4f}, got {centre[0]:g}, {centre[1]:g}"
            )


def read_street_map(file: Path) -> StreetMap:
    """Reads an OSM file, or counts the lanelets of a Lanelet2 map. Raises MapError and OSError."""
    street_map = StreetMap()
    for node in all_elements(file):
        _read_element(node, street_map, file)
    if street_map.lanelets:  # a map of Lanelet2, which has the same ending
        return street_map
    if not any("highway" in way.tags for way in street_map.ways):
        raise MapError(f"{file}: expected one or more ways with the tag `highway`, got none")
    if not street_map.of_highways():
        raise MapError(
            f"{file}: expected ways with the tag `highway` whose nodes have positions, got none"
        )
    _drop_partial_heights(street_map)
    return street_map


def _drop_partial_heights(street_map: StreetMap) -> None:
    """Ignores all heights if a node of a way has none, because its height would become 0."""
    used = {i for way in street_map.ways for i in way.nodes if i in street_map.nodes}
    count = len(used & street_map.with_heights)
    if 0 < count < len(used):
        street_map.ignores_heights = True
        street_map.with_heights.clear()
        street_map.others.append(
            f"heights (`ele`) of {count} of {len(used)} nodes of roads: left out, because the "
            "other nodes have none"
        )


def all_elements(file: Path) -> Iterator[Element]:
    """Yields all nodes, ways and relations. Raises MapError and OSError."""
    root = None
    try:
        with opened(file) as stream:
            for event, node in ElementTree.iterparse(stream, events=("start", "end")):
                if root is None:
                    root = node
                    if node.tag != "osm":
                        raise MapError(f"{file}: expected <osm>, got <{node.tag}>")
                elif event == "end" and node.tag in {"node", "way", "relation"}:
                    yield node
                    root.clear()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise MapError(f"{file}: cannot be read as XML: {error}") from error
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise MapError(f"{file}: cannot be unpacked as gzip: {error}") from error


def _read_element(node: Element, street_map: StreetMap, file: Path) -> None:
    if is_deleted(node):
        street_map.deleted += 1
        return
    tags = {tag.get("k", ""): tag.get("v", "") for tag in node.iterfind("tag")}
    name = node.get("id", "")
    if node.tag == "node":
        if node.get("lon") is None and node.get("lat") is None:
            return  # the position of a referenced node is missing
        if node.get("lon") == node.get("lat") == "" and {"local_x", "local_y"} <= tags.keys():
            return  # a node of Lanelet2 in metres
        street_map.nodes[name] = _lon_lat(node, file)
        street_map.rearranged |= bool(street_map.ways)
        if re.match(r"\s*[+-]?\.?\d", tags.get("ele", "")):
            street_map.with_heights.add(name)
        if tags.get("natural") == "tree":
            street_map.trees.append((name, tags))
        elif not AT_STREETS.isdisjoint(tags):
            street_map.things.append((name, tags))
        elif tags.get("barrier"):
            street_map.others.append(f"node {name}: {tags['barrier']}, left out")
    elif node.tag == "way":
        ids = [nd.get("ref", "") for nd in node.iterfind("nd")]
        for nd in node.iterfind("nd"):
            if nd.get("lon") is not None:
                street_map.rearranged = True
                street_map.nodes.setdefault(nd.get("ref", ""), _lon_lat(nd, file))
        if "highway" not in tags:
            street_map.outlines[name] = ids
        if tags.get("building", "no") != "no":
            street_map.houses.append((name, ids, tags))
        elif "highway" in tags or tags.get("railway") in RAILWAYS:
            street_map.ways.append(Way(name, ids, tags))
        elif "platform" in (tags.get("public_transport"), tags.get("railway")):
            street_map.lines.append(Way(name, ids, tags))
        elif tags.get("barrier") or tags.get("natural") == "tree_row":
            kind = tags.get("barrier") or "tree_row"
            street_map.others.append(f"way {name}: {kind}, left out")
    elif tags.get("type") == "lanelet":
        street_map.lanelets += 1
    elif tags.get("building", "no") != "no":
        found = [(m.get("type", "way"), m) for m in node.iterfind("member")]
        members = [
            (m.get("ref", ""), m.get("role") or "outer") for kind, m in found if kind == "way"
        ]
        if not any(kind == "relation" and m.get("role") == "outline" for kind, m in found):
            street_map.multipolygons.append(Multipolygon(name, members, tags))


def is_deleted(node: Element) -> bool:
    """Returns whether an editor (JOSM) or a history export marked an element as deleted."""
    return node.get("action") == "delete" or node.get("visible") == "false"


def _lon_lat(node: Element, file: Path) -> tuple[float, float]:
    lon, lat = number_or_nan(node.get("lon")), number_or_nan(node.get("lat"))
    if not (abs(lon) <= 180 and abs(lat) <= 85):
        raise MapError(
            f"{file}: node {node.get('id', node.get('ref'))}: lon, lat: expected degrees up to 180 "
            f"and up to 85, got {node.get('lon')!r} and {node.get('lat')!r}"
        )
    return lon, lat


def metres(text: str) -> float | None:
    match = re.match(r"\s*(\d+(?:\.\d+)?)\s*(m|ft|')?\s*$", text)
    value = float(match[1]) * (0.3048 if match[2] in {"ft", "'"} else 1) if match else 0.0
    return value if 0.5 <= value <= 1000 else None
