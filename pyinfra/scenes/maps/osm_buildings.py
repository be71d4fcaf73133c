"""Adds buildings and trees of OpenStreetMap: roofs, storeys above the ground, and passages.

Follows the public descriptions of the keys `building`, `min_height`, `layer`, `location` and of the
value `tunnel=building_passage`.
"""

import math
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import MapBody, MapTree, SiteMap
from pyinfra.scenes.maps.openstreetmap import (
    StreetMap,
    metres,
    transverse_mercator,
)
from pyinfra.scenes.maps.osm_relations import buildings, with_holes
from pyinfra.scenes.maps.surfaces import contains, crosses_itself

LEVEL_M = 3.0  # height of a storey
HOUSE_M = 6.0  # default height of a building
TREE_M = 9.0  # default height of a tree
ROOFS = frozenset({"roof", "canopy", "carport"})
SLAB_M = 0.5  # thickness of a roof
PASSAGE_HEIGHT_M = 4.5  # clearance of a passage without a stated height
LANE_M = 3.5  # width of a lane of a passage
BESIDE_M = 1.0  # space on each side of the lanes of a passage


@dataclass(frozen=True, eq=False)
class Passage:
    """A road through a building."""

    name: str
    line: FloatArray  # centreline (n, 2)
    half_width_m: float
    height_m: float


def is_underground(tags: dict[str, str]) -> bool:
    """Returns whether a building is below the ground."""
    if tags.get("location") == "underground" or tags.get("tunnel") == "yes":
        return True
    return any(tags.get(key, "").strip().startswith("-") for key in ("layer", "level"))


def passages(map_: StreetMap, centre: tuple[float, float]) -> list[Passage]:
    """Returns the roads through buildings."""
    out = []
    for way in map_.ways:
        nodes = [map_.nodes[i] for i in way.nodes if i in map_.nodes]
        if way.tags.get("tunnel") != "building_passage" or len(nodes) < 2:
            continue
        lanes = metres(way.tags.get("lanes", "")) or 2.0
        width = metres(way.tags.get("width", "")) or lanes * LANE_M
        height = metres(way.tags.get("maxheight", "")) or PASSAGE_HEIGHT_M
        line = transverse_mercator(np.array(nodes), centre)
        out.append(Passage(way.id, line, width / 2 + BESIDE_M, height))
    return out


def building_bodies(
    name: str,
    outline: FloatArray,
    height_m: float,
    base_m: float,
    tags: dict[str, str],
    roads: list[Passage],
) -> tuple[list[MapBody], list[str]]:
    """Returns the bodies of a building with an outline (n, 2), and a list of notes on its parts.

    `name` is that of its element, such as `way 5`.

    A roof is a slab. A building with `min_height` has an open space below. A passage is open up to
    its height, between two parts of the ground floor.
    """
    source = f"{name}: building"
    if tags.get("building") in ROOFS or tags.get("building:part") in ROOFS:
        base = max(height_m - SLAB_M, base_m, 0.1)
        slab = MapBody(outline, max(height_m - base, 0.1), None, True, base, source)
        return [slab], [f"{name}: roof: a slab of {SLAB_M:g} m, open below"]
    if 0 < base_m < height_m:
        return [MapBody(outline, height_m - base_m, None, True, base_m, source)], []
    for road in roads:
        middle = (road.line[1:] + road.line[:-1]) / 2
        clear = road.height_m
        if not contains(outline, np.concatenate([middle, road.line])).any() or clear >= height_m:
            continue
        upper = MapBody(outline, height_m - clear, None, True, clear, source)
        ahead = road.line[-1] - road.line[0]
        across = np.array([-ahead[1], ahead[0]]) / max(float(np.hypot(*ahead)), 1e-9)
        beside = [_clipped(outline, road.line[0], s * across, road.half_width_m) for s in (1, -1)]
        lower = [MapBody(part, clear, name=source) for part in beside if len(part) >= 3]
        return [upper, *lower], [f"{name}: passage of way {road.name}: open up to {clear:g} m"]
    return [MapBody(outline, height_m, name=source)], []


def _clipped(
    outline: FloatArray, point: FloatArray, normal: FloatArray, least_m: float
) -> FloatArray:
    """Returns the part of an outline (n, 2) farther than `least_m` from `point` along `normal`."""
    beyond = (outline - point) @ normal - least_m
    corners = []
    for i, (corner, d) in enumerate(zip(outline, beyond, strict=True)):
        j = (i + 1) % len(outline)
        if d > 0:
            corners.append(corner)
        if d * beyond[j] < 0:
            corners.append(corner + (outline[j] - corner) * d / (d - beyond[j]))
    return np.array(corners).reshape(-1, 2)


def add_surroundings(
    site_map: SiteMap, map_: StreetMap, centre: tuple[float, float], radius_m: float
) -> None:
    """Adds buildings and trees within the radius to the site map."""
    heights, roads = [], passages(map_, centre)
    for building in buildings(map_):
        if isinstance(building, str):
            site_map.not_understood.append(building)
            continue
        name, ids, tags = building.source, building.nodes, building.tags
        if not all(i in map_.nodes for i in ids):
            site_map.not_understood.append(f"{name}: building with missing nodes, left out")
            continue
        outline = transverse_mercator(np.array([map_.nodes[i] for i in ids]), centre)
        x, y = outline.mean(0)
        if np.hypot(x, y) > radius_m:
            continue
        if len(outline) < 3 or crosses_itself(outline):
            site_map.not_understood.append(
                f"{name}: building at {x:.1f} {y:.1f} without a valid outline, left out"
            )
            continue
        if is_underground(tags):
            site_map.not_understood.append(f"{name}: building below the ground, left out")
            continue
        stated_m = _stated_m(tags, "height", "building:levels")
        heights.append(stated_m > 0)
        base_m = _stated_m(tags, "min_height", "building:min_level")
        holes = [
            transverse_mercator(np.array([map_.nodes[i] for i in hole]), centre)
            for hole in building.holes
        ]
        outline = with_holes(outline, holes) if holes else outline
        bodies, notes = building_bodies(name, outline, stated_m or HOUSE_M, base_m, tags, roads)
        site_map.bodies += bodies
        site_map.guessed += notes
    for node, tags in map_.trees:
        x, y = transverse_mercator(np.array([map_.nodes[node]]), centre)[0]
        if math.hypot(x, y) <= radius_m:
            height_m = metres(tags.get("height", ""))
            site_map.trees.append(MapTree(float(x), float(y), height_m or TREE_M))
    if heights.count(False):
        site_map.guessed.append(f"height of {heights.count(False)} of {len(heights)} buildings")
    site_map.not_understood += map_.others


def _stated_m(tags: dict[str, str], height: str, levels: str) -> float:
    """Returns a height by its tag, else by the tag of the levels, else 0."""
    return metres(tags.get(height, "")) or LEVEL_M * (metres(tags.get(levels, "")) or 0.0)
