"""An OpenDRIVE map as SUMO's netconvert can read it; what is changed for it is listed."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

LEAST_CURVATURE = 1e-9  # an arc of less is a line; netconvert divides by it
JUNCTIONS = frozenset({"default", "direct", ""})  # others are left out of the network


def mended_for_netconvert(file: Path, out: Path) -> tuple[Path, list[str]]:
    """The file itself, or `out` with what netconvert would refuse taken out; and what that was."""
    root = ElementTree.parse(file).getroot()
    for node in root.iter():
        node.tag = node.tag.rpartition("}")[2]
    notes = [*_straightened(root), *_signals(root), *_junctions(root)]
    if not notes:
        return file, []
    ElementTree.ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)
    return out, [note for note in notes if note]


def _straightened(root: Element) -> list[str]:
    """Arcs and spirals without a curvature as lines: the same curve, so nobody need be told."""
    notes = []
    for geometry in root.iterfind("road/planView/geometry"):
        for shape in [*geometry.findall("arc"), *geometry.findall("spiral")]:
            keys = ("curvature",) if shape.tag == "arc" else ("curvStart", "curvEnd")
            bends = [float(shape.get(k, "nan")) for k in keys]
            if all(abs(bend) < LEAST_CURVATURE for bend in bends):
                shape.tag, shape.attrib = "line", {}
                notes.append("")
            elif shape.tag == "spiral" and math.isclose(bends[0], bends[1], rel_tol=1e-9):
                shape.tag, shape.attrib = "arc", {"curvature": repr(bends[0])}
                notes.append("")
    return notes


def _signals(root: Element) -> list[str]:
    """Signals without a type, an id or a place tell the network nothing."""
    notes = []
    for road in root.iterfind("road"):
        for signals in road.iterfind("signals"):
            for signal in list(signals):
                needed = ("id", "type") if signal.tag == "signal" else ("id",)
                lacks = [key for key in needed if not (signal.get(key) or "").strip()]
                if lacks:
                    signals.remove(signal)
                    notes.append(
                        f"road {road.get('id')}: {signal.tag} {signal.get('id')}: {lacks[0]} is "
                        "empty: not in the network"
                    )
    return notes


def _junctions(root: Element) -> list[str]:
    """Direct junctions as links from road to road; kinds without roads of their own left out."""
    notes = []
    for junction in root.findall("junction"):
        kind, name = junction.get("type", ""), junction.get("id", "")
        if kind == "direct":
            for connection in junction.iterfind("connection"):
                _linked(root, junction, connection)
            notes.append(f"junction {name}: direct: its roads are linked to each other")
        elif kind not in JUNCTIONS or any(
            not connection.get("connectingRoad") for connection in junction.iterfind("connection")
        ):
            notes.append(f"junction {name}: type {kind!r}: not in the network")
        else:
            continue
        root.remove(junction)
        for link in _links_to(root, name):
            link[0].remove(link[1])
    return notes


def _links_to(root: Element, junction: str) -> list[tuple[Element, Element]]:
    return [
        (link, end)
        for link in root.iterfind("road/link")
        for end in list(link)
        if end.get("elementType") == "junction" and end.get("elementId") == junction
    ]


def _linked(root: Element, junction: Element, connection: Element) -> None:
    """Each road's end at the junction goes on in the other road, lane by lane."""
    ids = connection.get("incomingRoad"), connection.get("linkedRoad")
    roads = [next((r for r in root.iterfind("road") if r.get("id") == i), None) for i in ids]
    incoming, linked = roads
    if incoming is None or linked is None:
        return
    ends = [_end_at(incoming, junction.get("id")), _end_at(linked, junction.get("id"))]
    if connection.get("contactPoint") in ("start", "end"):
        ends[1] = "predecessor" if connection.get("contactPoint") == "start" else "successor"
    if None in ends:
        return
    both = [(incoming, ends[0], linked, ends[1]), (linked, ends[1], incoming, ends[0])]
    pairs = [(n.get("from", ""), n.get("to", "")) for n in connection.iterfind("laneLink")]
    for k, (road, end, other, its_end) in enumerate(both):
        link = road.find("link")
        if link is None:
            link = Element("link")
            road.insert(0, link)
        assert end is not None
        for old in link.findall(end):
            if old.get("elementType") == "junction":
                link.remove(old)
        if link.find(end) is None:
            contact = "start" if its_end == "predecessor" else "end"
            words = {"elementType": "road", "elementId": other.get("id", "")}
            link.append(Element(end, {**words, "contactPoint": contact}))
        sections = road.findall("lanes/laneSection")
        if not sections:
            continue
        section = sections[0] if end == "predecessor" else sections[-1]
        for pair in pairs:
            own, its = pair if k == 0 else pair[::-1]
            for lane in section.iter("lane"):
                if lane.get("id") == own:
                    _link_lane(lane, end, its)


def _link_lane(lane: Element, end: str, other: str) -> None:
    link = lane.find("link")
    if link is None:
        link = Element("link")
        lane.insert(0, link)
    if link.find(end) is None:
        link.append(Element(end, {"id": other}))


def _end_at(road: Element, junction: str | None) -> str | None:
    """Which end of a road is at a junction."""
    for end in road.iterfind("link/*"):
        if end.get("elementType") == "junction" and end.get("elementId") == junction:
            return end.tag
    return None
