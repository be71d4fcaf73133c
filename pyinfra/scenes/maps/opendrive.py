"""Reads lanes and objects of an OpenDRIVE file, with the file's widths and elevations.

A road is sampled every metre if its line, width or elevation bends, else every four metres.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import (
    SHORTEST_M,
    MapError,
    MapLane,
    SiteMap,
    lane_name,
    without_folds,
)
from pyinfra.scenes.maps.opendrive_geometry import (
    Cubics,
    OpenDriveRoad,
    curve_length,
    number,
    read_cubics,
    read_reference_line,
    read_root,
)
from pyinfra.scenes.maps.opendrive_objects import read_objects
from pyinfra.scenes.maps.opendrive_unread import unread_elements

STEP_M = 1.0  # distance between samples of a road that bends
STRAIGHT_STEP_M = 4.0  # distance between samples of a straight road
LENGTHS_APART = 0.01  # relative difference of two lengths that counts as rounding
KERB_M = 0.15  # default height of sidewalks above the road
DRIVEN = frozenset(
    "driving entry exit onRamp offRamp connectingRamp bidirectional mwyEntry mwyExit "
    "bus taxi HOV slipLane".split()
)
PAVED = frozenset(
    "none shoulder border stop parking restricted median biking tram rail roadWorks special1 "
    "special2 special3 shared".split()
)
FOOTWAYS = frozenset({"sidewalk", "walking", "curb"})


def read_opendrive(file: Path) -> SiteMap:
    """Reads an OpenDRIVE file. Raises MapError and OSError."""
    try:
        root = read_root(file)
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise MapError(f"{file}: cannot be read as XML: {error}") from error
    if root.tag != "OpenDRIVE":
        raise MapError(f"{file}: expected <OpenDRIVE>, got <{root.tag}>")
    site_map, ids = SiteMap(), set[str | None]()
    try:
        for count, node in enumerate(root.iter("road")):
            ids.add(node.get("id"))
            if len(ids) <= count:
                name = node.get("id")
                raise MapError(f"road {name}: expected each road id once, got '{name}' twice")
            _read_road(node, site_map)
    except MapError as error:
        raise MapError(f"{file}: {error}") from error
    if root.find("header/offset") is not None:
        site_map.not_understood.append("header: offset")
    site_map.not_understood += unread_elements(root)
    return site_map


def _read_road(node: Element, site_map: SiteMap) -> None:
    road = OpenDriveRoad(
        node.get("id") or "",
        read_reference_line(node),
        read_cubics(node.findall("elevationProfile/elevation")),
        read_cubics(node.findall("lateralProfile/superelevation")),
        read_cubics(node.findall("lanes/laneOffset")),
    )
    site_map.not_understood += _lengths_that_disagree(road, node)
    for tag in ("shape", "crossfall"):
        if node.find(f"lateralProfile/{tag}") is not None:
            site_map.not_understood.append(f"road {road.id}: lateralProfile/{tag}")
    sections = node.findall("lanes/laneSection")
    starts = [number(section, "s") for section in sections]
    for before, start in itertools.pairwise(starts):
        if start < before:
            raise MapError(
                f"road {road.id}: laneSection: s: expected ascending values, got {start:g} after "
                f"{before:g}"
            )
    pieces: dict[tuple[int, int], Piece] = {}
    for side, sign in (("left", 1), ("right", -1)):
        some = [(at, one) for at, one in zip(starts, sections, strict=True) if _holds(one, side)]
        ends = [at for at, _ in some[1:]] + [road.line.length]
        for i, ((start, section), end) in enumerate(zip(some, ends, strict=True)):
            if end - start > 1e-3:
                lanes = section.findall(f"{side}/lane")
                pieces |= {(i, p.id): p for p in _pieces(road, lanes, sign, start, end)}
    left_hand = node.get("rule") == "LHT"
    for first, chain in _joined(pieces):
        _add_lane(road, first, chain, left_hand, site_map)
    read_objects(road, node, site_map)


def _lengths_that_disagree(road: OpenDriveRoad, node: Element) -> list[str]:
    """Returns texts about contradicting lengths.

    The stated length of a road may contradict the road's geometries. The stated length of a
    geometry may contradict the length of its curve.
    """
    stated, length = number(node, "length", road.line.length), road.line.length
    notes = []
    if abs(stated - length) > LENGTHS_APART * length + 0.1:
        notes.append(
            f"road {road.id}: length: expected {length:g} m, the length of the geometry, got "
            f"{stated:g} m; the import uses the geometry"
        )
    for shape in node.iterfind("planView/geometry"):
        along, declared = curve_length(shape), number(shape, "length")
        if abs(along - declared) > LENGTHS_APART * along + 0.1:
            notes.append(
                f"road {road.id}: geometry at s = {number(shape, 's'):g}: length: expected "
                f"{along:.3f} m, the length of the curve, got {declared:g} m"
            )
    return notes


@dataclass(frozen=True, eq=False)
class Piece:
    """A lane in one lane section, with points of increasing s."""

    id: int
    type: str
    kerb_m: float
    inner: FloatArray  # inner border (n, 3)
    outer: FloatArray  # outer border (n, 3)
    successor: int | None
    is_reversed: bool  # whether traffic is against the side's usual direction (OpenDRIVE 1.8)


def _holds(section: Element, side: str) -> bool:
    """Returns whether a lane section is valid for a side of the road."""
    return section.get("singleSide") not in ("true", "1") or section.find(side) is not None


def _pieces(
    road: OpenDriveRoad, nodes: list[Element], sign: int, start: float, end: float
) -> list[Piece]:
    """Returns the lanes of a side in a lane section. sign: sign of the ids of these lanes."""
    pieces = []
    lanes = sorted(nodes, key=lambda n: abs(_lane_id(road, n)))
    widths = [read_cubics(lane.findall("width"), "sOffset", start) for lane in lanes]
    borders = [read_cubics(lane.findall("border"), "sOffset", start) for lane in lanes]
    s = _samples(road, [*widths, *borders], start, end)
    t = inner = road.offset.at(s)
    for lane, width, border in zip(lanes, widths, borders, strict=True):
        across = width.at(s)
        if across.min() < -1e-3:
            at = s[int(across.argmin())]
            raise MapError(
                f"road {road.id}: lane {lane.get('id')}: width: expected 0 or more, got "
                f"{across.min():.3g} m at s = {at:.1f}"
            )
        has_border = len(border.starts) > 0 and not len(width.starts)
        t = border.at(s) if has_border else inner + sign * across.clip(0)
        pieces.append(
            Piece(
                _lane_id(road, lane),
                lane.get("type") or "none",
                _kerb(lane),
                road.positions(s, inner),
                road.positions(s, t),
                _successor(lane),
                lane.get("direction") == "reversed",
            )
        )
        inner = t
    return pieces


def _lane_id(road: OpenDriveRoad, node: Element) -> int:
    value = number(node, "id")
    if value != int(value):
        raise MapError(f"road {road.id}: lane: id: expected a whole number, got {value:g}")
    return int(value)


def _successor(lane: Element) -> int | None:
    node = lane.find("link/successor")
    return None if node is None else int(number(node, "id"))


def _kerb(lane: Element) -> float:
    heights = [number(node, "inner", 0.0) for node in lane.findall("height")]
    return heights[0] if heights else KERB_M if lane.get("type") in FOOTWAYS else 0.0


def _samples(road: OpenDriveRoad, cubics: list[Cubics], start: float, end: float) -> FloatArray:
    curves = [road.elevation, road.roll, road.offset, *cubics]
    bent = road.line.bent or any(c.bent for c in curves)
    step = STEP_M if bent else STRAIGHT_STEP_M
    even = np.linspace(start, end, max(2, math.ceil((end - start) / step) + 1))
    breaks = np.concatenate([c.starts for c in curves])
    inside = breaks[(breaks > start + 1e-3) & (breaks < end - 1e-3)]
    s = np.unique(np.concatenate([even, inside]))
    return np.asarray(s[np.concatenate([[True], np.diff(s) > 1e-3])])


def _joined(pieces: dict[tuple[int, int], Piece]) -> Iterator[tuple[int, list[Piece]]]:
    """Joins the pieces of lanes that continue with the same type, kerb and direction.

    Yields the number of the first section, and the pieces, of each lane.
    """
    remaining = dict(pieces)
    for i, number_ in sorted(pieces):
        if (i, number_) not in remaining:
            continue
        chain = [remaining.pop((i, number_))]
        last = i
        while chain[-1].successor is not None:
            after = remaining.get((last + 1, chain[-1].successor))
            if after is None or _kind(after) != _kind(chain[-1]):
                break
            if np.abs(after.inner[0] - chain[-1].inner[-1]).max() > 0.01:
                break
            chain.append(remaining.pop((last + 1, chain[-1].successor)))
            last += 1
        yield i, chain


def _kind(piece: Piece) -> tuple[str, float, bool]:
    return piece.type, piece.kerb_m, piece.is_reversed


def _add_lane(
    road: OpenDriveRoad, section: int, chain: list[Piece], left_hand: bool, site_map: SiteMap
) -> None:
    """Adds the lane of joined pieces, unless it is too narrow or too short."""
    first = chain[0]
    inner = np.concatenate([first.inner, *(p.inner[1:] for p in chain[1:])])
    outer = np.concatenate([first.outer, *(p.outer[1:] for p in chain[1:])])
    left, right = (outer, inner) if first.id > 0 else (inner, outer)
    if (first.id > 0) ^ left_hand ^ first.is_reversed:  # traffic against the reference line
        left, right = right[::-1], left[::-1]
    if np.hypot(*(left - right)[:, :2].T).max() < 0.01:
        return
    side = "left" if first.id > 0 else "right"
    name = lane_name(f"road{road.id}", section, f"{side}{abs(first.id)}")
    left, right, folded = without_folds(left, right)
    if folded is not None:
        x, y, _ = folded
        site_map.mended.append(
            f"lane {name}: removed a part that runs backwards at {x:.1f} {y:.1f}"
        )
    if np.hypot(*np.diff((left + right)[:, :2] / 2, axis=0).T).sum() < SHORTEST_M:
        site_map.mended.append(f"lane {name}: shorter than {SHORTEST_M} m, left out")
        return
    if first.type not in DRIVEN | PAVED | FOOTWAYS:
        site_map.not_understood.append(
            f"lane {name}: unknown type {first.type!r}; imported as a paved shoulder"
        )
    kind = "sidewalk" if first.type in FOOTWAYS else "road"
    site_map.lanes.append(MapLane(name, kind, first.type in DRIVEN, left, right, first.kerb_m))
