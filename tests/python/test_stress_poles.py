"""`pyinfra stress` on fused frames: altered scenes, and wrong clocks and poses of mounts."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import Infrasim

from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.experiments.stress import altered_scenes, trials
from pyinfra.experiments.stress.stressors import STRESSORS, chosen
from pyinfra.formats import kitti

FRAMES = (0, 20)
MOUNTS = ("west", "east", "north")


@pytest.fixture(scope="module")
def data(infrasim: Infrasim, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulates two frames of three poles at a crossroad."""
    folder = tmp_path_factory.mktemp("poles")
    keys = yaml.safe_load(scene_file("crossroad_poles").read_text())
    keys |= {"mounts": {name: keys["mounts"][name] for name in MOUNTS}, "duration_s": 3}
    (scene := folder / "three.yaml").write_text(yaml.safe_dump(keys, sort_keys=False))
    words = ["--lidar", lidar_file("helios_16"), "--frames", "0:21:20", "--threads", "1"]
    infrasim("run", scene, *words, "--out", folder / "data", "--fuse", check=True)
    return folder / "data"


@pytest.fixture(scope="module")
def base(data: Path) -> altered_scenes.Base:
    return altered_scenes.read_base(data / "fused/helios_16", 60)


def cloud(folder: Path) -> np.ndarray:
    return kitti.read_points(kitti.frame_file(folder, "velodyne", 20))


def stressed(name: str, severity: float, base: altered_scenes.Base, cache: Path) -> Path:
    change = STRESSORS[name].scene_change
    assert change is not None
    return altered_scenes.simulated(base, change(base, severity), cache, name)


def test_a_fused_scene_without_a_change_has_the_same_bytes(
    base: altered_scenes.Base, tmp_path: Path
) -> None:
    folder = altered_scenes.simulated(base, altered_scenes.AlteredScene(), tmp_path, "same")
    assert folder.parent.name == "fused"
    assert cloud(folder).tobytes() == cloud(base.folder).tobytes()


def test_clocks_of_poles_come_apart(base: altered_scenes.Base, tmp_path: Path) -> None:
    folder = stressed("pole_clock", 50.0, base, tmp_path)
    mounts = yaml.safe_load((folder.parent / "dataset.yaml").read_text())["mounts"]
    late_s = [mounts[name].get("clock_offset_s", 0) for name in MOUNTS]
    assert late_s == [0, 0.025, 0.05]


def test_poses_of_poles_come_apart_and_vehicles_stay(
    data: Path, base: altered_scenes.Base, tmp_path: Path
) -> None:
    folder = stressed("pole_yaw", 1.0, base, tmp_path)
    before, after = cloud(base.folder), cloud(folder)
    assert len(before) == len(after)
    mount = np.repeat(range(3), [len(cloud(data / name / "helios_16")) for name in MOUNTS])
    moved = np.hypot(*(after - before)[:, :2].T)
    assert (moved[mount == 0] == 0).all()
    for i, x, y in ((1, 50.0, 20.0), (2, 15.0, 35.0)):  # positions in the frame of the first mount
        away = np.hypot(before[:, 0] - x, before[:, 1] - y)[mount == i]
        np.testing.assert_allclose(moved[mount == i], away * np.radians(1), atol=2e-3, rtol=1e-3)
    mounts = yaml.safe_load((folder.parent / "dataset.yaml").read_text())["mounts"]
    assert [mounts[name]["calibration_error"]["yaw_deg"] for name in MOUNTS[1:]] == [1, -1]
    boxes = [
        kitti.read_objects(kitti.frame_file(f, "objects", 20)).boxes for f in (base.folder, folder)
    ]
    np.testing.assert_array_equal(*boxes)


def test_recorded_vehicles_follow_the_clock_of_the_first(data: Path, tmp_path: Path) -> None:
    (fused := tmp_path / "fused").mkdir()
    (fused / "helios_16").symlink_to(data / "fused/helios_16", target_is_directory=True)
    keys = yaml.safe_load((data / "fused/dataset.yaml").read_text())
    late = dict(zip(MOUNTS, (0.02, 0.0, 0.05), strict=True))
    for name, late_s in late.items():
        keys["mounts"][name]["clock_offset_s"] = late_s
    keys["trajectories"] = "cars.csv"
    (fused / "dataset.yaml").write_text(yaml.safe_dump(keys, sort_keys=False))
    mounts = altered_scenes.read_base(fused / "helios_16", 60).mounts
    offsets_s = [mounts[name].get("clock_offset_s", 0) for name in MOUNTS]
    np.testing.assert_allclose(offsets_s, [0, -0.02, 0.03], atol=1e-12)


def test_poles_of_one_mount_cannot_come_apart(data: Path) -> None:
    one = altered_scenes.read_base(data / "west/helios_16", 60)
    with pytest.raises(
        ValueError, match="expected fused frames of two mounts or more, got one mount"
    ):
        trials.able(chosen(["pole_clock", "pole_yaw"], None), one)


def test_ranges_of_fused_frames_are_from_no_one_place(base: altered_scenes.Base) -> None:
    stressors = chosen(["rain", "drop_out", "unseen_scene", "pole_yaw"], None)
    left_out = trials.left_out(stressors, base)
    assert list(left_out.values()) == [["rain", "unseen_scene"]]
    assert "expected frames of one mount, got fused frames of west, east, north" in next(
        iter(left_out)
    )


def test_fused_frames_without_their_mounts_are_not_simulated_again(
    data: Path, tmp_path: Path
) -> None:
    (tmp_path / "fused").symlink_to(data / "fused", target_is_directory=True)
    base = altered_scenes.read_base(tmp_path / "fused/helios_16", 60)
    with pytest.raises(
        ValueError, match=r"west/helios_16/lidar\.yaml: expected this file, got none"
    ):
        trials.able(chosen(["pole_yaw"], None), base)
