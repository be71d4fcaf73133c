"""LiDARs with a firing table: units, times, and data sets that contain the table."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import Infrasim

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.dataset.data_set import field_of_view_mask
from pyinfra.experiments.stress import lidar as stress_lidar
from pyinfra.formats import kitti
from pyinfra.metrics import scan_patterns
from pyinfra.viz.clouds import sector

ROWS = 500
FRAMES = "0:3"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Writes `parts/own.yaml` with a table beside it. The table is in degrees, and its rays are
    fired in bursts of five."""
    parts = tmp_path / "parts"
    parts.mkdir()
    k = np.arange(ROWS)
    rows = {"azimuth_deg": k * 0.72 - 179.9, "elevation_deg": -2.0 - k % 20}
    table = pd.DataFrame(rows).assign(time_s=k // 5 * 5e-4 + k % 5 * 1e-5)
    table.to_csv(parts / "table.csv", index=False)
    write_lidar(parts / "own.yaml", "table.csv")
    return tmp_path


def write_lidar(file: Path, table: str) -> None:
    keys = {
        "name": "own",
        "price_usd": {"low": 1, "high": 1, "source": "made up", "date": "2026"},
        "pattern": {"table": {"file": table}},
        "presets": {"datasheet": {"returns": {"max_range_m": 100}}},
    }
    file.write_text(yaml.safe_dump(keys))


def run(infrasim: Infrasim, folder: Path) -> Path:
    words = ["--lidar", folder / "parts/own.yaml", "--frames", FRAMES, "--out", folder / "data"]
    done = infrasim("run", "configs/scenes/flat.yaml", *words)
    assert done.returncode == 0, done.stderr
    return folder / "data"


def rays(infrasim: Infrasim, file: Path) -> np.ndarray:
    done = infrasim("pattern", file, "--frames", "0:1", "--out", file.with_suffix(".npy"))
    assert done.returncode == 0, done.stderr
    return np.asarray(np.load(file.with_suffix(".npy")))


def test_a_table_in_degrees_with_times_fires_its_rows_at_their_times(
    folder: Path, infrasim: Infrasim
) -> None:
    table = pd.read_csv(folder / "parts/table.csv")
    fired = rays(infrasim, folder / "parts/own.yaml")
    assert len(fired) == pytest.approx(0.1 * ROWS / table.time_s.max() * (ROWS - 1) / ROWS, abs=5)
    np.testing.assert_allclose(np.degrees(fired[:ROWS, 1]), table.elevation_deg, atol=1e-5)
    np.testing.assert_allclose(fired[:ROWS, 2], table.time_s, atol=1e-8)


@pytest.mark.parametrize("kind", ["channels", "table"])
def test_angles_that_look_like_radians_are_reported(
    kind: str, tmp_path: Path, infrasim: Infrasim
) -> None:
    elevation = np.linspace(-25, 12.5, 16)
    file = tmp_path / "own.yaml"
    write_lidar(file, "table.csv")
    keys = {"azimuth_deg": np.linspace(-180, 157.5, 16), "elevation_deg": elevation}
    keys["time_s"] = np.arange(16) / 1000
    if kind == "channels":
        spinning = {"rate_hz": 10, "azimuth_step_deg": 0.2, "channels": {"file": "table.csv"}}
        file.write_text(
            yaml.safe_dump(yaml.safe_load(file.read_text()) | {"pattern": {"spinning": spinning}})
        )
        keys = {"channel": np.arange(16), "elevation_deg": elevation}
        keys |= {"azimuth_offset_deg": np.zeros(16), "fire_time_us": np.arange(16.0)}
    else:  # a free phase of a table that repeats so soon has a warning of its own
        table = yaml.safe_load(file.read_text())
        table["pattern"]["table"]["phase"] = "locked"
        file.write_text(yaml.safe_dump(table))
    for in_degrees in (True, False):
        columns = {
            name: column if in_degrees or name[-3:] != "deg" else np.radians(column)
            for name, column in keys.items()
        }
        pd.DataFrame(columns).to_csv(tmp_path / "table.csv", index=False)
        done = infrasim("check", file)
        assert done.returncode == 0, done.stderr
        assert ("got 16 rows from -0.436" in done.stderr) != in_degrees
        assert ("probably radians" in done.stderr) != in_degrees
    frames = ["--frames", FRAMES, "--out", tmp_path / "data"]
    done = infrasim("run", "configs/scenes/flat.yaml", "--lidar", file, *frames)
    assert "own: elevation_deg: expected degrees" in done.stderr
    with pytest.warns(UserWarning, match="own: elevation_deg: expected degrees"):
        pi.simulate(pi.load_scene("highway", set={"duration_s": 1}), file, [0])


def test_what_pattern_writes_is_a_table(folder: Path, infrasim: Infrasim) -> None:
    first = rays(infrasim, folder / "parts/own.yaml")
    write_lidar(folder / "parts/again.yaml", "own.npy")
    again = rays(infrasim, folder / "parts/again.yaml")
    np.testing.assert_allclose(again[: len(first)], first, atol=1e-6)


def test_the_view_of_a_table_may_go_through_180_degrees(folder: Path, infrasim: Infrasim) -> None:
    k = np.arange(3000)
    ahead, behind = np.array([[50.0, 3.0, -5.0]]), np.array([[-50.0, 3.0, -5.0]])
    lit = []
    for middle_deg, seen, unseen, sides in [
        (0, ahead, behind, "sees from 55 degrees (north-east) to 125 degrees (south-east)"),
        (180, behind, ahead, "sees from 235 degrees (south-west) to 305 degrees (north-west)"),
    ]:
        azimuth = middle_deg - 35 + 70 * (k % 100) / 99
        rows = {"azimuth_deg": azimuth, "elevation_deg": -k // 100 * 0.9, "time_s": k * 1e-5}
        pd.DataFrame(rows).to_csv(folder / "parts/table.csv", index=False)
        data = run(infrasim, folder)
        lidar, tilt = kitti.read_lidar(data / "own"), kitti.read_tilt(data / "own")
        (view,) = lidar.field_of_view
        edges = [middle_deg - 35, middle_deg + 35]
        np.testing.assert_allclose(np.degrees(view.azimuth), edges, atol=0.01)
        assert field_of_view_mask(lidar, tilt, seen)[1].all()
        assert not field_of_view_mask(lidar, tilt, unseen)[0].any()
        outline = sector(view)
        assert (np.sign(outline[1:-1, 0]) == np.sign(seen[0, 0])).all()
        words = ["--lidar", folder / "parts/own.yaml"]
        assert sides in infrasim("check", "configs/scenes/flat.yaml", *words).stderr
        rays = scan_patterns.read_rays(data / "own/lidar.yaml", 0.1, lidar.period_s)
        lit.append(scan_patterns.lit_share(rays).field_deg2.iloc[0])
        shutil.rmtree(data)
    assert lit[1] == pytest.approx(lit[0], rel=0.02)


@pytest.mark.nightly
def test_a_data_set_carries_its_table_to_statistics_and_stress(
    folder: Path, infrasim: Infrasim
) -> None:
    data = run(infrasim, folder)
    clouds = [file.read_bytes() for file in sorted(data.glob("own/training/velodyne/*"))]
    (folder / "parts/table.csv").unlink()
    data = data.rename(folder / "moved")
    assert main.main(["statistics", str(data), "--out", str(folder / "out")]) == 0
    lit = pd.read_csv(folder / "out/lit_share.csv")
    assert lit.lit_percent.max() > 0
    description = data / "own/lidar.yaml"
    tables = stress_lidar.table_files(stress_lidar.read(description), description.parent)
    assert [file.is_file() for file in tables] == [True]
    again = folder / "again.yaml"
    again.write_text(stress_lidar.text(description))
    words = ["--lidar", again, "--frames", FRAMES, "--out", folder / "cast"]
    assert infrasim("run", "configs/scenes/flat.yaml", *words).returncode == 0
    cast = [file.read_bytes() for file in sorted((folder / "cast").glob("own/training/velodyne/*"))]
    assert cast == clouds


def test_a_folder_whose_table_lies_elsewhere_is_resumed(folder: Path, infrasim: Infrasim) -> None:
    data = run(infrasim, folder)
    description = data / "own/lidar.yaml"
    # version 0.3 wrote this name
    before = description.read_text().replace('"table.npy"', '"table.csv"')
    description.write_text(before)
    (data / "own/table.npy").unlink()
    run(infrasim, folder)
    assert description.read_text() == before
    table = pd.read_csv(folder / "parts/table.csv")
    table.assign(elevation_deg=-1.0).to_csv(folder / "parts/table.csv", index=False)
    words = ["--lidar", folder / "parts/own.yaml", "--frames", FRAMES, "--out", data]
    refused = infrasim("run", "configs/scenes/flat.yaml", *words)
    assert refused.returncode != 0
    assert "lidar.yaml" in refused.stderr
