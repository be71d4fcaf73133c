"""Converts OpenDRIVE maps with left-hand traffic by netconvert, which assumes right-hand traffic.

The map is mirrored at the x axis, so that vehicles drive on the right, and netconvert's network is
mirrored back. Lanes on the left of a reference line, with positive ids, become those on the right.
"""

import re
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from pyinfra.core.files import write
from pyinfra.scenes.maps.lane_map import MapError
from pyinfra.scenes.maps.opendrive_geometry import read_root

# Attributes whose sign changes in a mirrored map, by the path of an element below a road.
SIGNS: dict[str, tuple[str, ...]] = {
    "planView/geometry": ("y", "hdg"),
    "planView/geometry/arc": ("curvature",),
    "planView/geometry/spiral": ("curvStart", "curvEnd"),
    "planView/geometry/poly3": ("a", "b", "c", "d"),
    "planView/geometry/paramPoly3": ("aV", "bV", "cV", "dV"),
    "lateralProfile/superelevation": ("a", "b", "c", "d"),
    "lanes/laneOffset": ("a", "b", "c", "d"),
    "lanes/laneSection/*/lane": ("id",),
    "lanes/laneSection/*/lane/link/*": ("id",),
    "lanes/laneSection/*/lane/border": ("a", "b", "c", "d"),
    "signals/*": ("t",),
    "signals/*/validity": ("fromLane", "toLane"),
    "objects/object": ("t", "hdg"),
}
OTHER_SIDE = {"left": "right", "right": "left"}
TURNS = str.maketrans("lrLR", "rlRL")  # swaps left and right in the directions of connections


def has_left_hand_traffic(file: Path) -> bool:
    """Returns whether all roads of an OpenDRIVE map have the rule LHT."""
    roads = read_root(file).findall("road")
    return bool(roads) and all(road.get("rule") == "LHT" for road in roads)


def mirrored_map(file: Path, out: Path) -> Path:
    """Writes an OpenDRIVE map mirrored at the x axis, with right-hand traffic, and returns `out`.

    Raises MapError for a value that is no number.
    """
    root = read_root(file)
    for road in root.iterfind("road"):
        road.set("rule", "RHT")
        for path, keys in SIGNS.items():
            for node in road.iterfind(path):
                _negate(node, keys, f"{file}: road {road.get('id')}: {node.tag}")
        for section in road.iterfind("lanes/laneSection"):
            for side in list(section):
                side.tag = OTHER_SIDE.get(side.tag, side.tag)
                side[:] = list(side)[::-1]
            section[:] = sorted(
                section, key=lambda side: ("left", "center", "right").index(side.tag)
            )
    for link in root.iterfind("junction/connection/laneLink"):
        _negate(link, ("from", "to"), f"{file}: junction: laneLink")
    ElementTree.ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)
    return out


def mirror_network(file: Path) -> None:
    """Mirrors a network of SUMO at the x axis in its file, and marks its traffic as left-hand."""
    root = ElementTree.parse(file).getroot()
    root.set("lefthand", "true")
    for node in root.iter():
        for key in ("shape", "outlineShape", "customShape"):
            if node.get(key):
                node.set(key, " ".join(map(_flipped, node.get(key, "").split())))
        if node.tag == "junction" and node.get("y") is not None:
            node.set("y", _number(-float(node.get("y", "0"))))
        if node.tag == "connection" and node.get("dir"):
            node.set("dir", node.get("dir", "").translate(TURNS))
    for location in root.iterfind("location"):
        for key in ("convBoundary", "origBoundary"):
            if numbers := location.get(key):
                x0, y0, x1, y1 = map(float, numbers.split(","))
                location.set(key, ",".join(map(_number, (x0, -y1, x1, -y0))))
        if numbers := location.get("netOffset"):
            location.set("netOffset", _flipped(numbers))
    text = ElementTree.tostring(root, encoding="unicode")
    write(file, f'<?xml version="1.0" encoding="UTF-8"?>\n\n{text}\n')


def _flipped(point: str) -> str:
    x, y, *z = point.split(",")
    return ",".join([x, _number(-float(y)), *z])


def _number(value: float) -> str:
    return f"{value + 0.0:.2f}"


def _negate(node: Element, keys: Iterable[str], where: str) -> None:
    for key in keys:
        text = node.get(key)
        if text is None:
            continue
        if not re.fullmatch(r"\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*", text):
            raise MapError(f"{where}: {key}: expected a number, got '{text[:40]}'")
        plain = text.strip()
        node.set(key, plain[1:] if plain.startswith("-") else f"-{plain.lstrip('+')}")
