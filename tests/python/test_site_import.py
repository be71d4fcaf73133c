"""Maps become sites: surfaces are at the positions of the map, folders are complete, and errors are
clear."""

import bz2
import cmath
import gc
import gzip
import itertools
import math
import os
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast
from xml.etree import ElementTree

import numpy as np
import pytest
import site_data
import yaml
from conftest import Infrasim
from site_maps import Osm

from pyinfra.cli.main import main, make_parser
from pyinfra.experiments.planner.candidates import PoseGrid, read_candidates
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.formats.ply import Triangles, degenerate, read_ply
from pyinfra.scenes.maps.compass import looks_to
from pyinfra.scenes.maps.geographic import Projection, metres_of_degrees, network_projection
from pyinfra.scenes.maps.lane_map import MapError, MapLane, SiteMap
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.mount_guess import guess_pole
from pyinfra.scenes.maps.network import read_network
from pyinfra.scenes.maps.opendrive_geometry import read_reference_line
from pyinfra.scenes.maps.openstreetmap import (
    StreetMap,
    Way,
    read_street_map,
    transverse_mercator,
)
from pyinfra.scenes.maps.osm_pbf import write_xml
from pyinfra.scenes.maps.site_folder import feet, projection
from pyinfra.scenes.maps.site_writer import lanes_table
from pyinfra.scenes.maps.sumo import sumo_folder
from pyinfra.scenes.maps.surfaces import contains, ears
from pyinfra.viz.site_plan import plan, read_lanes

pytest.importorskip("sumo", reason="needs the extra `site`")


def write_map(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.write_text(text)
    return file


def height(mesh: Triangles, x: float, y: float) -> float:
    """Returns z of the highest triangle above a position, from its barycentric coordinates; -inf
    without a triangle."""
    highest = -math.inf
    for a, b, c in mesh.vertices[mesh.faces]:
        lever = np.array([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [1, 1, 1]])
        if abs(np.linalg.det(lever)) > 1e-9:
            weights = np.linalg.solve(lever, [x, y, 1])
            if weights.min() >= -1e-6:
                highest = max(highest, float(weights @ [a[2], b[2], c[2]]))
    return highest


def near(mesh: Triangles, x: float, y: float) -> Triangles:
    middles = mesh.vertices[mesh.faces].mean(1)[:, :2]
    return Triangles(mesh.vertices, mesh.faces[np.hypot(*(middles - (x, y)).T) < 12])


@pytest.fixture(scope="module")
def hill(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hill")
    import_map(write_map(folder, "hill.xodr", site_data.hill()), folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def district(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("district")
    import_map(write_map(folder, "district.osm", site_data.district()), folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ring")
    file = site_data.roundabout(folder, sumo_folder() / "bin/netconvert")
    import_map(file, folder / "site")
    return folder / "site"


def rise(x: float) -> float:
    """Returns the hill's elevation at s = x, computed independently: 3 m, rising at up to 6 %, and
    level at 15 m."""
    if x < 100:
        return 3 + 0.0003 * x**2
    return 6 + 0.06 * (x - 100) if x < 200 else 12 + 0.06 * (x - 200) - 0.0003 * (x - 200) ** 2


def test_road_lies_where_the_elevation_says(hill: Path) -> None:
    road = read_ply(hill / "meshes/road.ply")
    x0, y0, z0 = yaml.safe_load((hill / "map.yaml").read_text())["offset_m"]
    for x in np.arange(0.25, 300, 7.5):
        height_m = height(near(road, x - x0, -1.75 - y0), x - x0, -1.75 - y0)
        assert height_m == pytest.approx(rise(x) - z0, abs=0.02)


def test_lanes_go_with_the_traffic_and_have_the_roads_z(hill: Path) -> None:
    lanes = read_lanes(hill / "lanes.csv")
    x0, y0, z0 = yaml.safe_load((hill / "map.yaml").read_text())["offset_m"]
    right, left = lanes["road1_0_right1"], lanes["road1_0_left1"]
    assert right[0, 0] + x0 == pytest.approx(0)
    assert left[0, 0] + x0 == pytest.approx(300)
    assert right[0, 1] + y0 == pytest.approx(-1.75)
    assert {4} == {lane.shape[1] for lane in lanes.values()}
    for row in right:
        assert row[2] == pytest.approx(rise(row[0] + x0) - z0, abs=1e-3)
    bend = lanes["road2_0_right1"]
    radius = np.hypot(bend[:, 0] + x0 - 300, bend[:, 1] + y0 - 30)
    np.testing.assert_allclose(radius, 31.75, atol=1e-3)


def test_sidewalks_are_raised_and_terrain_lies_below(hill: Path) -> None:
    meshes = {p.stem: read_ply(p) for p in (hill / "meshes").glob("*.ply")}
    x0, y0, _ = yaml.safe_load((hill / "map.yaml").read_text())["offset_m"]
    x, road_y, walk_y = 50 - x0, -1.75 - y0, -5 - y0
    road = height(near(meshes["road"], x, road_y), x, road_y)
    assert height(near(meshes["sidewalk"], x, walk_y), x, walk_y) == pytest.approx(
        road + 0.15, abs=0.01
    )
    ground = height(near(meshes["terrain"], x, road_y), x, road_y)
    assert road - 0.5 < ground < road


@pytest.mark.parametrize("site", ["hill", "district", "ring"])
def test_no_triangle_is_a_line_and_each_lane_has_a_road(
    site: str, request: pytest.FixtureRequest
) -> None:
    folder: Path = request.getfixturevalue(site)
    for file in (folder / "meshes").glob("*.ply"):
        assert not degenerate(read_ply(file)).any()
    road = read_ply(folder / "meshes/road.ply")
    for lane in read_lanes(folder / "lanes.csv").values():
        middle = (lane[len(lane) // 2] + lane[len(lane) // 2 - 1]) / 2
        height_m = height(near(road, *middle[:2]), *middle[:2])
        assert height_m == pytest.approx(middle[2], abs=0.02)


@pytest.mark.parametrize("site", ["hill", "district", "ring"])
def test_pole_stands_off_the_carriageway_and_looks_at_it(
    site: str, request: pytest.FixtureRequest
) -> None:
    folder: Path = request.getfixturevalue(site)
    pole = yaml.safe_load((folder / "site.yaml").read_text())["mounts"]["pole"]
    lanes = read_lanes(folder / "lanes.csv")
    points = np.concatenate(list(lanes.values()))
    away = points[:, :2] - (pole["x_m"], pole["y_m"])
    assert (np.hypot(*away.T) - points[:, 3] / 2).min() > 0.9
    yaw = math.radians(pole["yaw_deg"])
    ahead = away @ [math.cos(yaw), math.sin(yaw)]
    assert ((ahead > 5) & (ahead < 30)).any()


def test_pole_looks_along_a_road_without_a_junction(tmp_path: Path) -> None:
    made = import_map(write_map(tmp_path, "a.xodr", site_data.straight()), tmp_path / "site")
    assert made["guessed"][-1].startswith("the pole, 6 m high, beside lane road1")
    along = abs(math.remainder(made["pole"]["yaw_deg"], 180))
    assert 0 < along < 45


def test_pole_is_apart_from_houses_and_trees(district: Path) -> None:
    pole = yaml.safe_load((district / "site.yaml").read_text())["mounts"]["pole"]
    at = np.array([pole["x_m"], pole["y_m"]])
    assert np.hypot(*(at - (40, -12))) > 5
    houses = read_ply(district / "meshes/buildings.ply").vertices[:, :2]
    assert np.hypot(*(houses - at).T).min() > 1


def test_rows_of_a_lane_are_apart_in_the_file() -> None:
    """The simulator refuses two consecutive rows at one position."""
    y = np.array([0, 0.0003, 0.0004, 4, 8])
    left, right = (np.column_stack([side * 1.5 + 0 * y, y, 0 * y]) for side in (-1, 1))
    rows = lanes_table([MapLane("a", "road", True, left, right)]).splitlines()
    assert rows[1:] == [f"a,0.000,{v},0.0000,3.000" for v in ("0.000", "4.000", "8.000")]


def test_lanes_of_a_network_have_no_crowded_points(tmp_path: Path) -> None:
    """The turning lanes of a random network have points that are a few millimetres apart."""
    import site_maps

    file = site_maps.netgenerate(tmp_path, sumo_folder())
    import_map(file, tmp_path / "site", ImportOptions(radius_m=150))
    for lane in read_lanes(tmp_path / "site/lanes.csv").values():
        assert np.hypot(*np.diff(lane[:, :2], axis=0).T).min() > 1e-3


def test_houses_and_trees_of_a_district(district: Path) -> None:
    houses = read_ply(district / "meshes/buildings.ply")
    ground = read_ply(district / "meshes/terrain.ply").vertices[:, 2].min()
    x, y = 35.0, 32.0  # inside the house with a height of 12 m
    middle = yaml.safe_load((district / "map.yaml").read_text())
    assert "height of 2 of 4 buildings" in middle["guessed"]
    tops = sorted({round(float(z - ground), 1) for z in houses.vertices[:, 2]})
    assert tops == [-0.5, 6.0, 9.0, 12.0]
    assert height(houses, x, y) - ground == pytest.approx(12, abs=0.01)
    assert height(houses, 45.0, 43.0) == -math.inf  # in the notch of the L-shaped house
    tree = yaml.safe_load((district / "site.yaml").read_text())["vegetation"][0]["tree"]
    assert (tree["x_m"], tree["y_m"]) == pytest.approx((40, -12), abs=0.3)


def test_our_projection_is_that_of_the_network(district: Path) -> None:
    """The node of SUMO at the crossing has the position that our projection gives."""
    nodes = {n.get("id"): n for n in ElementTree.parse(district / "map.net.xml").iter("junction")}
    record = yaml.safe_load((district / "map.yaml").read_text())
    lat, lon = (float(v) for v in re.findall(r"lat_0=(\S+) \+lon_0=(\S+)", record["projection"])[0])
    ends = ElementTree.fromstring(site_data.district()).iter("node")
    checked = 0
    for node in ends:
        if node.get("id") in {"1", "2", "3", "4", "5"}:
            lon_lat = np.array([float(node.attrib["lon"]), float(node.attrib["lat"])])
            x, y = transverse_mercator(lon_lat, (lon, lat))[0]
            match = nodes[node.get("id")]
            assert (float(match.attrib["x"]), float(match.attrib["y"])) == pytest.approx(
                (x, y), abs=0.02
            )
            checked += 1
    assert checked == 5


def test_objects_of_opendrive_and_what_is_not_understood(tmp_path: Path) -> None:
    made = import_map(write_map(tmp_path, "a.xodr", site_data.straight()), tmp_path / "site")
    assert made["not_understood"] == [
        "road 1: object 9 at s = 90.0, t = 30.0: type 'fountain', height 2 m: left out"
    ]
    house = read_ply(tmp_path / "site/meshes/buildings.ply").vertices
    np.testing.assert_allclose(house[:, :2].min(0), (1060 - 1100 - 6, 20 - 4), atol=1e-3)
    scene = yaml.safe_load((tmp_path / "site/site.yaml").read_text())
    assert scene["vegetation"][0]["tree"]["height_m"] == 7
    assert scene["trajectories"] == "trajectories.csv"


def test_a_map_may_name_its_schema(tmp_path: Path) -> None:
    text = _changed(site_data.straight(), "<OpenDRIVE>", '<OpenDRIVE xmlns="http://asam.net/odr">')
    plain = import_map(write_map(tmp_path, "a.xodr", site_data.straight()), tmp_path / "plain")
    named = import_map(write_map(tmp_path, "b.xodr", text), tmp_path / "named")
    assert (named["lanes"], named["triangles"]) == (plain["lanes"], plain["triangles"])


def test_packed_osm_is_the_same_and_a_radius_cuts(tmp_path: Path) -> None:
    packed = tmp_path / "d.osm.gz"
    packed.write_bytes(gzip.compress(site_data.district().encode()))
    whole = import_map(packed, tmp_path / "whole")
    near_ = ImportOptions(centre=(8.4 + 60 / 73_200, 49.0 + 45 / 111_200), radius_m=50)
    part = import_map(packed, tmp_path / "part", near_)
    assert part["lanes"] < whole["lanes"]
    assert (tmp_path / "part/meshes/buildings.ply").stat().st_size < 5000


@pytest.mark.parametrize("ending", [".osm.xml", ".osm.xml.gz", ".osm.bz2", ".OSM.GZ", ".xml"])
def test_osm_is_read_by_any_of_its_endings(tmp_path: Path, ending: str) -> None:
    data = site_data.district().encode()
    packed = {"gz": gzip.compress, "bz2": bz2.compress}.get(ending.rpartition(".")[2].lower())
    file = tmp_path / f"town{ending}"
    file.write_bytes(packed(data) if packed else data)
    near_ = ImportOptions(centre=(8.4, 49.0), radius_m=60)
    assert import_map(file, tmp_path / "site", near_)["source"] == file.name


@pytest.mark.parametrize("name", ["a.net.xml.gz", "a.xodr.gz", "net.xml", "map.xml.gz"])
def test_networks_and_opendrive_may_be_packed(tmp_path: Path, name: str) -> None:
    text = XODR
    if "net" in name:
        net = site_data.roundabout(tmp_path, sumo_folder() / "bin/netconvert")
        text = net.read_text()
    data = text.encode()
    (tmp_path / name).write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    assert import_map(tmp_path / name, tmp_path / "site")["lanes"]


def test_o5m_is_refused_with_the_command_that_converts_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "town.o5m").write_bytes(b"\xff\xe0\x04o5m2")
    assert main(["site", "import", str(tmp_path / "town.o5m"), "--out", str(tmp_path / "s")]) == 2
    assert "osmconvert town.o5m -o=town.osm" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["town.osm.pbf", "Town.PBF"])
def test_a_map_in_pbf_is_that_in_xml(tmp_path: Path, name: str) -> None:
    """The file is written by osmium, as Geofabrik's files are: with sorted elements and without
    versions."""
    osmium = pytest.importorskip("osmium", reason="needs the extra `pbf`")
    (tmp_path / "town.osm").write_text(site_data.district())
    with osmium.SimpleWriter(str(tmp_path / "town.osm.pbf")) as writer:
        for element in osmium.FileProcessor(str(tmp_path / "town.osm")):
            writer.add(element)
    (tmp_path / "town.osm.pbf").rename(tmp_path / name)
    near = ImportOptions(centre=(8.4, 49.0), radius_m=60)
    made = [import_map(tmp_path / file, tmp_path / f"site_{file}", near)
            for file in ("town.osm", name)]  # fmt: skip
    assert made[1]["source"] == name
    lists = ("lanes", "triangles", "pole", "features", "guessed", "mended", "not_understood")
    assert {k: made[1][k] for k in lists} == {k: made[0][k] for k in lists}
    lanes = [(tmp_path / f"site_{file}/lanes.csv").read_bytes() for file in ("town.osm", name)]
    assert lanes[0] == lanes[1]


@pytest.mark.parametrize("data", [b"\0\0\0\x0d\x0a\x09OSMHeader", b"", b"<osm/>"])
def test_what_is_no_pbf_is_refused(
    tmp_path: Path, data: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("osmium", reason="needs the extra `pbf`")
    file = tmp_path / "town.osm.pbf"
    file.write_bytes(data)
    assert main(["site", "import", str(file), "--out", str(tmp_path / "s")]) == 2
    assert capsys.readouterr().err.startswith(f"pyinfra: {file}: ")
    assert not (tmp_path / "s").exists()


def test_a_pbf_map_that_is_too_large_is_refused_with_the_command_that_cuts_it(
    tmp_path: Path,
) -> None:
    osmium = pytest.importorskip("osmium", reason="needs the extra `pbf`")
    (tmp_path / "town.osm").write_text(site_data.district())
    with osmium.SimpleWriter(str(tmp_path / "town.osm.pbf")) as writer:
        for element in osmium.FileProcessor(str(tmp_path / "town.osm")):
            writer.add(element)
    with pytest.raises(MapError, match="osmium extract -b"):
        write_xml(tmp_path / "town.osm.pbf", tmp_path / "out.osm", 1000)


def test_without_osmium_a_pbf_map_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "osmium", None)
    (tmp_path / "town.osm.pbf").write_bytes(b"\0\0\0\x0d")
    code = main(["site", "import", str(tmp_path / "town.osm.pbf"), "--out", str(tmp_path / "s")])
    assert code in (1, 2)
    assert "pip install 'infrasim[pbf]'" in capsys.readouterr().err


def lane_along(y: float, width: float, step_m: float, length_m: float = 400) -> MapLane:
    x = np.arange(-length_m / 2, length_m / 2 + step_m / 2, step_m)
    left, right = (np.column_stack([x, y + s * width / 2 + 0 * x, 0 * x]) for s in (1, -1))
    return MapLane(f"a{y:g}", "road", True, left, right)


@pytest.mark.parametrize("step_m", [1, 4, 50])
@pytest.mark.parametrize("lanes", [1, 8, 31, 61])
def test_the_guessed_pole_is_off_all_lanes(step_m: float, lanes: int) -> None:
    """This is true for any points of the lanes and any width of the road."""
    each = [lane_along(3.0 * (k - lanes // 2), 3.0, step_m) for k in range(lanes)]
    pole, _ = guess_pole(SiteMap(lanes=each))
    away = [abs(pole.y_m - lane.centre[0, 1]) - 1.5 for lane in each]
    assert min(away) > 0.99 or abs(pole.x_m) > 200.99


def test_the_same_import_is_accepted_and_another_refused(tmp_path: Path) -> None:
    file = write_map(tmp_path, "a.xodr", site_data.straight())
    import_map(file, tmp_path / "site")
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "site").rglob("*")}
    import_map(file, tmp_path / "site")
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "site").rglob("*")} == before
    with pytest.raises(FileExistsError, match="a different import"):
        import_map(file, tmp_path / "site", ImportOptions(radius_m=60))


def test_a_mount_is_where_it_is_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_map(tmp_path, "a.xodr", site_data.straight())
    words = ["site", "import", str(file), "--out", str(tmp_path / "s"), "--mount-pose=1,-9,7.5,80"]
    assert main(words) == 0
    pole = yaml.safe_load((tmp_path / "s/site.yaml").read_text())["mounts"]["pole"]
    assert pole == {"x_m": 1.0, "y_m": -9.0, "z_m": 7.5, "yaw_deg": 80.0}
    assert "pole at 1 -9 7.5 m, yaw 80 degrees\npole looks to 10 " in capsys.readouterr().out
    scene = tmp_path / "s/site.yaml"
    scene.write_text(scene.read_text().replace("yaw_deg: 80.0", "yaw_deg: 0.0"))
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "pole looks to 90 degrees (east)" in printed
    assert "yaw 80" not in printed
    of_map = ImportOptions(mount=(1101, 1991, 7.5, 80))
    with pytest.raises(MapError, match=r"origin \(1100, 2000 in the coordinates of the map\)"):
        import_map(file, tmp_path / "other", of_map)


def lanes_west_and_east(folder: Path) -> tuple[float, float]:
    """Returns the mean y of the lanes of the street along x that lead west, and of those that lead
    east."""
    streets = [
        lane
        for lane in read_lanes(folder / "lanes.csv").values()
        if np.abs(lane[:, 1]).max() < 5 and np.abs(lane[-1, 0] - lane[0, 0]) > 50
    ]
    west, east = (
        np.mean([lane[:, 1].mean() for lane in streets if (lane[-1, 0] > lane[0, 0]) == heads_east])
        for heads_east in (False, True)
    )
    return float(west), float(east)


def test_traffic_keeps_to_the_side_that_is_given(district: Path, tmp_path: Path) -> None:
    file = write_map(tmp_path, "district.osm", site_data.district())
    words = ["site", "import", str(file), "--out", str(tmp_path / "s"), "--traffic-side", "left"]
    assert main(words) == 0
    (west, east), (left_west, left_east) = map(lanes_west_and_east, (district, tmp_path / "s"))
    assert east < 0 < west
    assert left_west < 0 < left_east
    guessed = yaml.safe_load((district / "map.yaml").read_text())["guessed"]
    assert "traffic on the right: the map does not show the side" in guessed
    assert "traffic on" not in (tmp_path / "s/map.yaml").read_text()
    file = write_map(tmp_path, "a.xodr", site_data.straight())
    with pytest.raises(MapError, match="`traffic_side`: expected no value"):
        import_map(file, tmp_path / "a", ImportOptions(traffic_side="left"))


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize(("side", "turn"), [("left", -1), ("right", 1)])
def test_roundabouts_show_the_side_of_traffic(
    side: str, turn: int, parts: int, tmp_path: Path
) -> None:
    """A roundabout may consist of several ways. `oneway=-1` reverses a way."""
    osm = Osm(-0.1, 51.5)
    around = [cmath.rect(15, turn * k * math.tau / 12) for k in range(12)]
    ring = [osm.node(at.real, at.imag) for at in around]
    length = 12 // parts
    for i in range(0, 12, length):
        way = [*ring, *ring][i : i + length + 1]
        osm.way(way if i else way[::-1], highway="primary", junction="roundabout",
                oneway="yes" if i else "-1")  # fmt: skip
    osm.way([ring[0], osm.node(300, 0)], highway="primary")
    file = write_map(tmp_path, "ring.osm", osm.text())
    assert read_street_map(file).traffic_side() == side
    made = import_map(file, tmp_path / "site")
    assert f"traffic on the {side}: as in its roundabouts" in made["guessed"]
    assert ('lefthand="true"' in (tmp_path / "site/map.net.xml").read_text()) == (side == "left")


def test_poles_in_longitude_and_latitude_are_refused(district: Path, tmp_path: Path) -> None:
    known = projection(district)
    assert known is not None
    lon, lat = known.centre[0] + 0.0004, known.centre[1] - 0.0002
    x, y = known.metres(np.array([[lon, lat]]))[0]
    in_metres = rf"longitude and latitude of the site; in metres, this is {x:.2f}, {y:.2f}"
    file = write_map(tmp_path, "district.osm", site_data.district())
    with pytest.raises(ValueError, match=f"mount: .*{in_metres}"):
        import_map(file, tmp_path / "s", ImportOptions(mount=(lon, lat, 6, 0)))
    poses = tmp_path / "poses.csv"
    poses.write_text(f"x_m,y_m\n{lat!r},{lon!r}\n")
    site = cast(PlanSite, SimpleNamespace(file=district / "site.yaml"))
    with pytest.raises(ValueError, match=f"x_m, y_m: .*{in_metres}"):
        read_candidates(poses, site, PoseGrid())
    edited = Path(shutil.copytree(district, tmp_path / "edited")) / "site.yaml"
    scene = yaml.safe_load(edited.read_text())
    scene["mounts"]["pole"] |= {"x_m": lon, "y_m": lat}
    edited.write_text(yaml.safe_dump(scene))
    with pytest.raises(ValueError, match=f"mounts: x_m, y_m: .*{in_metres}"):
        feet(tmp_path / "edited")


def test_metres_are_no_degrees() -> None:
    near_greenwich = Projection((0.0, 51.5))
    for metres in ([[0.0, 51.0]], [[0.0, 51.5], [3.0, 51.5]], [[0.0, 0.0]]):
        assert metres_of_degrees(np.array(metres), near_greenwich) is None
    without_a_place = Projection((0.0, 0.0))  # as in CARLA's maps
    assert metres_of_degrees(np.array([[0.01, 0.02]]), without_a_place) is None


def test_plans_of_sites(district: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new/plan.svg"
    assert main(["site", "draw", str(district), "--out", str(out), "--radius", "60"]) == 0
    assert re.search(r"mount pole looks to \d+ degrees \(\w+", capsys.readouterr().out)
    assert {t.text for t in ElementTree.parse(out).iter() if t.text}
    low, high = plan(district, 60).axes[0].get_xlim()
    assert high - low == pytest.approx(120)
    assert main(["site", "draw", str(district), "--out", str(out), "--radius", "nan"]) == 2
    axes = plan(district).axes[0]
    assert "pole" in {text.get_text() for text in axes.texts}


def test_pieces_of_reference_lines_meet() -> None:
    """A spiral from curvature 0 to 1/50 turns by half of its length over the radius. A cubic ends
    at the given point."""
    spiral = '<spiral curvStart="0" curvEnd="0.02"/>'
    node = ElementTree.fromstring(site_data.road(1, (1, 2, 0.5), 40, shape=spiral))
    x, y, heading = read_reference_line(node).at(np.array([40.0]))[0]
    steps = 0.5 + (np.arange(40_000) + 0.5) ** 2 * (0.001**2 * 0.02 / 40 / 2)
    assert heading == pytest.approx(0.9)
    assert (x, y) == pytest.approx(
        (1 + np.cos(steps).sum() * 0.001, 2 + np.sin(steps).sum() * 0.001), abs=1e-5
    )
    cubic = '<paramPoly3 pRange="normalized" bU="30" cV="5" dV="-2"/>'
    node = ElementTree.fromstring(site_data.road(1, (0, 0, 0), 31, shape=cubic))
    assert read_reference_line(node).at(np.array([31.0]))[0, :2] == pytest.approx((30, 3))


def test_ears_cover_an_outline_once() -> None:
    outline = np.array([[0, 0], [20, 0], [20, 10], [10, 10], [10, 15], [0, 15], [4, 7.0]])
    corners = outline[ears(outline)]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    x, y = outline.T
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    assert np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2 == pytest.approx(area)
    assert contains(outline, corners.mean(1)).all()


def _changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


XODR = site_data.straight()
OSM = site_data.district()
NET = (
    '<net version="1.20"><location netOffset="0,0" convBoundary="0,0,9,9" origBoundary="0,0,9,9" '
    'projParameter="!"/><edge id="e" from="a" to="b"><lane id="e_0" index="0" speed="9" '
    'length="9" shape="0,0 9,0"/></edge></net>'
)
ENTITIES = "".join(f'<!ENTITY {b} "{10 * f"&{a};"}">' for a, b in itertools.pairwise("abcdefghij"))
GROWING = f'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">{ENTITIES}]><OpenDRIVE>&j;</OpenDRIVE>'
TWICE = site_data.open_drive(*2 * [site_data.road(1, (0, 0, 0), 99)])
BROKEN: dict[str, tuple[str, str | bytes]] = {
    "empty": ("a.xodr", ""),
    "not XML": ("a.xodr", "this is no map"),
    "bytes": ("a.xodr", b"\x00\xff\xfe\x80" * 50),
    "cut": ("a.xodr", XODR[: len(XODR) // 2]),
    "another root": ("a.xodr", OSM),
    "another ending": ("a.png", XODR),
    "no road": ("a.xodr", site_data.open_drive()),
    "no lane for vehicles": ("a.xodr", XODR.replace('"driving"', '"sidewalk"')),
    "a negative width": ("a.xodr", _changed(XODR, 'a="3.5"', 'a="-3.5"')),
    "NaN": ("a.xodr", _changed(XODR, 'a="3.5"', 'a="nan"')),
    "infinite": ("a.xodr", _changed(XODR, 'x="1000"', 'x="inf"')),
    "a word": ("a.xodr", _changed(XODR, 'x="1000"', 'x="east"')),
    "no geometry": ("a.xodr", _changed(XODR, "geometry", "gone").replace("/geometry", "/gone")),
    "an unknown curve": ("a.xodr", _changed(XODR, "<line/>", "<wiggle/>")),
    "a negative length": ("a.xodr", _changed(XODR, 'length="200"><line', 'length="-200"><line')),
    "a huge length": ("a.xodr", XODR.replace('length="200"', 'length="1e12"')),
    "degrees as metres": ("a.xodr", _changed(XODR, 'x="1000"', 'x="4e9"')),
    "a cliff": ("a.xodr", _changed(site_data.hill(), 's="100" a="6"', 's="100" a="60"')),
    "sections that fall": ("a.xodr", _changed(XODR, "</lanes>", '<laneSection s="-5"/></lanes>')),
    "one id of two roads": ("a.xodr", TWICE),
    "entities that grow": ("a.xodr", GROWING),
    "OSM in a cycle of one": ("a.osm", re.sub(r'<nd ref="[2-5]"/>', '<nd ref="1"/>', OSM)),
    "OSM far off": ("a.osm", OSM.replace('lat="49.', 'lat="95.').replace('lat="48.', 'lat="94.')),
    "OSM cut": ("a.osm", OSM[: len(OSM) // 2]),
    "OSM without roads": ("a.osm", OSM.replace("highway", "waterway")),
    "OSM without nodes": ("a.osm", re.sub(r"<node.*?</node>", "", OSM)),
    "OSM in metres": ("a.osm", _changed(OSM, 'lon="8.4"', 'lon="456789.1"')),
    "OSM not packed": ("a.osm.gz", OSM),
    "OSM packed and cut": ("a.osm.gz", gzip.compress(OSM.encode())[:300]),
    "a network without lanes": ("a.net.xml", "<net/>"),
    "a network with words": ("a.net.xml", _changed(NET, "0,0 9,0", "here there")),
    "a network with NaN": ("a.net.xml", _changed(NET, "0,0 9,0", "0,0 nan,0")),
    "a network of no nodes": ("a.net.xml", NET),
    "a negative width of a lane": ("a.net.xml", _changed(NET, 'speed="9"', 'width="-3"')),
    "a width in words": ("a.net.xml", _changed(NET, 'speed="9"', 'width="wide"')),
}  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_broken_maps_give_one_line_and_leave_nothing(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, text = BROKEN[what]
    file = tmp_path / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert main(["site", "import", str(file), "--out", str(tmp_path / "out/site")]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"pyinfra: {file}: ")
    assert message.count("\n") == 1
    assert not list((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else True


def test_a_missing_map_and_another_folder_are_errors(tmp_path: Path) -> None:
    assert main(["site", "import", str(tmp_path / "no.xodr"), "--out", str(tmp_path / "s")]) == 1
    file = write_map(tmp_path, "a.xodr", site_data.straight())
    (tmp_path / "full").mkdir()
    (tmp_path / "full/mine.txt").write_text("mine")
    assert main(["site", "import", str(file), "--out", str(tmp_path / "full")]) == 1
    assert [p.name for p in (tmp_path / "full").iterdir()] == ["mine.txt"]


def test_without_sumo_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    find: Callable[..., object] = lambda _name: None  # noqa: E731
    monkeypatch.setattr("importlib.util.find_spec", find)
    file = write_map(tmp_path, "a.xodr", site_data.straight())
    assert main(["site", "import", str(file), "--out", str(tmp_path / "s")]) == 2
    assert "pip install 'infrasim[site]'" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_a_lane_that_turns_back_is_mended_and_named(tmp_path: Path) -> None:
    """A bend has a radius of 2 m and a lane of 3.5 m, so its inner border would turn back."""
    bend = site_data.road(1, (0, 0, 0), 6, shape='<arc curvature="-0.5"/>')
    made = import_map(write_map(tmp_path, "a.xodr", site_data.open_drive(bend)), tmp_path / "s")
    assert made["lanes"]
    lanes = read_lanes(tmp_path / "s/lanes.csv")
    for lane in lanes.values():
        steps = np.diff(lane[:, :2], axis=0)
        assert ((steps[1:] * steps[:-1]).sum(1) > 0).all()


def test_roads_that_contradict_each_other_are_named(tmp_path: Path) -> None:
    """A road crosses another one 0.3 m above it, which is neither a bridge nor a crossing."""
    above = '<elevation s="0" a="0.3" b="0" c="0" d="0"/>'
    across = site_data.road(2, (50, -50, math.pi / 2), 100, elevation=above)
    both = site_data.open_drive(site_data.road(1, (0, 0, 0), 100), across)
    made = import_map(write_map(tmp_path, "a.xodr", both), tmp_path / "s")
    notes = made["not_understood"]
    assert len(notes) == 2
    assert all(re.match(r"lane road1_0_\w+: 0.30 m below lane road2_0", s) for s in notes)


def test_errors_are_map_errors(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"a\.xodr: expected .*got 0 bytes"):
        import_map(write_map(tmp_path, "a.xodr", ""), tmp_path / "s")


@pytest.mark.parametrize("value", ["-13,5,6,40", "-1.5e1,-3,6,-90", "-.5,0,6,0"])
def test_a_list_of_numbers_may_begin_with_a_minus(tmp_path: Path, value: str) -> None:
    file = write_map(tmp_path, "a.xodr", XODR)
    words = ["site", "import", str(file), "--out", str(tmp_path / "s"), "--centre", "-1000,2000"]
    assert make_parser(words).parse_args(words).centre == (-1000, 2000)
    assert main([*words[:-2], "--mount-pose", value]) == 0
    mount = yaml.safe_load((tmp_path / "s/site.yaml").read_text())["mounts"]["pole"]
    assert list(mount.values()) == [float(v) for v in value.split(",")]


def test_a_list_of_other_length_is_refused_by_the_names_of_its_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["site", "import", "a.xodr", "--out", str(tmp_path / "s"), "--mount-pose", "-1,2"])
    assert "--mount-pose: expected numbers X,Y,Z,YAW, got '-1,2'" in capsys.readouterr().err


def test_a_centre_in_either_order_is_one_site(tmp_path: Path) -> None:
    file = write_map(tmp_path, "a.osm", site_data.district())
    made = [
        import_map(file, tmp_path / f"s{i}", ImportOptions(centre=centre, radius_m=100))
        for i, centre in enumerate([(8.4, 49.0), (49.0, 8.4)])
    ]
    first, second = ((tmp_path / f"s{i}/lanes.csv").read_text() for i in (0, 1))
    assert first == second
    swapped = "`centre` appears to be lat,lon: read as 8.4 east, 49 north"
    assert [swapped in m["guessed"] for m in made] == [False, True]


def test_a_centre_that_may_be_of_either_order_is_lon_lat() -> None:
    """At this position, longitude and latitude are almost equal."""
    streets = StreetMap(
        nodes={"1": (8.40, 8.41), "2": (8.42, 8.43)},
        ways=[Way("1", ["1", "2"], {"highway": "primary"})],
    )
    assert streets.place_of((8.41, 8.42)) == ((8.41, 8.42), False)
    assert streets.place_of((8.42, 8.41)) == ((8.42, 8.41), False)
    assert streets.place_of((0.0, 1.0)) == ((0.0, 1.0), False)  # outside the map


# --- what an import writes passes the simulator's check


def long_road(folder: Path) -> Path:
    """Returns 600 m of an OpenDRIVE road uphill, with a house, a tree, a sign, a guard rail and a
    slope."""
    rail = '<object type="barrier" id="3" s="300" t="6" length="80" width="0.3" height="0.8"/>'
    sign = '<signals><signal id="4" type="1" s="250" t="-6" zOffset="2" height="0.6"/></signals>'
    bank = '<lateralProfile><superelevation s="0" a="0.03" b="0" c="0" d="0"/></lateralProfile>'
    things = site_data.HOUSE.replace("</objects>", f"{rail}</objects>") + sign + bank
    rise = '<elevation s="0" a="5" b="0.02" c="0" d="0"/>'
    road = site_data.road(1, (1000, 2000, 0.4), 600, more=things, elevation=rise)
    return write_map(folder, "road.xodr", site_data.open_drive(road))


MAPS: dict[str, Callable[[Path], Path]] = {
    "straight": lambda folder: write_map(folder, "a.xodr", site_data.straight()),
    "hill": lambda folder: write_map(folder, "a.xodr", site_data.hill()),
    "long_road": long_road,
    "roundabout": lambda folder: site_data.roundabout(folder, sumo_folder() / "bin/netconvert"),
}


@pytest.mark.parametrize("name", MAPS)
def test_what_an_import_of_opendrive_or_a_network_writes_passes_check(
    tmp_path: Path, infrasim: Infrasim, name: str
) -> None:
    import_map(MAPS[name](tmp_path), tmp_path / "site")
    done = infrasim("check", tmp_path / "site/site.yaml")
    assert done.returncode == 0, done.stderr
    warned = [line for line in done.stderr.splitlines() if "no-trajectories" not in line]
    assert [line for line in warned if ": mount " not in line] == []


@pytest.mark.parametrize("name", ["long_road", "roundabout"])
def test_what_an_import_writes_passes_check_with_its_traffic(
    tmp_path: Path, infrasim: Infrasim, name: str
) -> None:
    import_map(MAPS[name](tmp_path), tmp_path / "site")
    words = ["site", "traffic", str(tmp_path / "site"), "--vehicles-per-hour", "1500"]
    assert main([*words, "--seconds", "40"]) == 0
    done = infrasim("check", tmp_path / "site/site.yaml", "--traffic")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("yaw_deg", "text"),
    [
        (0, "90 degrees (east)"),
        (90, "0 degrees (north)"),
        (90.3, "0 degrees (north)"),
        (-135, "225 degrees (south-west)"),
    ],
)
def test_a_yaw_is_a_compass_bearing(yaw_deg: float, text: str) -> None:
    assert looks_to(yaw_deg) == text


def test_readers_of_networks_close_their_file(tmp_path: Path) -> None:
    edge = '<edge id="a"><lane id="a_0" shape="0,0 1,nan"/></edge>'
    location = '<location netOffset="0,0" projParameter="!"/>'
    file = tmp_path / "map.net.xml"
    file.write_text(f"<net>{location}{edge}{edge * 1000}</net>")
    gc.disable()  # a collection would close the file
    try:
        assert network_projection(file) is None
        with pytest.raises(MapError, match="shape"):
            read_network(file)
        open_files = [os.path.realpath(f) for f in Path("/proc/self/fd").iterdir()]
    finally:
        gc.enable()
    assert str(file.resolve()) not in open_files
