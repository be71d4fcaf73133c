"""Makers' tables of beams become LiDAR files that the simulator reads."""

import json
import math
from pathlib import Path

import pytest

from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.dataset.lidars import read_sheet
from pyinfra.exchange.beam_tables import read_beam_table, write_lidar_file

VLP_16 = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)


def ouster(nested: bool) -> str:
    beams = {
        "beam_altitude_angles": [round(16.2 - k, 2) for k in range(32)],
        "beam_azimuth_angles": [3.1 if k % 2 else -3.1 for k in range(32)],
    }
    layout = {"columns_per_frame": 1024}
    more = {"lidar_data_format": layout, "prod_line": "OS-1-32", "lidar_mode": "1024x20"}
    return json.dumps({"beam_intrinsics": beams, **more} if nested else {**beams, **more})


def velodyne() -> str:
    lasers = (
        f"- {{laser_id: {k}, rot_correction: {math.radians(k / 10)!r}, "
        f"vert_correction: {math.radians(e)!r}}}\n"
        for k, e in enumerate(VLP_16)
    )
    return "lasers:\n" + "".join(lasers) + "num_lasers: 16\n"


def veloview() -> str:
    items = "".join(
        f"<item><px><id_>{k}</id_><rotCorrection_>{k / 10}</rotCorrection_>"
        f"<vertCorrection_>{e}</vertCorrection_></px></item>"
        for k, e in enumerate(VLP_16)
    )
    return f"<boost_serialization><DB><points_>{items}</points_></DB></boost_serialization>"


HESAI = "Laser id,Elevation,Azimuth\n1,14.9,-1.04\n2,11.0,1.04\n3,8.1,0\n"
TABLES = {
    "ouster.json": (ouster(True), "Ouster", 32, (16.2, -3.1)),
    "flat.json": (ouster(False), "Ouster", 32, (16.2, -3.1)),
    "vlp.yaml": (velodyne(), "Velodyne", 16, (-15.0, 0.0)),
    "vlp.xml": (veloview(), "Velodyne", 16, (-15.0, 0.0)),
    "hesai.csv": ("\ufeff" + HESAI, "Hesai", 3, (14.9, -1.04)),
    "hesai_times.csv": (
        "Channel,Firetime,Elevation,Azimuth\n1,5.6,14.9,-1.04\n2,7,11,1.04\n3,9,8.1,0\n",
        *("Hesai", 3, (14.9, -1.04)),
    ),
    "hesai_azimuth.csv": (
        "Azimuth,No,Elevation,Laser id\n-1.04,x,14.9,1\n1.04,x,11.0,2\n0,x,8.1,3\n",
        *("Hesai", 3, (14.9, -1.04)),
    ),
    "hesai_commas.csv": (
        "Channel;Firetime;Elevation;Azimuth\n1;5,6;14,9;-1,04\n2;7;11;1,04\n;;deg;deg\n",
        *("Hesai", 2, (14.9, -1.04)),
    ),
    "hesai_tabs.csv": (
        "Laser id\tElevation\tAzimuth\r\n1\t14,9\t-1,04\r\n",
        *("Hesai", 1, (14.9, -1.04)),
    ),
    "robosense_commas.csv": ("-13,5;2,1\n-1,1;0,5\n", "RoboSense", 2, (-13.5, 2.1)),
    "robosense_blanks.csv": ("-13.5 2.1\n -1.1  0.5\n", "RoboSense", 2, (-13.5, 2.1)),
    "robosense.csv": ("-13.5,2.1\n-1.1,0.5\n4.3,-2\n", "RoboSense", 3, (-13.5, 2.1)),
}


@pytest.mark.parametrize("name", TABLES)
def test_beams_of_each_maker(name: str, tmp_path: Path) -> None:
    text, maker, count, first = TABLES[name]
    (tmp_path / name).write_text(text, encoding="utf-8")
    table = read_beam_table(tmp_path / name)
    assert (table.maker, len(table.beams)) == (maker, count)
    assert table.beams[0] == pytest.approx(first)
    if maker == "Velodyne":
        assert table.beams[10][1] == pytest.approx(-1)  # rot_correction reduces the azimuth


def test_the_file_is_a_lidar_that_the_simulator_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.json").write_text(ouster(True))
    words = ["lidars", "--from-table", str(tmp_path / "a.json"), "--out", str(tmp_path / "os.yaml")]
    assert main.main(words) == 0
    assert "32 beams of Ouster" in capsys.readouterr().out
    sheet = read_sheet(tmp_path / "os.yaml", "")
    assert (sheet.lines, sheet.model) == (32, "OS-1-32")
    assert sheet.vertical_fov_deg == pytest.approx(31)


def test_rays_of_livox(tmp_path: Path) -> None:
    rows = "".join(f"{k / 240000},{k % 360},{60 + k % 40}\n" for k in range(1, 2000))
    (tmp_path / "a.csv").write_text("Time/s,Azimuth/deg,Zenith/deg\n" + rows)
    table = read_beam_table(tmp_path / "a.csv")
    assert table.rays is not None
    assert table.rays[0] == pytest.approx((1, 29, 1 / 240000))
    (tmp_path / "b.csv").write_text("Zenith/deg;Azimuth/deg;Time/s\n61,5;1,25;0,1\n")
    assert read_beam_table(tmp_path / "b.csv").rays == [pytest.approx((1.25, 28.5, 0.1))]
    write_lidar_file(table, tmp_path / "mid.yaml")
    assert math.isfinite(read_sheet(tmp_path / "mid.yaml", "").vertical_fov_deg)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", '{"a": 1}', "expected Ouster's beam_altitude_angles .* got the keys a"),
        ("a.json", "[", "cannot be read"),
        ("a.yaml", "a: 1", "expected Velodyne's key 'lasers', got the keys a"),
        ("a.yaml", "lasers: [{vert_correction: x}]", "expected a finite number, got 'x'"),
        ("a.yaml", "lasers: [{vert_correction: 15}]", "expected an elevation of -90 to 90 degrees"),
        ("a.xml", "<a/>", "expected Velodyne's elements <vertCorrection_>"),
        ("a.csv", "x,y,z\n", "expected a table of Hesai"),
        ("a.csv", HESAI.replace("14.9", "14,9"), ":2: expected 3 columns, got 4.*decimal point"),
        ("a.csv", HESAI.replace("14.9", "x"), ":2: Elevation: expected a finite number, got 'x'"),
        ("a.csv", "a,azimuth,zenith\n1,2,3\n", ":1: expected a column with 'time', got a, azimu"),
        ("a.csv", "-13.5,2.1\n-1.1\n", ":2: expected 2 columns, got 1"),
    ],
)
def test_other_content_is_named(name: str, text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=message):
        read_beam_table(tmp_path / name)
