"""The bindings return the frames of the binary without copies, and raise its errors."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import BINARY

from pyinfra.core.arrays import FloatArray, Records
from pyinfra.dataset import simulation

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "configs" / "scenes" / "curve.yaml"
CATALOGUE = ROOT / "configs" / "lidars"
LIDARS = [CATALOGUE / f"{name}.yaml" for name in ("livox_avia", "helios_16")]
SHORT = {"duration_s": 2, "traffic.warm_up_s": 5}


@pytest.fixture(scope="module")
def world() -> simulation.World:
    return simulation.load_scene(SCENE, seed=3, set=SHORT)


def frames(
    world: simulation.World, numbers: range, threads: int = 2
) -> list[list[simulation.Frame]]:
    lidars = [simulation.load_lidar(file, "datasheet") for file in LIDARS]
    return [
        per_lidar for _, per_lidar in simulation.simulate(world, lidars, numbers, threads=threads)
    ]


def test_binding_and_binary_give_equal_bytes(world: simulation.World, tmp_path: Path) -> None:
    command = [BINARY, "run", SCENE, "--lidar", *LIDARS]
    command += ["--frames", "4:7", "--seed", "3", "--fields", "--out", tmp_path / "data"]
    for key, value in SHORT.items():
        command += ["--set", f"{key}={value}"]
    subprocess.run(command, check=True, capture_output=True)
    for number, per_lidar in zip(range(4, 7), frames(world, range(4, 7)), strict=True):
        for file, frame in zip(LIDARS, per_lidar, strict=True):
            training = tmp_path / "data" / file.stem / "training"
            velodyne = (training / "velodyne" / f"{number:06d}.bin").read_bytes()
            assert simulation.points(frame).tobytes() == velodyne
            fields = np.fromfile(
                training / "fields" / f"{number:06d}.bin",
                [("time", "<f4"), ("ring", "<u2"), ("class_id", "<u2"), ("object_id", "<i4")],
            )
            for name in fields.dtype.names or ():
                np.testing.assert_array_equal(fields[name], getattr(frame, name))


def test_every_hit_is_a_point_in_any_weather() -> None:
    lidar = simulation.load_lidar(CATALOGUE / "helios_16.yaml", "datasheet").with_every_hit()
    rays = []
    for weather in ({}, {"weather.visibility_m": 30, "weather.rain_mm_per_h": 50}):
        world = simulation.load_scene(SCENE, seed=3, set=SHORT | weather)
        ((_, (frame,)),) = simulation.simulate(world, [lidar], range(1), threads=1)
        rays.append(np.column_stack([frame.time, frame.ring]))
    np.testing.assert_array_equal(*rays)


def test_columns_are_views_that_outlive_their_frame(world: simulation.World) -> None:
    ((frame, _),) = frames(world, range(1))
    first, second = frame.xyz, frame.xyz
    assert first.__array_interface__["data"] == second.__array_interface__["data"]
    assert not first.flags.writeable
    assert not first.flags.owndata
    before = first.copy()
    del frame, second
    np.testing.assert_array_equal(first, before)


def test_frames_come_in_the_order_asked_for(world: simulation.World) -> None:
    lidar = simulation.load_lidar(LIDARS[1])
    numbers = [5, 1, 9, 0]
    assert [k for k, _ in simulation.simulate(world, [lidar], numbers, threads=2)] == numbers


ONE_FRAME = """
import resource, sys
import pyinfra as pi
scene = pi.load_scene("highway", set={"duration_s": int(sys.argv[1])})
frames = pi.simulate(scene, "helios_16", [20], threads=2)
assert len(frames[0].points) and len(frames.everybody().ids) and len(scene.mesh(20)[0])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.nightly
def test_memory_of_one_frame_does_not_grow_with_the_scene() -> None:
    peaks = []
    for seconds in (5, 3600):
        command = [sys.executable, "-c", ONE_FRAME, str(seconds)]
        peaks.append(int(subprocess.run(command, check=True, capture_output=True).stdout))
    assert peaks[1] < 1.2 * peaks[0]  # the ratio is 2.5 if all traffic of the scene is simulated


def test_frames_do_not_depend_on_which_were_simulated_before() -> None:
    whole, backwards = (simulation.load_scene(SCENE, seed=3, set=SHORT) for _ in range(2))
    whole.drive()
    down = range(19, -1, -1)
    late = [frames(backwards, range(k, k + 1), threads=1)[0] for k in (19, 7, 0)]
    for one, other in zip(frames(whole, down), frames(backwards, down), strict=True):
        for a, b in zip(one, other, strict=True):
            assert simulation.points(a).tobytes() == simulation.points(b).tobytes()
            assert a.objects.tolist() == b.objects.tolist()
    for k, one in zip((19, 7, 0), late, strict=True):
        assert one[0].xyz.tobytes() == frames(whole, range(k, k + 1))[0][0].xyz.tobytes()
        assert whole.objects(k).tolist() == backwards.objects(k).tolist()


def test_objects_count_the_points_of_their_id(world: simulation.World) -> None:
    ((frame, _),) = frames(world, range(1))
    for row in frame.objects:
        assert row["points"] == np.count_nonzero(frame.object_id == row["id"])


def test_a_higher_law_exponent_gives_more_points_to_a_lidar_with_one_published_range(
    world: simulation.World,
) -> None:
    def dumped(name: str, law_exponent: float | None) -> str:
        return simulation.load_lidar(CATALOGUE / f"{name}.yaml", law_exponent=law_exponent).dump()

    points = []
    for law_exponent in (None, 0.25, 0.375, 0.5):
        lidar = simulation.load_lidar(CATALOGUE / "helios_16.yaml", law_exponent=law_exponent)
        ((_, (frame,)),) = simulation.simulate(world, [lidar], range(1))
        points.append(len(frame))
    assert points[0] == points[1] < points[2] < points[3]
    assert "law_exponent: 0.5" in dumped("helios_16", 0.5)
    assert dumped("livox_mid_70", 0.25) == dumped("livox_mid_70", None)


def test_two_echoes_add_points_that_follow_the_first_of_their_ray(world: simulation.World) -> None:
    def records(echo: str) -> tuple[FloatArray, Records]:
        lidar = simulation.load_lidar(CATALOGUE / "ruby_plus.yaml", echo=echo)
        ((_, (frame,)),) = simulation.simulate(world, [lidar], range(1))
        return np.asarray(frame.xyz), simulation.fields(frame)

    (one_xyz, one), (both_xyz, both) = records("strongest"), records("dual")
    second = np.flatnonzero(both["echo"] == 1)
    assert len(second) > 20
    assert not one["echo"].any()
    for name in ("time_s", "ring"):
        assert (both[name][second] == both[name][second - 1]).all()
    apart = np.linalg.norm(both_xyz[second] - both_xyz[second - 1], axis=1)
    assert apart.min() > 0.8  # the least separation is 1 m before the range noise
    first = both_xyz[both["echo"] == 0]
    same = len(set(map(bytes, first)) & set(map(bytes, one_xyz)))
    assert same == len(one_xyz)  # the strongest echoes are the same


def test_labels_hold_when_the_scene_or_the_preset_says(world: simulation.World) -> None:
    paper, datasheet = (
        simulation.load_lidar(LIDARS[1], preset) for preset in ("paper", "datasheet")
    )
    assert simulation.label_time(world, paper) == "frame"
    assert simulation.label_time(world, datasheet) == "scan"
    explicit = simulation.load_scene(SCENE, set=SHORT | {"label_time": "frame"})
    assert simulation.label_time(explicit, datasheet) == "frame"


def test_objects_have_the_pose_of_their_scan(world: simulation.World) -> None:
    ((_, spinning),) = frames(world, range(1))
    rows = spinning.objects
    unhit = rows["points"] == 0
    np.testing.assert_array_equal(rows["scan_x"][unhit], rows["x"][unhit])
    np.testing.assert_array_equal(rows["scan_time_s"][unhit], 0.05)
    way = np.hypot(rows["scan_x"] - rows["x"], rows["scan_y"] - rows["y"])
    np.testing.assert_allclose(way, rows["speed"] * abs(rows["scan_time_s"] - 0.05), atol=0.02)
    assert way.max() > 0.2


def test_a_stream_can_be_left_early(world: simulation.World) -> None:
    lidar = simulation.load_lidar(LIDARS[1])
    stream = simulation.simulate(world, [lidar], range(20))
    assert next(stream)[0] == 0
    del stream


def test_errors_are_those_of_the_binary() -> None:
    with pytest.raises(
        simulation.ConfigError, match=r"--set lane=3: lane: expected .*got an unknown key"
    ):
        simulation.load_scene(SCENE, set={"lane": 3})
    with pytest.raises(
        ValueError, match="presets: expected paper, equal, datasheet, got unknown preset 'nice'"
    ):
        simulation.load_lidar(LIDARS[0], "nice")
    with pytest.raises(OSError, match=r"missing\.yaml: can't be read"):
        simulation.load_scene("missing.yaml")


def test_a_frame_beyond_the_scene_is_an_error(world: simulation.World) -> None:
    with pytest.raises(simulation.ConfigError, match="expected 0 to 19, got 20"):
        frames(world, range(20, 21))


def test_frames_beyond_every_scene_are_refused_at_once(world: simulation.World) -> None:
    with pytest.raises(
        simulation.ConfigError, match=f"frames: expected 0 to 19, got {world.frames}"
    ):
        simulation.simulate(world, LIDARS[:1], range(2**36))


def test_a_built_world_takes_no_further_settings(world: simulation.World) -> None:
    with pytest.raises(ValueError, match="got a World"):
        simulation.simulate(world, [], [0], seed=1)


def test_weather_that_a_lidar_does_not_feel_is_a_warning() -> None:
    fog = SHORT | {"weather.visibility_m": 30}
    foggy = simulation.load_scene(SCENE, preset="paper", set=fog)
    with pytest.warns(UserWarning, match="livox_avia, preset paper: weather: no effect") as caught:
        simulation.simulate(foggy, LIDARS[:1], range(1), preset="paper")
    assert caught[0].filename == __file__
    simulation.simulate(
        simulation.load_scene(SCENE, set=fog), LIDARS[:1], range(1), preset="datasheet"
    )


def test_a_scene_holds_the_keys_of_its_preset(world: simulation.World) -> None:
    plain = simulation.load_scene(SCENE, preset="paper", set=SHORT)
    assert "trees_along" in world.dump()
    assert "vegetation: []" in plain.dump()
    lidar = simulation.load_lidar(LIDARS[1], "equal")
    with pytest.raises(simulation.ConfigError, match=r"expected 'data.*, got 'equal'"):
        simulation.simulate(world, [lidar], range(1))
    assert (
        next(simulation.simulate(plain, [lidar], range(1)))[0] == 0
    )  # neither struct has its own keys
    (_, (frame,)) = next(simulation.simulate(world, LIDARS[1:], range(1)))
    assert np.count_nonzero(frame.class_id == 4) > 100


@pytest.mark.parametrize("threads", [-1, 1025])
def test_threads_that_can_not_be(world: simulation.World, threads: int) -> None:
    with pytest.raises(simulation.ConfigError, match=f"threads: expected 1 to 1024, got {threads}"):
        simulation.simulate(world, LIDARS, range(1), threads=threads)


def test_scan_pattern_takes_the_step_of_its_range() -> None:
    every = simulation.scan_pattern(LIDARS[1], range(0, 3))
    first, _, third = np.split(every, 3)
    np.testing.assert_array_equal(
        simulation.scan_pattern(LIDARS[1], range(0, 3, 2)), np.concatenate([first, third])
    )
    assert len(simulation.scan_pattern(LIDARS[1], range(0, 3, 2**31 - 1))) == len(first)


def test_scan_pattern_runs_on_over_frames() -> None:
    whole = simulation.scan_pattern(LIDARS[0], range(3))
    np.testing.assert_array_equal(whole[48000:], simulation.scan_pattern(LIDARS[0], range(2, 3)))
    assert whole.shape == (72000, 3)
    assert np.all(np.diff(whole[:, 2]) >= 0)


def test_filters_keep_what_the_binary_keeps(tmp_path: Path) -> None:
    world = simulation.load_scene(SCENE, preset="paper", seed=3, set=SHORT)
    lidar = simulation.load_lidar(LIDARS[1], "paper")
    clouds = [
        simulation.points(frame)
        for _, (frame,) in simulation.simulate(world, [lidar], range(0, 20, 2))
    ]
    for i, cloud in enumerate(clouds):
        cloud.tofile(tmp_path / f"{i}.bin")
    model = simulation.learn_background(clouds)
    model.save(str(tmp_path / "model"))
    steps = [
        simulation.CropRange(2, 60),
        simulation.GroundPlane(0.3),
        simulation.BackgroundModel.load(str(tmp_path / "model")),
    ]
    kept = simulation.filtered(clouds[0], *steps)
    words = ["--crop-range", "2,60", "--ground-plane", "0.3", "--background"]
    words += [str(tmp_path / f"{i}.bin") for i in range(len(clouds))]
    binary = [BINARY, "filter", tmp_path / "0.bin", *words]
    subprocess.run([*binary, "--out", tmp_path / "out.bin"], check=True, capture_output=True)
    assert kept.tobytes() == (tmp_path / "out.bin").read_bytes()
    assert 0 < len(kept) < len(clouds[0])


@pytest.mark.parametrize(
    ("step", "rows"),
    [
        (simulation.CropBox((-1, -1, -1), (1, 1, 1)), [0]),
        (simulation.CropPolygon([(4, 1), (6, 1), (6, -1), (4, -1)]), [1]),
        (simulation.CropRange(1, 6), [1]),
        (simulation.CropFieldOfView(azimuth_min_deg=-10, azimuth_max_deg=10), [0, 1]),
        (simulation.GroundHeight(-0.5), [0, 1]),
    ],
)
def test_each_filter_keeps_its_rows(step: simulation.Filter, rows: list[int]) -> None:
    points = np.array([[0.5, 0, 0], [5, 0, 0], [0, 9, -1], [np.nan, 0, 0]], np.float32)
    assert simulation.kept_rows(points, [step]).tolist() == rows


def test_wrong_points_and_parameters_are_refused() -> None:
    for points in (np.zeros((3, 3)), np.zeros(3, np.float32), np.zeros((3, 2), np.float32)):
        with pytest.raises(ValueError, match=r"points: expected \(n, 3\) or \(n, 4\).*got \(3"):
            simulation.filtered(points, simulation.CropRange(0, 1))
    cloud = np.zeros((3, 3), np.float32)
    with pytest.raises(ValueError, match="ground_plane: the distance must be positive"):
        simulation.filtered(cloud, simulation.GroundPlane(distance_m=-1))
    with pytest.raises(ValueError, match="frame"):
        simulation.learn_background([])


def test_background_file_that_is_no_model_is_named(tmp_path: Path) -> None:
    (tmp_path / "model").write_bytes(b"no model")
    with pytest.raises(simulation.ConfigError, match="model"):
        simulation.BackgroundModel.load(str(tmp_path / "model"))
    with pytest.raises(simulation.IoError, match="can't be read"):
        simulation.BackgroundModel.load(str(tmp_path / "none"))
