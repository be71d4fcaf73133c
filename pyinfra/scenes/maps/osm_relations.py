"""Buildings of OpenStreetMap as rings: a way, or a multipolygon with several outlines and holes.

Follows the public description of relations of type `multipolygon`: members with the role `outer` or
`inner` are ways, which alone or together form closed rings. A relation of type `building` has an
`outline`, which usually is a building of its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.openstreetmap import Multipolygon, StreetMap
from pyinfra.scenes.maps.surfaces import contains, crosses_itself, side_of, signed_area


@dataclass(frozen=True)
class Building:
    """A building with one outline. Nodes are ids; the first one is not repeated."""

    source: str  # name of the element in the map, such as `way 5`
    nodes: list[str]
    tags: dict[str, str]
    holes: list[list[str]] = field(default_factory=list)


def buildings(map_: StreetMap) -> Iterator[Building | str]:
    """Yields the buildings of ways and multipolygons, or a text for one that is left out.

    A way that is an outline of a multipolygon is not yielded twice. A way around a courtyard may
    be a building of its own, which fills the courtyard.
    """
    houses = {name for name, _, _ in map_.houses}
    relations = [
        r
        for r in map_.multipolygons
        if r.tags.get("type") != "building" or houses.isdisjoint(_outlines(r))
    ]
    outlines = {ref for relation in relations for ref in _outlines(relation)}
    for name, nodes, tags in map_.houses:
        if name not in outlines:
            is_closed = len(nodes) > 1 and nodes[0] == nodes[-1]
            yield Building(f"way {name}", nodes[:-1] if is_closed else nodes, tags)
    for relation in relations:
        source = f"relation {relation.id}"
        inner = [ref for ref, role in relation.members if role == "inner"]
        outer_rings, inner_rings = (
            _rings([map_.outlines.get(ref, []) for ref in refs])
            for refs in (_outlines(relation), inner)
        )
        if not outer_rings:
            yield f"{source}: building without a closed outline, left out"
            continue
        for nodes in outer_rings:
            if not all(node in map_.nodes for node in nodes):
                yield f"{source}: building with missing nodes, left out"
                continue
            outline = np.array([map_.nodes[node] for node in nodes])
            holes = [
                hole
                for hole in inner_rings
                if all(node in map_.nodes for node in hole)
                and contains(outline, np.array([map_.nodes[hole[0]]]))[0]
            ]
            yield Building(source, nodes, relation.tags, holes)


def _outlines(relation: Multipolygon) -> list[str]:
    return [ref for ref, role in relation.members if role in ("outer", "outline")]


def with_holes(outline: FloatArray, holes: Sequence[FloatArray]) -> FloatArray:
    """Returns one outline (n, 2) that goes around the holes, along a cut to each of them.

    The cut has no width. Holes that cross the outline or themselves are left out.
    """
    outline = outline if signed_area(outline) > 0 else outline[::-1]
    for hole in sorted(holes, key=lambda h: -float(h[:, 0].max())):
        if len(hole) < 3 or crosses_itself(hole):
            continue
        ring = hole if signed_area(hole) < 0 else hole[::-1]
        away = np.linalg.norm(outline[:, None] - ring[None], axis=2)
        for k in np.argsort(away, axis=None)[:MOST_CUTS]:
            i, j = np.unravel_index(int(k), away.shape)
            if not _cuts(outline, outline[i], ring[j]) and not _cuts(ring, outline[i], ring[j]):
                turned = np.concatenate([ring[j:], ring[: j + 1]])
                outline = np.concatenate([outline[: i + 1], turned, outline[i:]])
                break
    return outline


MOST_CUTS = 200  # maximum number of cuts that are tried for a hole, the shortest first


def _cuts(ring: FloatArray, start: FloatArray, end: FloatArray) -> bool:
    """Returns whether a segment crosses a side of a ring; common ends do not count."""
    a, b = ring, np.roll(ring, -1, axis=0)
    across = side_of(start, end, a) * side_of(start, end, b) < 0
    across &= side_of(a, b, start) * side_of(a, b, end) < 0
    return bool(across.any())


def _rings(parts: Sequence[list[str]]) -> list[list[str]]:
    """Joins parts of ways at their ends to closed rings, and returns them without the last node."""
    rest = [list(part) for part in parts if len(part) > 1]
    rings = []
    while rest:
        ring = rest.pop(0)
        while ring[0] != ring[-1]:
            at = next((k for k, part in enumerate(rest) if ring[-1] in (part[0], part[-1])), None)
            if at is None:
                break
            part = rest.pop(at)
            ring += part[1:] if part[0] == ring[-1] else part[-2::-1]
        if ring[0] == ring[-1] and len(ring) > 3:
            rings.append(ring[:-1])
    return rings
