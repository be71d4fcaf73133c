"""Impossible sites, and the most similar possible sites, as changes of one town.

    .venv/bin/python tests/python/impossible_sites.py --out results/impossible_sites.csv

This command writes the answer of `infrasim check` about each site. For possible sites, the check
includes a minute of traffic. The exit code is 1 if a verdict is wrong.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

TOWN = """\
name: town
duration_s: 1
mounts:
  pole: {x_m: -25, y_m: -12, z_m: 6}
roads:
  - name: main
    start: {x_m: -200, y_m: 0}
    centreline:
      - {line_m: 400}
    lanes: {each_way: 2, width_m: 3.5, shoulder_m: 0.5, sidewalk_m: 2.5}
  - name: side
    start: {x_m: 0, y_m: -200, heading_deg: 90}
    centreline:
      - {line_m: 400}
    lanes: {each_way: 2, width_m: 3.5, shoulder_m: 0.5, sidewalk_m: 2.5}
ground:
  - {elevation_m: -0.05, outline_m: [[-300, -300], [300, -300], [300, 300], [-300, 300]]}
buildings:
  - {x_m: 60, y_m: 40, length_m: 30, width_m: 20, height_m: 15}
barriers:
  - {road: main, offset_m: 11, from_m: 20, to_m: 120}
gantries:
  - {road: main, s_m: 60}
junctions:
  - roads: [main, side]
traffic:
  vehicles_per_km_lane: 15
  speed: {mean_km_h: 40}
  warm_up_s: 1
  class_shares: {Car: 0.9, Bus: 0.1}
"""
POLE = "pole: {x_m: -25, y_m: -12, z_m: 6}"
SIDE = "start: {x_m: 0, y_m: -200, heading_deg: 90}"
LANES = "lanes: {each_way: 2, width_m: 3.5, shoulder_m: 0.5, sidewalk_m: 2.5}"
SIDE_LINE = f"- {{line_m: 400}}\n    {LANES}\nground:"
GROUND = "elevation_m: -0.05"
HOUSE = "x_m: 60, y_m: 40, length_m: 30, width_m: 20, height_m: 15"
JUNCTION = "junctions:\n  - roads: [main, side]\n"
NO_JUNCTION = (JUNCTION, "")
RING = (JUNCTION, JUNCTION + "    roundabout: {radius_m: 20}\n")
CROSS_SECTION = "{each_way: 2, width_m: 3.5, shoulder_m: 0.5, sidewalk_m: 2.5}"
ONE_LANE = tuple(
    (CROSS_SECTION + after, CROSS_SECTION.replace("2", "1", 1) + after)
    for after in ("\n  - name: side", "\nground")
)
SHARES = "{Car: 0.9, Bus: 0.1}"

Edit = tuple[str, str]


@dataclass(frozen=True)
class Site:
    """Changes of the town. The error message must contain `key` and `words`, which are empty for a
    possible site."""

    name: str
    edits: tuple[Edit, ...]
    key: str = ""
    words: tuple[str, ...] = ()
    at: str = ""  # text in the line that the message names

    @property
    def text(self) -> str:
        text = TOWN
        for old, new in self.edits:
            if text.count(old) != 1:
                raise ValueError(f"{self.name}: expected 1, got '{old}' {text.count(old)} times")
            text = text.replace(old, new)
        return text

    @property
    def line(self) -> int:
        lines = [i for i, line in enumerate(self.text.splitlines(), 1) if self.at in line]
        if len(lines) != 1:
            raise ValueError(f"{self.name}: expected 1, got '{self.at}' on {len(lines)} lines")
        return lines[0]


def pole(x: float, y: float, z: float) -> Edit:
    return POLE, f"pole: {{x_m: {x:.9g}, y_m: {y:.9g}, z_m: {z:.9g}}}"


def profile(points: str) -> Edit:
    """Returns an edit that adds a profile to the whole town."""
    return "roads:\n  - name: main", f"profile:\n  points_m: {points}\nroads:\n  - name: main"


def pieces(*of_a_line: str) -> str:
    """Returns the YAML lines of the pieces of a centreline."""
    return "\n      ".join(f"- {{{piece}}}" for piece in of_a_line)


def side_line(line: str, more: str = "") -> Edit:
    """Returns an edit of the side road's centreline. `more` is added below it."""
    return SIDE_LINE, f"{line}\n{more}    {LANES}\nground:"


def side_keys(keys: str) -> Edit:
    return side_line("- {line_m: 400}", f"    {keys}\n")


def road(x: float, y: float, heading: float, *of_its_line: str) -> Edit:
    """Returns an edit that adds a third road."""
    lines = f"      {pieces(*of_its_line)}\n"
    start = f"start: {{x_m: {x:.9g}, y_m: {y:.9g}, heading_deg: {heading:.9g}}}"
    text = f"  - name: third\n    {start}\n    centreline:\n{lines}    lanes: {{each_way: 1}}\n"
    return "ground:\n", text + "ground:\n"


def house(x: float, y: float, more: str, *, base: float = 0) -> Edit:
    return HOUSE, f"x_m: {x:.9g}, y_m: {y:.9g}, {more}, base_m: {base:.9g}"


def more_ground(elevation: float) -> Edit:
    """Returns an edit that adds ground at the given elevation over a part of the main road."""
    outline = "[[-100, -30], [-80, -30], [-80, 30], [-100, 30]]"
    return "buildings:\n", (
        f"  - {{elevation_m: {elevation:.9g}, outline_m: {outline}}}\nbuildings:\n"
    )


def side_start(x: float, y: float, heading: float) -> Edit:
    return SIDE, f"start: {{x_m: {x:.9g}, y_m: {y:.9g}, heading_deg: {heading:.9g}}}"


EMBANKED = "elevation_m: 6\n    embankment: {foot_elevation_m: -0.05}"
NORTH = side_start(0, 60, 90)  # this road ends away from the main road
NORTH_LINE = "- {line_m: 200}"
SMALL = "length_m: 1, width_m: 1, height_m: 3"


def parked(row: str) -> Edit:
    """Returns an edit that adds parked cars along the main road, a metre apart."""
    shares = "class_shares: {Car: 1}"
    return "traffic:\n", f"parked:\n  - {{road: main, {row}, {shares}}}\ntraffic:\n"


def people(row: str) -> Edit:
    """Returns an edit that adds pedestrians along the main road."""
    rest = "per_km: 20, class: Pedestrian, speed: {mean_km_h: 5, std_km_h: 1}"
    return "traffic:\n", f"people:\n  - {{road: main, {row}, {rest}}}\ntraffic:\n"


ROADS = (
    Site("roads that cross without a junction", (NO_JUNCTION,), "centreline", ("main", "junction"),
         "name: side"),
    Site("a road that ends on another", (NO_JUNCTION, side_line("- {line_m: 196}")),
         "centreline", ("expected a junction of both", "'main'"), "name: side"),
    Site("a road that ends at another's edge", (NO_JUNCTION, side_line("- {line_m: 192.5}")),
         "centreline", ("expected a junction of both", "'main'"), "name: side"),
    Site("a road that goes on as another", (road(200, 0, 0, "line_m: 50"),),
         "centreline", ("'main'",), "name: third"),
    Site("a road beside another, on its lanes", (road(50, 9, 0, "line_m: 100"),),
         "centreline", ("'main'",), "name: third"),
    Site("a road beside another, edge to edge", (road(50, 11, 0, "line_m: 100"),),
         "centreline", ("'main'", "0.01 m of distance"), "name: third"),
    Site("a second crossing beside the junction",
         (side_line(pieces("line_m: 230", "radius_m: 40, turn_deg: -180", "line_m: 90")),),
         "centreline", ("'main'", "x 8"), "name: side"),
    Site("a third road through the junction", (road(-100, -100, 45, "line_m: 280"),),
         "centreline", ("expected a junction of both",), "name: third"),
    Site("a road that crosses itself",
         (road(-250, 150, 0, "line_m: 100", "radius_m: 40, turn_deg: 270", "line_m: 100"),),
         "centreline", ("cross itself",), "name: third"),
    Site("a ring that ends where it starts", (road(100, 150, 0, "radius_m: 40, turn_deg: 360"),),
         "centreline", ("got a closed road",), "name: third"),
    Site("a bridge of 3 m", (NO_JUNCTION, side_keys("elevation_m: 3")),
         "elevation_m", ("with 3 m between", "4.5"), "name: side"),
    Site("a bridge of 4.49 m", (NO_JUNCTION, side_keys("elevation_m: 4.49")),
         "elevation_m", ("with 4.49 m",), "name: side"),
    Site("a tunnel of 1 m", (NO_JUNCTION, side_keys("elevation_m: -1"),
         (GROUND, "elevation_m: -5")), "elevation_m", ("with 1 m",), "name: side"),
    Site("a bend tighter than the road is wide",
         (side_line(pieces("line_m: 250", "radius_m: 9, turn_deg: 90")),),
         "roads.1.centreline", ("radius_m of 9",), "{line_m: 250}"),
    Site("628 km of road", (road(0, 1000, 0, "radius_m: 100000, turn_deg: 360"),),
         "centreline", ("m of roads", "100000"), "name: third"),
    Site("more vehicles than memory", (road(0, 1000, 0, "line_m: 90000"),
         ("vehicles_per_km_lane: 15", "vehicles_per_km_lane: 70")), "vehicles_per_km_lane",
         ("vehicles on the scene's lanes", "5000"), "vehicles_per_km_lane"),
)  # fmt: skip
JUNCTIONS = (
    Site("a junction of two heights", (side_keys("elevation_m: 6"),), "roads",
         ("'main' at 0 m and 'side' at 6 m", "equal heights"), "roads: [main"),
    Site("a junction with a step of 5 cm", (side_keys("elevation_m: 0.05"),), "roads",
         ("0.05", "equal heights"), "roads: [main"),
    Site("a junction at 30 degrees", (side_start(-173.205, -100, 30),), "roads",
         ("30 degrees", "45 degrees or more"), "roads: [main"),
    Site("a junction at 44 degrees", (side_start(-143.868, -138.932, 44),), "roads",
         ("44 degrees", "45 degrees or more"), "roads: [main"),
    Site("a junction at 140 degrees", (side_start(153.209, -128.558, 140),), "roads",
         ("40 degrees", "45 degrees or more"), "roads: [main"),
    Site("a bend in a junction",
         (side_line(pieces("line_m: 194", "radius_m: 14, turn_deg: 50", "line_m: 100")),),
         "roads", ("'side' with a bend of",), "roads: [main"),
    Site("a junction of roads that do not meet", (side_start(250, -200, 90),), "roads",
         ("do not meet",), "roads: [main"),
    Site("a junction at a road's end", (side_start(0, -20, 90),), "roads",
         ("within 10 m of the end of 'side'",), "roads: [main"),
    Site("two junctions on a road", (road(100, -200, 90, "line_m: 400"),
         (JUNCTION, JUNCTION + "  - roads: [main, third]\n")), "roads",
         ("second junction",), "roads: [main, third]"),
    Site("a roundabout of roads with two lanes", (RING,), "roundabout",
         ("'main' with several", "one lane each way"), "roads: [main"),
    Site("a roundabout of 8 m", (*ONE_LANE, (RING[0], RING[1].replace("20", "8"))),
         "junctions.0.roundabout.radius_m", ("got '8'", "12"), "roundabout:"),
    Site("a roundabout with signals",
         (*ONE_LANE, (RING[0], RING[1] + "    signal: {green_s: 8}\n")), "junctions.0.signal",
         ("roundabout", "got both"), "signal:"),
    Site("a roundabout of arms at 50 degrees",
         (*ONE_LANE, RING, side_start(-128.558, -153.209, 50)), "roads",
         ("50 degrees", "60 degrees or more"), "roads: [main"),
    Site("a house on the ring of a roundabout", (*ONE_LANE, RING, house(14.1, 14.1, SMALL)),
         "x_m", ("on a lane",), "length_m: 1"),
    Site("a sensor on the ring of a roundabout", (*ONE_LANE, RING, pole(-14.1, -14.1, 4)),
         "mounts.pole.z_m", ("lane",), "pole:"),
)  # fmt: skip
PROFILES = (
    Site("a profile of one point", (profile("[[0, 0]]"),), "profile.points_m",
         ("expected 2 or more", "got fewer"), "points_m"),
    Site("a profile of 16 %", (profile("[[0, 0], [100, 16]]"),), "profile.points_m",
         ("got a grade of 16 %", "up to 15"), "points_m"),
    Site("a profile with points 39 m apart", (profile("[[0, 0], [39, 1]]"),), "profile.points_m",
         ("39 m after the one before", "40"), "points_m"),
    Site("a profile that goes back", (profile("[[0, 0], [-50, 1]]"),), "profile.points_m",
         ("-50 m after",), "points_m"),
    Site("a sensor in a hill", (profile("[[-100, 0], [0, 14]]"),), "mounts.pole.z_m",
         ("below the ground",), "pole:"),
)  # fmt: skip
GROUNDS = (
    Site("ground at the roads' height", ((GROUND, "elevation_m: 0"),), "elevation_m",
         ("got 0 on 'main'", "-0.011"), "outline_m"),
    Site("ground at the footways' height", ((GROUND, "elevation_m: -0.01"),), "elevation_m",
         ("got -0.01 on 'main'", "-0.011"), "outline_m"),
    Site("ground over the roads", ((GROUND, "elevation_m: 1"), pole(-25, -12, 7)), "elevation_m",
         ("got 1 on 'main'",), "outline_m"),
    Site("a deck 4.4 m over a road", (more_ground(4.4),), "elevation_m",
         ("got 4.4 on 'main'", "4.5"), "elevation_m: 4.4"),
    Site("a bridge's embankment on the road below", (NO_JUNCTION, side_keys(EMBANKED)),
         "embankment", ("got a slope across 'main'",), "name: side"),
    Site("a cutting's slope over a crossing road",
         (side_keys("embankment: {foot_elevation_m: 5}"),), "embankment",
         ("got a slope across 'main'",), "name: side"),
)  # fmt: skip
STANDING = (
    Site("a house on a lane", (house(-60, 8, "length_m: 9, width_m: 9, height_m: 9"),), "x_m",
         ("on a lane",), "length_m: 9"),
    Site("a post where vehicles turn", (house(-7.5, -7.5, SMALL),), "x_m", ("on a lane",),
         "length_m: 1"),
    Site("a house 4 m over a lane", (house(-60, 5, SMALL, base=4),), "x_m",
         ("on a lane", "4.5 m above"), "length_m: 1"),
    Site("a barrier on a lane", (("offset_m: 11", "offset_m: 5"),), "offset_m", ("on a lane",),
         "offset_m: 5"),
    Site("a barrier through the junction",
         (("offset_m: 11, from_m: 20, to_m: 120", "offset_m: 0, width_m: 0.1"),), "offset_m",
         ("on a lane",), "offset_m: 0"),
    Site("a gantry's leg in the junction", (("s_m: 60", "s_m: 195"),), "s_m", ("on a lane",),
         "s_m: 195"),
    Site("a gantry beyond its road", (("s_m: 60", "s_m: 401"),), "s_m", ("got 401",), "s_m: 401"),
    Site("cars parked on a lane", (parked("offset_m: -6, to_m: 100"),), "offset_m",
         ("m or more from the centreline for a Car",), "offset_m: -6"),
    Site("cars parked in the junction", (parked("offset_m: -9, from_m: 70"),), "offset_m",
         ("got a Car", "on a lane near"), "offset_m: -9"),
    Site("cars parked in a barrier", (parked("offset_m: 11, to_m: 100"),), "offset_m",
         ("overlaps another object",), "offset_m: 11, to_m: 100"),
    Site("cars parked beyond a road", (parked("offset_m: -9, from_m: 400"),), "from_m",
         ("got 400",), "from_m: 400"),
    Site("pedestrians parked",
         (("traffic:\n", parked("offset_m: -9")[1].replace("Car: 1", "Pedestrian: 1")),),
         "parked.0.class_shares", ("got Pedestrian", "no vehicle"), "Pedestrian"),
    Site("people on a lane", (people("offset_m: -6, to_m: 150"),), "offset_m",
         ("people on a lane",), "offset_m: -6"),
    Site("people across a road", (people("offset_m: -9, from_m: 70"),), "offset_m",
         ("people on a lane",), "offset_m: -9"),
    Site("people in a barrier", (people("offset_m: 11, to_m: 140"),), "offset_m",
         ("got an object in the way",), "offset_m: 11, to_m: 140"),
)  # fmt: skip
SENSORS = (
    Site("a sensor in the ground", (pole(-25, -12, -1),), "mounts.pole.z_m",
         ("got -1 below the ground", "-0.05"), "pole:"),
    Site("a sensor on the ground", (pole(-25, -12, -0.05),), "mounts.pole.z_m",
         ("got -0.05 below",), "pole:"),
    Site("a sensor between road and ground", (pole(-100, 0, -0.02),), "mounts.pole.z_m",
         ("below the ground or a road at 0 m",), "pole:"),
    Site("a sensor beside all ground, and below it", (pole(-400, 0, -3),), "mounts.pole.z_m",
         ("got -3 below",), "pole:"),
    Site("a sensor in an embankment", (NO_JUNCTION, NORTH,
         side_line(NORTH_LINE, f"    {EMBANKED}\n"), pole(12, 160, 3)),
         "mounts.pole.z_m", ("got 3 below", "4.6"), "pole:"),
    Site("a sensor in a bridge of 4 m", (NO_JUNCTION, NORTH,
         side_line(NORTH_LINE, "    elevation_m: 4\n"), pole(0, 160, 2)), "mounts.pole.z_m",
         ("got 2 below", "clearance of 4.5"), "pole:"),
    Site("a sensor in a house", (pole(60, 40, 6),), "mounts.pole.x_m", ("inside a building",),
         "pole:"),
    Site("a sensor on the wall of a house", (pole(45, 40, 6),), "mounts.pole.x_m",
         ("inside a building",), "pole:"),
    Site("a sensor in a barrier", (pole(-100, 11, 0.4),), "mounts.pole.x_m",
         ("inside a barrier of 'main'",), "pole:"),
    Site("a sensor in a gantry's leg", (pole(-140, 8, 3),), "mounts.pole.x_m",
         ("inside a gantry",), "pole:"),
    Site("a sensor in a gantry's beam", (pole(-140, 2, 6.5),), "mounts.pole.x_m",
         ("inside a gantry",), "pole:"),
    Site("a sensor on a lane", (pole(-25, -5.25, 2),), "mounts.pole.z_m",
         ("where vehicles hit the LiDAR", "expected 4.5 or more"), "pole:"),
    Site("a sensor where trucks pass", (pole(-25, -5.25, 4.4),), "mounts.pole.z_m",
         ("where vehicles hit the LiDAR",), "pole:"),
    Site("a sensor where vehicles turn", (pole(-7.5, -7.5, 3),), "mounts.pole.z_m",
         ("where vehicles hit the LiDAR",), "pole:"),
    Site("a sensor out of the world", (pole(1e9, -12, 6),), "mounts.pole.x_m",
         ("from every road and ground", "5000"), "pole:"),
    Site("a sensor 6 km away", (pole(-6300, -12, 6),), "mounts.pole.x_m", ("6000 m",), "pole:"),
    Site("a sensor 9 km up", (pole(-25, -12, 9000),), "mounts.pole.x_m", ("9000 m",), "pole:"),
)  # fmt: skip
TRAFFIC = (
    Site("pedestrians in lanes", ((SHARES, "{Car: 0.9, Pedestrian: 0.1}"),),
         "traffic.class_shares", ("got Pedestrian", "not simulated as traffic"), "Pedestrian"),
    Site("cyclists in lanes", ((SHARES, "{Cyclist: 1}"),), "traffic.class_shares",
         ("got Cyclist", "expected Car"), "Cyclist"),
    Site("buses wider than a lane", ((SHARES, "{Bus: 1}"), road(50, 150, 0, "line_m: 50"),
         ("lanes: {each_way: 1}", "lanes: {each_way: 1, width_m: 2.9}")),
         "class_shares", ("got Bus", "2.9 m"), "vehicles_per_km_lane"),
    Site("buses in a bend that they can't drive", (road(50, 150, 0, "radius_m: 8, turn_deg: 90"),),
         "class_shares", ("got Bus", "6.25 m"), "vehicles_per_km_lane"),
    Site("more buses than fit", ((SHARES, "{Bus: 1}"),
         ("vehicles_per_km_lane: 15", "vehicles_per_km_lane: 81")),
         "traffic.vehicles_per_km_lane", ("expected up to 80", "got 81"), "vehicles_per_km_lane"),
)  # fmt: skip
IMPOSSIBLE = (*ROADS, *JUNCTIONS, *PROFILES, *GROUNDS, *STANDING, *SENSORS, *TRAFFIC)

POSSIBLE = (
    Site("a roundabout", (*ONE_LANE, RING)),
    Site("a house on the island of a roundabout", (*ONE_LANE, RING, house(0, 0, SMALL))),
    Site("the town itself", ()),
    Site("a town on a hill of 15 %", (profile("[[-100, -15], [0, 0], [100, -15]]"),)),
    Site("a roundabout on a slope", (*ONE_LANE, RING, profile("[[-300, -30], [300, 30]]"))),
    Site("a bridge of 4.5 m", (NO_JUNCTION, side_keys("elevation_m: 4.5"))),
    Site("a road that ends 2 cm before another", (NO_JUNCTION, side_line("- {line_m: 192.48}"))),
    Site("a road 3 cm beside another", (road(50, 11.03, 0, "line_m: 100"),)),
    Site("a U of a road", (road(-250, 150, 0, "line_m: 50", "radius_m: 4, turn_deg: 180",
         "line_m: 50"), (SHARES, "{Car: 1}"))),
    Site("three quarters of a ring", (road(100, 150, 0, "radius_m: 40, turn_deg: 350"),)),
    Site("90 km of road with few vehicles", (road(0, 1000, 0, "line_m: 90000"),)),
    Site("a junction at 46 degrees", (side_start(-138.932, -143.868, 46),
         house(60, 100, SMALL))),
    Site("a wide bend in a junction",
         (side_line(pieces("line_m: 150", "radius_m: 200, turn_deg: 20", "line_m: 150")),)),
    Site("ground 1 mm below the footways", ((GROUND, "elevation_m: -0.011"),)),
    Site("a deck 4.5 m over a road", (more_ground(4.5),)),
    Site("a junction on an embankment",
         (side_keys("embankment: {foot_elevation_m: -3}"), (GROUND, "elevation_m: -3"))),
    Site("a house 10 cm beside the lanes", (house(-60, 7.6, SMALL),)),
    Site("a house 4.5 m over the lanes", (house(-60, 5, SMALL, base=4.5),)),
    Site("a barrier 10 cm beside the lanes", (("offset_m: 11", "offset_m: 7.25"),)),
    Site("a gantry just before the junction", (("s_m: 60", "s_m: 185"),)),
    Site("a sensor 1 cm over the ground", (pole(-25, -12, -0.04),)),
    Site("a sensor between the two directions", (pole(-100, 0, 1),)),
    Site("a sensor over a lane", (pole(-25, -5.25, 4.5),)),
    Site("a sensor at a lane's edge", (pole(-25, -7.01, 2),)),
    Site("a sensor on a roof", (pole(60, 40, 15.01),)),
    Site("a sensor 1 cm before a wall", (pole(44.99, 40, 6),)),
    Site("a sensor under a bridge", (NO_JUNCTION, side_keys("elevation_m: 4.5"), pole(0, -30, 2))),
    Site("people beside the lanes", (people("offset_m: -9, from_m: 70, to_m: 180"),)),
    Site("cars parked beside the lanes", (parked("offset_m: -8.6, from_m: 70, to_m: 180"),)),
    Site("cars parked head to the road",
         (parked("offset_m: -14, to_m: 150, turn_deg: 90, gap_m: 0.4"),)),
    Site("a sensor over a gantry", (pole(-140, 2, 7.01),)),
    Site("a sensor 4 km away", (pole(-4300, -12, 6),)),
    Site("no cyclists in lanes", ((SHARES, "{Car: 1, Cyclist: 0}"),)),
    Site("as many buses as fit", ((SHARES, "{Bus: 1}"),
         ("vehicles_per_km_lane: 15", "vehicles_per_km_lane: 80"))),
)  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """The answer of `infrasim check` about a site."""

    refused: bool
    # message without the path of the file and without the lines about the view of a mount
    message: str

    def is_right_for(self, site: Site) -> bool:
        if not site.key:
            return not self.refused and not self.message
        words = (f": {site.key}: expected ", ", got ", *site.words)
        placed = self.message.startswith(f"{site.line}:")
        return self.refused and placed and all(word in self.message for word in words)


def verdict_of(binary: Path, site: Site) -> Verdict:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.yaml"
        file.write_text(site.text)
        command = [binary, "check", file, *([] if site.key else ["--traffic"])]
        result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    notes = "infrasim: mount "  # start of the lines about the view of a mount
    lines = [line for line in result.stderr.splitlines() if not line.startswith(notes)]
    message = "\n".join(lines).strip().removeprefix(f"{file}:")
    return Verdict(result.returncode == 2, message)


def rows(binary: Path) -> Iterator[tuple[str, str, str, str]]:
    for sites, expected in ((IMPOSSIBLE, "refused"), (POSSIBLE, "allowed")):
        for site in sites:
            verdict = verdict_of(binary, site)
            right = ("wrong", "right")[verdict.is_right_for(site)]
            yield site.name, expected, right, verdict.message


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--binary", type=Path, default=Path(sys.executable).with_name("infrasim"))
    parser.add_argument("--out", type=Path, required=True, help="CSV")
    args = parser.parse_args()
    records = list(rows(args.binary))
    with args.out.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["site", "expected", "verdict", "message"])
        writer.writerows(records)
    for name, _, right, message in records:
        if right == "wrong":
            print(f"{name}: {message or 'allowed'}")
    print(f"{sum(row[2] == 'right' for row in records)} of {len(records)} verdicts are right")
    return int(any(row[2] == "wrong" for row in records))


if __name__ == "__main__":
    sys.exit(main())
