"""`infrasim run` from the view of a user: consistent files, and the same bytes however it is
run."""

import os
import pty
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from pyinfra.core.arrays import AnyArray, Float32Array

ROOT = Path(__file__).resolve().parents[2]
BINARY = Path(sys.executable).with_name("infrasim")
FOUR = ["helios_16", "livox_avia", "pandar_64", "ruby_plus"]
FRAMES = range(4)
SUMMARY = (
    "lidar,preset,frames,rays_per_frame,hits_per_frame,vehicles_per_frame,"
    "vehicle_points_per_frame,rays_cast_per_frame,seconds,mrays_per_s"
)
FIELDS = np.dtype(
    [("time_s", "<f4"), ("ring", "<u2"), ("class", "u1"), ("echo", "u1"), ("object_id", "<i4")]
)
OBJECTS = (
    "id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility,"
    "scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box"
)
CLASSES = {"Car", "Van", "Truck", "Bus", "Motorcycle"}

Infrasim = Callable[..., Any]
Words = Callable[..., list[str]]
Digests = Callable[[Path], dict[str, str]]


@pytest.fixture(scope="module")
def data_set(
    infrasim: Infrasim, run_command: Words, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Simulates four frames of four LiDARs, with fields."""
    out = tmp_path_factory.mktemp("data") / "highway"
    result = infrasim(*run_command(*FOUR, out=out), "--fields")
    assert result.returncode == 0, result.stderr
    return out


@pytest.fixture(scope="module", params=FOUR)
def training(data_set: Path, request: pytest.FixtureRequest) -> Path:
    return data_set / request.param / "training"


def objects(training: Path, k: int) -> pd.DataFrame:
    return pd.read_csv(training / f"objects/{k:06}.csv")


def velodyne(training: Path, k: int) -> Float32Array:
    return np.fromfile(training / f"velodyne/{k:06}.bin", "<f4").reshape(-1, 4)


def fields(training: Path, k: int) -> AnyArray:
    return np.fromfile(training / f"fields/{k:06}.bin", FIELDS)


def wrapped(angle: Any) -> Any:
    return np.remainder(np.asarray(angle) + np.pi, 2 * np.pi) - np.pi


# Files


def test_layout_is_that_of_the_design(data_set: Path) -> None:
    names = [f"{k:06}" for k in FRAMES]
    expected = {"dataset.yaml", "trajectories.csv", "roads.csv", "summary.csv"}
    for lidar in FOUR:
        expected.add(f"{lidar}/lidar.yaml")
        for folder, ending in [
            ("velodyne", "bin"),
            ("label_2", "txt"),
            ("calib", "txt"),
            ("objects", "csv"),
            ("fields", "bin"),
        ]:
            expected |= {f"{lidar}/training/{folder}/{name}.{ending}" for name in names}
    assert {str(p.relative_to(data_set)) for p in data_set.rglob("*") if p.is_file()} == expected


def test_a_scene_behind_the_lidars_is_asked_for_before_them(infrasim: Infrasim) -> None:
    result = infrasim("run", "--lidar", "livox_avia", "highway", "--frames", "0:1")
    words = "scene is required before the options, because --lidar takes all words after it"
    assert (result.returncode, words in result.stderr) == (2, True), result.stderr
    for without in (["run"], ["trajectories", "--out", "t.csv"]):
        assert "scene is required (see" in infrasim(*without).stderr


def test_fields_are_written_only_on_request(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    assert infrasim(*run_command(frames="0:1", out=tmp_path / "out")).returncode == 0
    assert (tmp_path / "out/helios_16/training/velodyne").is_dir()
    assert not (tmp_path / "out/helios_16/training/fields").exists()


def test_dataset_yaml_is_the_resolved_scene_with_preset_seed_and_version(
    data_set: Path, infrasim: Infrasim, tmp_path: Path
) -> None:
    text = (data_set / "dataset.yaml").read_text()
    keys = yaml.safe_load(text)
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert (keys["preset"], keys["seed"], keys["version"]) == ("paper", 1, version)
    assert keys["frames_version"] == 4
    assert keys["traffic"]["warm_up_s"] == 5
    assert keys["fields"] is True
    scene = {k: v for k, v in keys.items() if k not in {"preset", "version", "frames_version"}}
    copy = tmp_path / "scene.yaml"
    copy.write_text(yaml.safe_dump(scene))
    assert yaml.safe_load(infrasim("check", copy).stdout) == scene


def test_lidar_yaml_has_price_pose_range_and_field_of_view(data_set: Path) -> None:
    keys = yaml.safe_load((data_set / "livox_avia/lidar.yaml").read_text())
    assert keys["price_total_usd"] == {"low": 2079, "high": 2079}
    assert keys["preset"] == "paper"
    assert keys["period_s"] == 0.1
    assert keys["T_world_levelled"] == {"x_m": 0, "y_m": 0, "z_m": 6, "yaw_deg": 0}
    assert keys["T_levelled_sensor"] == {"pitch_deg": 0, "roll_deg": 0}
    (fov,) = keys["field_of_view"]
    np.testing.assert_allclose(fov["azimuth_deg"], [-35.31, 35.31], atol=0.02)
    np.testing.assert_allclose(fov["elevation_deg"], [-38.59, 38.59], atol=0.02)
    assert fov["range_m"] == [0, 260]


def test_memory_of_trajectories_does_not_grow_with_their_length(tmp_path: Path) -> None:
    peaks = []
    for seconds in (100, 800):
        words = ["trajectories", "highway", "--out", str(tmp_path / "t.csv")]
        command = [str(BINARY), *words, "--set", f"duration_s={seconds}"]
        script = (
            f"import resource, subprocess; subprocess.run({command}, stdout=2, check=True);"
            "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
        )
        done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True)
        peaks.append(int(done.stdout))
    assert peaks[1] < 1.3 * peaks[0]


def test_trajectories_have_ten_rows_a_second_and_roads_one_a_metre(data_set: Path) -> None:
    trajectories = pd.read_csv(data_set / "trajectories.csv")
    assert ",".join(trajectories.columns) == "t,id,class,x,y,z,heading,dx,dy,dz,speed"
    np.testing.assert_allclose(np.unique(trajectories.t), np.arange(5) / 10, atol=1e-9)
    assert set(trajectories["class"]) <= CLASSES
    roads = pd.read_csv(data_set / "roads.csv")
    assert ",".join(roads.columns) == "road,s,x,y,z,heading,half_width"
    assert set(roads.road) == {"motorway"}
    np.testing.assert_allclose(roads.s, np.arange(-100, 101))


def test_calibration_keeps_its_seven_lines_in_order(training: Path) -> None:
    lines = (training / "calib/000000.txt").read_text().splitlines()
    assert [line.split(":")[0] for line in lines] == [
        *("P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo")
    ]
    values = {line.split(":")[0]: [*map(float, line.split(":")[1].split())] for line in lines}
    assert values["R0_rect"] == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert values["Tr_velo_to_cam"] == [0, -1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0]
    assert len(values["P2"]) == 12
    assert np.linalg.det(np.reshape(values["P2"], (3, 4))[:, :3]) != 0


# The files of a frame agree


@pytest.mark.parametrize("k", FRAMES)
def test_labels_are_the_hit_objects_in_the_camera_frame(training: Path, k: int) -> None:
    hit = objects(training, k).query("points > 0")
    lines = [line.split() for line in (training / f"label_2/{k:06}.txt").read_text().splitlines()]
    assert len(lines) == len(hit)
    assert len(hit) > 0
    assert [line[0] for line in lines] == list(hit["class"])
    number = np.array([line[1:] for line in lines], float)
    assert number.shape[1] == 14
    # type truncated occluded alpha x1 y1 x2 y2 h w l x y z rotation_y
    np.testing.assert_array_equal(number[:, 3:7], np.tile([0, 0, 50, 50], (len(hit), 1)))
    np.testing.assert_allclose(number[:, 7:10], hit[["dz", "dy", "dx"]], atol=1e-4)
    bottom = np.stack([-hit.y, -(hit.z - hit.dz / 2), hit.x], axis=1)
    np.testing.assert_allclose(number[:, 10:13], bottom, atol=2e-4)
    rotation_y, alpha = number[:, 13], number[:, 2]
    assert np.abs(wrapped(rotation_y + hit.heading + np.pi / 2)).max() < 1e-5
    x, z = number[:, 10], number[:, 12]
    assert np.abs(wrapped(alpha - rotation_y + np.arctan2(x, z))).max() < 1e-4
    v = hit.visibility.to_numpy()
    occluded = np.select([v < 0, v >= 0.8, v >= 0.4], [3, 0, 1], 2)
    clear = np.min(np.abs(v[:, None] - [0.4, 0.8]), axis=1) > 1e-4
    np.testing.assert_array_equal(number[clear, 1], occluded[clear])


@pytest.mark.parametrize(
    ("preset", "words", "expected"),
    [
        ("paper", [], "frame"),
        ("equal", [], "frame"),
        ("datasheet", [], "scan"),
        ("paper", ["--label-time", "scan"], "scan"),
        ("datasheet", ["--set", "label_time=frame"], "frame"),
    ],
)
def test_labels_hold_at_the_time_of_the_preset_or_the_one_asked_for(
    infrasim: Infrasim,
    run_command: Words,
    tmp_path: Path,
    preset: str,
    words: list[str],
    expected: str,
) -> None:
    out = tmp_path / "out"
    infrasim(*run_command(preset=preset, frames="3:4", out=out), *words, check=True)
    for file in (out / "dataset.yaml", out / "helios_16/lidar.yaml"):
        assert f"\nlabel_time: {expected}\n" in file.read_text()
    hit = objects(out / "helios_16/training", 3).query("points > 0")
    lines = (out / "helios_16/training/label_2/000003.txt").read_text().splitlines()
    # z of the camera frame is the distance ahead
    labelled = np.array([float(line.split()[13]) for line in lines])
    assert np.abs(hit.scan_x - hit.x).max() > 0.3
    np.testing.assert_allclose(labelled, hit.scan_x if expected == "scan" else hit.x, atol=2e-4)


def test_a_folder_holds_labels_of_one_time(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    words = run_command(frames="3:4", out=tmp_path / "out")
    infrasim(*words, check=True)
    other = infrasim(*words, "--label-time", "scan")
    assert other.returncode == 1
    assert "it has 'label_time: frame', this run has 'label_time: scan'" in other.stderr


def test_the_seed_moves_a_free_motor_alone(
    infrasim: Infrasim, tmp_path: Path, pattern: Callable[..., np.ndarray]
) -> None:
    locked = (ROOT / "configs/lidars/helios_16.yaml").read_text()
    file = tmp_path / "free.yaml"
    file.write_text(
        locked.replace("rate_hz: 10", "rate_hz: 10, phase: free").replace(
            "channels/", f"{ROOT}/configs/lidars/channels/"
        )
    )
    first = {seed: pattern("helios_16", "--seed", seed)[0, 0] for seed in (1, 2)}
    # the first ray points behind the view
    assert np.abs([first[1], first[2]]) == pytest.approx([np.pi, np.pi])
    starts = [pattern(file, *words)[0, 0] for words in ([], ["--seed", 1], ["--seed", 2])]
    assert abs(starts[0]) == pytest.approx(np.pi)
    assert len({round(abs(start), 3) for start in starts}) == 3
    bridge = pattern(file, "--seed", 1, "--mount", "bridge")[0, 0]
    assert bridge != starts[1]


@pytest.mark.parametrize("k", FRAMES)
def test_objects_table_is_sound(training: Path, k: int) -> None:
    assert (training / f"objects/{k:06}.csv").read_text().splitlines()[0] == OBJECTS
    table = objects(training, k)
    assert table.id.is_monotonic_increasing
    assert table.id.is_unique
    assert set(table["class"]) <= CLASSES
    assert np.all(table.points_in_box <= table.points.where(table.points > 0, table.points_in_box))
    np.testing.assert_allclose(table.distance, np.hypot(table.x, table.y), atol=1e-3)
    seen = table.visibility[table.visibility != -1]
    assert seen.between(0, 1).all()


def test_objects_are_the_vehicles_of_the_trajectories_at_mid_frame(
    data_set: Path, training: Path
) -> None:
    rows = pd.read_csv(data_set / "trajectories.csv").set_index(["t", "id"])
    for k in FRAMES:
        table = objects(training, k).set_index("id")
        before = rows.loc[k / 10].loc[table.index]
        after = rows.loc[round((k + 1) / 10, 10)].loc[table.index]
        for axis, mount in (("x", 0), ("y", 0), ("z", 6)):
            middle = (before[axis] + after[axis]) / 2 - mount
            np.testing.assert_allclose(table[axis], middle, atol=2e-4)
        np.testing.assert_array_equal(table[["dx", "dy", "dz"]], before[["dx", "dy", "dz"]])


@pytest.mark.parametrize("k", FRAMES)
def test_fields_have_a_record_for_each_point(training: Path, k: int) -> None:
    points, record = velodyne(training, k), fields(training, k)
    assert (training / f"velodyne/{k:06}.bin").stat().st_size == 16 * len(points)
    assert (training / f"fields/{k:06}.bin").stat().st_size == 12 * len(points)
    assert len(points) == len(record) > 0
    assert np.isfinite(points).all()
    assert points[:, 3].min() >= 0
    assert points[:, 3].max() <= 1
    assert record["time_s"].min() >= 0
    assert record["time_s"].max() < 0.1 + 1e-6
    lines = {"helios_16": 16, "livox_avia": 6, "pandar_64": 64, "ruby_plus": 128}
    assert record["ring"].max() < lines[training.parent.name]


@pytest.mark.parametrize("k", FRAMES)
def test_object_ids_of_the_points_count_to_points(training: Path, k: int) -> None:
    table, record = objects(training, k).set_index("id"), fields(training, k)
    counted = pd.Series(record["object_id"]).value_counts().drop(-1)
    assert counted.to_dict() == table.points[table.points > 0].to_dict()
    # Each class of points has the number of the object's class.
    of_object = record[record["object_id"] >= 0]
    names = table["class"].loc[of_object["object_id"]].to_numpy()
    pairs = set(zip(names, of_object["class"], strict=True))
    assert len(pairs) == len({name for name, _ in pairs})
    background = set(record["class"][record["object_id"] < 0])
    assert background.isdisjoint(number for _, number in pairs)


def test_ring_0_is_the_lowest_elevation(data_set: Path) -> None:
    for lidar in ("helios_16", "pandar_64", "ruby_plus"):
        points, record = (
            velodyne(data_set / lidar / "training", 0),
            fields(data_set / lidar / "training", 0),
        )
        elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
        mean = pd.Series(elevation).groupby(record["ring"]).mean()
        assert mean.is_monotonic_increasing


def test_points_of_an_object_lie_in_its_box_when_the_traffic_stands_still(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    command = run_command("livox_avia", "ruby_plus", frames="0:2", aggregation="instant")
    assert infrasim(*command, "--fields", "--out", tmp_path / "out").returncode == 0
    for lidar in ("livox_avia", "ruby_plus"):
        training = tmp_path / "out" / lidar / "training"
        for k in range(2):
            table = objects(training, k)
            assert (table.points_in_box >= table.points * 0.999 - 1).all()
            points, record = velodyne(training, k), fields(training, k)
            for row in table[table.points > 0].itertuples():
                p = points[record["object_id"] == row.id, :3] - [row.x, row.y, row.z]
                c, s = np.cos(row.heading), np.sin(row.heading)
                along, across = c * p[:, 0] + s * p[:, 1], -s * p[:, 0] + c * p[:, 1]
                outside = np.abs(np.stack([along, across, p[:, 2]], axis=1)) - [
                    *(row.dx / 2, row.dy / 2, row.dz / 2)
                ]
                assert outside.max() < 1e-3


def test_labels_all_has_the_unseen_objects_too(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    command = run_command("livox_avia", frames="0:1", labels="all", out=tmp_path / "out")
    assert infrasim(*command).returncode == 0
    training = tmp_path / "out/livox_avia/training"
    table = objects(training, 0)
    assert (table.points == 0).any()
    assert len((training / "label_2/000000.txt").read_text().splitlines()) == len(table)


# Summary and printed text


def test_summary_is_what_the_files_hold(data_set: Path) -> None:
    text = (data_set / "summary.csv").read_text()
    assert text.splitlines()[0] == SUMMARY
    table = pd.read_csv(data_set / "summary.csv").set_index("lidar")
    assert list(table.index) == FOUR
    assert (table.preset == "paper").all()
    assert (table.frames == len(FRAMES)).all()
    rays = {"helios_16": 28800, "livox_avia": 24000, "pandar_64": 115200, "ruby_plus": 230400}
    assert table.rays_per_frame.to_dict() == rays
    for lidar, row in table.iterrows():
        training = data_set / str(lidar) / "training"
        tables = [objects(training, k) for k in FRAMES]
        hits = np.mean([len(velodyne(training, k)) for k in FRAMES])
        assert row.hits_per_frame == pytest.approx(hits, rel=1e-5)
        assert row.vehicles_per_frame == pytest.approx(np.mean([*map(len, tables)]), rel=1e-5)
        points = np.mean([t.points.sum() for t in tables])
        assert row.vehicle_points_per_frame == pytest.approx(points, rel=1e-5)
        assert row.seconds > 0
        assert row.mrays_per_s > 0


def test_summary_option_writes_the_same_table_elsewhere(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    out, other = tmp_path / "out", tmp_path / "other.csv"
    assert infrasim(*run_command(out=out, summary=other)).returncode == 0
    assert other.read_text() == (out / "summary.csv").read_text()


def test_resumed_run_has_the_counts_of_the_whole(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert infrasim(*run_command(frames="0:2", out=out)).returncode == 0
    assert infrasim(*run_command(frames="0:4", out=out)).returncode == 0
    resumed = pd.read_csv(out / "summary.csv")
    whole = tmp_path / "whole"
    assert infrasim(*run_command(frames="0:4", out=whole)).returncode == 0
    # the last three columns depend on the frames that this run computed
    columns = SUMMARY.split(",")[:-3]
    pd.testing.assert_frame_equal(resumed[columns], pd.read_csv(whole / "summary.csv")[columns])


def counted(folder: Path) -> pd.DataFrame:
    """Returns the rows of summary.csv by LiDAR, without the columns that depend on the run."""
    table = pd.read_csv(folder / "summary.csv").set_index("lidar").sort_index()
    return table[SUMMARY.split(",")[1:-3]]


def test_summary_is_of_all_frames_of_a_folder_whichever_runs_made_them(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    out, whole = tmp_path / "out", tmp_path / "whole"
    assert infrasim(*run_command(*FOUR[:2], frames="0:4", out=whole)).returncode == 0
    for lidar, frames in (("helios_16", "0:2"), ("livox_avia", "1:4"), ("helios_16", "2:4:1")):
        assert infrasim(*run_command(lidar, frames=frames, out=out)).returncode == 0
    before = pd.read_csv(out / "summary.csv")
    assert before.lidar.tolist() == ["helios_16", "livox_avia"]
    assert before.frames.tolist() == [4, 3]
    assert infrasim(*run_command("livox_avia", frames="0:1", out=out)).returncode == 0
    pd.testing.assert_frame_equal(counted(out), counted(whole), rtol=1e-5)


def test_summary_keeps_the_times_of_a_lidar_of_which_nothing_is_computed(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert infrasim(*run_command(out=out)).returncode == 0
    before = (out / "summary.csv").read_text()
    assert infrasim(*run_command(frames="0:1", out=out)).returncode == 0
    assert (out / "summary.csv").read_text() == before


def test_summary_has_no_row_of_a_lidar_that_was_removed(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert infrasim(*run_command(frames="0:1", out=out)).returncode == 0
    (out / "helios_16").rename(out / "helios_16_old")
    (out / "helios_16_old/lidar.yaml").unlink()
    assert infrasim(*run_command("livox_avia", frames="0:1", out=out)).returncode == 0
    assert pd.read_csv(out / "summary.csv").lidar.tolist() == ["livox_avia"]


def test_summary_keeps_rows_that_an_editor_saved_in_its_own_way(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert infrasim(*run_command(frames="0:1", out=out)).returncode == 0
    text = (out / "summary.csv").read_text()
    far = f"{'x' * 300},paper,1,1,1,1,1,1,1,1\n"  # no folder can have this name
    (out / "summary.csv").write_bytes(b"\xef\xbb\xbf" + (text + far).replace("\n", "\r\n").encode())
    (out / "loop").symlink_to("loop")  # an entry that cannot be read
    result = infrasim(*run_command("livox_avia", frames="0:1", out=out))
    assert result.returncode == 0, result.stderr
    assert pd.read_csv(out / "summary.csv").lidar.tolist() == ["helios_16", "livox_avia"]
    assert "\r" not in (out / "summary.csv").read_text()


def test_without_out_nothing_is_written(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    absolute = [str(ROOT / w) if w.startswith("configs/") else w for w in run_command()]
    result = infrasim(*absolute, cwd=tmp_path)
    assert result.returncode == 0
    assert "helios_16" in result.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_step_that_shows_a_part_of_a_pattern_is_warned_of(
    infrasim: Infrasim, run_command: Words
) -> None:
    words = [
        *run_command("velodyne_hdl_64e", preset="equal", frames="0:12:3"),
        *("--set", "traffic.vehicles_per_km_lane=0"),
    ]
    result = infrasim(*words)
    assert result.returncode == 0
    (line,) = result.stderr.splitlines()
    assert line.startswith("infrasim: warning: pattern-period: velodyne_hdl_64e: ")
    assert "shows 3 of the pattern's 9 frames" in line
    assert infrasim(*(word.replace("0:12:3", "0:12:4") for word in words)).stderr == ""


def test_existing_frames_are_left_alone(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert infrasim(*run_command(out=out)).returncode == 0
    bins = sorted(out.rglob("*.bin"))
    before = [(p.stat().st_mtime_ns, p.stat().st_ino) for p in bins]
    assert infrasim(*run_command(out=out)).returncode == 0
    assert [(p.stat().st_mtime_ns, p.stat().st_ino) for p in bins] == before


def test_a_pipe_gets_results_on_stdout_and_no_bar(infrasim: Infrasim, run_command: Words) -> None:
    result = infrasim(*run_command(*FOUR))
    assert result.stderr == ""
    lines = result.stdout.splitlines()
    assert len(lines) == 1 + len(FOUR)
    assert [line.split()[0] for line in lines[1:]] == FOUR


def test_weather_that_a_preset_does_not_feel_is_a_warning(
    infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    fog = ("--set", "weather.visibility_m=30")
    result = infrasim(*run_command(frames="0:1"), *fog, "--out", tmp_path / "a")
    assert result.returncode == 0, result.stderr
    assert result.stderr == (
        "infrasim: warning: helios_16, preset paper: weather: no effect, because it affects only "
        "LiDARs with returns.detection, which the preset lacks\n"
    )


def test_a_terminal_gets_a_bar_on_stderr(run_command: Words) -> None:
    primary, secondary = pty.openpty()
    try:
        process = subprocess.run(
            [str(BINARY), *run_command()],
            cwd=ROOT,
            stdin=secondary,
            stdout=subprocess.PIPE,
            stderr=secondary,
            timeout=60,
        )
        shown = ""
        while not shown.endswith("\n"):  # a read may return only a part of the written text
            shown += os.read(primary, 65536).decode()
    finally:
        os.close(primary)
        os.close(secondary)
    assert process.returncode == 0
    assert "\r[" in shown
    assert "4/4 frames" in shown
    assert shown.endswith("\n")
    assert "\r" not in process.stdout.decode()


@pytest.mark.parametrize("command", [[], ["run"], ["check"], ["pattern"], ["trajectories"]])
def test_help_shows_an_example(command: list[str], infrasim: Infrasim) -> None:
    result = infrasim(*command, "--help")
    assert result.returncode == 0
    assert result.stderr == ""
    example = re.search(r"Example: (infrasim .*)", result.stdout)
    assert example is not None
    words = example.group(1).split()
    assert not command or words[1] == command[0]
    assert all((ROOT / word).is_file() for word in words if word.endswith(".yaml"))


def test_every_command_of_the_help_is_tested_here(infrasim: Infrasim) -> None:
    text = infrasim("--help").stdout.split("Subcommands:")[1]
    commands = set(re.findall(r"^  (\w+)", text, re.MULTILINE))
    assert {"run", "check", "pattern", "trajectories"} <= commands
    for command in commands:
        result = infrasim(command, "--help")
        assert result.returncode == 0
        assert f"Example: infrasim {command} " in result.stdout


def test_version_is_the_packages(infrasim: Infrasim) -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    result = infrasim("--version")
    assert (result.returncode, result.stdout) == (0, f"infrasim {version} (frames 4)\n")


@pytest.fixture(scope="module")
def written(infrasim: Infrasim, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the trajectories of the scene of `data_set`, written by `infrasim trajectories`."""
    out = tmp_path_factory.mktemp("trajectories") / "highway.csv"
    words = ["--set", "duration_s=20", "--set", "traffic.warm_up_s=5", "--out", out]
    result = infrasim("trajectories", "configs/scenes/highway.yaml", *words)
    assert (result.returncode, result.stdout) == (0, "200 frames\n")
    return out


def test_trajectories_command_writes_the_rows_of_a_run(data_set: Path, written: Path) -> None:
    rows = pd.read_csv(written)
    of_run = pd.read_csv(data_set / "trajectories.csv")
    assert len(of_run) > 0
    assert rows.t.max() == 20
    pd.testing.assert_frame_equal(rows[rows.t < 0.45].reset_index(drop=True), of_run)


def test_a_written_trajectory_file_gives_the_frames_of_its_traffic(
    data_set: Path, written: Path, infrasim: Infrasim, tmp_path: Path
) -> None:
    keys = yaml.safe_load((ROOT / "configs/scenes/highway.yaml").read_text())
    del keys["traffic"]
    (tmp_path / "recorded.csv").write_bytes(written.read_bytes())
    scene = tmp_path / "scene.yaml"
    scene.write_text(yaml.safe_dump(keys | {"trajectories": "recorded.csv", "duration_s": 20}))
    words = ["--lidar", "configs/lidars/helios_16.yaml", "--preset", "paper", "--frames", "0:4"]
    result = infrasim("run", scene, *words, "--out", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    for k in FRAMES:
        mine, theirs = (
            folder / f"helios_16/training/velodyne/{k:06}.bin"
            for folder in (tmp_path / "out", data_set)
        )
        assert mine.read_bytes() == theirs.read_bytes()


def test_a_run_resumes_from_another_working_directory(
    written: Path, infrasim: Infrasim, tmp_path: Path
) -> None:
    """The path of the trajectory file is relative to the scene file."""
    keys = yaml.safe_load((ROOT / "configs/scenes/highway.yaml").read_text())
    del keys["traffic"]
    (tmp_path / "recorded.csv").write_bytes(written.read_bytes())
    text = yaml.safe_dump(keys | {"trajectories": "recorded.csv", "duration_s": 20})
    (tmp_path / "scene.yaml").write_text(text)
    (tmp_path / "below").mkdir()
    for folder, scene in ((tmp_path, "scene.yaml"), (tmp_path / "below", "../scene.yaml")):
        words = ["--lidar", ROOT / "configs/lidars/helios_16.yaml", "--out", tmp_path / "out"]
        result = infrasim("run", scene, "--frames", "0:1", *words, cwd=folder)
        assert result.returncode == 0, result.stderr


# The same bytes


@pytest.fixture(scope="module")
def reference(
    infrasim: Infrasim, run_command: Words, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Simulates the frames 38:47 of four LiDARs and a bundle with one thread."""
    out = tmp_path_factory.mktemp("reference") / "out"
    command = run_command(*FOUR, "bundle_5_livox_avia", frames="38:47", threads=1, out=out)
    assert infrasim(*command, "--fields").returncode == 0
    return out


@pytest.mark.parametrize("threads", [2, 4])
def test_bytes_do_not_depend_on_the_number_of_threads(
    threads: int,
    reference: Path,
    infrasim: Infrasim,
    run_command: Words,
    digests: Digests,
    tmp_path: Path,
) -> None:
    lidars = [*FOUR, "bundle_5_livox_avia"]
    command = run_command(*lidars, frames="38:47", threads=threads, out=tmp_path / "out")
    assert infrasim(*command, "--fields").returncode == 0
    assert digests(tmp_path / "out") == digests(reference)


def without_trajectories(files: dict[str, str]) -> dict[str, str]:
    """Returns the files without trajectories.csv, which has only the rows of a run's frames."""
    return {name: digest for name, digest in files.items() if name != "trajectories.csv"}


def test_bytes_of_a_frame_do_not_depend_on_the_other_frames(
    reference: Path, infrasim: Infrasim, run_command: Words, digests: Digests, tmp_path: Path
) -> None:
    command = run_command(*FOUR, "bundle_5_livox_avia", frames="40:45", out=tmp_path / "out")
    assert infrasim(*command, "--fields").returncode == 0
    mine, whole = digests(tmp_path / "out"), digests(reference)
    assert len(mine) == 3 + 5 * (1 + 5 * 5)
    assert without_trajectories(mine).items() <= whole.items()


@pytest.mark.parametrize("lidar", [*FOUR, "bundle_5_livox_avia"])
def test_bytes_of_a_lidar_do_not_depend_on_the_other_lidars(
    lidar: str,
    reference: Path,
    infrasim: Infrasim,
    run_command: Words,
    digests: Digests,
    tmp_path: Path,
) -> None:
    command = run_command(lidar, frames="38:47:4", out=tmp_path / "out")
    assert infrasim(*command, "--fields").returncode == 0
    mine, whole = digests(tmp_path / "out"), digests(reference)
    assert len(mine) == 3 + 1 + 5 * 3
    assert without_trajectories(mine).items() <= whole.items()


@pytest.mark.parametrize("lidar", ["helios_16", "pandar_64", "ruby_plus"])
def test_vehicles_at_the_end_of_the_range_do_not_depend_on_a_lidar_that_sees_further(
    lidar: str, data_set: Path, infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    """The ranges are 100 m for this LiDAR and 260 m for the Avia. In frame 0, the near corner of a
    vehicle is just within range."""
    assert infrasim(*run_command(lidar, out=tmp_path / "out"), "--fields").returncode == 0
    for k in FRAMES:
        for file in (f"velodyne/{k:06}.bin", f"objects/{k:06}.csv", f"fields/{k:06}.bin"):
            mine, among = (d / lidar / "training" / file for d in (tmp_path / "out", data_set))
            assert mine.read_bytes() == among.read_bytes(), file


@pytest.mark.parametrize("preset", [pytest.param("equal", marks=pytest.mark.nightly), "datasheet"])
@pytest.mark.parametrize("aggregation", ["exact", "instant", "slices:3"])
def test_presets_and_aggregations_repeat(
    preset: str,
    aggregation: str,
    infrasim: Infrasim,
    run_command: Words,
    digests: Digests,
    tmp_path: Path,
) -> None:
    lidars = ["livox_avia", "pandar_64", "bundle_5_livox_avia"]
    seen = []
    for name, frames, threads in (("a", "5:8", 1), ("b", "5:8", 4), ("c", "6:7", 2)):
        command = run_command(
            *lidars,
            preset=preset,
            frames=frames,
            threads=threads,
            aggregation=aggregation,
            out=tmp_path / name,
        )
        assert infrasim(*command, "--fields").returncode == 0
        seen.append(digests(tmp_path / name))
    assert seen[0] == seen[1]
    assert without_trajectories(seen[2]).items() <= seen[0].items()


def test_seed_and_aggregation_change_the_points(
    reference: Path, infrasim: Infrasim, run_command: Words, tmp_path: Path
) -> None:
    bytes_of = {}
    for name, options in {
        "seed": {"seed": 2},
        "slices": {"aggregation": "slices:3"},
        "instant": {"aggregation": "instant"},
    }.items():
        out = tmp_path / name
        command = run_command("livox_avia", frames="40:41", out=out, **options)
        assert infrasim(*command, "--fields").returncode == 0
        bytes_of[name] = (out / "livox_avia/training/velodyne/000040.bin").read_bytes()
    bytes_of["exact"] = (reference / "livox_avia/training/velodyne/000040.bin").read_bytes()
    assert len(set(bytes_of.values())) == 4


@pytest.mark.parametrize("attempt", range(2))
def test_two_processes_fill_one_folder_with_disjoint_frames(
    attempt: int, reference: Path, run_command: Words, digests: Digests, tmp_path: Path
) -> None:
    """Both processes claim dataset.yaml at the start, and both write summary.csv at the end."""
    out = tmp_path / "out"
    lidars = [*FOUR, "bundle_5_livox_avia"]
    processes = [
        subprocess.Popen(
            [str(BINARY), *run_command(*lidars, frames=frames, threads=1, out=out), "--fields"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for frames in ("38:47:2", "39:47:2")
    ]
    errors = [process.communicate(timeout=120)[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], errors
    assert digests(out) == digests(reference)
    pd.testing.assert_frame_equal(counted(out), counted(reference), rtol=1e-5)


@pytest.mark.nightly
def test_processes_that_end_at_once_all_succeed(run_command: Words, tmp_path: Path) -> None:
    """Six processes with one frame each end at the same time, and each writes summary.csv."""
    for attempt in range(8):
        out = tmp_path / str(attempt)
        quick = ["--set", "duration_s=2", "--set", "traffic.warm_up_s=0"]
        processes = [
            subprocess.Popen(
                [str(BINARY), *run_command(frames=f"{k}:{k + 1}", threads=1, out=out), *quick],
                cwd=ROOT,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            for k in range(6)
        ]
        errors = [process.communicate(timeout=120)[1] for process in processes]
        assert [process.returncode for process in processes] == [0] * 6, errors
        assert counted(out).frames.tolist() == [6]
        assert not [path for path in out.rglob(".*") if path.is_file()]
