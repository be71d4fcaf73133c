"""The bindings give the frames of the binary, without copies and with its errors."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from pyinfra import sim

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "configs" / "scenes" / "curve.yaml"
LIDARS = [ROOT / "configs" / "lidars" / f"{name}.yaml" for name in ("livox_avia", "helios_16")]
SHORT = {"duration_s": 2, "traffic.warm_up_s": 5}


@pytest.fixture(scope="module")
def world() -> sim.World:
    return sim.load_scene(SCENE, seed=3, set=SHORT)


def frames(world: sim.World, numbers: range, threads: int = 2) -> list[list[sim.Frame]]:
    lidars = [sim.load_lidar(file, "datasheet") for file in LIDARS]
    return [found for _, found in sim.simulate(world, lidars, numbers, threads=threads)]


def test_binding_and_binary_give_equal_bytes(world: sim.World, tmp_path: Path) -> None:
    command = [ROOT / "build/dev/cpp/infrasim", "run", SCENE, "--lidar", *LIDARS]
    command += ["--frames", "4:7", "--seed", "3", "--fields", "--out", tmp_path / "data"]
    for key, value in SHORT.items():
        command += ["--set", f"{key}={value}"]
    subprocess.run(command, check=True, capture_output=True)
    for number, found in zip(range(4, 7), frames(world, range(4, 7)), strict=True):
        for file, frame in zip(LIDARS, found, strict=True):
            training = tmp_path / "data" / file.stem / "training"
            velodyne = (training / "velodyne" / f"{number:06d}.bin").read_bytes()
            assert sim.points(frame).tobytes() == velodyne
            fields = np.fromfile(
                training / "fields" / f"{number:06d}.bin",
                [("time", "<f4"), ("ring", "<u2"), ("class_id", "<u2"), ("object_id", "<i4")],
            )
            for name in fields.dtype.names or ():
                np.testing.assert_array_equal(fields[name], getattr(frame, name))


def test_columns_are_views_that_outlive_their_frame(world: sim.World) -> None:
    ((frame, _),) = frames(world, range(1))
    first, second = frame.xyz, frame.xyz
    assert first.__array_interface__["data"] == second.__array_interface__["data"]
    assert not first.flags.writeable
    assert not first.flags.owndata
    before = first.copy()
    del frame, second
    np.testing.assert_array_equal(first, before)


def test_frames_come_in_the_order_asked_for(world: sim.World) -> None:
    lidar = sim.load_lidar(LIDARS[1], "paper")
    numbers = [5, 1, 9, 0]
    assert [k for k, _ in sim.simulate(world, [lidar], numbers, threads=2)] == numbers


def test_objects_count_the_points_of_their_id(world: sim.World) -> None:
    ((frame, _),) = frames(world, range(1))
    for row in frame.objects:
        assert row["points"] == np.count_nonzero(frame.object_id == row["id"])


def test_a_stream_can_be_left_early(world: sim.World) -> None:
    lidar = sim.load_lidar(LIDARS[1], "paper")
    stream = sim.simulate(world, [lidar], range(20))
    assert next(stream)[0] == 0
    del stream


def test_errors_are_those_of_the_binary() -> None:
    with pytest.raises(sim.ConfigError, match=r"--set lanes=3: lanes: found an unknown key"):
        sim.load_scene(SCENE, set={"lanes": 3})
    with pytest.raises(ValueError, match="no preset 'nice', allowed paper, equal, datasheet"):
        sim.load_lidar(LIDARS[0], "nice")
    with pytest.raises(OSError, match=r"missing\.yaml: can't be read"):
        sim.load_scene("missing.yaml")


def test_a_frame_beyond_the_scene_is_an_error(world: sim.World) -> None:
    with pytest.raises(sim.ConfigError, match="found 20, allowed 0 to 19"):
        frames(world, range(20, 21))


def test_a_built_world_takes_no_further_settings(world: sim.World) -> None:
    with pytest.raises(ValueError, match="already built"):
        sim.simulate(world, [], [0], seed=1)


def test_scan_pattern_runs_on_over_frames() -> None:
    whole = sim.scan_pattern(LIDARS[0], range(3))
    np.testing.assert_array_equal(whole[48000:], sim.scan_pattern(LIDARS[0], range(2, 3)))
    assert whole.shape == (72000, 3)
    assert np.all(np.diff(whole[:, 2]) >= 0)
