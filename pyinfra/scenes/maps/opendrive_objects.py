"""Reads roadside objects of an OpenDRIVE map as bodies and trees, and lists ignored objects.

The outline of an object replaces its box, and a repeat replaces its single position.
"""

import itertools
import math
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import MapBody, MapFeature, MapTree, SiteMap
from pyinfra.scenes.maps.opendrive_geometry import OpenDriveRoad, number
from pyinfra.scenes.maps.surfaces import crosses_itself

PAINT = frozenset({"crosswalk", "roadMark", "parkingSpace", "roadSurface", "patch"})
NO_TYPE = frozenset({"-1", "none", ""})
PLANTS = frozenset({"tree", "vegetation"})
MOVERS = frozenset("bike bus car motorbike pedestrian trailer train tram van".split())
STANDING = frozenset(
    "barrier building gantry house obstacle pole railing soundBarrier streetLamp trafficIsland "
    "wind".split()
)
THINNEST_M = 0.1  # minimum width of walls and posts
LOWEST_M = 0.05  # minimum height of a built object
OVERHEAD_M = 2.0  # the space below an object is open if its base is higher than this
WALL_STEP_M = 2.0  # length of the pieces of a continuous object
TREE_M = 9.0  # default height of a tree
MOST_COPIES = 10_000  # maximum number of copies of an object


def read_objects(road: OpenDriveRoad, node: Element, site_map: SiteMap) -> None:
    """Reads all objects and signals of a road into the site map."""
    for thing in node.iterfind("objects/object"):
        _read_object(road, thing, site_map)
    marks = [n for n in node.iterfind("objects/object") if _is_mark(n)]
    if marks:
        site_map.not_understood.append(
            f"road {road.id}: {len(marks)} objects of road marks: left out"
        )
    for signal in node.iterfind("signals/signal"):
        s, t = (number(signal, k, 0.0) for k in "st")
        top = number(signal, "zOffset", 0.0) + number(signal, "height", 0.0)
        site_map.bodies.append(_box(road, (s, t), signal, (0.15, 0.15, max(top, 2.0)), 0.0))
        x, y, _ = road.positions(np.array([s]), np.array([t]))[0].tolist()
        kind = "traffic_signals" if signal.get("dynamic") == "yes" else "traffic_sign"
        tags = {k: v for k in ("name", "type", "country") if (v := signal.get(k, ""))}
        signal_name = f"road {road.id}: signal {signal.get('id')}"
        site_map.features.append(MapFeature(kind, signal_name, x, y, tags))
    site_map.not_understood += [
        f"road {road.id}: {tag} {thing.get('id')} at s = {number(thing, 's', 0.0):.1f}: left out"
        for tag in ("tunnel", "bridge", "objectReference")
        for thing in node.iterfind(f"objects/{tag}")
    ]
    if references := node.findall("signals/signalReference"):
        site_map.not_understood.append(
            f"road {road.id}: {len(references)} signalReference: left out"
        )
    site_map.not_understood += [
        f"road {road.id}: {tag}: left out"
        for tag in ("surface", "railroad")
        if (part := node.find(tag)) is not None and len(part)
    ]


def _is_mark(node: Element) -> bool:
    """Returns whether an object is a painted line, as in CARLA's maps."""
    name = node.get("name", "").lower()
    return node.get("type") != "crosswalk" and name.startswith(("solid", "dashed"))


def _read_object(road: OpenDriveRoad, node: Element, site_map: SiteMap) -> None:
    s, t = (number(node, k, 0.0) for k in "st")
    type_ = node.get("type") or "none"
    where = f"road {road.id}: object {node.get('id')} at s = {s:.1f}, t = {t:.1f}"

    def leave_out(why: str) -> None:
        site_map.not_understood.append(f"{where}: {why}")

    if type_ == "crosswalk":  # a crosswalk is a marking without height
        x, y, _ = road.positions(np.array([s]), np.array([t]))[0].tolist()
        name = f"road {road.id}: object {node.get('id')}"
        site_map.features.append(MapFeature("crossing", name, x, y))
        return
    if _is_mark(node):
        return  # read_objects counts objects that are road marks
    if type_ in PAINT or type_ in MOVERS:
        leave_out(f"type {type_!r}, name {node.get('name')!r}: left out")
        return
    repeats, outlines = node.findall("repeat"), node.findall(".//outline")
    if type_ in PLANTS:
        if outlines:
            leave_out("outline of a plant ignored; one tree is built")
        _read_plants(road, node, repeats, site_map)
        return
    before = len(site_map.bodies)
    if any(n.get("outer") == "false" for n in outlines):
        leave_out("inner outline ignored; the hole is filled")
    outlines = [n for n in outlines if n.get("outer") != "false"]
    for copy, at in _copies(node, repeats):
        if copy is not None and number(copy, "distance", 0.0) == 0:
            site_map.bodies += _wall(road, node, copy)
        elif outlines:
            for outline in outlines:
                site_map.bodies += _of_outline(road, node, outline, at)
        else:
            site_map.bodies += _of_box(road, node, copy, at)
    if len(site_map.bodies) == before:
        name, height = f"name {node.get('name')!r}", f"height {number(node, 'height', 0.0):g} m"
        leave_out(f"type {type_!r}, {name if type_ in NO_TYPE else height}: left out")
    elif type_ not in STANDING:
        text = f"objects of type {type_!r}: built at their positions"
        site_map.guessed += [] if text in site_map.guessed else [text]
    if any(abs(number(node, k, 0.0)) > 0.1 for k in ("pitch", "roll")):
        leave_out("pitch and roll ignored; the object is built upright")


def _read_plants(
    road: OpenDriveRoad, node: Element, repeats: list[Element], site_map: SiteMap
) -> None:
    for copy, (at_s, at_t) in _copies(node, repeats):
        if copy is not None and number(copy, "distance", 0.0) == 0:
            site_map.bodies += _wall(road, node, copy)  # a continuous row of plants is a hedge
            continue
        height, base = _of(copy, node, "height", at_s), _of(copy, node, "zOffset", at_s)
        x, y, z = road.positions(np.array([at_s]), np.array([at_t]))[0].tolist()
        tall = height if height > 1 else TREE_M
        site_map.trees.append(MapTree(x, y, tall, z + min(0.0, base)))


def _copies(
    node: Element, repeats: list[Element]
) -> Iterator[tuple[Element | None, tuple[float, float]]]:
    """Yields the `repeat` element and s, t of each copy of an object.

    Without repeats, yields None and s, t of the object.
    """
    if not repeats:
        yield None, (number(node, "s", 0.0), number(node, "t", 0.0))
    for repeat in repeats:
        start, length = number(repeat, "s", number(node, "s", 0.0)), number(repeat, "length", 0.0)
        distance = number(repeat, "distance", 0.0)
        count = 1 if distance <= 0 else min(int(length / distance + 1e-6) + 1, MOST_COPIES)
        for k in range(count):
            s = start + k * distance
            yield repeat, (s, _of(repeat, node, "t", s))


def _of(repeat: Element | None, node: Element, name: str, s: float) -> float:
    """Returns a value at s, interpolated between the ends of a `repeat` element.

    Without a repeat, returns the object's value.
    """
    value = number(node, name, 0.0)
    if repeat is None:
        return value
    first, last = (number(repeat, f"{name}{end}", value) for end in ("Start", "End"))
    length = number(repeat, "length", 0.0)
    part = (s - number(repeat, "s", number(node, "s", 0.0))) / length if length > 0 else 0.0
    return first + (last - first) * min(max(part, 0.0), 1.0)


def _wall(road: OpenDriveRoad, node: Element, repeat: Element) -> list[MapBody]:
    """Returns the pieces of a continuous object along the road.

    Width and height are those of the repeat.
    """
    start = number(repeat, "s", number(node, "s", 0.0))
    length = min(number(repeat, "length", 0.0), road.line.length - start)
    if length <= 0:
        return []
    count = min(max(1, math.ceil(length / WALL_STEP_M)), MOST_COPIES)
    at = np.linspace(start, start + length, count + 1)
    t, width, height, base = (
        np.array([_of(repeat, node, name, s) for s in at])
        for name in ("t", "width", "height", "zOffset")
    )
    half = np.maximum(width, THINNEST_M) / 2
    left, right = road.positions(at, t + half), road.positions(at, t - half)
    bodies = []
    for i, j in itertools.pairwise(range(count + 1)):
        outline = np.stack([right[i], right[j], left[j], left[i]])
        low = float(outline[:, 2].min() + min(base[i], base[j]))
        high = float(outline[:, 2].max() + max(base[i] + height[i], base[j] + height[j]))
        if max(height[i], height[j]) >= LOWEST_M:
            hangs = bool(min(base[i], base[j]) > OVERHEAD_M)
            bodies.append(MapBody(outline[:, :2], high - low, low, hangs))
    return bodies


def _of_box(
    road: OpenDriveRoad, node: Element, repeat: Element | None, at: tuple[float, float]
) -> list[MapBody]:
    """Returns the box of an object at one position. A cylinder becomes a box."""
    s = at[0]
    round_ = 2 * _of(repeat, node, "radius", s)
    length, width = (_of(repeat, node, name, s) or round_ for name in ("length", "width"))
    height = _of(repeat, node, "height", s)
    type_ = node.get("type") or "none"
    if height < LOWEST_M or (type_ not in STANDING and max(length, width) <= 0):
        return []
    size = (
        max(length or 0.2, THINNEST_M),
        max(width or 0.2, THINNEST_M),
        height,
    )
    return [_box(road, at, node, size, _of(repeat, node, "zOffset", s))]


def _box(
    road: OpenDriveRoad,
    at: tuple[float, float],
    node: Element,
    size: tuple[float, float, float],
    base: float,
) -> MapBody:
    length, width, height = size
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (length / 2, width / 2)
    xy, z = _in_world(road, at, node, corners)
    return MapBody(xy, height, z + base, base > OVERHEAD_M)


def _in_world(
    road: OpenDriveRoad, at: tuple[float, float], node: Element, uv: FloatArray
) -> tuple[FloatArray, float]:
    """Transforms object coordinates (n, 2) to x y, and returns z of the road at the object."""
    s, t = (np.array([v]) for v in at)
    heading = float(road.line.at(s)[0, 2]) + number(node, "hdg", 0.0)
    x, y, z = road.positions(s, t)[0].tolist()
    cos, sin = math.cos(heading), math.sin(heading)
    return uv @ np.array([[cos, sin], [-sin, cos]]) + (x, y), z


def _of_outline(
    road: OpenDriveRoad, node: Element, outline: Element, at: tuple[float, float]
) -> list[MapBody]:
    """Returns one body, or thin walls between the corners.

    There are walls if the outline is open or crosses itself.
    """
    usual = number(node, "height", 0.0)
    local, along = outline.findall("cornerLocal"), outline.findall("cornerRoad")
    if local:
        uv = np.array([[number(n, "u"), number(n, "v")] for n in local])
        xy, z = _in_world(road, at, node, uv)
        base = z + number(node, "zOffset", 0.0) + np.array([number(n, "z", 0.0) for n in local])
    elif along:
        shift = at[0] - number(node, "s", 0.0)
        s = np.array([number(n, "s") + shift for n in along])
        positions = road.positions(s, np.array([number(n, "t") for n in along]))
        xy, z = positions[:, :2], float(positions[0, 2])
        base = positions[:, 2] + np.array([number(n, "dz", 0.0) for n in along])
    else:
        return []
    heights = np.array([number(n, "height", usual) for n in local or along])
    is_ring = np.allclose(xy[0], xy[-1])
    closed = outline.get("closed", "true") != "false" or is_ring
    ring = xy[:-1] if is_ring and len(xy) > 1 else xy
    if closed and len(ring) >= 3 and not crosses_itself(ring):
        return _upright(ring, base, heights, z)
    pieces = list(itertools.pairwise(range(len(ring))))
    if closed and len(ring) > 2:
        pieces.append((len(ring) - 1, 0))
    bodies = []
    for i, j in pieces:
        ahead = ring[j] - ring[i]
        if (metres := math.hypot(*ahead)) < 1e-3:
            continue
        side = np.array([-ahead[1], ahead[0]]) / metres * THINNEST_M / 2
        wall = np.stack([ring[i] - side, ring[j] - side, ring[j] + side, ring[i] + side])
        bodies += _upright(wall, base[[i, j]], heights[[i, j]], z)
    return bodies


def _upright(xy: FloatArray, base: FloatArray, heights: FloatArray, z: float) -> list[MapBody]:
    low, high = float(base.min()), float((base + heights).max())
    if high - low < LOWEST_M or heights.max() < LOWEST_M:
        return []
    return [MapBody(xy, high - low, low, low - z > OVERHEAD_M)]
