"""Reads lanes and junctions of a SUMO network (`.net.xml`)."""

import itertools
import math
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import (
    FARTHEST_M,
    SHORTEST_M,
    MapError,
    MapFeature,
    MapLane,
    SiteMap,
    lane_name,
    without_folds,
)
from pyinfra.scenes.maps.opendrive_geometry import number

DEFAULT_WIDTH_M = 3.2  # SUMO's default lane width
KERB_M = 0.15  # height of sidewalks above the road
STEP_M = 4.0  # maximum distance between successive points of a lane
CLOSE_M = 0.05  # minimum distance between successive points of a lane
CARS = frozenset({"passenger", "private", "taxi", "bus", "delivery", "truck", "custom1", "all"})
WALKERS = frozenset({"pedestrian"})


def read_network(file: Path, *, lanes: bool = True) -> SiteMap:
    """Reads a network. With `lanes` = False, only the junctions are read. Raises MapError."""
    site_map = SiteMap()
    try:
        with file.open("rb") as stream:  # `iterparse` does not close a file after an error
            for _, node in ElementTree.iterparse(stream):
                if node.tag == "edge":
                    if lanes:
                        _read_edge(node, site_map)
                    node.clear()
                elif node.tag == "junction":
                    _read_junction(node, site_map)
                    node.clear()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise MapError(f"{file}: cannot be read as XML: {error}") from error
    except MapError as error:
        raise MapError(f"{file}: {error}") from error
    return site_map


def shape_of(text: str, where: str) -> FloatArray:
    """Parses `x,y x,y,z ...` to positions (n, 3). Raises MapError."""
    try:
        rows = [[float(v) for v in point.split(",")] for point in text.split()]
        shape = np.array([[*row, 0.0][:3] for row in rows]).reshape(-1, 3)
    except ValueError as error:
        raise MapError(f"{where}: shape: expected x,y or x,y,z, got {text[:40]!r}") from error
    if not np.isfinite(shape).all():
        raise MapError(f"{where}: shape: expected finite numbers, got {text[:40]!r}")
    if len(shape) and (metres := float(np.ptp(shape, axis=0).max())) > FARTHEST_M:
        raise MapError(
            f"{where}: shape: expected up to {FARTHEST_M:g} m from end to end, got {metres:g}"
        )
    return shape


def _read_edge(edge: Element, site_map: SiteMap) -> None:
    function = edge.get("function", "normal")
    if function == "crossing":  # a crossing is a marking in the junction and needs no surface
        for lane in edge.iterfind("lane"):
            x, y, _ = shape_of(lane.get("shape", ""), f"lane {lane.get('id')}").mean(0).tolist()
            site_map.features.append(MapFeature("crossing", f"edge {edge.get('id')}", x, y))
        return
    for lane in edge.iterfind("lane"):
        name = lane_name("lane", lane.get("id") or "")
        shape = shape_of(lane.get("shape", ""), f"lane {lane.get('id')}")
        if function == "walkingarea":
            site_map.footways.append(shape)
            continue
        width = number(lane, "width", DEFAULT_WIDTH_M)
        if not 0 < width < 100:
            raise MapError(f"lane {lane.get('id')}: width: expected 0 to 100 m, got {width:g}")
        shape = _thinned(shape)
        if len(shape) < 2 or np.hypot(*np.diff(shape[:, :2], axis=0).T).sum() < SHORTEST_M:
            site_map.mended.append(f"lane {name}: shorter than {SHORTEST_M} m, left out")
            continue
        left, right, folded = without_folds(*borders(_dense(_unfolded(shape)), width))
        if folded is not None or len(_unfolded(shape)) < len(shape):
            x, y, _ = shape[0] if folded is None else folded
            site_map.mended.append(
                f"lane {name}: removed a part that runs backwards near {x:.1f} {y:.1f}"
            )
        walked = _is_for(lane, WALKERS) and not _is_for(lane, CARS)
        site_map.lanes.append(
            MapLane(
                name,
                "sidewalk" if walked else "road",
                _is_for(lane, CARS),
                left,
                right,
                KERB_M if walked else 0.0,
            )
        )


def _thinned(shape: FloatArray) -> FloatArray:
    """Returns the line without points closer than CLOSE_M to the previous point.

    Both ends of the line are kept.
    """
    kept: list[int] = []
    for i, point in enumerate(shape[:, :2]):
        if not kept or math.hypot(*(point - shape[kept[-1], :2])) >= CLOSE_M:
            kept.append(i)
    if len(kept) > 1 and kept[-1] != len(shape) - 1:
        kept[-1] = len(shape) - 1
    return shape[kept]


def _unfolded(shape: FloatArray) -> FloatArray:
    """Returns the line without points where it turns by more than 120 degrees.

    Both ends of the line are kept.
    """
    while len(shape) > 2:
        steps = np.diff(shape[:, :2], axis=0)
        steps /= np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
        back = np.flatnonzero((steps[1:] * steps[:-1]).sum(1) < -0.5) + 1
        if not len(back):
            break
        shape = np.delete(shape, back[0], 0)
    return shape


def _dense(shape: FloatArray) -> FloatArray:
    """Returns the line with points at most STEP_M apart, which avoids long thin triangles."""
    s = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(shape[:, :2], axis=0).T))])
    more = [np.linspace(a, b, int((b - a) // STEP_M) + 2)[:-1] for a, b in itertools.pairwise(s)]
    at = np.concatenate([*more, s[-1:]])
    return np.stack([np.interp(at, s, column) for column in shape.T], 1)


def borders(centre: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """Returns left and right border (n, 3) of a line.

    The borders have mitred corners, at most twice the half width from the line.
    """
    steps = np.diff(centre[:, :2], axis=0)
    steps /= np.hypot(*steps.T)[:, None]
    before, after = np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]])
    normal = before + after
    normal /= np.maximum(np.hypot(*normal.T), 1e-9)[:, None]
    stretch = 1 / np.maximum((normal * after).sum(1), 0.5)
    side = np.stack([-normal[:, 1], normal[:, 0], 0 * stretch], 1)
    side *= (width / 2 * stretch)[:, None]
    return centre + side, centre - side


def _is_for(lane: Element, users: frozenset[str]) -> bool:
    """Returns whether any of the user classes may use a lane."""
    allow, disallow = lane.get("allow"), lane.get("disallow", "")
    if allow is not None:
        return bool(users & set(allow.split()))
    return "all" not in disallow.split() and bool(users - {"all"} - set(disallow.split()))


def _read_junction(node: Element, site_map: SiteMap) -> None:
    if node.get("type") in {"internal", "dead_end"}:
        return
    if node.get("type", "").startswith("traffic_light"):
        x, y = number(node, "x", 0.0), number(node, "y", 0.0)
        site_map.features.append(MapFeature("traffic_signals", f"junction {node.get('id')}", x, y))
    shape = shape_of(node.get("shape", ""), f"junction {node.get('id')}")
    if len(shape) < 3:
        return
    site_map.areas.append(shape[:, :2])
    ways = len(node.get("intLanes", "").split())
    if ways > 1:
        x, y = _centroid(shape[:, :2])
        site_map.junctions.append((ways, x, y))


def _centroid(outline: FloatArray) -> tuple[float, float]:
    """Returns the centroid of an outline (n, 2), or the mean of its corners if it has no area."""
    middle = outline.mean(0)
    a, b = outline - middle, np.roll(outline, -1, axis=0) - middle
    doubled = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    if abs(doubled.sum()) > 1e-6:
        middle = middle + ((a + b) * doubled[:, None]).sum(0) / (3 * doubled.sum())
    return float(middle[0]), float(middle[1])
