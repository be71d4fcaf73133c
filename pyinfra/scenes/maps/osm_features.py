"""Reads street features of OpenStreetMap: stops, signals, crossings and sidewalks.

The features are only listed. SUMO guesses the signals and crossings of the network.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pyinfra.scenes.maps.lane_map import MapFeature, MapLane
from pyinfra.scenes.maps.openstreetmap import StreetMap, transverse_mercator

KEPT_TAGS = ("name", "crossing", "crossing:markings", "shelter", "direction", "local_ref")
_NONE = frozenset({"no", "none"})
_CROSSED_BY = ("footway", "cycleway", "path")
_AS_TAGGED = ("traffic_signals", "stop", "give_way", "street_lamp", "speed_camera")


def kind_of(tags: dict[str, str]) -> str:
    """Returns the kind of a street feature, such as bus_stop, or an empty text for other tags."""
    highway, railway = tags.get("highway", ""), tags.get("railway", "")
    transport = tags.get("public_transport", "")
    is_platform = "platform" in (transport, railway)
    kinds = (
        (highway == "bus_stop" or (is_platform and tags.get("bus") == "yes"), "bus_stop"),
        (is_platform, "platform"),
        ("crossing" in (highway, *(tags.get(key) for key in _CROSSED_BY)), "crossing"),
        (railway in ("level_crossing", "crossing"), "level_crossing"),
        (transport == "stop_position" or railway == "tram_stop", "stop_position"),
        (highway in _AS_TAGGED, highway),
        ("traffic_sign" in tags, "traffic_sign"),
    )
    return next((kind for holds, kind in kinds if holds), "")


def sides_without(tags: dict[str, str]) -> dict[str, str]:
    """Maps the sides (left, right) of a road without a sidewalk to `no` or `separate`.

    `separate` means that the map has the sidewalk as another way.
    """
    general = tags.get("sidewalk", "")
    sides = {}
    for side, other in (("left", "right"), ("right", "left")):
        value = tags.get(f"sidewalk:{side}") or tags.get("sidewalk:both") or general
        value = "no" if value == other else value
        if value in _NONE or value == "separate":
            sides[side] = "no" if value in _NONE else value
    return sides


def edges_without_sidewalk(map_: StreetMap, traffic_side: str = "right") -> list[str]:
    """Returns all names that netconvert may give to edges without a sidewalk in the map.

    The lanes forward are on the side of the traffic.
    """
    names = []
    for way in map_.ways:
        if "highway" not in way.tags:
            continue
        for side in sides_without(way.tags):
            edge = way.id if side == traffic_side else f"-{way.id}"
            names += [edge, *(f"{edge}#{k}" for k in range(max(len(way.nodes) - 1, 0)))]
    return names


def features(map_: StreetMap, centre: tuple[float, float], radius_m: float) -> Iterator[MapFeature]:
    """Yields all features within the radius. The position of a way is its middle."""
    elements = [(f"node {i}", [i], tags, kind_of(tags)) for i, tags in map_.things]
    for way in (*map_.lines, *map_.ways):
        kind = kind_of(way.tags)
        if not kind and "highway" in way.tags and "separate" in sides_without(way.tags).values():
            kind = "separate_sidewalk"
        elements.append((f"way {way.id}", way.nodes, way.tags, kind))
    for source, ids, tags, kind in elements:
        coordinates = [map_.nodes[i] for i in ids if i in map_.nodes]
        if not kind or not coordinates:
            continue
        xy = transverse_mercator(np.array(coordinates), centre)
        x, y = ((xy.min(0) + xy.max(0)) / 2).tolist()
        if math.hypot(x, y) <= radius_m:
            kept = {k: tags[k] for k in KEPT_TAGS if k in tags}
            if kind == "separate_sidewalk":
                kept = {k: v for k, v in tags.items() if k.startswith("sidewalk")}
            yield MapFeature(kind, source, x, y, kept)


def without_kerb_at_crossings(lanes: list[MapLane], map_: StreetMap) -> list[MapLane]:
    """Sets the kerb height of sidewalks that cross a street to 0, and returns all lanes."""
    crossing = {way.id.lstrip("-") for way in map_.ways if kind_of(way.tags) == "crossing"}

    def is_crossing(lane: MapLane) -> bool:
        match = re.match(r"lane_-{0,2}(\d+)_", lane.name)
        return lane.kind == "sidewalk" and match is not None and match[1] in crossing

    return [replace(lane, kerb_m=0.0) if is_crossing(lane) else lane for lane in lanes]
