"""Reads Lanelet2 maps (.osm): lanelets between two borders, by the public description of the tags.

Positions are the tags `local_x` and `local_y` in metres if all points have them, else longitude and
latitude; `ele` is the height. A map has no network for SUMO, so that traffic has to be recorded.
"""

import itertools
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import (
    MapFeature,
    MapLane,
    SiteMap,
    number_or_nan,
    without_folds,
)
from pyinfra.scenes.maps.network import KERB_M
from pyinfra.scenes.maps.openstreetmap import all_elements, is_deleted, transverse_mercator
from pyinfra.scenes.maps.surfaces import signed_area

STEP_M = 2.0  # largest distance between points of a lane
MOST_STEPS = 5000
# Subtypes of lanelets for vehicles; `road` is the default.
DRIVEN = frozenset(("road", "lane", "highway", "play_street", "bus_lane", "emergency_lane", "exit"))
WALKED = frozenset(("walkway", "shared_walkway", "stairs"))


@dataclass
class LaneletFile:
    """The elements of a file. Positions are lon, lat, or metres, and heights in metres."""

    degrees: dict[str, tuple[float, float]] = field(default_factory=dict)
    metres: dict[str, tuple[float, float]] = field(default_factory=dict)
    heights: dict[str, float] = field(default_factory=dict)
    ways: dict[str, list[str]] = field(default_factory=dict)
    # Id, ids of the ways of both borders, and tags of each lanelet.
    lanelets: list[tuple[str, list[str], list[str], dict[str, str]]] = field(default_factory=list)
    others: Counter[str] = field(default_factory=Counter)  # relations that are not read, by type


def read_lanelets(
    file: Path, centre: tuple[float, float] | None
) -> tuple[SiteMap, tuple[float, float] | None]:
    """Returns the lanes of a map, and the centre (lon, lat) of their metres.

    Without `centre`, it is the middle of the points. It is None for maps with `local_x` and
    `local_y`, whose metres have an origin of their own. Raises MapError and OSError.
    """
    content = LaneletFile()
    for element in all_elements(file):
        if not is_deleted(element):
            _read_element(element, content)
    site_map = SiteMap()
    used = {n for way in content.ways.values() for n in way if n in content.degrees}
    is_local = bool(used) and used <= content.metres.keys()
    if is_local:
        centre, xy = None, content.metres
    else:
        places = np.array([content.degrees[n] for n in used]).reshape(-1, 2)
        if centre is None and len(places):
            low, high = places.min(0), places.max(0)
            centre = (float((low + high)[0] / 2), float((low + high)[1] / 2))
        plane = transverse_mercator(places, centre or (0.0, 0.0))
        xy = dict(zip(used, map(tuple, plane.tolist()), strict=True))
    site_map.guessed += _fill_heights(content, xy)
    points = {n: np.array([*xy[n], content.heights.get(n, 0.0)]) for n in used}
    for name, *borders, tags in content.lanelets:
        left, right = (_border(content, points, ways) for ways in borders)
        if len(left) < 2 or len(right) < 2:
            site_map.not_understood.append(f"lanelet {name}: a border without points, left out")
            continue
        _add(site_map, name, left, right, tags)
    site_map.not_understood += [
        f"{kind}: not read, {count} in the file" for kind, count in sorted(content.others.items())
    ]
    site_map.guessed.append("no network and no signals: Lanelet2 maps are not converted for SUMO")
    if not content.heights:
        site_map.guessed.append("all roads are level: the map has no heights")
    return site_map, centre


def _fill_heights(content: LaneletFile, xy: Mapping[str, tuple[float, float]]) -> list[str]:
    """Interpolates missing heights along the borders, and returns texts about them.

    If the height of a point remains unknown, all heights are removed.
    """
    ways = {way for _, left, right, _ in content.lanelets for way in (*left, *right)}
    borders = [[n for n in content.ways.get(way, ()) if n in xy] for way in sorted(ways)]
    used = {n for names in borders for n in names}
    missing = used - content.heights.keys()
    if not missing or not content.heights:
        return []
    for names in borders:
        steps = [math.dist(xy[a], xy[b]) for a, b in itertools.pairwise(names)]
        s = np.concatenate([[0.0], np.cumsum(steps)])
        known = [i for i, n in enumerate(names) if n in content.heights]
        if known and missing.intersection(names):
            heights = np.interp(s, s[known], [content.heights[names[i]] for i in known])
            for n, z in zip(names, heights.tolist(), strict=True):
                content.heights.setdefault(n, z)
    if used <= content.heights.keys():
        return [f"heights of {len(missing)} of {len(used)} points: interpolated along the borders"]
    content.heights.clear()
    count = len(used) - len(missing)
    return [f"heights of {count} of {len(used)} points: left out, because other points have none"]


def _read_element(element: Element, content: LaneletFile) -> None:
    tags = {tag.get("k", ""): tag.get("v", "") for tag in element.iterfind("tag")}
    name = element.get("id", "")
    if element.tag == "node":
        lon, lat = (number_or_nan(element.get(key)) for key in ("lon", "lat"))
        if abs(lon) <= 180 and abs(lat) <= 85:
            content.degrees[name] = (lon, lat)
        x, y, z = (number_or_nan(tags.get(key)) for key in ("local_x", "local_y", "ele"))
        if math.isfinite(x) and math.isfinite(y):
            content.metres[name] = (x, y)
            content.degrees.setdefault(name, (0.0, 0.0))
        if math.isfinite(z):
            content.heights[name] = z
    elif element.tag == "way":
        content.ways[name] = [nd.get("ref", "") for nd in element.iterfind("nd")]
    elif tags.get("type") == "lanelet":
        members = [(m.get("role"), m.get("ref", "")) for m in element.iterfind("member")]
        borders = [[ref for role, ref in members if role == side] for side in ("left", "right")]
        content.lanelets.append((name, *borders, tags))  # type: ignore[arg-type]
    else:
        content.others[tags.get("type") or "relation"] += 1


def _border(content: LaneletFile, points: dict[str, FloatArray], ways: list[str]) -> FloatArray:
    """Returns the points (n, 3) of a border of one or more ways, without repeated points."""
    names = [n for way in ways for n in content.ways.get(way, ()) if n in points]
    rows = [points[n] for i, n in enumerate(names) if i == 0 or n != names[i - 1]]
    return np.array(rows).reshape(-1, 3)


def _add(
    site_map: SiteMap, name: str, left: FloatArray, right: FloatArray, tags: dict[str, str]
) -> None:
    left, right = _directed(left, right)
    subtype = tags.get("subtype", "road")
    if subtype == "crosswalk":
        x, y, _ = np.concatenate([_even(left, 3), _even(right, 3)]).mean(0).tolist()
        site_map.features.append(MapFeature("crossing", f"lanelet {name}", x, y))
        return
    count = min(max(math.ceil(max(map(_length, (left, right))) / STEP_M), 1), MOST_STEPS) + 1
    left, right, _ = without_folds(_even(left, count), _even(right, count))
    allowed = {k.removeprefix("participant:"): v for k, v in tags.items() if "participant:" in k}
    driven = subtype in DRIVEN
    if allowed:
        driven = any(k.startswith("vehicle") and v == "yes" for k, v in allowed.items())
    is_walk = subtype in WALKED and not driven
    kind, kerb = ("sidewalk", KERB_M) if is_walk else ("road", 0.0)
    site_map.lanes.append(MapLane(f"lanelet_{name}", kind, driven, left, right, kerb))
    if driven and tags.get("one_way") == "no":
        site_map.not_understood.append(f"lanelet {name}: for both directions, read as one lane")


def _directed(left: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the borders in the direction of travel, so that the left border is on the left."""
    ends = np.linalg.norm(left[[0, -1]] - right[[0, -1]], axis=1).sum()
    crossed = np.linalg.norm(left[[0, -1]] - right[[-1, 0]], axis=1).sum()
    if crossed < ends:
        right = right[::-1]
    area = signed_area(np.concatenate([right, left[::-1]])[:, :2])
    return (left, right) if area >= 0 else (left[::-1], right[::-1])


def _length(line: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _even(line: FloatArray, count: int) -> FloatArray:
    """Returns `count` points (count, 3) at equal distances along a line (n, 3)."""
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0, s[-1], count)
    return np.column_stack([np.interp(at, s, line[:, i]) for i in range(3)])
