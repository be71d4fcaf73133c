"""`pyinfra stress` on a small simulated road: altered scenes, resumed tests, and comparisons of
runs."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from detector_data import SITE

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset.runs import SimulatorError
from pyinfra.experiments.stress import altered_scenes, lidar, runner, trials
from pyinfra.experiments.stress.stressors import STRESSORS, chosen
from pyinfra.formats import kitti
from pyinfra.models.detectors.background import Background

ROOT = Path(__file__).resolve().parents[2]
FRAMES = (0, 20, 40)
QUICK = ["drop_out", "yaw_error", "density", "unseen_lidar"]


@pytest.fixture(scope="module")
def data(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Simulates three frames of a LiDAR with 16 lines on the motorway. Returns the LiDAR's
    folder."""
    out = tmp_path_factory.mktemp("stress") / "highway"
    infrasim(*run_command("helios_16", frames="0:41:20", out=out), check=True)
    return out / "helios_16"


@pytest.fixture(scope="module")
def background(data: Path) -> Path:
    """Writes a run of Background, which needs no training labels."""
    run = data.parent.parent / "run"
    run.mkdir()
    clouds = [kitti.read_points(kitti.frame_file(data, "velodyne", k)) for k in FRAMES]
    Background.learn(clouds).save(run / "background.npz")
    return run


@pytest.fixture(scope="module")
def base(data: Path) -> altered_scenes.Base:
    return altered_scenes.read_base(data, 60)


def test_frames_without_a_split_are_tested_where_trainings_do_not_learn(
    data: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "ring"
    (folder / "training/velodyne").mkdir(parents=True)
    shutil.copy(data / "lidar.yaml", folder)
    for k in (0, 1000, 4050):
        (folder / f"training/velodyne/{k:06d}.bin").touch()
    assert altered_scenes.read_base(folder, 60).frames == (0, 1000, 4050)  # too few for a split
    for k in (4100, 4500):
        (folder / f"training/velodyne/{k:06d}.bin").touch()
    assert altered_scenes.read_base(folder, 60).frames == (4100, 4500)


def bytes_of(folder: Path) -> list[bytes]:
    return [kitti.frame_file(folder, "velodyne", k).read_bytes() for k in FRAMES]


def scene_of(folder: Path) -> dict[str, object]:
    scene = yaml.safe_load((folder.parent / "dataset.yaml").read_text())
    assert isinstance(scene, dict)
    return scene


def stress(name: str, severity: float | str, base: altered_scenes.Base, cache: Path) -> Path:
    change = STRESSORS[name].scene_change
    assert change is not None
    return altered_scenes.simulated(base, change(base, severity), cache, name)


# Altered scenes.


def test_a_scene_without_a_change_has_the_same_bytes(
    base: altered_scenes.Base, data: Path, tmp_path: Path
) -> None:
    folder = altered_scenes.simulated(base, altered_scenes.AlteredScene(), tmp_path, "same")
    assert bytes_of(folder) == bytes_of(data)


def test_an_altered_scene_is_simulated_once(base: altered_scenes.Base, tmp_path: Path) -> None:
    folder = stress("density", 2.0, base, tmp_path)
    file = kitti.frame_file(folder, "velodyne", 20)
    before = file.stat().st_mtime_ns
    assert stress("density", 2.0, base, tmp_path) == folder
    assert file.stat().st_mtime_ns == before
    assert stress("density", 3.0, base, tmp_path) != folder


def test_density_and_speed_are_multiples_of_the_scenes(
    base: altered_scenes.Base, tmp_path: Path
) -> None:
    dense = scene_of(stress("density", 2.0, base, tmp_path))["traffic"]
    fast = scene_of(stress("speed", 1.5, base, tmp_path))["traffic"]
    assert dense["vehicles_per_km_lane"] == 24  # type: ignore[index]
    assert dense["speed"]["mean_km_h"] == 62  # type: ignore[index]
    assert fast["speed"]["mean_km_h"] == 93  # type: ignore[index]


def test_a_tilted_sensor_sees_other_points_of_the_same_boxes(
    base: altered_scenes.Base, data: Path, tmp_path: Path
) -> None:
    folder = stress("tilt", 10.0, base, tmp_path)
    assert "T_levelled_sensor: {pitch_deg: 10," in (folder / "lidar.yaml").read_text()
    before, after = (
        kitti.read_objects(kitti.frame_file(path, "objects", 20)) for path in (data, folder)
    )
    np.testing.assert_array_equal(after.boxes, before.boxes)
    assert (after.points != before.points).any()
    # The lowest ray of the level sensor looks 16 degrees down. The tilted sensor therefore sees the
    # road nearer to the pole.
    nearest = [
        np.hypot(p[:, 0], p[:, 1])[p[:, 0] > 0].min()
        for p in (kitti.read_points(kitti.frame_file(f, "velodyne", 20)) for f in (data, folder))
    ]
    assert nearest[1] < nearest[0]


def test_tilt_is_added_to_the_pitch_of_the_mount(base: altered_scenes.Base) -> None:
    mounts = {"pole": {"pitch_deg": 10}, "level": {}}
    down = replace(base, scene=base.scene | {"mounts": mounts})
    assert altered_scenes.tilt(down, 5.0).set == (
        "mounts.pole.pitch_deg=15",
        "mounts.level.pitch_deg=5",
    )


def cut_angles_of(folder: Path) -> list[float]:
    units = lidar.units_of(lidar.read(folder / "lidar.yaml"))
    return [unit["pattern"]["spinning"]["cut_angle_deg"] for unit in units]


def test_a_turned_cut_angle_leaves_the_boxes_of_mid_frame_and_moves_those_of_the_scan(
    base: altered_scenes.Base, data: Path, tmp_path: Path
) -> None:
    folder = stress("cut_angle", 90.0, base, tmp_path)
    assert (cut_angles_of(data), cut_angles_of(folder)) == ([180], [270])
    before, after = (
        kitti.read_objects(kitti.frame_file(path, "objects", 20)) for path in (data, folder)
    )
    np.testing.assert_array_equal(after.boxes, before.boxes)
    hit = (before.points > 0) & (after.points > 0)
    assert np.abs(after.scan_time_s - before.scan_time_s)[hit].min() > 0.02
    assert kitti.read_label_time(folder) == kitti.read_label_time(data)


def test_random_phases_differ_and_each_is_the_same_again(
    base: altered_scenes.Base, tmp_path: Path
) -> None:
    cut_angles = [cut_angles_of(stress("phase", f"sample_{n}", base, tmp_path))[0] for n in (1, 2)]
    assert len({180.0, *cut_angles}) == 3
    assert altered_scenes.phase(base, "sample_1") == altered_scenes.phase(base, "sample_1")
    turns = altered_scenes.phase(base, "sample_1").turns_deg
    assert len(set(turns)) == len(turns) == altered_scenes.PHASES  # one angle per unit


def test_labels_of_an_altered_scene_hold_when_those_of_the_base_do(
    base: altered_scenes.Base, tmp_path: Path
) -> None:
    """This is also true for another scene with its own label time."""
    asked = replace(base, lidar=replace(base.lidar, label_time="scan"))
    folder = stress("unseen_scene", "curve", asked, tmp_path)
    assert kitti.read_label_time(folder) == "scan"


def test_all_traffic_is_of_the_class(base: altered_scenes.Base, tmp_path: Path) -> None:
    folder = stress("vehicle_class", "Bus", base, tmp_path)
    names = [kitti.read_objects(kitti.frame_file(folder, "objects", k)).names for k in FRAMES]
    assert set(np.concatenate(names)) == {"Bus"}


def test_another_lidar_preset_and_scene(
    base: altered_scenes.Base, data: Path, tmp_path: Path
) -> None:
    lidar = stress("unseen_lidar", "livox_avia", base, tmp_path)
    assert kitti.read_lidar(lidar).name == "livox_avia"
    preset = kitti.read_lidar(stress("unseen_preset", "equal", base, tmp_path))
    assert (preset.name, preset.preset) == ("helios_16", "equal")
    assert scene_of(stress("unseen_scene", "curve", base, tmp_path))["name"] == "curve"


def test_frames_that_are_not_evenly_spaced_are_in_one_range() -> None:
    assert altered_scenes.frame_words([4100, 4120, 4140]) == "4100:4141:20"
    assert altered_scenes.frame_words([3, 9, 13]) == "3:14:2"
    assert altered_scenes.frame_words([7]) == "7:8:1"


def test_at_most_so_many_frames_evenly_spaced(data: Path) -> None:
    assert altered_scenes.read_base(data, 60).frames == FRAMES
    assert altered_scenes.read_base(data, 2).frames == (0, 40)
    assert altered_scenes.read_base(data, 1).frames == (0,)


# Own LiDARs.

OTHER_LINES = {"count": 8, "upper_deg": 2, "lower_deg": -20}
SPINNING = {"rate_hz": 10, "azimuth_step_deg": 0.4, "channels": OTHER_LINES}
Made = Callable[..., Path]


def custom_lidar(folder: Path, name: str, **keys: Any) -> Path:
    """Writes the file of a LiDAR without presets. It has eight lines, or the given keys."""
    single = {
        "price_usd": {"low": 1, "high": 2, "source": "nobody", "date": "2026"},
        "pattern": {"spinning": SPINNING},
        "returns": {"max_range_m": 120, "range_accuracy_m": 0.02},
    }
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump({"name": name} | (keys if "bundle" in keys else single | keys)))
    return file


@pytest.fixture
def made(
    infrasim: Callable[..., Any], run_command: Callable[..., list[str]], tmp_path: Path
) -> Made:
    """Returns a function that simulates the three frames with an own LiDAR, and returns the LiDAR's
    folder."""

    def make(file: Path, preset: str = "paper", scene: Path | None = None) -> Path:
        out = tmp_path / f"data_{file.stem}"
        words = run_command(frames="0:41:20", preset=preset, out=out)
        words[words.index("--lidar") + 1] = str(file)
        if scene is not None:
            first = words.index("--set")
            words = ["run", str(scene), *words[2:first], *words[first + 4 :]]
        infrasim(*words, check=True)
        return out / file.stem

    return make


def lidars_of_all_kinds(folder: Path) -> dict[str, Path]:
    part = custom_lidar(folder, "part")
    rays = np.column_stack([np.linspace(-1, 1, 500), np.tile([-0.1, -0.2], 250)])
    np.save(folder / "table.npy", rays)
    table = {"table": {"file": "table.npy", "rays_per_s": 50000}}
    parts = [{"lidar": "part.yaml", "pitch_deg": 10}, {"lidar": "table.yaml", "yaw_deg": 180}]
    return {
        "lines": part,
        "table": custom_lidar(folder, "table", pattern=table),
        "tilted": custom_lidar(folder, "tilted", bundle=parts[:1]),
        "bundle": custom_lidar(folder, "bundle", bundle=parts),
        "shipped name": custom_lidar(folder, "helios_16"),
        "free": custom_lidar(
            folder, "ruby_plus", pattern={"spinning": SPINNING | {"phase": "free"}}
        ),
    }


@pytest.mark.parametrize("kind", ["lines", "table", "tilted", "bundle", "shipped name", "free"])
def test_an_altered_scene_is_cast_with_the_lidar_of_the_frames(
    kind: str, made: Made, tmp_path: Path
) -> None:
    file = lidars_of_all_kinds(tmp_path / "lidars")[kind]
    folder = made(file)
    for table in (tmp_path / "lidars").glob("table.npy"):
        table.rename(folder / table.name)
    base = altered_scenes.read_base(folder, 60)
    same = altered_scenes.simulated(base, altered_scenes.AlteredScene(), tmp_path / "cache", "same")
    assert bytes_of(same) == bytes_of(folder)
    assert len(bytes_of(same)[0]) > 1000


def test_another_lidar_of_the_same_name_is_another_altered_scene(
    made: Made, data: Path, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    other = altered_scenes.read_base(made(custom_lidar(tmp_path, "helios_16")), 60)
    shipped = replace(other, folder=data)
    results = [
        altered_scenes.simulated(b, altered_scenes.AlteredScene(), cache, "same")
        for b in (other, shipped)
    ]
    assert results[0] != results[1]


def test_a_changed_lidar_of_the_catalogue_is_simulated_again(
    base: altered_scenes.Base, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = stress("unseen_lidar", "livox_avia", base, tmp_path)
    assert stress("unseen_lidar", "livox_avia", base, tmp_path) == before
    file = tmp_path / "livox_avia.yaml"
    text = altered_scenes.lidar_file("livox_avia").read_text()
    file.write_text(text.replace("max_range_m: 260", "max_range_m: 50"))
    assert file.read_text() != text
    monkeypatch.setattr(altered_scenes, "lidar_file", lambda _: file)
    after = stress("unseen_lidar", "livox_avia", base, tmp_path)
    assert len(bytes_of(after)[0]) < len(bytes_of(before)[0])


@pytest.mark.nightly
def test_an_own_lidar_goes_through_all_but_its_unknown_presets(
    made: Made, background: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["fog", "tilt", "unseen_lidar", "unseen_preset"]
    folder, out = made(custom_lidar(tmp_path, "mine")), tmp_path / "out"
    assert main.main(command(background, folder, out, "--stressors", *names)) == 0
    error = capsys.readouterr().err
    assert error.startswith("pyinfra: note: left out unseen_preset: ")
    assert "lidar.yaml: name: expected a LiDAR of the catalogue, got 'mine'" in error
    assert rows(out).stressor.value_counts().to_dict() == {
        "none": 1,
        "fog": 4,
        "tilt": 4,
        "unseen_lidar": 4,
    }
    assert set(pd.read_csv(out / "stress_summary.csv").stressor) == set(names[:3])


def reasons(names: list[str], base: altered_scenes.Base) -> dict[str, list[str]]:
    return trials.left_out([STRESSORS[name] for name in names], base)


def test_a_lidar_without_a_cut_angle_is_left_out_of_cut_angle_and_phase(
    made: Made, tmp_path: Path
) -> None:
    table = lidars_of_all_kinds(tmp_path / "lidars")["table"]
    base = altered_scenes.read_base(made(table), 60)
    (tmp_path / "lidars/table.npy").rename(base.folder / "table.npy")
    ((why, names),) = reasons(["cut_angle", "phase", "tilt"], base).items()
    assert names == ["cut_angle", "phase"]
    assert why.endswith("lidar.yaml: pattern: expected a spinning unit for a cut angle, got none")


def test_the_presets_of_a_changed_lidar_are_unknown(made: Made, tmp_path: Path) -> None:
    base = altered_scenes.read_base(made(custom_lidar(tmp_path, "helios_16")), 60)
    ((why, names),) = reasons(["tilt", "unseen_preset", "unseen_lidar"], base).items()
    assert names == ["unseen_preset"]
    assert "lidar.yaml: pattern: expected the value of the catalogue, in " in why


def test_a_shipped_lidar_can_take_every_stressor_but_those_between_poles(
    base: altered_scenes.Base,
) -> None:
    assert list(trials.left_out(STRESSORS.values(), base).values()) == [["pole_clock", "pole_yaw"]]


def test_other_lidars_need_a_preset_of_the_catalogue(made: Made, tmp_path: Path) -> None:
    base = altered_scenes.read_base(made(custom_lidar(tmp_path, "mine"), preset="rainy"), 60)
    ((why, names),) = reasons(["tilt", "unseen_lidar"], base).items()
    assert names == ["unseen_lidar"]
    assert "preset: expected paper, equal, datasheet, " in why
    assert why.endswith(", got 'rainy'")


def test_a_list_of_directions_must_lie_beside_the_frames(made: Made, tmp_path: Path) -> None:
    folder = made(lidars_of_all_kinds(tmp_path / "lidars")["table"])
    base = altered_scenes.read_base(folder, 60)
    assert not reasons(["tilt"], base)  # the run wrote the table to this folder
    (folder / "table.npy").unlink()
    ((why, names),) = reasons(["tilt", "unseen_lidar", "unseen_scene"], base).items()
    assert names == ["tilt", "unseen_scene"]
    assert f"pattern.table.file: expected the file {folder / 'table.npy'}, got none" in why


def test_the_first_difference_of_two_lidars_is_named(base: altered_scenes.Base) -> None:
    description = lidar.read(base.folder / "lidar.yaml")
    assert lidar.difference(description, description) == ""
    assert lidar.difference(description, description | {"price_usd": {"low": 1}}) == ""
    assert lidar.difference(description, description | {"name": "mine"}) == "name"
    assert lidar.difference(description, description | {"returns": {"max_range_m": 1}}) == "returns"
    units = lidar.units_of(description)
    assert lidar.difference(description, description | {"bundle": units}) == ""
    assert lidar.difference(description, description | {"bundle": units * 2}) == "bundle"
    assert (
        lidar.difference(description, description | {"bundle": [units[0] | {"pitch_deg": 3}]})
        == "pitch_deg"
    )


# Recorded trajectories.


@pytest.fixture
def recorded(infrasim: Callable[..., Any], made: Made, tmp_path: Path) -> Path:
    """Simulates the motorway with vehicles from a file beside the scene, for the LiDAR with eight
    lines."""
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    words = ["--set", "duration_s=20", "--set", "traffic.warm_up_s=5"]
    highway, file = "configs/scenes/highway.yaml", scenes / "t.csv"
    infrasim("trajectories", highway, *words, "--out", file, check=True)
    keys = yaml.safe_load((ROOT / highway).read_text()) | {
        "duration_s": 20,
        "trajectories": "t.csv",
    }
    (scenes / "own.yaml").write_text(
        yaml.safe_dump({k: v for k, v in keys.items() if k != "traffic"})
    )
    return made(custom_lidar(tmp_path, "mine"), scene=scenes / "own.yaml")


def test_recorded_trajectories_come_from_beside_the_frames(recorded: Path, tmp_path: Path) -> None:
    (tmp_path / "scenes/t.csv").unlink()
    base = altered_scenes.read_base(recorded, 60)
    cache = tmp_path / "cache"
    same = altered_scenes.simulated(base, altered_scenes.AlteredScene(), cache, "same")
    assert bytes_of(same) == bytes_of(recorded)
    objects = [
        [kitti.frame_file(path, "objects", k).read_bytes() for k in FRAMES]
        for path in (recorded, same)
    ]
    assert objects[0] == objects[1]
    file = recorded.parent / "trajectories.csv"
    file.write_text(file.read_text().replace(",Car,", ",Van,"))
    assert altered_scenes.simulated(base, altered_scenes.AlteredScene(), cache, "same") != same


@pytest.mark.nightly
def test_recorded_trajectories_have_no_density_and_no_speed(
    recorded: Path, background: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names, out = ["density", "speed", "tilt", "vehicle_class"], tmp_path / "out"
    assert main.main(command(background, recorded, out, "--stressors", *names)) == 0
    error = capsys.readouterr().err
    assert error.startswith("pyinfra: note: left out density, speed, vehicle_class: ")
    assert "dataset.yaml: traffic: expected simulated traffic, got recorded trajectories" in error
    assert set(rows(out).stressor) == {"none", "tilt"}
    (recorded.parent / "trajectories.csv").unlink()
    assert main.main(command(background, recorded, tmp_path / "2", "--stressors", "tilt")) == 2
    assert (
        "trajectories.csv: expected this file, got none; the scene is simulated again"
        in capsys.readouterr().err
    )


# Altered scenes that fail.


def test_a_wrong_scene_is_named_before_the_first_trial_and_the_rest_is_measured(
    background: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--stressors", "speed", "--severities", "1.5", "100"]
    assert main.main(command(background, data, tmp_path, *words, "--dry-run")) == 1
    output = capsys.readouterr()
    assert output.out.splitlines()[:-1] == ["run none 0.0", "run speed 1.5"]
    assert main.main(command(background, data, tmp_path, *words)) == 1
    first, last = capsys.readouterr().err.splitlines()
    assert first.startswith("pyinfra: speed 100.0 failed: infrasim check: --set traffic.speed")
    assert "mean_km_h: expected above 0 to 200, got '6200'" in first
    assert last == "pyinfra: 1 of 3 trials failed; the same command tries them again"
    assert rows(tmp_path).severity.tolist() == [0, 1.5]
    assert pd.read_csv(tmp_path / "stress_summary.csv").severities.tolist() == [2]


@pytest.mark.nightly
def test_a_scene_that_fails_on_the_way_leaves_the_others_their_rows_and_figures(
    background: Path,
    data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulated = altered_scenes.simulated

    def failing(
        base: altered_scenes.Base, changed: altered_scenes.AlteredScene, *rest: Any
    ) -> Path:
        if changed.scene == "curve":
            raise SimulatorError("infrasim run: disk full", 1)
        return simulated(base, changed, *rest)

    monkeypatch.setattr(altered_scenes, "simulated", failing)
    words = command(background, data, tmp_path, "--stressors", "unseen_scene", "fog")
    assert main.main(words) == 1
    error = capsys.readouterr().err.splitlines()
    assert error[0] == "pyinfra: run unseen_scene curve failed: infrasim run: disk full"
    assert set(rows(tmp_path).severity) == {"0", "5", "10", "20", "40", "crossroad"}
    for name in ("stress_summary.csv", "stress_ranking.csv", "stress_highway_paper_helios_16.svg"):
        assert (tmp_path / name).stat().st_size > 50
    monkeypatch.setattr(altered_scenes, "simulated", simulated)
    assert main.main(words) == 0
    assert "curve" in set(rows(tmp_path).severity)


@pytest.mark.nightly
def test_a_notebook_stresses_a_detector_as_the_command_does(
    background: Path, data: Path, tmp_path: Path
) -> None:
    """The rows and the summary are equal. Existing rows are not computed again, and a plot has the
    curve."""
    assert main.main(command(background, data, tmp_path / "a", "--stressors", "drop_out")) == 0
    lines: list[str] = []
    how: dict[str, Any] = {"stressors": ["drop_out"], "progress": lines.append}
    table = pi.stress(background, data, work=tmp_path / "b", **how)
    written = pd.read_csv(tmp_path / "a/stress_summary.csv")
    assert table.stressor.tolist() == written.stressor.tolist() == ["drop_out"]
    assert table.ap_least.tolist() == pytest.approx(written.ap_least.tolist(), rel=1e-3)
    assert len(lines) == len(rows(tmp_path / "b"))
    pi.stress(background, data, work=tmp_path / "b", **how)
    assert len(lines) == len(rows(tmp_path / "b"))
    assert len(pi.plot_stress(tmp_path / "b", "drop_out").lines) == 1
    with pytest.raises(pi.Error, match="did you mean 'drop_out'"):
        pi.plot_stress(tmp_path / "b", "drop_uot")
    with pytest.raises(pi.Error, match=r"names: drop_out$"):
        pi.plot_stress(tmp_path / "b", "unlike_any_name")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"stressors": ["rian"]}, "stressors: .*did you mean 'rain'"),
        ({"frames": 0}, "frames: expected 1 or more"),
        ({"severities": [1]}, "severities: "),
        ({"stressors": ["rain"], "severities": [-1]}, "severities: "),
        ({"models": []}, "models: expected one or more"),
        ({"models": 3}, "models: "),
        ({"data": "/no/such"}, "data: "),
    ],
)
def test_a_wrong_stress_test_is_named(
    background: Path, data: Path, tmp_path: Path, words: dict[str, Any], message: str
) -> None:
    usual = {"models": background, "data": data, "work": tmp_path / "work"}
    with pytest.raises(pi.Error, match=message):
        pi.stress(**(usual | words))


def test_a_stressor_by_name_that_is_left_out_is_warned_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = runner.Prepared(None, [], [], {}, {"the preset has no weather": ["rain"]})
    monkeypatch.setattr(runner, "prepare", lambda *_: plan)
    monkeypatch.setattr(trials, "write_summary", lambda _: [])
    monkeypatch.setattr(trials, "read", lambda _: pd.DataFrame())
    monkeypatch.setattr(runner.summary, "summary", lambda table: table)
    with pytest.warns(UserWarning, match="left out rain: the preset has no weather"):
        pi.stress("background", tmp_path, work=tmp_path, stressors=["rain"])
    pi.stress("background", tmp_path, work=tmp_path)


def test_a_bug_in_a_trial_keeps_its_traceback(
    background: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = trials.row_of

    def failing(trial: trials.Trial, *rest: Any) -> Any:
        return done(trial, *rest) if trial.stressor.name == "none" else [][0]

    monkeypatch.setattr(trials, "row_of", failing)
    with pytest.warns(UserWarning, match="trials failed"):
        pi.stress(background, data, work=tmp_path, stressors=["fog"])
    texts = [file.read_text() for file in (tmp_path / "tracebacks").iterdir()]
    assert len(texts) > 0
    assert all("IndexError" in text for text in texts)


def test_a_detector_that_fails_without_stress_ends_the_test(
    background: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise RuntimeError("no memory")

    monkeypatch.setattr(trials, "row_of", failing)
    assert main.main(command(background, data, tmp_path, "--stressors", "fog")) == 1
    assert not (tmp_path / "stress_summary.csv").exists()


def test_a_scene_of_the_catalogue_must_be_as_long_as_the_frames(base: altered_scenes.Base) -> None:
    late = replace(base, frames=(0, 5000))
    altered_scenes.check(base, altered_scenes.AlteredScene(scene="curve"))
    with pytest.raises(
        ValueError, match=r"curve.yaml: duration_s: expected 500.1 or more, .*got 500"
    ):
        altered_scenes.check(late, altered_scenes.AlteredScene(scene="curve"))


# The command.


def command(background: Path, data: Path, out: Path, *words: str) -> list[str]:
    return ["stress", str(data), "--model", str(background), "--out", str(out), *words]


def rows(out: Path) -> pd.DataFrame:
    return pd.read_csv(out / "stress.csv").sort_values(["stressor", "severity"], ignore_index=True)


@pytest.fixture(scope="module")
def whole(background: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a test without interruption."""
    out = tmp_path_factory.mktemp("whole")
    assert main.main(command(background, data, out, "--stressors", *QUICK)) == 0
    return out


def test_every_severity_has_its_row(whole: Path) -> None:
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
    row = table[(table.stressor == "density") & (table.severity == "2")].iloc[0]
    assert (
        row.command == "pyinfra stress --stressors density --severities 2 --seed 1 --max-frames 3"
    )
    for name in ("stress_summary.csv", "stress_ranking.csv", "stress_highway_paper_helios_16.svg"):
        assert (whole / name).stat().st_size > 50
    assert set(pd.read_csv(whole / "stress_summary.csv").stressor) == set(QUICK)


@pytest.mark.nightly
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
    assert main.main(words) == 0
    assert file.read_text().startswith(kept)
    pd.testing.assert_frame_equal(rows(tmp_path), rows(whole))


def test_a_finished_trial_is_not_computed_again(
    whole: Path, background: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (whole / "stress.csv").read_bytes()
    monkeypatch.setattr(trials, "row_of", lambda *_: pytest.fail("computed again"))
    assert main.main(command(background, data, whole, "--stressors", *QUICK)) == 0
    assert (whole / "stress.csv").read_bytes() == before


def test_another_model_of_the_same_name_is_no_finished_trial(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clouds = [kitti.read_points(kitti.frame_file(data, "velodyne", k)) for k in FRAMES]
    for path, learnt in (("old", clouds), ("new", clouds[:2])):
        (tmp_path / path / "run").mkdir(parents=True)
        Background.learn(learnt).save(tmp_path / path / "run/background.npz")
    old, new = (
        command(tmp_path / path / "run", data, tmp_path / "out", "--stressors", "drop_out")
        for path in ("old", "new")
    )
    assert main.main(old) == 0
    assert main.main(new) == 2
    assert "none 0 1 3: expected a row of this model, " in (capsys.readouterr().err)
    table = pd.read_csv(tmp_path / "out/stress.csv")
    table.drop(columns="inputs").to_csv(tmp_path / "out/stress.csv", index=False)
    assert main.main(new) == 0  # rows of an earlier version count as the same rows


def test_a_run_is_named_as_its_folder(
    background: Path, base: altered_scenes.Base, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(background)
    (trial,) = trials.plan([trials.read_run(Path(), base)], {}, base)
    assert trials.key_of(trial, base, 1)["run"] == "run"


def test_a_trial_that_another_process_holds_is_left_to_it(
    background: Path, base: altered_scenes.Base, tmp_path: Path
) -> None:
    run = trials.read_run(background, base)
    (trial,) = trials.plan([run], {}, base)
    name = "_".join(trials.key_of(trial, base, 1).values())
    with trials.held(tmp_path / "locks" / name, wait=False) as ours:
        assert ours
        assert not trials.fill(trial, base, tmp_path, 1)
    assert trials.fill(trial, base, tmp_path, 1)
    assert not trials.fill(trial, base, tmp_path, 1)


def test_chosen_severities_and_a_dry_run(
    background: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["--stressors", "fog", "--severities", "0", "3", "7", "--dry-run"]
    assert main.main(command(background, data, out, *words)) == 0
    *listed, last = capsys.readouterr().out.splitlines()
    assert listed == ["run none 0.0", "run fog 3.0", "run fog 7.0"]
    assert last.startswith("3 of 3 trials to do, 3 frames each, ")
    assert not out.exists()


def test_runs_of_one_detector_are_severities_of_the_training(base: altered_scenes.Base) -> None:
    first = trials.TrainedRun(Path("a"), "pointpillars", 800, 1)
    fewer = trials.TrainedRun(Path("b"), "pointpillars", 200, 1)
    seed = trials.TrainedRun(Path("c"), "pointpillars", 800, 2)
    stressors = chosen(["fog", "training_frames", "training_seed"], None)
    planned = trials.plan([first, fewer, seed], stressors, base)
    trained = [
        (c.run, c.stressor.name, c.severity) for c in planned if c.stressor.acts_on == "training"
    ]
    named = [row for row in trained if row[1] != "none"]
    assert named == [(fewer, "training_frames", 200.0), (seed, "training_seed", "2")]
    assert all(c.reference is first for c in planned)
    assert sum(c.stressor.name == "fog" for c in planned) == 4
    with pytest.raises(
        ValueError,
        match=r"d: expected either the .* frames or the seed .* of a, got 200 frames and seed 2",
    ):
        trials.plan([first, trials.TrainedRun(Path("d"), "pointpillars", 200, 2)], stressors, base)


def test_two_runs_of_the_same_frames_are_refused(base: altered_scenes.Base) -> None:
    first, *same = (
        trials.TrainedRun(Path(name), "pointpillars", frames, 1)
        for name, frames in (("a", 800), ("b", 200), ("c", 200))
    )
    with pytest.raises(
        Error, match=r"c: expected one run for .* training_frames, got two runs with 200"
    ):
        trials.plan([first, *same], chosen(["training_frames"], None), base)


def untrained(folder: Path, frames: int, lidar: str = "helios_16") -> Path:
    """Writes a run of a small PointPillars that has learnt nothing."""
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    from pyinfra.core.config import as_plain
    from pyinfra.models.detectors import pointpillars
    from pyinfra.models.training import checkpoint
    from pyinfra.models.training.provenance import Provenance

    config = pointpillars.Config()
    network = checkpoint.build("pointpillars", config, SITE)
    names = {"lidar": lidar, "preset": "paper", "scene": "highway"}
    provenance = Provenance(
        "pointpillars", as_plain(config), SITE, **names, seed=1, step=1, steps=1
    )
    folder.mkdir()
    checkpoint.save(folder / "last.safetensors", network, {}, provenance)
    (folder / "run.yaml").write_text(f"frames: {frames}\n")
    return folder


def test_a_smaller_training_is_a_row_of_its_reference(data: Path, tmp_path: Path) -> None:
    runs = [untrained(tmp_path / "a", 800), untrained(tmp_path / "b", 200)]
    words = ["--model", *map(str, runs), "--stressors", "training_frames"]
    assert main.main(["stress", str(data), *words, "--out", str(tmp_path)]) == 0
    table = pd.read_csv(tmp_path / "stress.csv")
    columns = ["detector", "run", "stressor", "severity", "trained_frames", "trained_seed"]
    assert table[columns].to_numpy().tolist() == [
        ["pointpillars", "a", "none", 0, 800, 1],
        ["pointpillars", "a", "training_frames", 200, 200, 1],
    ]
    (curve,) = pd.read_csv(tmp_path / "stress_summary.csv").to_dict("records")
    assert curve["severities"] == 2


def test_a_run_of_another_lidar_is_one_line(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = untrained(tmp_path / "run", 800, "ruby_plus")
    assert main.main(["stress", str(data), "--model", str(run), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith(
        "lidar: expected a model trained on helios_16, got a model trained on ruby_plus\n"
    )


def test_the_own_lidar_scene_and_preset_are_no_stress(base: altered_scenes.Base) -> None:
    run = trials.TrainedRun(Path("a"), "background", -1, -1)
    stressors = chosen(["unseen_lidar", "unseen_scene", "unseen_preset"], None)
    severities = {trial.severity for trial in trials.plan([run], stressors, base)}
    assert severities.isdisjoint({"own", "helios_16", "highway", "paper"})
    assert {"ruby_plus", "curve", "datasheet"} <= severities


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--stressors", "snow"], "--stressors: expected names of stressors, got 'snow'; names: "),
        (["--severities", "1"], "--severities: expected one stressor .*got drop_out, "),
        (
            ["--stressors", "training_seed", "--severities", "1"],
            "--severities: expected one stressor .*got training_seed",
        ),
        (
            ["--stressors", "fog", "--severities", "much"],
            "--severities: expected a number, 0 or more, got 'much'",
        ),
        (
            ["--stressors", "fog", "--severities", "-3"],
            "--severities: expected a number, 0 or more, got '-3'",
        ),
        (
            ["--stressors", "density", "--severities", "0.5"],
            "--severities: expected a number, 1 or more, got '0.5'",
        ),
        (
            ["--stressors", "unseen_scene", "--severities", "moon"],
            "--severities: expected one of .*; got 'moon'",
        ),
        (["--max-frames", "0"], "--max-frames: expected 1 or more, got 0"),
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
    assert main.main(command(background, data, tmp_path / "out", *words)) == 2
    error = capsys.readouterr().err
    assert re.match(f"pyinfra: {message}", error)
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_wrong_folders_are_one_line(
    background: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b"):
        shutil.copytree(data, tmp_path / "two" / name)
    assert main.main(command(background, tmp_path / "two", tmp_path / "out")) == 2
    assert "expected the folder of one LiDAR, got a data set with " in capsys.readouterr().err
    assert main.main(command(tmp_path, data, tmp_path)) == 1
    assert "The folder has no last.safetensors or background.npz" in capsys.readouterr().err
    (tmp_path / "stress.csv").write_text("a,b\n1,2\n")
    assert main.main(command(background, data, tmp_path)) == 2
    assert (
        "stress.csv:1: expected the columns of a table of `pyinfra stress`; the column detector"
        in capsys.readouterr().err
    )


def test_a_recorded_folder_takes_stress_on_clouds_but_not_on_scenes(
    background: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without dataset.yaml the scene is unknown. The dataset.yaml of an import contains no
    scene."""
    recorded = tmp_path / "site" / "helios_16"
    recorded.parent.mkdir()
    recorded.symlink_to(data)
    out = tmp_path / "out"
    assert main.main(command(background, recorded, out, "--stressors", "fog")) == 0
    assert main.main(command(background, recorded, out, "--stressors", "tilt")) == 2
    assert (
        "expected stressors that only change clouds, because there is no dataset.yaml"
        in capsys.readouterr().err
    )
    (recorded.parent / "dataset.yaml").write_text("name: site\npreset: recorded\n")
    assert main.main(command(background, recorded, out, "--stressors", "tilt", "rain")) == 0
    message = capsys.readouterr().err
    assert message.startswith("pyinfra: note: left out tilt: ")
    assert "only change clouds, because a recording has no roads" in message
