"""Several mounts of one scene: one data set per mount, fused frames, and errors of clocks and
poses."""

import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import ROOT, Infrasim
from message_pattern import pattern

import pyinfra as pi
from pyinfra.core.boxes import points_in_box
from pyinfra.dataset.data_set import field_of_view_mask, read_data_set
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.experiments.benchmark.frames import hit_row, lidar_row
from pyinfra.formats import kitti
from pyinfra.viz import scene_pictures as scene_figures

LIDAR = ROOT / "configs/lidars/helios_16.yaml"
SPEED = 15.0
MOUNTS = {  # the first mount in the file is not the first by name
    "right": {"x_m": -20, "y_m": -8, "z_m": 6, "yaw_deg": 10, "pitch_deg": 5, "roll_deg": 2},
    "left": {"x_m": 30, "y_m": 9, "z_m": 7, "yaw_deg": 170, "pitch_deg": 8},
}
Runs = Callable[..., Path]
Digests = Callable[[Path], dict[str, str]]


def trajectories() -> str:
    """Returns trajectories of two cars for a second. One of them stands."""
    lines = ["t,id,class,x,y,z,heading,dx,dy,dz,speed"]
    for k in range(11):
        lines.append(f"{k / 10:g},1,Car,4,-2,0.75,0,4.5,1.9,1.5,0")
        lines.append(f"{k / 10:g},2,Car,{-5 + SPEED * k / 10:g},2,0.75,0,4.5,1.9,1.5,{SPEED:g}")
    return "\n".join(lines) + "\n"


def scene_keys(mounts: Mapping[str, Any] = MOUNTS) -> dict[str, Any]:
    lanes = {"each_way": 1, "width_m": 4, "shoulder_m": 0.5, "sidewalk_m": 1}
    start = {"x_m": -150, "y_m": 0, "heading_deg": 0}
    return {
        "name": "poles",
        "duration_s": 1,
        "detail": "box",
        "mounts": dict(mounts),
        "roads": [
            {"name": "main", "start": start, "centreline": [{"line_m": 300}], "lanes": lanes}
        ],
        "trajectories": "cars.csv",
    }


@pytest.fixture
def runs(infrasim: Infrasim, tmp_path: Path) -> Runs:
    """Returns a function that runs a scene with these or other mounts. Its first argument is the
    name of the folder. It raises an error with the message of a failed run."""
    (tmp_path / "cars.csv").write_text(trajectories())

    def run(
        name: str, *words: str, mounts: Mapping[str, Any] = MOUNTS, preset: str = "paper"
    ) -> Path:
        scene = tmp_path / f"{name}.yaml"
        scene.write_text(yaml.safe_dump(scene_keys(mounts), sort_keys=False))
        usual = ["--lidar", LIDAR, "--preset", preset, "--fields"]
        usual += [] if "--threads" in words else ["--threads", "1"]
        frames = [] if "--frames" in words else ["--frames", "0:2"]
        out = tmp_path / name
        done = infrasim("run", scene, *usual, *frames, "--out", out, *words)
        if done.returncode != 0:
            raise RuntimeError(done.stderr)
        return out

    return run


def frame_of(folder: Path, k: int = 0) -> tuple[np.ndarray, np.ndarray, kitti.Objects]:
    """Returns the points (n, 4), their fields and the objects of a frame."""
    lidar = folder / "helios_16"
    points = kitti.read_points(kitti.frame_file(lidar, "velodyne", k))
    fields = kitti.read_fields(kitti.frame_file(lidar, "fields", k))
    return points, fields, kitti.read_objects(kitti.frame_file(lidar, "objects", k))


def to_first(points: np.ndarray, mount: Mapping[str, float]) -> np.ndarray:
    """Transforms points (n, 3) from a mount's levelled frame to that of the first mount."""
    first = MOUNTS["right"]

    def turn(degrees: float) -> np.ndarray:
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    shift = np.array([mount[key] - first[key] for key in ("x_m", "y_m", "z_m")])
    world = points @ turn(mount["yaw_deg"]).T + shift
    return world @ turn(first["yaw_deg"])


@pytest.mark.parametrize("preset", ["paper", "datasheet"])
def test_a_mount_alone_has_the_bytes_of_the_run_of_all(
    runs: Runs, digests: Digests, preset: str
) -> None:
    everything = runs("everything", preset=preset)
    assert sorted(path.name for path in everything.iterdir()) == ["left", "right"]
    for mount in MOUNTS:
        alone = runs(f"{mount}_alone", "--mount", mount, preset=preset)
        assert [path.name for path in alone.iterdir()] == [mount]
        assert digests(alone / mount) == digests(everything / mount)


def test_some_mounts_have_the_bytes_of_a_scene_of_these_alone(runs: Runs, digests: Digests) -> None:
    third = {"x_m": 30, "y_m": 9, "z_m": 5, "yaw_deg": 180}
    some = runs("some", "--mount", "right,left", "--fuse", mounts=MOUNTS | {"third": third})
    these = runs("these", "--fuse")
    assert sorted(path.name for path in some.iterdir()) == ["fused", "left", "right"]
    for folder in some.iterdir():
        ours, other = digests(folder), digests(these / folder.name)
        assert ours == other


@pytest.mark.parametrize("words", ["left,middle", "left,left"])
def test_mounts_that_cannot_be_chosen_are_named(runs: Runs, words: str) -> None:
    wrong = words.partition(",")[2]
    with pytest.raises(RuntimeError, match=f"--mount: expected one or more of .*got '{wrong}'"):
        runs("wrong", "--mount", words)


def test_each_mount_and_the_fused_one_keep_the_summary_of_an_earlier_lidar(runs: Runs) -> None:
    other = str(ROOT / "configs/lidars/livox_avia.yaml")
    runs("all", "--fuse", "--frames", "0:1", "--lidar", other)  # together with the usual LiDAR
    out = runs("all", "--fuse", "--frames", "0:1")
    for part in (*MOUNTS, "fused"):
        table = pd.read_csv(out / part / "summary.csv")
        assert table.lidar.tolist() == ["helios_16", "livox_avia"]
        assert (table.rays_per_frame > 0).all()


def test_a_mount_s_data_set_is_that_of_its_own_description(
    runs: Runs, digests: Digests, infrasim: Infrasim, tmp_path: Path
) -> None:
    """The mount has its own random stream. Its `dataset.yaml` contains the key
    `own_random_stream`."""
    left = runs("out", preset="datasheet") / "left"
    keys = yaml.safe_load((left / "dataset.yaml").read_text())
    of_the_run = ("preset", "version", "frames_version")
    (again := tmp_path / "again.yaml").write_text(
        yaml.safe_dump({k: v for k, v in keys.items() if k not in of_the_run})
    )
    words = ["--lidar", LIDAR, "--frames", "0:2", "--out", tmp_path / "again"]
    infrasim("run", again, *words, check=True)
    assert digests(left) == digests(tmp_path / "again")


def test_each_of_several_mounts_has_its_own_random_stream(runs: Runs) -> None:
    pose = {"x_m": -20, "y_m": -8, "z_m": 6}
    same = {"one": pose, "two": pose}
    both = runs("both", mounts=same)
    alone = runs("alone", mounts={"one": pose})
    clouds = [frame_of(folder)[0] for folder in (both / "one", both / "two", alone)]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert clouds[a].tobytes() != clouds[b].tobytes()
    shared = {name: pose | {"own_random_stream": False} for name in same}
    assert frame_of(runs("shared", mounts=shared) / "two")[0].tobytes() == clouds[2].tobytes()


def test_the_current_name_of_a_renamed_key_of_a_mount_is_named(
    infrasim: Infrasim, tmp_path: Path
) -> None:
    keys = {"mounts": {"one": {"x_m": 0, "y_m": 0, "z_m": 6, "own_draws": True}}}
    (file := tmp_path / "scene.yaml").write_text(yaml.safe_dump({"name": "scene"} | keys))
    result = infrasim("check", file)
    assert result.returncode == 2
    assert "mounts.one.own_draws: expected own_random_stream, " in result.stderr


def test_all_mounts_see_one_scene(runs: Runs) -> None:
    out = runs("out")
    texts = {(out / mount / "trajectories.csv").read_text() for mount in MOUNTS}
    # Vehicle 1 stands, so it has only its first and last row.
    standing = [f"{k / 10:g},1," for k in range(1, 10)]
    lines = trajectories().splitlines(keepends=True)
    assert texts == {"".join(one for one in lines if not one.startswith(tuple(standing)))}
    poses = [read_data_set(out / mount).lidars[0].T_world_levelled for mount in MOUNTS]
    assert [(pose.x, pose.y, pose.z) for pose in poses] == [(-20, -8, 6), (30, 9, 7)]


def test_the_fused_cloud_is_that_of_all_mounts_in_the_frame_of_the_first(runs: Runs) -> None:
    out = runs("out", "--fuse")
    points, fields, _ = frame_of(out / "fused")
    of_mount = [frame_of(out / mount) for mount in MOUNTS]
    moved = [
        np.column_stack([to_first(rows[:, :3], pose), rows[:, 3]])
        for (rows, _, _), pose in zip(of_mount, MOUNTS.values(), strict=True)
    ]
    np.testing.assert_allclose(points, np.concatenate(moved), atol=2e-5)
    np.testing.assert_array_equal(points[: len(moved[0])], of_mount[0][0])
    np.testing.assert_array_equal(fields, np.concatenate([rows for _, rows, _ in of_mount]))
    mounts = np.fromfile(out / "fused/helios_16/training/mounts/000000.bin", "<u2")
    np.testing.assert_array_equal(mounts, np.repeat([0, 1], [len(rows) for rows in moved]))


def test_fused_vehicles_are_labelled_once(runs: Runs) -> None:
    out = runs("out", "--fuse", "--aggregation", "instant")
    points, fields, fused = frame_of(out / "fused")
    first, other = (frame_of(out / mount)[2] for mount in MOUNTS)
    assert fused.ids.tolist() == [1, 2]
    np.testing.assert_array_equal(fused.boxes, first.boxes)
    np.testing.assert_array_equal(fused.distance, first.distance)
    np.testing.assert_array_equal(fused.points, first.points + other.points)
    np.testing.assert_array_equal(fused.visibility, np.maximum(first.visibility, other.visibility))
    assert (first.points > 0).all()
    assert (other.points > 0).all()
    np.testing.assert_array_equal(fused.points_in_box, fused.points)
    for i, object_id in enumerate(fused.ids):
        hits = points[fields["object_id"] == object_id, :3].astype(float)
        assert points_in_box(hits, fused.boxes[i], 0.011).all()
    labels = (out / "fused/helios_16/training/label_2/000000.txt").read_text()
    assert labels.count("Car") == 2


def test_a_fused_label_holds_at_the_mean_time_of_all_points(runs: Runs) -> None:
    out = runs("out", "--fuse", "--label-time", "scan")
    fused = frame_of(out / "fused")[2]
    objects = [frame_of(out / mount)[2] for mount in MOUNTS]
    points = np.array([o.points for o in objects])
    mean = (points * [o.scan_time_s for o in objects]).sum(axis=0) / points.sum(axis=0)
    np.testing.assert_allclose(fused.scan_time_s, mean, atol=2e-6)
    way = np.hypot(*(fused.scan_boxes - fused.boxes)[:, :2].T)
    np.testing.assert_allclose(way, [0, SPEED * abs(mean[1] - 0.05)], atol=3e-4)


def test_a_late_clock_moves_vehicles_on(runs: Runs) -> None:
    """50 ms at 15 m/s are 0.75 m. Standing vehicles do not move."""
    late = {name: dict(mount) for name, mount in MOUNTS.items()}
    late["left"]["clock_offset_s"] = 0.05
    words = ("--fuse", "--aggregation", "instant", "--label-time", "scan")
    before, after = runs("before", *words), runs("after", *words, mounts=late)
    sides = [frame_of(out / "left")[2].boxes for out in (before, after)]
    way = np.hypot(*(sides[1] - sides[0])[:, :2].T)
    np.testing.assert_allclose(way, [0, 0.75], atol=2e-4)
    rows = pd.read_csv(after / "left/trajectories.csv")
    np.testing.assert_allclose(rows["x"][rows["id"] == 2], -5 + SPEED * (np.arange(11) / 10 + 0.05))

    fused = frame_of(after / "fused")[2]
    share = frame_of(after / "left")[2].points / fused.points
    np.testing.assert_allclose(fused.scan_time_s, 0.05 + 0.05 * share, atol=1e-5)
    first = frame_of(after / "right")[2]
    np.testing.assert_array_equal(fused.boxes, first.boxes)
    way = np.hypot(*(fused.scan_boxes - first.boxes)[:, :2].T)
    np.testing.assert_allclose(way, [0, 0.75 * share[1]], atol=2e-4)
    assert fused.points_in_box[1] < fused.points[1]
    assert fused.points_in_box[0] == fused.points[0]


def test_an_error_of_calibration_moves_fused_points_alone(runs: Runs, digests: Digests) -> None:
    wrong = {name: dict(mount) for name, mount in MOUNTS.items()}
    wrong["left"]["calibration_error"] = {"x_m": 0.5, "yaw_deg": 2, "pitch_deg": 1}
    right, off = runs("right", "--fuse"), runs("off", "--fuse", mounts=wrong)
    for mount in MOUNTS:
        assert digests(right / mount) == digests(off / mount)
    clouds = [frame_of(out / "fused")[0][:, :3] for out in (right, off)]
    seen = len(frame_of(right / "right")[0])
    np.testing.assert_array_equal(clouds[0][:seen], clouds[1][:seen])

    def turn(pitch_deg: float, roll_deg: float) -> np.ndarray:
        p, r = np.radians([pitch_deg, roll_deg])
        pitch_matrix = [[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]]
        roll_matrix = [[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]]
        return np.array(pitch_matrix) @ np.array(roll_matrix)

    levelled = frame_of(off / "left")[0][:, :3] @ (turn(9, 0) @ turn(8, 0).T).T
    assumed = MOUNTS["left"] | {"x_m": 30.5, "yaw_deg": 172}
    np.testing.assert_allclose(clouds[1][seen:], to_first(levelled, assumed), atol=2e-5)
    boxes = [frame_of(out / "fused")[2].boxes for out in (right, off)]
    np.testing.assert_array_equal(*boxes)


POLES = ("west", "east", "north")


@pytest.mark.parametrize(("max_range_m", "echo"), [(180, None), (40, "dual")])
def test_fused_objects_of_python_are_those_of_the_run(
    infrasim: Infrasim, tmp_path: Path, max_range_m: float, echo: str | None
) -> None:
    """All columns are equal, also with wrong poses, and for objects beyond the first LiDAR's range.
    The run rounds them as `save` does."""
    scene = yaml.safe_load((ROOT / "configs/scenes/crossroad_poles.yaml").read_text())
    scene["mounts"] = {mount: scene["mounts"][mount] for mount in POLES}
    scene["mounts"]["west"]["calibration_error"] = {"x_m": 0.3, "pitch_deg": 0.5}
    scene["mounts"]["east"]["calibration_error"] = {"yaw_deg": 1, "y_m": 0.2, "roll_deg": 0.3}
    (file := tmp_path / "poles.yaml").write_text(yaml.safe_dump(scene, sort_keys=False))
    keys = yaml.safe_load((ROOT / "configs/lidars/helios_16.yaml").read_text())
    keys["presets"]["datasheet"]["returns"]["max_range_m"] = max_range_m
    keys["presets"]["datasheet"]["pattern"]["spinning"]["channels"]["file"] = str(
        ROOT / "configs/lidars/channels/robosense_helios_16.csv"
    )
    (lidar := tmp_path / "helios_16.yaml").write_text(yaml.safe_dump(keys))
    words = ["--fuse", "--fields", "--frames", "100:102", *(["--echo", echo] if echo else [])]
    infrasim("run", file, "--lidar", lidar, *words, "--out", tmp_path / "run", check=True)
    unit = pi.load_lidar(lidar, echo=echo)
    frames = pi.simulate(file, unit, [100, 101], mount=list(POLES), fuse=True)
    saved = frames.save(tmp_path / "saved/poles")
    for k in frames.numbers:
        ours, theirs = (
            pd.read_csv(kitti.frame_file(folder / "helios_16", "objects", k))
            for folder in (saved, tmp_path / "run/fused")
        )
        assert (ours.points_in_box < ours.points).any()
        assert (ours.points_in_scan_box > ours.points_in_box).any()
        assert (ours.distance > max_range_m).any()
        pd.testing.assert_frame_equal(ours, theirs)


def test_fused_frames_of_python_refuse_different_clocks(tmp_path: Path) -> None:
    scene = pi.load_scene("crossroad_poles", mount="west", set={"mounts.east.clock_offset_s": 0.1})
    alone = pi.simulate(scene, "helios_16", [0], mount=["west", "east"])
    assert sorted(alone) == ["east", "west"]
    with pytest.raises(pi.Error, match=r"mounts\.east\.clock_offset_s: expected 0 .* got 0\.1"):
        pi.simulate(scene, "helios_16", [0], mount=["west", "east"], fuse=True)
    late = {f"mounts.{name}.clock_offset_s": 0.1 for name in POLES}
    same = pi.load_scene("crossroad_poles", mount="west", set=late)
    assert len(pi.simulate(same, "helios_16", [0], mount=list(POLES), fuse=True)[0].points)


def test_a_fused_data_set_says_where_its_sensors_are(runs: Runs) -> None:
    out = runs("out", "--fuse")
    data, left = read_data_set(out / "fused"), read_data_set(out / "left")
    assert data.lidars[0].price_usd == tuple(2 * usd for usd in left.lidars[0].price_usd)
    first = read_data_set(out / "right").lidars[0]
    assert data.lidars[0].T_world_levelled == first.T_world_levelled
    keys = yaml.safe_load((out / "fused/dataset.yaml").read_text())
    assert list(keys["mounts"]) == ["right", "left"]
    boxes = frame_of(out / "left")[2].boxes[:, :3]
    far = np.concatenate([boxes, boxes + np.array([0, 0, 40]), boxes + np.array([140, 0, 0])])
    seen = np.array(field_of_view_mask(left.lidars[0], left.tilts[0], far))
    views = data.lidars[0].field_of_view
    lidar = kitti.Lidar(**{**vars(data.lidars[0]), "field_of_view": views[1:]})
    moved = to_first(far, MOUNTS["left"])
    np.testing.assert_array_equal(field_of_view_mask(lidar, data.tilts[0], moved), seen)
    assert 0 < seen[1].sum() < len(far)
    assert read_vehicles(out / "fused/helios_16", data.frames).points.sum() > 0


def test_a_plan_marks_every_sensor(runs: Runs) -> None:
    out = runs("out", "--fuse")
    for name, mounts in (("left", ["left"]), ("fused", list(MOUNTS))):
        folder = out / name / "helios_16"
        assert len(kitti.read_lidar(folder).sensors) == len(mounts)
        lines = scene_figures.plan(scene_figures.read_scene([folder])).axes[0].lines
        marks = [line.get_xydata()[0] for line in lines if line.get_marker() == "^"]
        positions = [(MOUNTS[mount]["x_m"], MOUNTS[mount]["y_m"]) for mount in mounts]
        np.testing.assert_allclose(marks, positions, atol=1e-3)


def test_a_fused_lidar_is_one_of_each_mount_in_a_benchmark(runs: Runs) -> None:
    out = runs("out", "--fuse")
    fused, left = (out / name / "helios_16" for name in ("fused", "left"))
    assert lidar_row(fused) == lidar_row(left)
    assert hit_row(fused, 10)["mounts"] == 2
    assert "mounts" not in hit_row(left, 10)


def test_a_fused_run_goes_on_to_the_same_bytes(runs: Runs, digests: Digests) -> None:
    whole = runs("whole", "--fuse", "--frames", "0:4")
    parts = runs("parts", "--mount", "left", "--frames", "3:4")
    runs("parts", "--frames", "2:4", "--threads", "3")
    runs("parts", "--fuse", "--frames", "1:4", "--threads", "2")
    for folder in ("left", "fused"):
        kitti.frame_file(parts / folder / "helios_16", "velodyne", 2).unlink()
    runs("parts", "--fuse", "--frames", "0:4")
    assert digests(parts) == digests(whole)


def test_an_edited_recording_is_another_run(runs: Runs, tmp_path: Path) -> None:
    runs("out", "--frames", "0:2")
    extra = "".join(f"{k / 10:g},3,Car,20,-2,0.75,0,4.5,1.9,1.5,0\n" for k in range(11))
    rows = sorted(
        [*trajectories().splitlines()[1:], *extra.splitlines()],
        key=lambda row: [float(cell) for cell in row.split(",")[:2]],
    )
    header = trajectories().splitlines()[0]
    (tmp_path / "cars.csv").write_text("\n".join([header, *rows]) + "\n")
    with pytest.raises(RuntimeError, match=r"the folder holds another run: at 0 s .* no object 3"):
        runs("out", "--frames", "0:4")
    (tmp_path / "cars.csv").write_text(trajectories())
    runs("out", "--frames", "0:4")


def test_a_fused_folder_keeps_its_lidar(runs: Runs) -> None:
    out = runs("out", "--fuse", "--frames", "0:1", preset="datasheet")
    for mount in MOUNTS:
        shutil.rmtree(out / mount)
    with pytest.raises(RuntimeError, match=r"the folder holds another run: .*lidar_digest"):
        runs("out", "--fuse", "--frames", "0:2", "--echo", "last", preset="datasheet")


def test_names_of_mounts_stay_texts(runs: Runs) -> None:
    mounts = {"1": MOUNTS["right"], "no": MOUNTS["left"], "010": MOUNTS["left"] | {"x_m": 50}}
    out = runs("out", "--fuse", "--frames", "0:1", mounts=mounts)
    written = yaml.safe_load((out / "fused/helios_16/lidar.yaml").read_text())
    assert written["mounts"] == list(mounts)
    assert list(yaml.safe_load((out / "fused/dataset.yaml").read_text())["mounts"]) == list(mounts)


def test_two_points_of_a_ray_count_once_in_boxes_of_fused_frames(runs: Runs) -> None:
    lidar = str(ROOT / "configs/lidars/ruby_plus.yaml")
    words = ("--lidar", lidar, "--echo", "dual", "--fuse", "--frames", "0:3")
    out = runs("out", *words, preset="datasheet")
    for k in range(3):
        objects = kitti.read_objects(kitti.frame_file(out / "fused/ruby_plus", "objects", k))
        assert (objects.points_in_box <= objects.points).all()


def test_a_stream_takes_a_mount_s_name(runs: Runs, tmp_path: Path) -> None:
    sim = pytest.importorskip("pyinfra.dataset.simulation", reason="the extension is not built")
    left = runs("out") / "left"
    scene = tmp_path / "out.yaml"
    for k, (frame,) in sim.simulate(scene, [LIDAR], range(2), preset="paper", mount="left"):
        assert sim.points(frame).tobytes() == frame_of(left, k)[0].tobytes()
    with pytest.raises(sim.ConfigError, match="mount: expected right, left, got none"):
        sim.load_scene(scene)


@pytest.mark.parametrize(
    ("words", "changes", "message"),
    [
        (["--mount", "middle"], {}, "mount: expected right, left, got 'middle'"),
        (["--fuse", "--mount", "left"], {}, "--fuse: expected several mounts, got --mount left"),
        (["--fuse"], {"left": None}, "--fuse: expected several mounts, got a scene with one"),
        ([], {"fused": MOUNTS["left"]}, "mounts: expected a name of letters, ..., got 'fused'"),
        ([], {"a/b": MOUNTS["left"]}, "mounts: expected a name of letters, ..., got 'a/b'"),
        (
            [],
            {"left": {"y_m": 2, "z_m": 3}},
            "mounts.left.z_m: expected ..., got 3, where vehicles hit the LiDAR",
        ),
        (
            [],
            {"left": {"clock_offset_s": 0.2}},
            "clock_offset_s: expected -0.1 to 0.1, got '0.2'",
        ),
        (
            [],
            {"left": None, "right": {"calibration_error": {"x_m": 1}}},
            "mounts: expected no calibration_error with a single mount, got one",
        ),
        (
            ["--set", "static_layers={helios_16: a.layer}"],
            {},
            "static_layers: expected one mount, got several; a file ... at one mount only",
        ),
    ],
)
def test_what_mounts_can_not_be(
    runs: Runs, tmp_path: Path, words: list[str], changes: Mapping[str, Any], message: str
) -> None:
    mounts = {name: dict(mount) for name, mount in MOUNTS.items()}
    for name, keys in changes.items():
        mounts[name] = mounts.get(name, {}) | (keys or {})
        if keys is None:
            del mounts[name]
    with pytest.raises(RuntimeError) as error:
        runs("out", *words, mounts=mounts)
    assert re.search(pattern(message), str(error.value))
    assert not (tmp_path / "out").exists()


def test_a_mount_twice_is_refused(infrasim: Infrasim, tmp_path: Path) -> None:
    text = yaml.safe_dump(scene_keys(), sort_keys=False).replace("  left:", "  right:")
    (file := tmp_path / "scene.yaml").write_text(text)
    result = infrasim("check", file)
    assert result.returncode == 2
    assert "right" in result.stderr
    assert "twice" in result.stderr or "duplicate" in result.stderr


def test_a_folder_of_one_mount_takes_no_others(runs: Runs) -> None:
    runs("out", mounts={"right": MOUNTS["right"]})
    with pytest.raises(RuntimeError, match=r"dataset\.yaml: .*holds a run of one mount"):
        runs("out")
