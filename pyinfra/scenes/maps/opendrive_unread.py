"""Counts elements of an OpenDRIVE file that neither the importer nor netconvert uses."""

from collections import Counter
from xml.etree.ElementTree import Element

_LANE = "link width border height speed access"
_READ = {
    "OpenDRIVE": "header road junction",
    "header": "geoReference offset",
    "road": "link type planView elevationProfile lateralProfile lanes objects signals "
    "surface railroad",
    "road/link": "predecessor successor",
    "type": "speed",
    "planView": "geometry",
    "geometry": "line arc spiral poly3 paramPoly3",
    "elevationProfile": "elevation",
    "lateralProfile": "superelevation shape crossfall",
    "lanes": "laneOffset laneSection",
    "laneSection": "left center right",
    "left": "lane",
    "center": "lane",
    "right": "lane",
    "lane": _LANE,
    "lane/link": "predecessor successor",
    "objects": "object objectReference tunnel bridge",
    "object": "repeat outline outlines",
    "outlines": "outline",
    "outline": "cornerLocal cornerRoad",
    "signals": "signal signalReference",
    "signal": "validity",
    "signalReference": "validity",
    "junction": "connection",
    "connection": "laneLink predecessor successor",
}  # maps an element to its children that are read or reported elsewhere
# Elements that are reported without their children.
_LISTED = frozenset({"objectReference", "tunnel", "bridge", "surface", "railroad"})
_TRUE = ("true", "1")
_ANYWHERE = frozenset({"userData", "include", "dataQuality"})  # allowed in every element
_CHILDREN = {parent: frozenset(tags.split()) for parent, tags in _READ.items()}


def unread_elements(root: Element) -> list[str]:
    """Returns a text for each kind of unread element, with its count.

    Elements inside an unread element are not counted separately. Attributes of lanes count if they
    change the lane.
    """
    counts = Counter[str]()
    _count(root, "", counts)
    for road in root.iterfind("road"):
        for lane in road.iterfind("lanes/laneSection/*/lane"):
            counts += Counter(_unread_attributes(lane, road.find("lateralProfile/*") is not None))
    return [f"{kind}: not read, {count} in the file" for kind, count in sorted(counts.items())]


def _unread_attributes(lane: Element, is_inclined: bool) -> list[str]:
    attributes = (
        (lane.get("direction") == "both", 'lane: direction="both"'),
        (lane.get("dynamicLaneDirection") in _TRUE, "lane: dynamicLaneDirection"),
        (lane.get("level") in _TRUE and is_inclined, "lane: level"),
    )
    return [text for holds, text in attributes if holds]


def _count(node: Element, parent: str, counts: Counter[str]) -> None:
    read = _CHILDREN.get(f"{parent}/{node.tag}", _CHILDREN.get(node.tag, frozenset()))
    for child in node:
        if child.tag in _ANYWHERE:
            counts[child.tag] += 1
        elif child.tag not in read:
            of = "" if node.tag == "OpenDRIVE" else f"{node.tag}/"
            counts[f"{of}{child.tag}"] += 1
        elif child.tag not in _LISTED:
            _count(child, node.tag, counts)
