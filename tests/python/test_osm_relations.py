"""Buildings with courtyards, lanes for buses and turns, and sidewalks of left-hand traffic."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import shapely
from site_maps import Osm

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import MapBody, SiteMap
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.network import read_network
from pyinfra.scenes.maps.openstreetmap import Multipolygon, StreetMap, read_street_map
from pyinfra.scenes.maps.osm_buildings import add_surroundings
from pyinfra.scenes.maps.osm_relations import with_holes
from pyinfra.scenes.maps.surfaces import Sheet, body, contains, ears

CENTRE = (8.4, 49.0)


def star(random: np.random.Generator, at: tuple[float, float], low: float, high: float, n: int):
    """Returns an outline (n, 2) that does not cross itself."""
    angle = np.sort(random.uniform(0, 2 * np.pi, n))
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False) + 0.3 * (angle - angle.mean()) / n
    radius = random.uniform(low, high, n)
    return np.array(at) + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)


@pytest.mark.parametrize("seed", range(20))
def test_holes_are_cut_out_of_the_roof(seed: int) -> None:
    """Area of the triangles and points inside, compared with shapely."""
    random = np.random.default_rng(seed)
    outline = star(random, (0, 0), 22, 40, random.integers(5, 30))
    places = [(-9.0, 0.0), (9.0, 1.0), (0.0, 11.0)][: random.integers(1, 4)]
    holes = [star(random, place, 1, 5, random.integers(3, 15)) for place in places]
    turned = [hole[:: random.choice([1, -1])] for hole in holes]
    cut = with_holes(outline[:: random.choice([1, -1])], turned)
    polygon = shapely.Polygon(outline, holes)
    assert polygon.is_valid
    corners = cut[ears(cut)]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2 == pytest.approx(polygon.area)
    points = random.uniform(-45, 45, (500, 2))
    assert np.array_equal(contains(cut, points), shapely.contains_xy(polygon, *points.T))


def mapped(polygons: list[Multipolygon], ways: dict[str, FloatArray]) -> SiteMap:
    """Returns the surroundings of multipolygons whose ways (n, 2) are given in metres."""
    map_ = StreetMap(multipolygons=polygons)
    names: dict[tuple[float, float], str] = {}
    for way, corners in ways.items():
        ids = [names.setdefault((x, y), str(len(names))) for x, y in corners.tolist()]
        map_.outlines[way] = ids
    scale = 111_320.0
    for (x, y), name in names.items():
        east = CENTRE[0] + x / scale / np.cos(np.radians(CENTRE[1]))
        map_.nodes[name] = (float(east), CENTRE[1] + y / scale)
    site = SiteMap()
    add_surroundings(site, map_, CENTRE, 500)
    return site


def square(half: float, x: float = 0.0) -> FloatArray:
    corners = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
    return corners + np.array([x, 0.0])


def test_a_building_with_a_courtyard() -> None:
    """The outline is of two ways, of which one runs the other way round."""
    tags = {"building": "yes", "height": "12", "type": "multipolygon"}
    members = [("1", "outer"), ("2", "outer"), ("3", "inner")]
    outer = square(20)
    ways = {"1": outer[:3], "2": outer[:1:-1], "3": square(8)}
    site = mapped([Multipolygon("9", members, tags)], ways)
    (block,) = site.bodies
    assert (block.name, block.height_m) == ("relation 9: building", 12)
    inside = contains(block.outline, np.array([[15.0, 0], [0, 0], [-15, 10], [7, 7], [25, 0]]))
    assert inside.tolist() == [True, False, True, False, False]
    ground = Sheet(np.array([[-50.0, -50, 0], [50, 50, 0]]), 4.0, 4.0, 0.0)
    mesh = body(block, ground)
    top = mesh.vertices[mesh.faces][(mesh.vertices[mesh.faces][..., 2] > 11).all(1)]
    assert not any(contains(corners[:, :2], np.zeros((1, 2)))[0] for corners in top)


def test_a_building_of_several_outlines_is_several_bodies() -> None:
    tags = {"building": "yes", "height": "9"}
    members = [("1", "outer"), ("2", "outer"), ("3", "inner")]
    ways = {"1": square(10), "2": square(10, 60), "3": square(4, 60)}
    one, two = mapped([Multipolygon("9", members, tags)], ways).bodies
    assert contains(one.outline, np.zeros((1, 2)))[0]
    assert not contains(two.outline, np.array([[60.0, 0]]))[0]
    assert contains(two.outline, np.array([[67.0, 0]]))[0]


def test_an_incomplete_building_is_named() -> None:
    broken = Multipolygon("9", [("1", "outer"), ("7", "outer")], {"building": "yes"})
    site = mapped([broken], {"1": square(20)[:3]})
    assert site.bodies == []
    assert site.not_understood == ["relation 9: building without a closed outline, left out"]


def test_a_way_of_a_multipolygon_is_no_second_building() -> None:
    polygon = Multipolygon("9", [("1", "outer")], {"building": "yes"})
    map_ = StreetMap(multipolygons=[polygon])
    map_.houses.append(("1", ["a", "b", "c"], {"building": "yes"}))
    map_.outlines["1"] = ["a", "b", "c", "a"]
    map_.nodes |= {"a": CENTRE, "b": (8.4002, 49.0), "c": (8.4002, 49.0001)}
    site = SiteMap()
    add_surroundings(site, map_, CENTRE, 500)
    assert [thing.name for thing in site.bodies] == ["relation 9: building"]


def read(osm: Osm, relations: str, folder: Path) -> SiteMap:
    """Returns the surroundings of a street, the ways of `osm`, and relations in XML."""
    osm.way([osm.node(-100, -90), osm.node(100, -90)], highway="residential")
    file = folder / "a.osm"
    file.write_text(osm.text().replace("</osm>", f"{relations}</osm>"))
    site = SiteMap()
    add_surroundings(site, read_street_map(file), CENTRE, 500)
    return site


def relation(members: list[tuple[str, int, str]], **tags: str) -> str:
    inner = "".join(f'<member type="{m[0]}" ref="{m[1]}" role="{m[2]}"/>' for m in members)
    words = "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
    return f'<relation id="9">{inner}{words}</relation>'


def ring(osm: Osm, half: float, **tags: str) -> None:
    nodes = [osm.node(x, y) for x, y in square(half)[:-1].tolist()]
    osm.way([*nodes, nodes[0]], **tags)


def test_a_building_in_a_courtyard_is_built(tmp_path: Path) -> None:
    """Its way is both the inner outline of a multipolygon and a building of its own."""
    osm = Osm(*CENTRE)
    ring(osm, 20)
    ring(osm, 8, building="yes", height="25")
    tags = {"type": "multipolygon", "building": "yes", "height": "9"}
    site = read(osm, relation([("way", 1, "outer"), ("way", 2, "inner")], **tags), tmp_path)
    heights = {thing.name: thing.height_m for thing in site.bodies}
    assert heights == {"way 2: building": 25, "relation 9: building": 9}
    assert site.not_understood == []


@pytest.mark.parametrize(
    ("tags", "name", "height_m"),
    [
        ({"building": "yes", "height": "25"}, "way 1: building", 25),
        ({}, "relation 9: building", 9),
    ],
)
def test_a_relation_of_type_building_is_its_outline(
    tags: dict[str, str], name: str, height_m: float, tmp_path: Path
) -> None:
    osm = Osm(*CENTRE)
    ring(osm, 20, **tags)
    ring(osm, 8, building__part="yes", height="30")
    of_relation = {"type": "building", "building": "yes", "height": "9"}
    members = [("way", 1, "outline"), ("way", 2, "part")]
    site = read(osm, relation(members, **of_relation), tmp_path)
    assert [(thing.name, thing.height_m) for thing in site.bodies] == [(name, height_m)]
    assert site.not_understood == []


def test_members_that_are_no_ways_hide_no_building(tmp_path: Path) -> None:
    """Nodes and relations have ids of their own, which may equal that of a way."""
    osm = Osm(*CENTRE)
    ring(osm, 20, building="yes")
    ring(osm, 30)
    tags = {"type": "multipolygon", "building": "yes"}
    members = [("way", 2, "outer"), ("node", 1, ""), ("relation", 1, "outer")]
    site = read(osm, relation(members, **tags), tmp_path)
    assert [thing.name for thing in site.bodies] == ["way 1: building", "relation 9: building"]
    assert site.not_understood == []


def street(
    folder: Path,
    tags: dict[str, str],
    side: Literal["left", "right"] | None = None,
    crossed: bool = False,
):
    """Imports a street along x; returns the folder of the site and the notes.

    crossed: whether another street crosses it, so that netconvert splits it.
    """
    osm = Osm(*CENTRE)
    nodes = [osm.node(-100, 0), osm.node(100, 0)]
    if crossed:
        nodes.insert(1, osm.node(0, 0))
        osm.way([osm.node(0, -100), nodes[1], osm.node(0, 100)], highway="residential", lanes="2")
    osm.way(nodes, **{"highway": "residential", **tags})
    folder.mkdir(exist_ok=True)
    (folder / "a.osm").write_text(osm.text())
    options = ImportOptions(CENTRE, 300, traffic_side=side)
    record = import_map(folder / "a.osm", folder / "site", options)
    return folder / "site", [note for note in record["not_understood"] if note.startswith("way")]


@pytest.mark.parametrize(
    ("tags", "words"),
    [
        ({}, ""),
        ({"lanes": "2"}, ""),
        ({"lanes": "2", "oneway": "yes"}, ""),
        ({"lanes": "1", "oneway": "yes", "busway__left": "opposite_lane"}, ""),
        ({"lanes": "1"}, "one lane for both directions"),
        (
            {"lanes": "3", "lanes__forward": "1", "lanes__backward": "1", "lanes__both_ways": "1"},
            "a lane for turns from both directions",
        ),
        (
            {"lanes": "2", "oneway": "yes", "lanes__forward": "1", "lanes__backward": "1"}
            | {"lanes__bus__backward": "1", "oneway__bus": "no"},
            "lanes: 2 in the map, 3 in the network",
        ),
        (
            {"lanes": "3", "lanes__forward": "2", "lanes__psv__forward": "1"},
            "a bus lane (lanes:psv",
        ),
        ({"lanes": "4", "bus__lanes__forward": "designated|"}, "a bus lane (bus:lanes:forward)"),
    ],
)
@pytest.mark.parametrize("crossed", [False, True])
def test_lanes_that_the_network_has_otherwise_are_named(
    tags: dict[str, str], words: str, crossed: bool, tmp_path: Path
) -> None:
    pytest.importorskip("sumo", reason="needs the extra `site`")
    _, notes = street(tmp_path, tags, crossed=crossed)
    assert len(notes) == bool(words), notes
    assert all(words in note for note in notes)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("tags", "sides"),
    [
        ({"sidewalk": "right"}, {-1}),
        ({"sidewalk": "left"}, {1}),
        ({"sidewalk__left": "yes", "sidewalk__right": "no"}, {1}),
        ({"sidewalk": "both"}, {-1, 1}),
        ({"sidewalk": "no"}, set()),
    ],
)
def test_a_sidewalk_is_on_its_side_of_the_street(
    tags: dict[str, str], sides: set[int], side: Literal["left", "right"], tmp_path: Path
) -> None:
    """The way runs east, so its left is north, on whichever side vehicles drive."""
    pytest.importorskip("sumo", reason="needs the extra `site`")
    site, _ = street(tmp_path, {"maxspeed": "50", **tags}, side)
    lanes = [x for x in read_network(site / "map.net.xml").lanes if not x.name.startswith("lane__")]
    walks = [x.centre[:, 1].mean() for x in lanes if x.kind == "sidewalk"]
    assert {int(np.sign(y)) for y in walks} == sides
    east = [x.centre[:, 1].mean() for x in lanes if x.kind == "road" and x.centre[-1, 0] > 0]
    assert np.sign(np.mean(east)) == (1 if side == "left" else -1)


def test_bodies_without_holes_are_unchanged() -> None:
    outline = square(5)[:-1]
    assert np.array_equal(with_holes(outline, []), outline)
    assert MapBody(outline, 3.0).height_m == 3
