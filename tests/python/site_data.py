"""Small maps that the tests of sites write: OpenDRIVE, OpenStreetMap, a SUMO network."""

import math
import subprocess
from pathlib import Path

LANES = """<lanes><laneSection s="0"><left>
<lane id="3" type="sidewalk"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
<lane id="2" type="shoulder"><width sOffset="0" a="0.5" b="0" c="0" d="0"/></lane>
<lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
</left><center><lane id="0" type="none"/></center><right>
<lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
<lane id="-2" type="shoulder"><width sOffset="0" a="0.5" b="0" c="0" d="0"/></lane>
<lane id="-3" type="sidewalk"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
</right></laneSection></lanes>"""
HOUSE = (
    '<objects><object id="7" type="building" s="60" t="20" hdg="0" zOffset="0" length="12" '
    'width="8" height="9"/><object id="8" type="tree" s="80" t="-10" height="7"/>'
    '<object id="9" type="fountain" s="90" t="30" height="2"/></objects>'
)


def road(
    number: int,
    pose: tuple[float, float, float],
    length: float,
    *,
    shape: str = "<line/>",
    elevation: str = "",
    lanes: str = LANES,
    more: str = "",
    junction: int = -1,
) -> str:
    """Returns an OpenDRIVE road with one geometry."""
    x, y, heading = pose
    return (
        f'<road id="{number}" length="{length}" junction="{junction}"><planView><geometry s="0" '
        f'x="{x}" y="{y}" hdg="{heading}" length="{length}">{shape}</geometry></planView>'
        f"<elevationProfile>{elevation}</elevationProfile>{lanes}{more}</road>"
    )


def open_drive(*roads: str) -> str:
    """Returns a complete OpenDRIVE map."""
    head = '<header revMajor="1" revMinor="6" north="0" south="0" east="0" west="0"/>'
    return f"<?xml version='1.0'?><OpenDRIVE>{head}{''.join(roads)}</OpenDRIVE>"


def straight() -> str:
    """Returns a map with a straight road of 200 m to the east, a house and a tree. The road begins
    far from the origin."""
    return open_drive(road(1, (1000, 2000, 0), 200, more=HOUSE))


def hill() -> str:
    """Returns a road of cubics: level, up to a grade of 6 %, and level again. A bend with a radius
    of 30 m follows."""
    rise = (
        '<elevation s="0" a="3" b="0" c="0.0003" d="0"/>'
        '<elevation s="100" a="6" b="0.06" c="0" d="0"/>'
        '<elevation s="200" a="12" b="0.06" c="-0.0003" d="0"/>'
    )
    bend = road(2, (300, 0, 0), 45, shape='<arc curvature="0.0333333333"/>',
                elevation='<elevation s="0" a="15" b="0" c="0" d="0"/>')  # fmt: skip
    return open_drive(road(1, (0, 0, 0), 300, elevation=rise), bend)


def roundabout(folder: Path, netconvert: Path, reach_m: float = 120) -> Path:
    """Builds a network with nodes and edges: a ring with a radius of 20 m, and four arms."""
    nodes, edges = [], []
    for k in range(4):
        x, y = (round(math.cos(k * math.pi / 2)), round(math.sin(k * math.pi / 2)))
        nodes += [f'<node id="r{k}" x="{20 * x}" y="{20 * y}"/>']
        nodes += [f'<node id="a{k}" x="{reach_m * x}" y="{reach_m * y}"/>']
        arc = [k * math.pi / 2 + i * math.pi / 16 for i in range(9)]
        shape = " ".join(f"{20 * math.cos(a):.2f},{20 * math.sin(a):.2f}" for a in arc)
        edges += [f'<edge id="ring{k}" from="r{k}" to="r{(k + 1) % 4}" shape="{shape}"/>']
        edges += [f'<edge id="in{k}" from="a{k}" to="r{k}"/>']
        edges += [f'<edge id="out{k}" from="r{k}" to="a{k}"/>']
    (folder / "n.nod.xml").write_text(f"<nodes>{''.join(nodes)}</nodes>")
    (folder / "e.edg.xml").write_text(f"<edges>{''.join(edges)}</edges>")
    out = folder / "ring.net.xml"
    command: list[str | Path] = [
        netconvert,
        "-n",
        folder / "n.nod.xml",
        "-e",
        folder / "e.edg.xml",
        "-o",
        out,
    ]
    subprocess.run(command, check=True, capture_output=True)
    return out


def district() -> str:
    """Returns a map of two crossing streets, four houses and a tree. One of the houses has a
    height."""
    lon, lat = 8.4, 49.0
    nodes, ways = [], []

    def node(number: int, east: float, north: float, tags: str = "") -> int:
        at = (lon + east / 73_200, lat + north / 111_200)
        nodes.append(f'<node id="{number}" lon="{at[0]!r}" lat="{at[1]!r}">{tags}</node>')
        return number

    def way(number: int, ids: list[int], **tags: str) -> None:
        inner = "".join(f'<nd ref="{i}"/>' for i in ids)
        inner += "".join(f'<tag k="{k.replace("__", ":")}" v="{v}"/>' for k, v in tags.items())
        ways.append(f'<way id="{number}">{inner}</way>')

    middle = node(1, 0, 0)
    ends = [node(2, -150, 0), node(3, 150, 0), node(4, 0, -150), node(5, 0, 150)]
    way(10, [ends[0], middle, ends[1]], highway="residential", name="Long Street")
    way(11, [ends[2], middle, ends[3]], highway="residential")
    for k, (x, y) in enumerate([(30, 30), (-50, 30), (-50, -45), (30, -45)]):
        corners = [(0, 0), (20, 0), (20, 10), (10, 10), (10, 15), (0, 15)]
        ids = [node(100 + 10 * k + i, x + a, y + b) for i, (a, b) in enumerate(corners)]
        more = {"height": "12 m"} if k == 0 else {"building__levels": "3"} if k == 1 else {}
        way(20 + k, [*ids, ids[0]], building="yes", **more)
    node(200, 40, -12, '<tag k="natural" v="tree"/>')
    return f'<?xml version="1.0"?><osm version="0.6">{"".join(nodes)}{"".join(ways)}</osm>'
