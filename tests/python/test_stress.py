"""`pyinfra stress` on a small simulated road: worlds, resumption, runs to compare, wrong input."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from detector_data import SITE

from pyinfra import cli, kitti
from pyinfra.detectors.background import Background
from pyinfra.stress import cells, worlds
from pyinfra.stress.catalogue import STRESSORS
from pyinfra.stress.command import chosen

ROOT = Path(__file__).resolve().parents[2]
FRAMES = (0, 20, 40)
QUICK = ["drop_out", "yaw_error", "density", "unseen_lidar"]


@pytest.fixture(scope="module")
def data(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Three frames of 16 lines on the motorway; their folder."""
    out = tmp_path_factory.mktemp("stress") / "highway"
    infrasim(*run_command("helios_16", frames="0:41:20", out=out), check=True)
    return out / "helios_16"


@pytest.fixture(scope="module")
def background(data: Path) -> Path:
    """A run that needs no training."""
    run = data.parent.parent / "run"
    run.mkdir()
    clouds = [kitti.read_points(kitti.frame_file(data, "velodyne", k)) for k in FRAMES]
    Background.learn(clouds).save(run / "background.npz")
    return run


@pytest.fixture(scope="module")
def base(data: Path) -> worlds.Base:
    return worlds.read_base(data, 60)


def bytes_of(folder: Path) -> list[bytes]:
    return [kitti.frame_file(folder, "velodyne", k).read_bytes() for k in FRAMES]


def scene_of(folder: Path) -> dict[str, object]:
    found = yaml.safe_load((folder.parent / "dataset.yaml").read_text())
    assert isinstance(found, dict)
    return found


def stress(name: str, dial: float | str, base: worlds.Base, cache: Path) -> Path:
    world = STRESSORS[name].world
    assert world is not None
    return worlds.simulated(base, world(base, dial), cache, name)


# Worlds.


def test_a_world_without_a_change_has_the_same_bytes(
    base: worlds.Base, data: Path, tmp_path: Path
) -> None:
    folder = worlds.simulated(base, worlds.World(), tmp_path, "same")
    assert bytes_of(folder) == bytes_of(data)


def test_a_world_is_simulated_once(base: worlds.Base, tmp_path: Path) -> None:
    folder = stress("density", 2.0, base, tmp_path)
    file = kitti.frame_file(folder, "velodyne", 20)
    before = file.stat().st_mtime_ns
    assert stress("density", 2.0, base, tmp_path) == folder
    assert file.stat().st_mtime_ns == before
    assert stress("density", 3.0, base, tmp_path) != folder


def test_density_and_speed_are_times_the_scenes_own(base: worlds.Base, tmp_path: Path) -> None:
    dense = scene_of(stress("density", 2.0, base, tmp_path))["traffic"]
    fast = scene_of(stress("speed", 1.5, base, tmp_path))["traffic"]
    assert dense["vehicles_per_km_lane"] == 24  # type: ignore[index]
    assert dense["speed"]["mean_km_h"] == 62  # type: ignore[index]
    assert fast["speed"]["mean_km_h"] == 93  # type: ignore[index]


def test_a_tilted_sensor_sees_other_points_of_the_same_boxes(
    base: worlds.Base, data: Path, tmp_path: Path
) -> None:
    folder = stress("tilt", 10.0, base, tmp_path)
    assert "T_levelled_sensor: {pitch_deg: 10," in (folder / "lidar.yaml").read_text()
    before, after = (
        kitti.read_objects(kitti.frame_file(place, "objects", 20)) for place in (data, folder)
    )
    np.testing.assert_array_equal(after.boxes, before.boxes)
    assert (after.points != before.points).any()
    # Ahead it sees the road nearer by than a level sensor, whose lowest ray is 16 degrees down.
    nearest = [
        np.hypot(p[:, 0], p[:, 1])[p[:, 0] > 0].min()
        for p in (kitti.read_points(kitti.frame_file(f, "velodyne", 20)) for f in (data, folder))
    ]
    assert nearest[1] < nearest[0]


def test_all_traffic_is_of_the_class(base: worlds.Base, tmp_path: Path) -> None:
    folder = stress("vehicle_class", "Bus", base, tmp_path)
    names = [kitti.read_objects(kitti.frame_file(folder, "objects", k)).names for k in FRAMES]
    assert set(np.concatenate(names)) == {"Bus"}


def test_another_lidar_preset_and_scene(base: worlds.Base, data: Path, tmp_path: Path) -> None:
    lidar = stress("unseen_lidar", "livox_avia", base, tmp_path)
    assert kitti.read_lidar(lidar).name == "livox_avia"
    preset = kitti.read_lidar(stress("unseen_preset", "equal", base, tmp_path))
    assert (preset.name, preset.preset) == ("helios_16", "equal")
    assert scene_of(stress("unseen_scene", "curve", base, tmp_path))["name"] == "curve"


def test_frames_that_are_not_evenly_spaced_are_in_one_range() -> None:
    assert worlds.frame_words([4100, 4120, 4140]) == "4100:4141:20"
    assert worlds.frame_words([3, 9, 13]) == "3:14:2"
    assert worlds.frame_words([7]) == "7:8:1"


def test_at_most_so_many_frames_evenly_spaced(data: Path) -> None:
    assert worlds.read_base(data, 60).frames == FRAMES
    assert worlds.read_base(data, 2).frames == (0, 40)
    assert worlds.read_base(data, 1).frames == (0,)


# The command.


def command(background: Path, data: Path, out: Path, *words: str) -> list[str]:
    return ["stress", str(background), "--data", str(data), "--out", str(out), *words]


def rows(out: Path) -> pd.DataFrame:
    return pd.read_csv(out / "stress.csv").sort_values(["stressor", "dial"], ignore_index=True)


@pytest.fixture(scope="module")
def whole(background: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A test that nothing disturbed."""
    out = tmp_path_factory.mktemp("whole")
    assert cli.main(command(background, data, out, "--stressors", *QUICK)) == 0
    return out


def test_every_dial_has_its_row(whole: Path) -> None:
    table = rows(whole)
    assert table.groupby("stressor").size().to_dict() == {
        "none": 1,
        "drop_out": 4,
        "yaw_error": 4,
        "density": 2,
        "unseen_lidar": 3,
    }
    assert set(table.detector) == {"background"}
    assert set(table.lidar) == {"helios_16"}
    assert set(table.frames) == {3}
    row = table[(table.stressor == "density") & (table.dial == "2")].iloc[0]
    assert row.command == "pyinfra stress --stressors density --dials 2 --seed 1 --frames 3"
    for name in ("stress_summary.csv", "stress_ranking.csv", "stress_highway_paper_helios_16.svg"):
        assert (whole / name).stat().st_size > 50
    assert set(pd.read_csv(whole / "stress_summary.csv").stressor) == set(QUICK)


def test_a_killed_test_goes_on_to_the_same_rows(
    whole: Path, background: Path, data: Path, tmp_path: Path
) -> None:
    words = command(background, data, tmp_path, "--stressors", *QUICK)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, "-m", "pyinfra", *words], env=environment)
    file = tmp_path / "stress.csv"
    while not file.is_file() or len(file.read_text().splitlines()) < 6:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = file.read_text()
    assert len(kept.splitlines()) < 15
    assert cli.main(words) == 0
    assert file.read_text().startswith(kept)
    pd.testing.assert_frame_equal(rows(tmp_path), rows(whole))


def test_a_finished_cell_is_not_computed_again(
    whole: Path, background: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (whole / "stress.csv").read_bytes()
    monkeypatch.setattr(cells, "row_of", lambda *_: pytest.fail("computed again"))
    assert cli.main(command(background, data, whole, "--stressors", *QUICK)) == 0
    assert (whole / "stress.csv").read_bytes() == before


def test_a_cell_that_another_process_holds_is_left_to_it(
    background: Path, base: worlds.Base, tmp_path: Path
) -> None:
    run = cells.read_run(background, base)
    (cell,) = cells.plan([run], {}, base)
    name = "_".join(cells.key_of(cell, base, 1).values())
    with cells.held(tmp_path / "locks" / name, wait=False) as ours:
        assert ours
        assert not cells.fill(cell, base, tmp_path, 1)
    assert cells.fill(cell, base, tmp_path, 1)
    assert not cells.fill(cell, base, tmp_path, 1)


def test_chosen_dials_and_a_dry_run(
    background: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["--stressors", "fog", "--dials", "0", "3", "7", "--dry-run"]
    assert cli.main(command(background, data, out, *words)) == 0
    *listed, last = capsys.readouterr().out.splitlines()
    assert listed == ["run none 0.0", "run fog 3.0", "run fog 7.0"]
    assert last.startswith("3 of 3 cells to do, 3 frames each, ")
    assert not out.exists()


def test_runs_of_one_detector_are_dials_of_the_training(base: worlds.Base) -> None:
    first = cells.Run(Path("a"), "pointpillars", 800, 1)
    fewer = cells.Run(Path("b"), "pointpillars", 200, 1)
    seed = cells.Run(Path("c"), "pointpillars", 800, 2)
    stressors = chosen(["fog", "training_frames", "training_seed"], None)
    found = cells.plan([first, fewer, seed], stressors, base)
    trained = [(c.run, c.stressor.name, c.dial) for c in found if c.stressor.acts_on == "training"]
    named = [row for row in trained if row[1] != "none"]
    assert named == [(fewer, "training_frames", 200.0), (seed, "training_seed", "2")]
    assert all(c.reference is first for c in found)
    assert sum(c.stressor.name == "fog" for c in found) == 4
    with pytest.raises(ValueError, match="found 200 frames and seed 2, allowed another number"):
        cells.plan([first, cells.Run(Path("d"), "pointpillars", 200, 2)], stressors, base)


def untrained(folder: Path, frames: int, lidar: str = "helios_16") -> Path:
    """A run of a small PointPillars that learnt nothing."""
    pytest.importorskip("torch", reason="the extra `detectors` is not installed")
    from pyinfra.config import as_plain
    from pyinfra.detectors import pointpillars
    from pyinfra.training import checkpoint

    config = pointpillars.Config()
    network = checkpoint.build("pointpillars", config, SITE)
    names = {"lidar": lidar, "preset": "paper", "scene": "highway"}
    about = checkpoint.About(
        "pointpillars", as_plain(config), SITE, **names, seed=1, step=1, steps=1
    )
    folder.mkdir()
    checkpoint.save(folder / "last.safetensors", network, {}, about)
    (folder / "run.yaml").write_text(f"frames: {frames}\n")
    return folder


def test_a_smaller_training_is_a_row_of_its_reference(data: Path, tmp_path: Path) -> None:
    runs = [untrained(tmp_path / "a", 800), untrained(tmp_path / "b", 200)]
    words = ["--data", str(data), "--out", str(tmp_path), "--stressors", "training_frames"]
    assert cli.main(["stress", *map(str, runs), *words]) == 0
    table = pd.read_csv(tmp_path / "stress.csv")
    columns = ["detector", "run", "stressor", "dial", "trained_frames", "trained_seed"]
    assert table[columns].to_numpy().tolist() == [
        ["pointpillars", "a", "none", 0, 800, 1],
        ["pointpillars", "a", "training_frames", 200, 200, 1],
    ]
    (curve,) = pd.read_csv(tmp_path / "stress_summary.csv").to_dict("records")
    assert curve["dials"] == 2


def test_a_run_of_another_lidar_is_one_line(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = untrained(tmp_path / "run", 800, "ruby_plus")
    assert cli.main(["stress", str(run), "--data", str(data), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith("lidar: found ruby_plus, allowed helios_16\n")


def test_the_own_lidar_scene_and_preset_are_no_stress(base: worlds.Base) -> None:
    run = cells.Run(Path("a"), "background", -1, -1)
    stressors = chosen(["unseen_lidar", "unseen_scene", "unseen_preset"], None)
    dials = {cell.dial for cell in cells.plan([run], stressors, base)}
    assert dials.isdisjoint({"own", "helios_16", "highway", "paper"})
    assert {"ruby_plus", "curve", "datasheet"} <= dials


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--stressors", "snow"], "--stressors: found 'snow', allowed drop_out, rain, "),
        (["--dials", "1"], "--dials: found it without one stressor of clouds or worlds"),
        (["--stressors", "training_seed", "--dials", "1"], "--dials: found it without one"),
        (["--stressors", "fog", "--dials", "much"], "--dials: found 'much', allowed a number"),
        (["--stressors", "fog", "--dials", "-3"], "--dials: found '-3', allowed a number from 0"),
        (["--stressors", "unseen_scene", "--dials", "moon"], "--dials: found 'moon', allowed"),
        (["--frames", "0"], "--frames: found 0, allowed 1 or more"),
    ],
)
def test_wrong_words_are_one_line(
    words: list[str],
    message: str,
    background: Path,
    data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(command(background, data, tmp_path / "out", *words)) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"pyinfra: {message}")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_wrong_folders_are_one_line(
    background: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(command(background, data.parent, tmp_path)) == 2
    assert "found a data set, allowed a LiDAR of it: helios_16" in capsys.readouterr().err
    assert cli.main(command(tmp_path, data, tmp_path)) == 1
    assert "No last.safetensors or background.npz in it" in capsys.readouterr().err
    (tmp_path / "stress.csv").write_text("a,b\n1,2\n")
    assert cli.main(command(background, data, tmp_path)) == 2
    assert "stress.csv:1: found no column detector" in capsys.readouterr().err


def test_a_recorded_folder_takes_stress_on_clouds_but_not_on_worlds(
    background: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without dataset.yaml nobody knows the world."""
    recorded = tmp_path / "site" / "helios_16"
    recorded.parent.mkdir()
    recorded.symlink_to(data)
    out = tmp_path / "out"
    assert cli.main(command(background, recorded, out, "--stressors", "fog")) == 0
    assert cli.main(command(background, recorded, out, "--stressors", "tilt")) == 2
    assert "found no dataset.yaml, allowed --stressors of clouds" in capsys.readouterr().err
