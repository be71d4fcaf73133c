"""The table of hit points, the pictures, and the `pyinfra` command around them."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pyinfra import cli
from pyinfra.commands import demo
from pyinfra.data import paper_tables
from pyinfra.drawing import clouds
from pyinfra.simulator import catalogue, runs
from pyinfra.statistics import hit_points

SUMMARY = """\
lidar,preset,frames,rays_per_frame,hits_per_frame,vehicles_per_frame,vehicle_points_per_frame,seconds,mrays_per_s
livox_avia,paper,2,24000,900.5,1,10,0.1,1
helios_16,paper,2,28800,220,1,10,0.1,1
"""
PAPER = pd.DataFrame(
    {
        "lidar": ["livox_avia", "helios_16", "livox_avia"],
        "scene": ["highway", "highway", "curve"],
        "hits": [1000, 200, 500],
    }
)
FLAT = pd.Series({"livox_avia": 2000.0, "helios_16": 100.0})


def simulated(*rows: tuple[str, str, float]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["lidar", "scene", "hits"])


def test_hits_are_read_from_a_summary(tmp_path: Path) -> None:
    file = tmp_path / "summary.csv"
    file.write_text(SUMMARY)
    assert runs.read_hits(file).to_dict() == {"livox_avia": 900.5, "helios_16": 220}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hits_per_frame", "hits", "found no column hits_per_frame"),
        ("paper,2", "paper,0", "without frames"),
        (SUMMARY[SUMMARY.index("livox") :], "", "without frames"),
    ],
)
def test_summary_without_hits_is_an_error(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "summary.csv"
    file.write_text(SUMMARY.replace(old, new))
    with pytest.raises(ValueError, match=message):
        runs.read_hits(file)


def test_errors_are_relative_to_the_paper() -> None:
    table = hit_points.compare(
        simulated(("livox_avia", "highway", 900), ("helios_16", "highway", 220)), FLAT, PAPER
    )
    assert table["lidar"].tolist() == ["livox_avia", "helios_16"]
    assert table["paper"].tolist() == [1000, 200]
    np.testing.assert_allclose(table["error"], [-0.1, 0.1])
    np.testing.assert_allclose(table["flat_error"], [1.0, -0.5])


def test_scene_that_the_paper_does_not_have_has_no_error() -> None:
    table = hit_points.compare(simulated(("livox_avia", "tunnel", 900)), FLAT, PAPER)
    assert table[["paper", "error", "flat_error"]].isna().all(axis=None)
    assert table["simulated"].tolist() == [900]
    text = hit_points.table_text(table)
    assert "mean error" not in text
    assert "nan" not in text


def test_printed_table_has_the_mean_and_the_largest_error() -> None:
    table = hit_points.compare(
        simulated(
            ("livox_avia", "highway", 900),
            ("helios_16", "highway", 204),
            ("livox_avia", "curve", 500),
        ),
        FLAT,
        PAPER,
    )
    text = hit_points.table_text(table)
    assert "simulated: mean error 4.0%, largest 10.0% (highway, livox_avia)" in text
    assert "flat ground: mean error 150.0%, largest 300.0% (curve, livox_avia)" in text
    assert "+2.0%" in text


def test_written_table_reads_back(tmp_path: Path) -> None:
    table = hit_points.compare(simulated(("livox_avia", "highway", 912.34)), FLAT, PAPER)
    file = tmp_path / "deep/hit_points.csv"
    hit_points.write_table(table, file)
    (row,) = pd.read_csv(file).to_dict("records")
    assert row["simulated"] == 912.3
    assert row["error"] == -0.0877
    assert [path.name for path in file.parent.iterdir()] == ["hit_points.csv"]


def test_paper_has_a_figure_for_every_scene_and_lidar() -> None:
    paper = paper_tables.paper_hits()
    pairs = set(zip(paper["scene"], paper["lidar"], strict=True))
    assert pairs == {(scene, lidar) for scene in catalogue.SCENES for lidar in catalogue.LIDARS}


def test_short_run_is_near_the_paper_and_asked_once(tmp_path: Path) -> None:
    scenes = [catalogue.scene_file("crossroad")]
    lidars = [catalogue.lidar_file(name) for name in ("livox_avia", "pandar_64")]
    steps: list[str] = []
    table = hit_points.hit_table(scenes, lidars, "0:75:25", cache=tmp_path, say=steps.append)
    assert len(steps) == 2
    assert table["lidar"].tolist() == ["livox_avia", "pandar_64"]
    assert (table["error"].abs() < 0.05).all()
    assert (table["flat_error"].abs() < 0.05).all()

    summaries = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert len(summaries) == 2
    again = hit_points.hit_table(scenes, lidars, "0:75:25", cache=tmp_path)
    pd.testing.assert_frame_equal(again, table)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == summaries


def test_flat_ground_is_the_level_ground_of_the_arithmetic() -> None:
    """A channel at elevation e from 6 m hits flat ground at 6 / sin(-e); the range is 100 m."""
    found = runs.hits_per_frame(
        catalogue.scene_file("flat"), [catalogue.lidar_file("pandar_64")], "0:20"
    )
    elevations = np.radians(np.linspace(-25, 15, 64))
    ranges = 6 / np.sin(-elevations[elevations < 0])
    ranges = ranges[ranges < 100]
    # CARLA: 45 % dropped; of the rest, below intensity 0.8, a share of 0.4 - 0.5 I is dropped too.
    intensity = np.exp(-0.004 * ranges)
    kept = 0.55 * np.where(intensity > 0.8, 1, 1 - (0.4 - 0.5 * intensity))
    assert found["pandar_64"] == pytest.approx(1800 * kept.sum(), rel=0.01)


def test_wrong_configuration_keeps_the_message_of_the_binary(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text("name: [1\n")
    with pytest.raises(runs.SimulatorError, match=r"infrasim check: .*scene\.yaml:") as error:
        runs.hits_per_frame(scene, [catalogue.lidar_file("pandar_64")], "0:1")
    assert error.value.exit_code == 2


def test_pictures_of_a_short_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = tmp_path / "highway"
    lidars = [catalogue.lidar_file(name) for name in ("livox_avia", "helios_16")]
    runs.simulate(catalogue.scene_file("highway"), lidars, "2:3", data)
    assert cli.main(["pictures", str(data), "--frame", "2", "--out", str(tmp_path / "out")]) == 0
    names = [Path(line).name for line in capsys.readouterr().out.splitlines()]
    views = ["sheet.png", "highway_helios_16.png", "highway_livox_avia.png"]
    assert names == [*views, "plan_highway.png", "cutouts_highway.png"]
    for name in views:
        with Image.open(tmp_path / "out" / name) as image:
            colours = image.convert("RGB").getcolors() or []
            assert min(image.size) > 200
        seen = {colour for _, colour in colours}
        assert (0, 32, 91) in seen, "no box of a vehicle with many points"  # 00205B
        assert (213, 94, 0) in seen, "no crossed-out box of a missed vehicle"  # D55E00
    assert cli.main(["pictures", str(data), "--frame", "-1", "--out", str(tmp_path / "out")]) == 2
    assert "--frame: found -1, allowed 2 to 2" in capsys.readouterr().err
    (data / "helios_16/training/velodyne/000002.bin").unlink()
    assert cli.main(["pictures", str(data), "--frame", "2", "--out", str(tmp_path / "out")]) == 2
    assert "found 2, allowed none, as the folder has no frame" in capsys.readouterr().err


def test_rays_on_a_car_are_counted_per_frame() -> None:
    middle = clouds.CAR.mean(axis=0)
    rays = np.array([[*middle, 0.01], [*middle, 0.11], [*middle, 0.19], [0.5, 0.5, 0.05]])
    figure = clouds.pattern_picture({"four rays": rays})
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["four rays\n2 rays in 0.1 s", "on a car's rear at 60 m:\n2 rays on average"]


@pytest.mark.slow
def test_demo_writes_all_it_names_and_resumes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "SCENES", ("highway",))
    monkeypatch.setattr(demo, "LIDARS", ("livox_avia", "helios_16"))
    command = ["demo", "--out", str(tmp_path), "--frames", "4:6"]
    assert cli.main(command) == 0
    first = capsys.readouterr()
    named = [Path(line.split()[-1]) for line in first.out.splitlines() if str(tmp_path) in line]
    assert len(named) == 2 + 4
    assert all(path.exists() for path in named)
    assert "mean error" in first.out
    assert "pictures" in first.err
    frame = tmp_path / "data/highway/helios_16/training/velodyne/000004.bin"
    before = frame.stat().st_mtime_ns
    assert cli.main(command) == 0
    assert capsys.readouterr().out == first.out
    assert frame.stat().st_mtime_ns == before


def pyinfra(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "pyinfra", *words], capture_output=True, text=True, cwd=cwd
    )


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], 2),
        (["nothing"], 2),
        (["demo", "--frames"], 2),
        (["demo", "--frames", "5:2"], 2),
        (["demo", "--frames", "0:999999"], 2),
        (["pictures", "missing", "--out", "out"], 1),
    ],
)
def test_errors_are_one_line_on_stderr(tmp_path: Path, words: list[str], code: int) -> None:
    done = pyinfra(*words, cwd=tmp_path)
    assert done.returncode == code
    assert done.stdout == ""
    messages = [line for line in done.stderr.splitlines() if not line.startswith("[")]
    assert len(messages) == 1
    assert messages[0].startswith("pyinfra")


@pytest.mark.parametrize("command", [command.name for command in cli.COMMANDS])
def test_help_of_every_command_has_an_example(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as done:
        cli.main([command, "--help"])
    assert done.value.code == 0
    assert f"example: pyinfra {command}" in capsys.readouterr().out


def test_closed_pipe_is_no_traceback(tmp_path: Path) -> None:
    data = tmp_path / "highway"
    runs.simulate(catalogue.scene_file("highway"), [catalogue.lidar_file("helios_16")], "0:1", data)
    words = ["pictures", str(data), "--out", str(tmp_path / "out")]
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write) as pipe:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "pyinfra", *words],
            stdout=pipe,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
        )
    assert (done.returncode, done.stderr) == (1, "")
