"""Adapts an OpenDRIVE map so that SUMO's netconvert can read it, and lists the changes."""

import math
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.scenes.maps.opendrive_geometry import (
    number,
    read_cubics,
    read_reference_line,
    read_root,
)

# Length of a connecting road that is added to a direct junction, where the roads touch.
WAY_M = 0.05
# Shapes with a smaller curvature become lines, because netconvert divides by the curvature.
LEAST_CURVATURE = 1e-9
JUNCTIONS = frozenset({"default", ""})  # types of junctions that netconvert can read


def mended_for_netconvert(file: Path, out: Path) -> tuple[Path, list[str]]:
    """Returns a file that netconvert can read, and a list of notes on changes.

    If no change is needed, the returned file is `file`. Otherwise it is `out`, without the content
    that netconvert refuses.
    """
    root = read_root(file)
    notes = [*_straightened(root), *_signals(root), *_junctions(root)]
    if not notes:
        return file, []
    ElementTree.ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)
    return out, [note for note in notes if note]


def _straightened(root: Element) -> list[str]:
    """Turns arcs and spirals without curvature into lines, and constant spirals into arcs.

    The curves stay the same. The notes are therefore empty texts, one for each change.
    """
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


_NEEDED = {
    "signal": ("id", "type", "orientation", "dynamic", "s"),
    "signalReference": ("id", "orientation", "s"),
}


def _signals(root: Element) -> list[str]:
    """Removes signals that lack attributes needed by netconvert, and references to the signals."""
    notes = []
    kept = set[str]()
    for tag in ("signal", "signalReference"):
        for road in root.iterfind("road"):
            for signals in road.iterfind("signals"):
                for signal in signals.findall(tag):
                    name = signal.get("id") or ""
                    why = _lack(signal)
                    if not why and tag == "signalReference" and name not in kept:
                        why = "no such signal in the network"
                    if not why:
                        kept.add(name)
                        continue
                    signals.remove(signal)
                    where = f"road {road.get('id')}: {tag} {signal.get('id')}"
                    notes.append(f"{where}: {why}; left out of the network")
    return notes


def _lack(signal: Element) -> str:
    """Returns why netconvert would refuse a signal, or an empty text if it would accept it."""
    for key in _NEEDED[signal.tag]:
        if not (signal.get(key) or "").strip():
            return f"{key} is empty"
    try:
        float(signal.get("s", ""))
        for validity in signal.iterfind("validity"):
            int(validity.get("fromLane", "")), int(validity.get("toLane", ""))
    except ValueError:
        return "s or validity is not a number"
    return ""


def _junctions(root: Element) -> list[str]:
    """Adds connecting roads to direct junctions, and removes junctions of other special types."""
    notes = []
    for junction in root.findall("junction"):
        kind, name = junction.get("type", ""), junction.get("id", "")
        if kind == "direct":
            _as_default(root, junction)
            notes.append(f"junction {name}: type 'direct'; short connecting roads were added")
        elif kind not in JUNCTIONS or any(
            not connection.get("connectingRoad") for connection in junction.iterfind("connection")
        ):
            notes.append(f"junction {name}: type {kind!r}; left out of the network")
            root.remove(junction)
            for link, end in _links_to(root, name):
                link.remove(end)
    return notes


def _links_to(root: Element, junction: str) -> list[tuple[Element, Element]]:
    return [
        (link, end)
        for link in root.iterfind("road/link")
        for end in list(link)
        if end.get("elementType") == "junction" and end.get("elementId") == junction
    ]


def _as_default(root: Element, junction: Element) -> None:
    """Converts a direct junction to the type `default`, with connecting roads of WAY_M."""
    roads = {road.get("id"): road for road in root.iterfind("road")}
    links = []
    for connection in junction.findall("connection"):
        junction.remove(connection)
        incoming, linked = (roads.get(connection.get(k)) for k in ("incomingRoad", "linkedRoad"))
        if incoming is None or linked is None:
            continue
        near_end = _end_at(incoming, junction.get("id"))
        contact = connection.get("contactPoint", "start")
        for pair in connection.iterfind("laneLink"):
            ends = [
                (incoming, near_end, int(number(pair, "from"))),
                (linked, contact, int(number(pair, "to"))),
            ]
            outwards = (ends[0][2] < 0) == (near_end == "end")
            if incoming.get("rule") == "LHT":
                outwards = not outwards
            links.append((ends[0], ends[1]) if outwards else (ends[1], ends[0]))
    for count, (origin, goal) in enumerate(links):
        name = f"{junction.get('id')}_direct{count}"
        root.insert(list(root).index(junction), _way(name, junction.get("id", ""), origin, goal))
        words = {"id": str(count), "incomingRoad": origin[0].get("id", ""), "connectingRoad": name}
        connection = Element("connection", {**words, "contactPoint": "start"})
        connection.append(Element("laneLink", {"from": str(origin[2]), "to": "-1"}))
        junction.append(connection)
    junction.attrib.pop("type")


_End = tuple[Element, str, int]  # a road, its contact point (start or end), and a lane id


def _way(name: str, junction: str, origin: _End, goal: _End) -> Element:
    """Returns a connecting road with one lane that begins where the origin's lane ends."""
    road, contact, lane = origin
    line = read_reference_line(road)
    s = line.length if contact == "end" else 0.0
    x, y, heading = line.at(np.array([s]))[0].tolist()
    offset, width = _across(road, s, contact, lane)
    if contact != "end":
        heading, offset = heading + math.pi, -offset
    z = float(read_cubics(road.findall("elevationProfile/elevation")).at(np.array([s]))[0])

    def link(tag: str, end: _End) -> str:
        words = f'elementType="road" elementId="{end[0].get("id")}" contactPoint="{end[1]}"'
        return f"<{tag} {words}/>"

    text = (
        f'<road id="{name}" junction="{junction}" length="{WAY_M}">'
        f"<link>{link('predecessor', origin)}{link('successor', goal)}</link>"
        f'<planView><geometry s="0" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{WAY_M}"><line/>'
        f'</geometry></planView><elevationProfile><elevation s="0" a="{z!r}" b="0" c="0" d="0"/>'
        f'</elevationProfile><lanes><laneOffset s="0" a="{offset!r}" b="0" c="0" d="0"/>'
        '<laneSection s="0"><center><lane id="0" type="none"/></center><right>'
        f'<lane id="-1" type="driving"><link><predecessor id="{lane}"/>'
        f'<successor id="{goal[2]}"/></link><width sOffset="0" a="{width!r}" b="0" c="0" d="0"/>'
        "</lane></right></laneSection></lanes></road>"
    )
    return ElementTree.fromstring(text)


def _across(road: Element, s: float, contact: str, lane: int) -> tuple[float, float]:
    """Returns t of the lane's inner border and the lane's width at the junction."""
    section = road.findall("lanes/laneSection")[-1 if contact == "end" else 0]
    start = number(section, "s")
    side = "left" if lane > 0 else "right"
    at = np.array([s])
    t = float(read_cubics(road.findall("lanes/laneOffset")).at(at)[0])
    width = 3.5
    for node in sorted(section.findall(f"{side}/lane"), key=lambda n: abs(number(n, "id"))):
        wide = float(read_cubics(node.findall("width"), "sOffset", start).at(at)[0])
        if int(number(node, "id")) == lane:
            width = wide
            break
        t += math.copysign(wide, lane)
    return t, max(width, 0.1)


def _end_at(road: Element, junction: str | None) -> str:
    """Returns `start` or `end`, whichever end of a road is at a junction."""
    for end in road.iterfind("link/*"):
        if end.get("elementType") == "junction" and end.get("elementId") == junction:
            return "start" if end.tag == "predecessor" else "end"
    return "end"
