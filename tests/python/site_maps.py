"""Maps of whole sites in the imported formats. Each extends some hundred metres to every side."""

import itertools
import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import site_data

ARM_M = 300.0
LANE_M = 3.5


def t_junction(folder: Path, home: Path) -> Path:
    return _written(folder / "t.xodr", junction([0, 180, 270], 15))


def oblique(folder: Path, home: Path) -> Path:
    """Writes a map of two roads that cross at 50 degrees."""
    return _written(folder / "oblique.xodr", junction([0, 50, 180, 230], 30))


def hill(folder: Path, home: Path, grade: float = 0.06) -> Path:
    """Writes a map of a road of 700 m: level, then a grade over 250 m, then level again."""
    bend = grade / 200
    up = [(0, 0, 0, 0), (150, 0, 0, bend), (250, 50 * grade, grade, 0)]
    up += [(500, 300 * grade, grade, -bend), (600, 350 * grade, 0, 0)]
    elevation = "".join(f'<elevation s="{s}" a="{a}" b="{b}" c="{c}" d="0"/>' for s, a, b, c in up)
    road = site_data.road(1, (0, 0, 0), 700, elevation=elevation)
    return _written(folder / "hill.xodr", site_data.open_drive(road))


def roundabout(folder: Path, home: Path) -> Path:
    return site_data.roundabout(folder, home / "bin/netconvert", ARM_M)


def slip_road(folder: Path, home: Path) -> Path:
    """Writes a map of a motorway with two lanes each way. A slip road joins one carriageway."""
    osm = Osm(8.4, 49.0)
    west, merge, east = osm.node(-450, 0), osm.node(0, 0), osm.node(450, 0)
    main = {"highway": "motorway", "oneway": "yes", "lanes": "2", "maxspeed": "100"}
    osm.way([west, merge], **main)
    osm.way([merge, east], **{**main, "lanes": "3"})
    osm.way([osm.node(450, 18), osm.node(-450, 18)], **main)
    ramp = [osm.node(-400, -90), osm.node(-250, -70), osm.node(-120, -20), merge]
    osm.way(ramp, highway="motorway_link", oneway="yes", lanes="1", maxspeed="60")
    return _written(folder / "slip_road.osm", osm.text())


def district(folder: Path, home: Path) -> Path:
    return _written(folder / "district.osm", district_text())


def district_text(*, crossings: bool = False) -> str:
    """Returns a map of three streets in each direction, houses in four blocks, and rows of trees.

    crossings: whether pedestrian crossings of the middle junction are marked.
    """
    osm = Osm(8.4, 49.0)
    lines = (-100, 0, 100)
    corners = {(i, j): osm.node(x, y) for i, x in enumerate(lines) for j, y in enumerate(lines)}
    kind = {"highway": "residential", "maxspeed": "30"}
    for k, at in enumerate(lines):
        row, column = [corners[i, k] for i in range(3)], [corners[k, i] for i in range(3)]
        osm.way([osm.node(-ARM_M, at), *row, osm.node(ARM_M, at)], **kind)
        osm.way([osm.node(at, -ARM_M), *column, osm.node(at, ARM_M)], **kind)
    for number, (x, y) in enumerate(itertools.product((-85, -50, 15, 50), repeat=2)):
        osm.house([(x, y), (x + 22, y), (x + 22, y + 22), (x + 10, y + 22), (x + 10, y + 12),
                   (x, y + 12)], **({"building__levels": str(2 + number % 3)}))  # fmt: skip
    for x in (-70, -40, 30, 60):
        osm.node(x, 8, natural="tree", height="7")
    for x, y in ((-9, 0), (9, 0), (0, -9), (0, 9)) if crossings else ():
        osm.node(x, y, highway="crossing", crossing="marked")
    return osm.text()


def netgenerate(folder: Path, home: Path) -> Path:
    """Makes a random network with SUMO's program netgenerate."""
    out = folder / "random.net.xml"
    words = ["--rand", "--rand.iterations", "40", "--seed", "7", "--rand.min-distance", "90"]
    words += ["--rand.max-distance", "200", "--rand.min-angle", "45", "--default.lanenumber", "2"]
    words += ["--tls.guess", "true", "-o", str(out)]
    subprocess.run([home / "bin/netgenerate", *words], check=True, capture_output=True)
    return out


MAPS: dict[str, Callable[[Path, Path], Path]] = {
    "t_junction": t_junction,
    "roundabout": roundabout,
    "oblique": oblique,
    "hill": hill,
    "slip_road": slip_road,
    "district": district,
    "netgenerate": netgenerate,
}


def _written(file: Path, text: str) -> Path:
    file.write_text(text)
    return file


def junction(arms_deg: list[float], radius_m: float) -> str:
    """Returns an OpenDRIVE map of roads that meet in one junction. Each turn is a connecting road
    with one lane. radius_m: distance from the middle to the start of the arms."""
    roads, connections = [], []
    link = '<link><predecessor elementType="junction" elementId="9"/></link>'
    for k, arm in enumerate(arms_deg, start=1):
        a = math.radians(arm)
        pose = (radius_m * math.cos(a), radius_m * math.sin(a), a)
        roads.append(site_data.road(k, pose, ARM_M, more=link))
    for number, (i, j) in enumerate(itertools.permutations(range(len(arms_deg)), 2), start=100):
        a, b = (math.radians(arms_deg[k]) for k in (i, j))
        roads.append(_turn(number, (i + 1, a), (j + 1, b), radius_m))
        connections.append(
            f'<connection id="{number}" incomingRoad="{i + 1}" connectingRoad="{number}" '
            'contactPoint="start"><laneLink from="1" to="-1"/></connection>'
        )
    middle = f'<junction id="9" name="">{"".join(connections)}</junction>'
    return site_data.open_drive(*roads, middle)


def _turn(number: int, origin: tuple[int, float], goal: tuple[int, float], radius_m: float) -> str:
    """Returns a cubic from the start of one arm to that of another. At both ends it has the
    direction of the arm."""
    (i, a), (j, b) = origin, goal
    heading = a + math.pi
    cos, sin = math.cos(heading), math.sin(heading)
    start = radius_m * np.array([math.cos(a), math.sin(a)])
    way = radius_m * np.array([math.cos(b), math.sin(b)]) - start
    turn = np.array([[cos, sin], [-sin, cos]])
    reach = turn @ way
    speed = 1.2 * float(np.hypot(*reach))
    out = speed * (turn @ np.array([math.cos(b), math.sin(b)]))
    into = np.array([speed, 0.0])
    second, third = 3 * reach - 2 * into - out, into + out - 2 * reach
    p = np.linspace(0, 1, 2001)[:, None]
    line = into * p + second * p**2 + third * p**3
    length = float(np.hypot(*np.diff(line, axis=0).T).sum())
    cubic = "".join(
        f'{k}{axis}="{value!r}" '
        for k, row in zip("bcd", (into, second, third), strict=True)
        for axis, value in zip("UV", row.tolist(), strict=True)
    )
    link = (
        f'<link><predecessor elementType="road" elementId="{i}" contactPoint="start"/>'
        f'<successor elementType="road" elementId="{j}" contactPoint="start"/></link>'
    )
    lane = (
        '<lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>'
        '<lane id="-1" type="driving"><link><predecessor id="1"/><successor id="-1"/></link>'
        f'<width sOffset="0" a="{LANE_M}" b="0" c="0" d="0"/></lane></right></laneSection></lanes>'
    )
    return site_data.road(
        number,
        (*start.tolist(), heading),
        length,
        shape=f'<paramPoly3 pRange="normalized" aU="0" aV="0" {cubic}/>',
        lanes=lane,
        more=link,
        junction=9,
    )


class Osm:
    """Collects the elements of an OpenStreetMap file. Positions are in metres around lon, lat."""

    def __init__(self, lon: float, lat: float) -> None:
        self.lon, self.lat = lon, lat
        self.nodes: list[str] = []
        self.ways: list[str] = []

    def node(self, east: float, north: float, **tags: str) -> int:
        east_m = 111_320 * math.cos(math.radians(self.lat))
        lon, lat = self.lon + east / east_m, self.lat + north / 111_200
        number = len(self.nodes) + 1
        self.nodes.append(f'<node id="{number}" lon="{lon!r}" lat="{lat!r}">{_tags(tags)}</node>')
        return number

    def way(self, nodes: list[int], **tags: str) -> None:
        inner = "".join(f'<nd ref="{i}"/>' for i in nodes)
        self.ways.append(f'<way id="{len(self.ways) + 1}">{inner}{_tags(tags)}</way>')

    def house(self, corners: list[tuple[float, float]], **tags: str) -> None:
        nodes = [self.node(*corner) for corner in corners]
        self.way([*nodes, nodes[0]], building="yes", **tags)

    def text(self) -> str:
        inner = "".join([*self.nodes, *self.ways])
        return f'<?xml version="1.0"?><osm version="0.6">{inner}</osm>'


def _tags(tags: dict[str, str]) -> str:
    return "".join(f'<tag k="{k.replace("__", ":")}" v="{v}"/>' for k, v in tags.items())
