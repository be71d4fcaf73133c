"""Stops, crossings, signals and sidewalks of a map are listed and drawn with their kind."""

from pathlib import Path

import numpy as np
import pytest
import site_data
import yaml
from conftest import Infrasim
from matplotlib.colors import to_hex
from site_maps import Osm

from pyinfra.cli.main import main
from pyinfra.core.errors import FormatError
from pyinfra.formats.ply import read_ply
from pyinfra.scenes.maps import site_folder
from pyinfra.scenes.maps.lane_map import MapError
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.opendrive import read_opendrive
from pyinfra.scenes.maps.osm_features import sides_without
from pyinfra.scenes.maps.sumo import sumo_folder
from pyinfra.viz.site_plan import MARKERS, plan

pytest.importorskip("sumo", reason="needs the extra `site`")

CENTRE = (8.4, 49.0)
NODES: list[tuple[str, dict[str, str]]] = [
    ("bus_stop", {"highway": "bus_stop", "name": "Town Hall"}),
    ("bus_stop", {"public_transport": "platform", "bus": "yes"}),
    ("platform", {"public_transport": "platform", "tram": "yes"}),
    ("stop_position", {"public_transport": "stop_position"}),
    ("crossing", {"highway": "crossing", "crossing": "zebra"}),
    ("level_crossing", {"railway": "level_crossing"}),
    ("traffic_signals", {"highway": "traffic_signals"}),
    ("give_way", {"highway": "give_way"}),
    ("stop", {"highway": "stop"}),
    ("street_lamp", {"highway": "street_lamp"}),
    ("traffic_sign", {"traffic_sign": "DE:274-30"}),
]


def street(tags: dict[str, str], *, then: tuple[dict[str, str], ...] = ()) -> Osm:
    """Returns a road of two lanes along x with a length of 400 m, and nodes beside it."""
    osm = Osm(*CENTRE)
    ends = [osm.node(x, 0) for x in (-200, 0, 200)]
    osm.way(ends, **{"highway": "residential", "lanes": "2", **tags})
    for k, more in enumerate(then):
        osm.node(-100 + 20 * k, 6, **{key.replace(":", "__"): v for key, v in more.items()})
    return osm


def imported(folder: Path, osm: Osm) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "a.osm").write_text(osm.text())
    import_map(folder / "a.osm", folder / "s", ImportOptions(CENTRE, 300))
    return folder / "s"


def test_what_stands_at_streets_is_listed_and_drawn_where_it_is(tmp_path: Path) -> None:
    site = imported(tmp_path, street({}, then=tuple(tags for _, tags in NODES)))
    listed = yaml.safe_load((site / "map.yaml").read_text())["features"]
    for k, (kind, tags) in enumerate(NODES):
        one = next(row for row in listed[kind] if row["id"] == f"node {k + 4}")
        assert (one["x_m"], one["y_m"]) == pytest.approx((-100 + 20 * k, 6), abs=0.3)
        assert one.get("name") == tags.get("name")
    assert sum(map(len, listed.values())) == len(NODES)
    figure = plan(site)
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {kind.replace("_", " ") for kind in listed} <= names
    assert {"N", "100 m"} <= {text.get_text().strip() for text in figure.axes[0].texts}
    drawn = [line for line in figure.axes[0].lines if line.get_linestyle() == "None"]
    for kind, positions in site_folder.features(site).items():
        look = MARKERS.get(kind, (".", "#555555"))
        assert any(
            np.array_equal(np.asarray(line.get_xydata()), positions)
            and (line.get_marker(), to_hex(line.get_color())) == (look[0], look[1].lower())
            for line in drawn
        ), kind


def test_an_import_prints_what_it_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.osm").write_text(street({}, then=({"highway": "bus_stop"},) * 2).text())
    assert main(["site", "import", str(tmp_path / "a.osm"), "--out", str(tmp_path / "s")]) == 0
    assert "features: 2 bus_stop (map.yaml)" in capsys.readouterr().out


def test_what_lies_beyond_the_radius_is_not_listed(tmp_path: Path) -> None:
    osm = street({})
    osm.node(0, 310, highway="bus_stop")
    assert yaml.safe_load((imported(tmp_path, osm) / "map.yaml").read_text())["features"] == {}


@pytest.mark.parametrize(
    ("tags", "north", "south"),  # the road leads to the east, so its right side is south
    [
        ({}, True, True),
        ({"sidewalk": "both"}, True, True),
        ({"sidewalk": "both", "maxspeed": "70"}, True, True),
        ({"maxspeed": "70"}, False, False),
        ({"sidewalk": "separate"}, False, False),
        ({"sidewalk": "no"}, False, False),
        ({"sidewalk": "none"}, False, False),
        ({"sidewalk": "left"}, True, False),
        ({"sidewalk": "right"}, False, True),
        ({"sidewalk__both": "separate"}, False, False),
        ({"sidewalk__left": "separate"}, False, True),
        ({"sidewalk__left": "separate", "sidewalk__right": "no"}, False, False),
    ],
)
def test_sidewalks_are_where_the_map_says(
    tmp_path: Path, tags: dict[str, str], north: bool, south: bool
) -> None:
    """If a sidewalk is also a separate way in the map, only that way is built."""
    osm = street(tags)
    osm.way([osm.node(-200, 9), osm.node(200, 9)], highway="footway", footway="sidewalk")
    site = imported(tmp_path, osm)
    mesh = read_ply(site / "meshes/sidewalk.ply")
    y = mesh.vertices[mesh.faces].mean(1)
    y = y[np.abs(y[:, 0]) > 20, 1]
    apart, up, down = ((y > 8).any(), ((y > 3) & (y < 6)).any(), ((y < -3) & (y > -6)).any())
    assert (apart, up, down) == (True, north, south)
    separate = (
        "separate" in sides_without({k.replace("__", ":"): v for k, v in tags.items()}).values()
    )
    listed = yaml.safe_load((site / "map.yaml").read_text())["features"]
    assert ("separate_sidewalk" in listed) == separate


def test_a_way_that_crosses_a_street_lies_on_it(tmp_path: Path) -> None:
    """This is also true if the map has no common node. The crossing is not a kerb across the
    lanes."""
    osm = street({"sidewalk": "separate"})
    osm.way([osm.node(60, -9), osm.node(60, 9)], highway="footway", footway="crossing")
    site = imported(tmp_path, osm)
    listed = yaml.safe_load((site / "map.yaml").read_text())["features"]
    assert [row["id"] for row in listed["crossing"]] == ["way 2"]
    vertices = read_ply(site / "meshes/sidewalk.ply").vertices
    on_road = (np.abs(vertices[:, 0] - 60) < 3) & (np.abs(vertices[:, 1]) < 3.2)
    assert on_road.any()
    assert np.abs(vertices[on_road, 2]).max() < 0.01


def test_many_ways_without_sidewalks_fit(tmp_path: Path) -> None:
    """The names of the edges are longer than the maximum length of a command-line argument (128
    KiB)."""
    osm = street({"sidewalk": "no"})
    for _ in range(6000):
        osm.ways.append(
            f'<way id="{10**9 + len(osm.ways)}"><nd ref="1"/><nd ref="1"/>'
            '<tag k="highway" v="residential"/><tag k="sidewalk" v="no"/></way>'
        )
    assert (imported(tmp_path, osm) / "lanes.csv").exists()


def test_crosswalks_signals_and_marks_of_opendrive_are_listed(tmp_path: Path) -> None:
    more = (
        '<objects><object id="1" type="crosswalk" s="40" t="0" length="3" width="7"/>'
        '<object id="2" name="Solid_Line" type="none" s="10" t="0"/>'
        '<object id="3" name="dashed" type="roadMark" s="20" t="0"/></objects>'
        "<signals>"
        '<signal id="4" orientation="+" dynamic="yes" type="1000001" s="50" t="5" height="1"/>'
        '<signal id="5" orientation="+" dynamic="no" type="7" s="60" t="-5" height="1"/></signals>'
    )
    file = tmp_path / "a.xodr"
    file.write_text(site_data.open_drive(site_data.road(1, (0, 0, 0), 100, more=more)))
    site_map = read_opendrive(file)
    assert [(f.kind, f.source, f.x_m, f.y_m) for f in site_map.features] == [
        ("crossing", "road 1: object 1", 40, 0),
        ("traffic_signals", "road 1: signal 4", 50, 5),
        ("traffic_sign", "road 1: signal 5", 60, -5),
    ]
    assert site_map.not_understood == ["road 1: 2 objects of road marks: left out"]
    assert len(site_map.bodies) == 2  # the posts of the signals
    import_map(file, tmp_path / "s")
    record = yaml.safe_load((tmp_path / "s/map.yaml").read_text())
    x, y, _ = record["offset_m"]
    assert record["features"]["crossing"] == [{"id": "road 1: object 1", "x_m": 40 - x, "y_m": -y}]


def test_crossings_of_a_network_are_listed(tmp_path: Path) -> None:
    net = site_data.roundabout(tmp_path, sumo_folder() / "bin/netconvert")
    edge = (
        '<edge id=":r0_c0" function="crossing"><lane id=":r0_c0_0" index="0" speed="1" '
        'length="6" width="4" shape="30,-3 30,3"/></edge>'
    )
    net.write_text(net.read_text().replace("<junction", f"{edge}<junction", 1))
    from pyinfra.scenes.maps.network import read_network

    crossing = read_network(net).features[0]
    assert (crossing.kind, crossing.x_m, crossing.y_m) == ("crossing", 30, 0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("features: 3", "features: expected kinds with positions, got 3"),
        ("features: {bus_stop: [{x_m: a}]}", "bus_stop: expected a list of positions with the key"),
        ("features: {a: 1}", "features: a: expected a list of positions with the keys"),
    ],
)
def test_a_broken_list_of_features_is_named(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(FormatError, match=rf"map\.yaml: .*{expected}"):
        site_folder.features(tmp_path)


def test_trees_leave_the_space_over_lanes_free(tmp_path: Path, infrasim: Infrasim) -> None:
    """Street trees are near the lanes. The scene would refuse a crown over a lane."""
    osm = street({})
    for x, y in ((-60, 1.0), (-20, 4.2), (20, -5.5), (60, 12.0)):
        osm.node(x, y, natural="tree", height="8")
    site = imported(tmp_path, osm)
    plants = [one["tree"] for one in yaml.safe_load((site / "site.yaml").read_text())["vegetation"]]
    trunks = {round(tree["x_m"]): tree["trunk_m"] for tree in plants}
    assert set(trunks) == {-20, 20, 60}  # the tree on the lane is left out
    assert min(trunks[-20], trunks[20]) > 4.5
    assert trunks[60] < 3
    mended = yaml.safe_load((site / "map.yaml").read_text())["mended"]
    assert any(text.startswith("tree at ") for text in mended)
    assert any(text.startswith("crowns raised") and text.endswith(": 2") for text in mended)
    done = infrasim("check", site / "site.yaml")
    assert done.returncode == 0, done.stderr


def test_a_centre_beside_the_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.osm").write_text(street({}).text())
    with pytest.raises(MapError, match=r"a.osm: `centre`: expected longitude 8.3.* got 8.5, 49"):
        import_map(tmp_path / "a.osm", tmp_path / "s", ImportOptions((8.5, 49.0), 300))
