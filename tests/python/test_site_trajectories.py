"""Trajectories from other sources as the traffic of a site, and errors in them."""

import gzip
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import traffic_data as data
from message_pattern import pattern

from pyinfra.cli import main
from pyinfra.core.arrays import FloatArray
from pyinfra.formats.kitti import (
    Labels,
    frame_file,
    simulated,
    write_calibration,
    write_labels,
)
from pyinfra.scenes.maps.box_links import link
from pyinfra.scenes.maps.openstreetmap import transverse_mercator

GOOD = data.csv(data.drive())
FCD = data.fcd(data.drive())


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "corner"
    folder.mkdir()
    (folder / "site.yaml").write_text(data.SITE)
    return folder


def imported(site: Path, file: Path, *words: str) -> pd.DataFrame:
    assert main.main(["site", "trajectories", str(file), "--out", str(site), *words]) == 0
    return pd.read_csv(site / "trajectories.csv")


def test_boxes_that_move_well_stay_as_they_are(site: Path) -> None:
    file = site / "in.csv"
    file.write_text(data.HEADER + GOOD)
    table = imported(site, file)
    rows = data.drive()
    np.testing.assert_allclose(table["t"], rows[:, 0], atol=1e-9)
    np.testing.assert_allclose(table["x"], rows[:, 1], atol=1e-4)
    assert set(table["dx"]) == {4.5}


def test_own_names_frames_and_degrees(site: Path) -> None:
    rows = data.drive(rate_hz=25)
    frame = pd.DataFrame({
        "number": np.arange(len(rows)) + 700, "id": 5, "kind": "auto", "center_x": rows[:, 2],
        "y": rows[:, 1], "z": 0.75, "yaw": 90.0, "dx": 4.5, "dy": 1.9, "dz": 1.5,
    })  # fmt: skip
    frame.to_csv(site / "in.csv", index=False)
    columns = "x=center_x,heading=yaw,class=kind,frame=number"
    words = ["--columns", columns, "--class-of", "auto=Car", "--rate-hz", "25", "--degrees"]
    table = imported(site, site / "in.csv", *words)
    assert table["t"].to_list() == pytest.approx(np.arange(81) / 10)
    np.testing.assert_allclose(table["y"], table["t"] * 10, atol=1e-3)
    np.testing.assert_allclose(table["heading"], np.pi / 2, atol=1e-5)


def test_positions_are_those_of_the_map_by_default(site: Path) -> None:
    (site / "map.yaml").write_text("offset_m: [100, -20, 5]\n")
    for name, text in (("in.csv", data.HEADER + GOOD), ("in.xml", FCD)):
        (site / name).write_text(text)
        of_map, of_site = imported(site, site / name), imported(site, site / name, "--world")
        for axis, metres in (("x", 100), ("y", -20), ("z", 5)):
            np.testing.assert_allclose(of_site[axis] - of_map[axis], metres, atol=2e-4)


LON, LAT = 11.57, 48.14
METRES_A_DEGREE = (74_423, 111_193)  # at LAT


def degrees(rows: FloatArray, digits: int = 6) -> str:
    """Converts the vehicle of `rows` to degrees, as SUMO writes it with --fcd-output.geo."""
    text = data.fcd(rows)
    for axis, start, metres in (("x", LON, METRES_A_DEGREE[0]), ("y", LAT, METRES_A_DEGREE[1])):
        text = re.sub(
            rf' {axis}="([^"]+)"',
            lambda m, a=axis, b=start, c=metres: f' {a}="{b + float(m[1]) / c:.{digits}f}"',
            text,
        )
    return text


NET = (
    '<net><location netOffset="{}" convBoundary="0,0,9,9" origBoundary="0,0,9,9" '
    'projParameter="{}"/></net>'
)


def utm_offset() -> str:
    """Returns the offset that moves LON, LAT to 0, 0. It uses the series for short distances from
    the meridian of 9 degrees."""
    x, y = (transverse_mercator(np.array([LON, LAT]), (9.0, 0.0))[0] * 0.9996).tolist()
    return f"{-x - 5e5!r},{-y!r}"


@pytest.mark.parametrize("speeds", [True, False])
@pytest.mark.parametrize("net", ["none", "tmerc", "utm"])
def test_degrees_of_a_site_are_its_metres(site: Path, net: str, speeds: bool) -> None:
    text = degrees(data.drive())
    (site / "fcd.xml").write_text(text if speeds else text.replace(' speed="10"', ""))
    (site / "map.yaml").write_text("offset_m: [100, -20, 5]\n")
    if net == "none":
        (site / "site.yaml").unlink()
    else:
        tmerc = f"+proj=tmerc +lat_0={LAT} +lon_0={LON} +k=1 +ellps=WGS84 +units=m +no_defs"
        utm = "+proj=utm +zone=32 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
        chosen = {"tmerc": ("0,0", tmerc), "utm": (utm_offset(), utm)}[net]
        (site / "map.net.xml").write_text(NET.format(*chosen))
    table = imported(site, site / "fcd.xml")
    start = -40 if net == "none" else 0  # without a site, 0 is the middle of the path
    # rad; angle between the grid of the UTM zone and north at this position
    convergence = 0.0335 if net == "utm" else 0.0
    np.testing.assert_allclose(table["x"], start + 10 * table["t"] - 4.53 / 2, atol=0.2)
    np.testing.assert_allclose(table["y"], convergence * (table["x"] - start), atol=0.3)


def test_degrees_are_refused_where_nothing_says_the_place(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (site / "fcd.xml").write_text(degrees(data.drive()))
    rows = data.drive()
    rows[:, 1:3] = (LON, LAT) + rows[:, 1:3] / METRES_A_DEGREE
    (site / "boxes.csv").write_text(
        data.HEADER + "".join(f"{t},a,Car,{x:.7f},{y:.7f},1,0,4,2,1.5\n" for t, x, y, _ in rows)
    )
    far = NET.format("0,0", "+proj=tmerc +lat_0=40 +lon_0=11 +ellps=WGS84")
    unknown = NET.format("0,0", "+proj=lcc +lat_1=40 +lat_2=44 +lon_0=11 +ellps=WGS84")
    for name, net in (
        ("fcd.xml", NET.format("0,0", "!")),
        ("fcd.xml", far),
        ("fcd.xml", unknown),
        ("boxes.csv", far),
    ):
        (site / "map.net.xml").write_text(net)
        assert main.main(["site", "trajectories", str(site / name), "--out", str(site)]) == 2
        assert not (site / "trajectories.csv").exists()
        assert capsys.readouterr().err.count("\n") == 1


def test_standing_and_slow_metres_near_the_origin_stay_metres(site: Path) -> None:
    """All of these values could be longitude and latitude. A vehicle that stands does not move in
    either unit."""
    tmerc = f"+proj=tmerc +lat_0={LAT} +lon_0={LON} +k=1 +ellps=WGS84"
    (site / "map.net.xml").write_text(NET.format("0,0", tmerc))
    for speed in (0, 0.5):
        (site / "fcd.xml").write_text(data.fcd(data.drive(speed_m_s=speed)))
        table = imported(site, site / "fcd.xml")
        assert table["x"].iloc[-1] == pytest.approx(8 * speed - 4.53 / 2, abs=0.01)
        text = data.fcd(data.drive(speed_m_s=speed)).replace('speed="10"', f'speed="{speed}"')
        (site / "fcd.xml").write_text(text)
        assert imported(site, site / "fcd.xml")["x"].iloc[-1] == table["x"].iloc[-1]


def test_a_queue_in_degrees_stands_beside_its_site(site: Path) -> None:
    tmerc = f"+proj=tmerc +lat_0={LAT} +lon_0={LON} +k=1 +ellps=WGS84"
    (site / "map.net.xml").write_text(NET.format("0,0", tmerc))
    rows = data.drive(speed_m_s=0) + np.array([0, 30, 40, 0])
    (site / "fcd.xml").write_text(degrees(rows).replace('speed="10"', 'speed="0"'))
    table = imported(site, site / "fcd.xml")
    np.testing.assert_allclose(table[["x", "y"]].to_numpy()[0], (30 - 4.53 / 2, 40), atol=0.1)


@pytest.mark.parametrize(
    ("kind", "words", "taken"),
    [
        ("", [], "Car"),
        ("", ["--class-of", "=Van"], "Van"),
        ("Car", [], "Car"),
        ("coach", [], "Bus"),
        ("BUS", [], "Bus"),
        ("truck_truck", [], "Truck"),
        ("a=b", ["--class-of", "a=b=Bus"], "Bus"),
    ],
)
def test_types_and_none_are_classes(site: Path, kind: str, words: list[str], taken: str) -> None:
    text = data.fcd(data.drive(), kind)
    (site / "fcd.xml").write_text(text if kind else text.replace(' type=""', ""))
    assert set(imported(site, site / "fcd.xml", *words)["class"]) == {taken}


def test_a_person_without_a_type_walks_and_may_share_an_id(site: Path) -> None:
    text = data.fcd(data.drive(speed_m_s=1)).replace(' type="passenger"', "")
    person = re.sub(r"<vehicle(.*?)/>", r"<vehicle\1/><person\1/>", text)
    person = re.sub(r'(<person[^>]* y=)"[^"]*"', r'\1"9"', person)
    (site / "fcd.xml").write_text(person)
    table = imported(site, site / "fcd.xml")
    assert sorted(set(table["class"])) == ["Car", "Pedestrian"]


def test_without_angles_vehicles_look_where_they_drive(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = data.drive()
    rows[:, 1:3] = rows[:, 1:2] * (-0.6, 0.8)
    rows[:20, 1:3] = rows[20, 1:3]  # the vehicle stands at first
    text = re.sub(r' angle="[^"]*"', "", data.fcd(rows))
    still = '<vehicle id="b" x="30" y="9" type="passenger"/></timestep>'
    (site / "fcd.xml").write_text(text.replace("</timestep>", still))
    table = imported(site, site / "fcd.xml")
    np.testing.assert_allclose(table["heading"], np.arctan2(0.8, -0.6), atol=0.02)
    assert "b: left out: it has no angle and never moves" in capsys.readouterr().out


@pytest.mark.parametrize("words", ["Car", "a=Lorry", "=", "a=Car,b"])
def test_a_class_that_is_none_of_ours_is_refused(site: Path, words: str) -> None:
    with pytest.raises(SystemExit):
        main.main(["site", "trajectories", "a.xml", "--out", str(site), "--class-of", words])


@pytest.mark.parametrize("packed", [False, True])
def test_sumo_front_bumpers_become_centres(site: Path, packed: bool) -> None:
    file = site / ("fcd.xml.gz" if packed else "fcd.xml")
    file.write_bytes(gzip.compress(FCD.encode()) if packed else FCD.encode())
    table = imported(site, file)
    np.testing.assert_allclose(table["x"], 10 * table["t"] - 4.53 / 2, atol=1e-3)
    np.testing.assert_allclose(table["heading"], 0, atol=1e-5)


def test_short_gaps_are_filled_and_long_ones_cut(
    site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = data.drive(20)
    kept = np.ones(len(rows), bool)
    kept[50:55] = kept[100:120] = False
    (site / "in.csv").write_text(data.HEADER + data.csv(rows[kept]))
    table = imported(site, site / "in.csv")
    assert "cut at 9.9 s: gap of 2.1 s" in capsys.readouterr().out
    assert table.groupby("id")["t"].count().to_list() == [100, 81]


def test_a_jump_of_the_place_cuts(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = data.drive(8)
    rows[40:, 2] += 50
    (site / "in.csv").write_text(data.HEADER + data.csv(rows))
    assert imported(site, site / "in.csv")["id"].nunique() == 2
    assert "jump of 50.0 m" in capsys.readouterr().out


def test_boxes_without_ids_are_linked(site: Path) -> None:
    there, back = data.drive(), data.drive()
    back[:, 1:] = np.column_stack([80 - back[:, 1], 0 * back[:, 0] + 4, 0 * back[:, 0] + np.pi])
    text = (data.HEADER + data.csv(there) + data.csv(back)).replace(",a,", ",")
    (site / "in.csv").write_text(text.replace("t,id,class", "t,class"))
    table = imported(site, site / "in.csv")
    assert table["id"].nunique() == 2
    assert all(part["y"].nunique() == 1 for _, part in table.groupby("id"))


def test_boxes_with_unknown_ids_are_linked(site: Path) -> None:
    """Table programs write -1.0 for an unknown id, and 7.0 for the id 7."""
    there, back = data.drive(), data.drive()
    back[:, 1:] = np.column_stack([80 - back[:, 1], 0 * back[:, 0] + 4, 0 * back[:, 0] + np.pi])
    lost = back.copy()
    lost[:, 2] += 4
    known = [row.replace(",a,", ",7," if k % 2 else ",7.0,") for k, row in rows_of(there)]
    unknown = [row.replace(",a,", ",-1.0," if k % 2 else ",nan,") for k, row in rows_of(back)]
    also = [row.replace(",a,", ",,") for _, row in rows_of(lost)]
    (site / "in.csv").write_text(data.HEADER + "\n".join([*known, *unknown, *also]) + "\n")
    table = imported(site, site / "in.csv")
    assert table["id"].nunique() == 3
    assert all(part["y"].nunique() == 1 for _, part in table.groupby("id"))


def rows_of(drive: FloatArray) -> list[tuple[int, str]]:
    return list(enumerate(data.csv(drive).splitlines()))


def test_links_bridge_a_lost_frame_and_never_join_two_classes() -> None:
    times = np.array([0, 0.1, 0.3, 0.3])
    boxes = np.zeros((4, 7))
    boxes[:, 0] = [0, 1, 3, 3.1]
    tracks = link(times, boxes, np.array(["Car", "Car", "Car", "Pedestrian"]))
    assert tracks.tolist() == [0, 0, 0, 1]


BROKEN = {
    "empty": ("", ":1: expected each column name once, got an empty file"),
    "no rows": (data.HEADER, "expected one or more rows, got none"),
    "no column": (
        "t,id,class,x,y\n0,1,Car,1,1\n",
        "expected a column 'heading', got the columns t, id, class, x, y; --columns maps",
    ),
    "cut line": (data.HEADER + GOOD[:-20], ":82: expected 10 columns, got 7"),
    "not finite": (data.HEADER + GOOD.replace("0.1000,a,Car,1.0000", "0.1000,a,Car,nan"), ":3: x"),
    "infinite": (
        data.HEADER + GOOD.replace("Car,1.0000", "Car,inf"),
        ":3: x: expected ..., got 'inf'",
    ),
    "no number": (
        data.HEADER + GOOD.replace("Car,1.0000", "Car,far"),
        ":3: x: expected ..., got 'far'",
    ),
    "negative size": (
        data.HEADER + GOOD.replace(",4.5,1.9", ",-4.5,1.9"),
        ":2: dx: expected ..., got '-4.5'",
    ),
    "no size": (data.HEADER + GOOD.replace(",1.9,", ",0,"), ":2: dy: expected ..., got '0'"),
    "huge": (data.HEADER + GOOD.replace("4.5", "4500"), ":2: dx: expected ..., got '4500'"),
    "class": (data.HEADER + GOOD.replace("Car", "Tram"), ":2: class: expected ...; got 'Tram'"),
    "order": (data.HEADER + "".join(reversed(GOOD.splitlines(True))), "expected ascending times"),
    "twice": (data.HEADER + GOOD + GOOD, "expected ascending times"),
    "degrees": (
        data.HEADER + data.csv(data.drive() + np.array([0, 0, 0, 45])),
        "set --degrees",
    ),
    "clock": (
        data.HEADER + GOOD + data.csv(data.drive() + np.array([99999, 0, 0, 0])),
        "clock may have jumped",
    ),
    "two classes": (
        data.HEADER + GOOD.replace("Car", "Bus", 9),
        "expected one class for each object, got ... for object 'a'",
    ),
    "too short": (
        data.HEADER + data.csv(data.drive(0.5)),
        "expected one or more usable tracks, got none",
    ),
    "bytes": ("\0\1\2\n", ":1: expected a column 'x'"),
}
BROKEN_XML = {
    "cut": (FCD[:900], "got broken XML"),
    "other": ("<routes/>", "expected <fcd-export>"),
    "nobody": ("<fcd-export/>", "expected one or more vehicles or people, got none"),
    "type": (data.fcd(data.drive(), "tram"), "got type 'tram'"),
    "time": (FCD.replace('"0.20"', '"0.05"'), "timestep 3: time: expected above 0.1, got 0.05"),
    "clock": (
        FCD.replace('"0.20"', '"nan"'),
        "timestep 3: time: expected seconds from -1e8 to 1e8",
    ),
    "place": (FCD.replace('x="2.0000"', 'x="nan"'), "time 0.2: a: x: expected a number, got 'nan'"),
    "wrong angle": (
        FCD.replace('angle="90.00"', 'angle="east"', 1),
        "angle: expected a number, got 'east'",
    ),
    "type in words": (data.fcd(data.drive(), "my tram"), "--class-of 'my tram=Car'"),
    "a long type": (data.fcd(data.drive(), 60 * "a"), f"--class-of {60 * 'a'}=Car"),
    "no id": (FCD.replace('id="a"', ""), "expected an id for each <vehicle>, got none"),
}


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [(f"{name}.csv", *row) for name, row in BROKEN.items()]
    + [(f"{name}.xml", *row) for name, row in BROKEN_XML.items()]
    + [("plain.gz", FCD, "expected a complete .gz file, got a damaged file")],
)
def test_a_broken_file_gives_one_line_and_leaves_the_site(
    site: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, expected: str
) -> None:
    (site / "trajectories.csv").write_text("before")
    (site / name).write_text(text)
    code = main.main(["site", "trajectories", str(site / name), "--out", str(site)])
    out, err = capsys.readouterr()
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"pyinfra: {site / name}")
    assert re.search(pattern(expected), err)
    assert (site / "trajectories.csv").read_text() == "before"


def test_a_million_vehicles_are_refused(
    site: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from pyinfra.scenes.maps import fcd, recorded_boxes

    monkeypatch.setattr(recorded_boxes, "MOST_OBJECTS", 50)
    monkeypatch.setattr(fcd, "MOST_OBJECTS", 50)
    lines = [f"0,{i},Car,{10 * i},0,0.75,0,4.5,1.9,1.5\n" for i in range(60)]
    (site / "many.csv").write_text(data.HEADER + "".join(lines))
    each = "".join(f'<vehicle id="{i}" x="0" y="0" angle="0"/>' for i in range(60))
    (site / "many.xml").write_text(f'<fcd-export><timestep time="0">{each}</timestep></fcd-export>')
    for name in ("many.csv", "many.xml"):
        assert main.main(["site", "trajectories", str(site / name), "--out", str(site)]) == 2
        assert "50" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "words", "message"),
    [
        ({"heading": np.pi / 2}, ["--degrees"], "heading: expected the direction of motion"),
        ({"heading": 1.0}, [], r"headings that are off by 33 degrees"),
        ({"heading": 0.0}, [], r"headings that are off by 90 degrees"),
        ({"dx": 1.9, "dy": 4.5}, [], "1 of 1 vehicles that are wider than long"),
    ],
)
def test_boxes_that_contradict_their_motion_are_refused(
    site: Path,
    change: dict[str, float],
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = data.drive()
    table = pd.DataFrame({
        "t": rows[:, 0], "id": 5, "class": "Car", "x": rows[:, 2], "y": rows[:, 1], "z": 0.75,
        "heading": np.pi / 2, "dx": 4.5, "dy": 1.9, "dz": 1.5,
    })  # fmt: skip
    table.to_csv(site / "in.csv", index=False)
    assert set(imported(site, site / "in.csv")["heading"].round(4)) == {1.5708}
    table.assign(heading=-np.pi / 2).to_csv(site / "in.csv", index=False)  # it reverses
    imported(site, site / "in.csv")
    table.assign(**change).to_csv(site / "in.csv", index=False)
    capsys.readouterr()
    command = ["site", "trajectories", str(site / "in.csv"), "--out", str(site), *words]
    assert main.main(command) == 2
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.parametrize(
    ("lane_m", "note"),
    [(0.0, ""), (0.75, "0.75 m below the lanes (median)"), (-9, "9.00 m above the lanes")],
)
def test_boxes_off_the_lanes_are_reported(
    site: Path, lane_m: float, note: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"a,{x},0,{lane_m},3.5\n" for x in range(-20, 120, 4))
    (site / "lanes.csv").write_text(f"lane,x,y,z,width\n{rows}")
    for name, text in (("in.csv", data.HEADER + GOOD), ("in.xml", FCD)):
        (site / name).write_text(text)
        imported(site, site / name)
        out = capsys.readouterr().out
        assert note in out
        assert ("bottoms of vehicles" in out) == bool(note)


@pytest.mark.parametrize("behind_m", [None, 0.27])
def test_labels_of_frames_are_linked_in_world_coordinates(
    behind_m: float | None, site: Path, tmp_path: Path
) -> None:
    """The camera may be at another place than the sensor."""
    camera = simulated()
    camera.Tr_velo_to_cam[2, 3] -= behind_m or 0
    lidar = tmp_path / "lidar"
    for part in ("velodyne", "label_2", "calib"):
        (lidar / "training" / part).mkdir(parents=True)
    (lidar / "lidar.yaml").write_text(
        "name: lidar\nmodel: m\npreset: datasheet\nperiod_s: 0.1\n"
        "price_total_usd: {low: 1, high: 1}\n"
        "label_time: frame\nT_world_levelled: {x_m: 5, y_m: 7, z_m: 6, yaw_deg: 90}\n"
        "T_levelled_sensor: {pitch_deg: 0, roll_deg: 0}\n"
        "field_of_view: [{yaw_deg: 0, pitch_deg: 0, azimuth_deg: [-180, 180], "
        "elevation_deg: [-20, 20], range_m: [0, 100]}]\n"
    )
    for k in range(30):
        boxes = np.array([[k * 1.0, -3, -5.25, 4.5, 1.9, 1.5, 0]])
        labels = Labels(np.array(["Car"]), boxes, None, None)
        write_labels(frame_file(lidar, "label_2", k), labels, camera)
        if behind_m is not None:
            write_calibration(frame_file(lidar, "calib", k), camera)
        frame_file(lidar, "velodyne", k).write_bytes(b"")
    table = imported(site, lidar)
    assert table["id"].nunique() == 1
    np.testing.assert_allclose(table["x"], 8, atol=0.01)
    np.testing.assert_allclose(table["y"], 7 + 10 * table["t"], atol=0.02)
    np.testing.assert_allclose(table["heading"], np.pi / 2, atol=1e-3)
