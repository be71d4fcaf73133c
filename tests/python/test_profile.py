"""Scenes on a hill: values that readers of a data set compute agree with the simulated surfaces."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import Infrasim

from pyinfra.core.errors import FormatError
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.ground import ground_of
from pyinfra.dataset.roads import read_roads
from pyinfra.dataset.surroundings import profile_of, read_surroundings
from pyinfra.formats import kitti

CREST = """\
name: crest
duration_s: 2
mounts: {pole: {x_m: -20, y_m: -14, z_m: 6}}
profile: {x_m: 5, y_m: -3, heading_deg: 30, points_m: [[-90, -7], [-10, 0], [80, -3]]}
roads:
  - name: main
    start: {x_m: -200, y_m: 0}
    centreline: [{line_m: 400}]
    lanes: {each_way: 2, shoulder_m: 0.5}
ground:
  - {elevation_m: -0.05, outline_m: [[-300, -300], [300, -300], [300, 300], [-300, 300]]}
buildings:
  - {x_m: 50, y_m: 40, base_m: -0.05, length_m: 30, width_m: 20, height_m: 15}
traffic:
  vehicles_per_km_lane: 25
  speed: {mean_km_h: 40, std_km_h: 2}
  class_shares: {Car: 0.9, Bus: 0.1}
"""
ROAD = 0  # number of the material
RUN = ("--lidar", "helios_16", "--preset", "paper", "--frames", "0:20:5")


@pytest.fixture(scope="module")
def crest(tmp_path_factory: pytest.TempPathFactory, infrasim: Infrasim) -> Path:
    folder = tmp_path_factory.mktemp("crest")
    (folder / "crest.yaml").write_text(CREST)
    result = infrasim("run", folder / "crest.yaml", *RUN, "--out", folder / "data")
    assert result.returncode == 0, result.stderr
    return folder / "data"


def test_the_profile_of_a_data_set_is_that_of_its_roads(crest: Path) -> None:
    profile = profile_of(kitti.read_yaml(crest / "dataset.yaml").at("profile"))
    (road,) = read_roads(crest / "roads.csv")
    assert np.ptp(road.z) > 5
    np.testing.assert_allclose(profile.rise_m(road.xy), road.z, atol=1e-4)
    (house,) = read_surroundings(crest).buildings
    assert house[2] == pytest.approx(7.45 + float(profile.rise_m(house[:2])))


def test_vehicles_stand_on_the_ground_that_detectors_are_told_of(crest: Path) -> None:
    folder = crest / "helios_16"
    vehicles = read_vehicles(folder, kitti.frames(folder))
    boxes = vehicles.mid_frame[vehicles.visibility >= 0]
    ground = ground_of(folder)
    assert ground is not None
    under = ground.height(boxes[:, :2])
    assert len(boxes) > 20
    # The ground has the height of the middle of the road. The profile falls by 4 % across the
    # road's 14 m.
    np.testing.assert_allclose(boxes[:, 2] - boxes[:, 5] / 2, under, atol=0.35)


def test_a_run_from_its_own_trajectories_is_the_run_itself(
    crest: Path, tmp_path: Path, infrasim: Infrasim
) -> None:
    (tmp_path / "driven.yaml").write_text(CREST)
    file = tmp_path / "driven.csv"
    result = infrasim("trajectories", tmp_path / "driven.yaml", "--preset", "paper", "--out", file)
    assert result.returncode == 0, result.stderr
    text = CREST[: CREST.index("traffic:")] + f"trajectories: {file}\n"
    (tmp_path / "crest.yaml").write_text(text)
    result = infrasim("run", tmp_path / "crest.yaml", *RUN, "--out", tmp_path / "data")
    assert result.returncode == 0, result.stderr
    for frame in kitti.frames(crest / "helios_16"):
        one, other = (
            kitti.frame_file(data / "helios_16", "velodyne", frame).read_bytes()
            for data in (crest, tmp_path / "data")
        )
        assert one == other


@pytest.mark.parametrize(
    ("points", "error"),
    [
        ("[[-90, high], [80, -3]]", r"points_m\[0\]\[1\]: expected"),
        ("[[-90, -7], [80]]", r"points_m\[1\]: expected 2 numbers .station and rise., got 1"),
        ("[[1, 2, 3], [4, 5, 6]]", r"points_m\[0\]: expected 2 numbers .*, got 3"),
        ("[]", r"points_m: expected"),
    ],
)
def test_a_damaged_profile_is_named(crest: Path, tmp_path: Path, points: str, error: str) -> None:
    keys = yaml.safe_load((crest / "dataset.yaml").read_text())
    keys["profile"]["points_m"] = yaml.safe_load(points)
    (tmp_path / "dataset.yaml").write_text(yaml.safe_dump(keys))
    with pytest.raises(FormatError, match=rf"profile.{error}"):
        profile_of(kitti.read_yaml(tmp_path / "dataset.yaml").at("profile"))


@pytest.mark.parametrize("seen", ["near", "far"])
def test_trajectories_of_both_doors_are_the_same(
    seen: str, tmp_path: Path, infrasim: Infrasim
) -> None:
    """This is also true if no vehicle meets the slope. The run has all frames."""
    text = CREST if seen == "near" else CREST.replace("x_m: 5, y_m: -3", "x_m: 5000, y_m: -3")
    text = text.replace("z_m: 6", "z_m: 0") if seen == "far" else text
    (tmp_path / "crest.yaml").write_text(text)
    run = ["run", *RUN[:-1], "0:20", "--out", "data"]
    for words in (run, ["trajectories", "--out", "alone.csv"]):
        result = infrasim(words[0], tmp_path / "crest.yaml", *words[1:], cwd=tmp_path)
        assert result.returncode == 0, result.stderr
    alone = (tmp_path / "alone.csv").read_text()
    assert alone == (tmp_path / "data/trajectories.csv").read_text()
    assert alone.splitlines()[0].endswith(",pitch")


def test_fused_poles_with_a_late_clock_see_one_hill(tmp_path: Path, infrasim: Infrasim) -> None:
    second = "x_m: -20, y_m: -14, z_m: 6}, far: {x_m: 40, y_m: 12, z_m: 5, clock_offset_s: 0.05}"
    text = CREST.replace("x_m: -20, y_m: -14, z_m: 6}", second)
    (tmp_path / "crest.yaml").write_text(text)
    words = ("--fuse", "--fields", "--out", tmp_path / "data")
    result = infrasim("run", tmp_path / "crest.yaml", *RUN, *words)
    assert result.returncode == 0, result.stderr
    profile = profile_of(kitti.read_yaml(tmp_path / "data/fused/dataset.yaml").at("profile"))
    folder = tmp_path / "data/fused/helios_16"
    for frame in kitti.frames(folder):
        cloud = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))[:, :3]
        fields = kitti.read_fields(kitti.frame_file(folder, "fields", frame))
        # position in the frame of the first pole
        road = cloud[fields["class"] == ROAD] + (-20, -14, 6)
        assert len(road) > 500
        np.testing.assert_allclose(road[:, 2], profile.rise_m(road[:, :2]), atol=0.02)
