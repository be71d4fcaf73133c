"""Compares the lanes that OpenStreetMap states for its ways with SUMO's network.

Follows the public descriptions of the keys `lanes`, `lanes:both_ways`, `lanes:bus`, `busway` and
`bus:lanes`. Differences are only reported, because vehicles drive on the network.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element

from pyinfra.scenes.maps.lane_map import MapLane
from pyinfra.scenes.maps.openstreetmap import StreetMap, Way

MOST_LISTED = 50
SIDED = re.compile(r"(sidewalk|cycleway|busway|footway)(:|$)")
# Name of a lane in SUMO's network: sign of the direction, way, part of the way, and lane.
LANE = re.compile(r"lane_(-?)(\d+)((?:_\d+)?)_\d+")
BUS_LANES = re.compile(r"(lanes:(bus|psv)|(bus|psv):lanes|busway)(:|$)")


def has_sides(map_: StreetMap) -> bool:
    """Returns whether a street has a sidewalk, cycleway or bus lane on only one side."""
    return any(SIDED.match(key) for way in map_.ways for key in way.tags)


def swap_sides(tag: Element) -> None:
    """Swaps left and right in a tag of a sidewalk, cycleway or bus lane of a street.

    For left-hand traffic, netconvert puts the lanes forward on the left, but takes the sidewalk of
    the lanes forward from the tags of the right.
    """
    key, value = tag.get("k", ""), tag.get("v", "")
    if not SIDED.match(key):
        return
    other = {"left": "right", "right": "left"}
    tag.set("k", ":".join(other.get(word, word) for word in key.split(":")))
    tag.set("v", other.get(value, value))


def lane_notes(map_: StreetMap, lanes: Sequence[MapLane]) -> list[str]:
    """Returns a text with the id of each way whose lanes differ from those of the network."""
    counts: defaultdict[str, defaultdict[str, defaultdict[str, int]]] = defaultdict(
        lambda: defaultdict(lambda: defaultdict(int))
    )
    for lane in lanes:
        match = LANE.fullmatch(lane.name)
        if match and lane.kind == "road":
            counts[match[2]][match[1]][match[3]] += 1
    notes = [
        f"way {way.id}: {text}"
        for way in map_.ways
        if way.id in counts
        for text in _differences(way, [set(p.values()) for p in counts[way.id].values()])
    ]
    more = len(notes) - MOST_LISTED
    return notes[:MOST_LISTED] + ([f"{more} more ways differ in their lanes"] if more > 0 else [])


def _differences(way: Way, by_direction: Sequence[set[int]]) -> Iterator[str]:
    """Yields how the lanes of a way differ. `by_direction`: its edges' lane counts."""
    stated = _whole(way.tags.get("lanes", ""))
    is_oneway = way.tags.get("oneway", "no") != "no"
    if stated is not None and any("opposite" in v for k, v in way.tags.items() if "busway" in k):
        stated += 1  # the tag `lanes` seldom counts an opposite bus lane
    if len(by_direction) < 2 - is_oneway:
        stated = None  # netconvert joined the other direction to another way
    low, high = (sum(map(of, by_direction)) for of in (min, max))
    if stated == 1 and not is_oneway and len(by_direction) == 2 and low == 2:
        yield "one lane for both directions, a lane for each direction in the network"
    elif stated is not None and not low <= stated <= high:
        got = f"{low}" if low == high else f"{low} to {high}"
        yield f"lanes: {stated} in the map, {got} in the network"
    if _whole(way.tags.get("lanes:both_ways", "")):
        yield "a lane for turns from both directions is a lane of one direction in the network"
    bus = sorted(key for key, value in way.tags.items() if BUS_LANES.match(key) and _is_bus(value))
    # Bus lanes against a one-way street are also in the network, so they are not reported.
    bus = [key for key in bus if not (is_oneway and key.endswith("backward"))]
    if bus and not any("opposite" in way.tags[key] for key in bus):
        yield f"a bus lane ({bus[0]}), which is a lane for all vehicles in the network"


def _is_bus(value: str) -> bool:
    return value not in ("no", "0", "none") and (
        "designated" in value or "yes" in value or "lane" in value or bool(_whole(value))
    )


def _whole(text: str) -> int | None:
    return int(text) if text.strip().isdecimal() and len(text) < 4 else None
