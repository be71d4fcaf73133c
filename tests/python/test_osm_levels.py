"""Roads at several levels in OpenStreetMap, and files as editors and servers write them."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from site_maps import Osm, district_text

from pyinfra.formats.ply import read_ply
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.openstreetmap import read_street_map
from pyinfra.scenes.maps.osm_levels import Levels, find_levels
from pyinfra.scenes.maps.ramps import CLEARANCE_M
from pyinfra.viz.site_plan import read_lanes

pytest.importorskip("sumo", reason="needs the extra `site`")

CENTRE = (8.4, 49.0)
BRIDGE = {"bridge": "yes", "layer": "1"}


def crossroads(
    tags: dict[str, str], *, arm_m: float = 300.0, half_m: float = 60.0, under: str = "0"
) -> str:
    """Returns a road to the north that crosses a road to the east without a common node. The tags
    are on the middle part of the first road."""
    osm = Osm(*CENTRE)
    main = {"highway": "primary", "lanes": "2"}
    west, east = osm.node(-arm_m, 0), osm.node(arm_m, 0)
    osm.way([west, osm.node(0, 0), east], **main, **({"layer": under} if under != "0" else {}))
    a, b = osm.node(0, -half_m), osm.node(0, half_m)
    osm.way([osm.node(0, -arm_m), a], **main)
    osm.way([a, b], **main, **tags)
    osm.way([b, osm.node(0, arm_m)], **main)
    return osm.text()


def levels_of(folder: Path, text: str) -> Levels:
    file = folder / "a.osm"
    file.write_text(text)
    return find_levels(read_street_map(file), CENTRE, 500)


@pytest.mark.parametrize(
    ("tags", "under", "z_m"),
    [
        (BRIDGE, "0", 6),
        ({"bridge": "viaduct"}, "0", 6),
        ({"layer": "2"}, "0", 6),
        ({"layer": "+1;2"}, "0", 6),
        ({"tunnel": "yes", "layer": "-1"}, "0", -6),
        ({"tunnel": "yes"}, "0", -6),
        ({"layer": "-1"}, "-2", 0),
    ],
)
def test_a_way_on_another_layer_has_the_clearance(
    tmp_path: Path, tags: dict[str, str], under: str, z_m: float
) -> None:
    levels = levels_of(tmp_path, crossroads(tags, under=under))
    assert (levels.crossings, levels.flat) == (1, [])
    assert levels.heights.get("4", 0) == levels.heights.get("5", 0) == pytest.approx(z_m)


@pytest.mark.parametrize(
    "tags", [{}, {"bridge": "no"}, {"layer": "0"}, {"tunnel": "building_passage"}]
)
def test_a_way_on_the_same_layer_stays(tmp_path: Path, tags: dict[str, str]) -> None:
    assert levels_of(tmp_path, crossroads(tags)) == Levels()


def test_a_bridge_over_no_road_stays(tmp_path: Path) -> None:
    text = crossroads(BRIDGE)
    text = re.sub(r'<tag k="highway" v="primary"/>', '<tag k="waterway" v="river"/>', text, count=1)
    assert levels_of(tmp_path, text) == Levels()


def test_ramps_are_no_steeper_than_roads_are(tmp_path: Path) -> None:
    levels = levels_of(tmp_path, crossroads(BRIDGE))
    profile = sorted(
        (lat, levels.heights[name])
        for name, (_, lat) in levels.places.items()
        if abs(_ - 8.4) < 1e-6
    )
    north, z = np.array(profile).T
    grades = np.diff(z) / np.diff(north * 111_200)
    assert np.abs(grades).max() < 0.065
    assert z.max() == pytest.approx(CLEARANCE_M)
    assert z.min() < 0.3


def test_three_roads_lie_one_above_the_other(tmp_path: Path) -> None:
    osm = Osm(*CENTRE)
    main = {"highway": "primary"}
    osm.way([osm.node(-400, 0), osm.node(400, 0)], **main)
    for layer, slope in ((1, 1.0), (2, -1.0)):
        ends = [osm.node(-k * 500, -k * 500 * slope) for k in (1, 0.1, -0.1, -1)]
        osm.way(ends[:2], **main)
        osm.way(ends[1:3], **main, bridge="yes", layer=str(layer))
        osm.way(ends[2:], **main)
    levels = levels_of(tmp_path, osm.text())
    assert (levels.crossings, levels.flat) == (3, [])
    assert (levels.heights["4"], levels.heights["8"]) == pytest.approx((6, 12))


def test_a_bridge_without_room_for_ramps_is_named(tmp_path: Path) -> None:
    """A way ends 5 m away from the bridge on the road below, and its other end is on the bridge."""
    osm = Osm(*CENTRE)
    main = {"highway": "primary"}
    below, above = osm.node(5, 0), osm.node(0, 2)
    osm.way([osm.node(-300, 0), below, osm.node(300, 0)], **main)
    osm.way([osm.node(0, -300), above, osm.node(0, 300)], **main, **BRIDGE)
    osm.way([below, above], **main)
    levels = levels_of(tmp_path, osm.text())
    for name, z in levels.heights.items():
        assert abs(z) <= CLEARANCE_M + 0.01, name
    with_heights = re.sub(r"(<node [^>]*>)", r'\1<tag k="ele" v="3"/>', osm.text())
    assert "way 2 (bridge, layer) crosses above way 1" in levels_of(tmp_path, with_heights).flat[0]


@pytest.mark.parametrize("first", ["432", "about 430", "432 m"])
def test_heights_of_some_nodes_make_no_hill(tmp_path: Path, first: str) -> None:
    """A node without a height is at z = 0 for SUMO, and the bridge is lifted as without heights."""
    text = re.sub(r'(<node id="3"[^>]*>)', rf'\1<tag k="ele" v="{first}"/>', crossroads(BRIDGE))
    (tmp_path / "a.osm").write_text(text)
    record = import_map(tmp_path / "a.osm", tmp_path / "s", ImportOptions(CENTRE, 350))
    lanes = read_lanes(tmp_path / "s/lanes.csv").values()
    assert max(lane[:, 2].max() for lane in lanes) == pytest.approx(6, abs=0.05)
    notes = " ".join(record["not_understood"])
    is_named = "heights (`ele`) of 1 of 7 nodes of roads: left out" in notes
    assert is_named == first.startswith("432")


def test_heights_of_all_nodes_are_kept(tmp_path: Path) -> None:
    text = re.sub(r"(<node [^>]*>)", r'\1<tag k="ele" v="432"/>', crossroads({}))
    (tmp_path / "a.osm").write_text(text)
    record = import_map(tmp_path / "a.osm", tmp_path / "s", ImportOptions(CENTRE, 350))
    lanes = read_lanes(tmp_path / "s/lanes.csv").values()
    np.testing.assert_allclose(np.concatenate(list(lanes))[:, 2], 432)
    assert record["not_understood"] == []


@pytest.mark.parametrize("same_place", [False, True])
def test_the_site_has_the_bridge_and_what_is_below_stays(tmp_path: Path, same_place: bool) -> None:
    """This is also true if a node of the bridge has the position of a node of the road below."""
    text = crossroads(BRIDGE)
    if same_place:
        middle = re.search(r'<node id="3" (lon="[^"]*" lat="[^"]*")', text)
        assert middle
        text = text.replace("<way", f'<node id="99" {middle[1]}/><way', 1)
        text = text.replace(
            '<nd ref="4"/><nd ref="5"/>', '<nd ref="4"/><nd ref="99"/><nd ref="5"/>'
        )
    (tmp_path / "a.osm").write_text(text)
    made = import_map(tmp_path / "a.osm", tmp_path / "s", ImportOptions(CENTRE, 350))
    lanes = read_lanes(tmp_path / "s/lanes.csv").values()
    for lane in lanes:
        z = lane[np.hypot(*lane[:, :2].T) < 20, 2]
        to_east = np.ptp(lane[:, 0]) > np.ptp(lane[:, 1])
        np.testing.assert_allclose(z, 0 if to_east else 6, atol=0.05)
    assert made["not_understood"] == []


def test_the_ground_over_a_tunnel_stays(tmp_path: Path) -> None:
    (tmp_path / "a.osm").write_text(crossroads({"tunnel": "yes", "layer": "-1"}))
    import_map(tmp_path / "a.osm", tmp_path / "s", ImportOptions(CENTRE, 350))
    ground = read_ply(tmp_path / "s/meshes/terrain.ply").vertices
    beside = (np.abs(ground[:, 0]) < 30) & (np.abs(ground[:, 1]) < 30)
    assert ground[beside, 2].min() > -1
    assert min(lane[:, 2].min() for lane in read_lanes(tmp_path / "s/lanes.csv").values()) < -5.9


@pytest.mark.nightly
def test_what_an_editor_deleted_is_not_built(tmp_path: Path) -> None:
    """JOSM keeps deleted elements with action='delete', and gives new elements negative ids."""
    text = district_text()
    gone = re.sub(r'<(way id="1"|way id="7"|node id="49")', r'<\1 action="delete"', text)
    gone = re.sub(r'<way id="8"', '<way id="8" visible="false"', gone)
    gone = gone.replace('ref="50"', 'ref="-50"').replace('node id="50"', 'node id="-50"')
    gone = gone.replace("<way", '<node id="888" visible="false"/><way', 1)
    (tmp_path / "all.osm").write_text(text)
    (tmp_path / "gone.osm").write_text(gone)
    whole, edited = (read_street_map(tmp_path / f"{name}.osm") for name in ("all", "gone"))
    assert len(edited.ways) == len(whole.ways) - 1
    assert len(edited.houses) == len(whole.houses) - 2
    lanes = [import_map(tmp_path / f"{n}.osm", tmp_path / n)["lanes"] for n in ("all", "gone")]
    assert lanes[1] < lanes[0]
    record = yaml.safe_load((tmp_path / "gone/map.yaml").read_text())
    assert "elements marked as deleted by an editor: left out" in " ".join(record["guessed"])


def nodes_behind(text: str) -> str:
    """Returns the file as Overpass's `out body; >; out skel qt` writes it, with its header."""
    nodes = re.findall(r"<node.*?</node>", text)
    ways = re.findall(r"<way.*?</way>", text)
    head = '<note>data is ODbL</note><meta osm_base="2026-01-01T00:00:00Z"/>'
    return f'<osm version="0.6" generator="Overpass API">{head}{"".join(ways + nodes)}</osm>'


def with_inline_positions(text: str) -> str:
    """Returns the file as Overpass's `out geom` writes it: only nodes with tags are elements."""
    at = dict(re.findall(r'<node id="(\d+)" (lon="[^"]*" lat="[^"]*")', text))
    text = re.sub(r'<node id="\d+"[^>]*></node>', "", text)
    return re.sub(r'<nd ref="(\d+)"', lambda m: f"{m[0]} {at[m[1]]}", text)


def bounded(text: str) -> str:
    """Returns the file as Geofabrik and the API write it: with versions, bounds and users."""
    text = re.sub(
        r"<(node|way) ", r'<\1 version="3" timestamp="2026-01-01T00:00:00Z" uid="1" ', text
    )
    bounds = '<bounds minlat="48.99" minlon="8.39" maxlat="49.01" maxlon="8.41"/>'
    return text.replace('<osm version="0.6">', f'<osm version="0.6">{bounds}')


@pytest.mark.parametrize("written", [nodes_behind, with_inline_positions, bounded])
def test_files_of_editors_and_servers_are_one_map(tmp_path: Path, written) -> None:  # type: ignore[no-untyped-def]
    text = district_text()
    (tmp_path / "a.osm").write_text(text)
    (tmp_path / "b.osm").write_text(written(text))
    options = ImportOptions(CENTRE, 150)
    one, other = (import_map(tmp_path / f"{n}.osm", tmp_path / n, options) for n in "ab")
    assert (one["lanes"], one["triangles"]) == (other["lanes"], other["triangles"])
    assert one["guessed"] == other["guessed"]
