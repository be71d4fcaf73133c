"""`simulation.Observer`: what LiDARs see of a scene's objects from many poses, without clouds."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import pyinfra as pi
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import lidar_file, scene_file

FRAMES = (40, 400)
POSE = [-14.0, 9.5, 5.0, -30.0, 8.0]
# Two sparse trees near the pose. Vehicles behind them are nearer and farther than 31 m, from where
# a beam of 0.1 degrees has sub-rays.
CROWN = {"y_m": 10.5, "height_m": 7.0, "trunk_m": 1.5, "crown_m": 5.0, "density_per_m": 0.3}
TREES = {"vegetation": [{"tree": {"x_m": x, **CROWN}} for x in (-19.0, -24.0)]}
KEYS = dict(zip(["x_m", "y_m", "z_m", "yaw_deg", "pitch_deg"], POSE, strict=True))


@pytest.fixture(scope="module")
def observer() -> simulation.Observer:
    return simulation.load_observer(scene_file("crossroad"), FRAMES)


def expect_counts_of_simulation(
    observer: simulation.Observer, lidar: simulation.Lidar, keys: dict[str, object]
) -> None:
    rows = observer.observe(POSE, [lidar], [*FRAMES])
    region = {(int(one["frame"]), int(one["id"])) for one in observer.present([*FRAMES])}
    pose = {f"mounts.pole.{key}": value for key, value in KEYS.items()}
    world = simulation.load_scene(scene_file("crossroad"), set=keys | pose)
    full = {
        (number, int(one["id"])): int(one["points"])
        for number, (frame,) in simulation.simulate(world, [lidar], FRAMES)
        for one in frame.objects
        if one["points"] and (number, int(one["id"])) in region
    }
    assert len(full) > 10
    assert {(int(r["frame"]), int(r["id"])): int(r["points"]) for r in rows} == full


@pytest.mark.parametrize("name", ["helios_16", "livox_avia", "hesai_xt32"])
def test_counts_equal_those_of_the_full_simulation(
    observer: simulation.Observer, name: str
) -> None:
    expect_counts_of_simulation(observer, simulation.load_lidar(lidar_file(name)), {})


@pytest.fixture(scope="module")
def behind_trees() -> simulation.Observer:
    return simulation.load_observer(scene_file("crossroad"), FRAMES, set=TREES)


@pytest.mark.parametrize("mode", ["strongest", "first", "last", "dual"])
@pytest.mark.parametrize("beam", [None, "moving", "everywhere"])
def test_counts_behind_trees_equal_those_of_the_full_simulation(
    behind_trees: simulation.Observer, mode: str, beam: str | None, tmp_path: Path
) -> None:
    returns: dict[str, object] = {
        "max_range_m": 180,
        "detection": {"range_at_10_percent_m": 100},
        "echoes": {"separation_m": 1, "mode": mode},
    }
    if beam is not None:
        returns["beam"] = {"horizontal_deg": 0.1, "vertical_deg": 0.1, "where": beam}
    channels = {"count": 16, "upper_deg": 15, "lower_deg": -15}
    spinning = {"rate_hz": 10, "columns_per_turn": 1800, "channels": channels}
    keys = {
        "name": "own",
        "price_usd": {"low": 1, "high": 1, "source": "made up", "date": "2026"},
        "pattern": {"spinning": spinning},
        "presets": {"datasheet": {"returns": returns}},
    }
    file = tmp_path / "own.yaml"
    file.write_text(yaml.safe_dump(keys))
    expect_counts_of_simulation(behind_trees, simulation.load_lidar(file), TREES)


def test_extents_are_within_the_box_of_the_object(observer: simulation.Observer) -> None:
    lidar = simulation.load_lidar(lidar_file("ruby_plus"))
    rows = pd.DataFrame(observer.observe(POSE, [lidar], [40]))
    boxes = pd.DataFrame(observer.present([40])).set_index("id").loc[rows.id]
    for extent, size in (("along", "dx"), ("across", "dy"), ("up", "dz")):
        assert (rows[extent].to_numpy() <= boxes[size].to_numpy() + 0.1).all()
    assert (rows[rows.points > 50].along > 0.5).all()
    assert ((rows.visibility >= 0) & (rows.visibility <= 1)).all()


def test_the_same_objects_are_present_for_every_pose(observer: simulation.Observer) -> None:
    lidar = simulation.load_lidar(lidar_file("helios_16"))
    present = {int(one) for one in observer.present([40])["id"]}
    for x in (-14.0, 60.0):
        assert set(observer.observe([x, 9.5, 6, 0, 0], [lidar], [40])["id"].tolist()) <= present


def test_a_pose_in_a_lane_or_below_the_road_has_a_fault(observer: simulation.Observer) -> None:
    assert observer.fault(POSE) == ""
    assert "lane" in observer.fault([-20, 2, 2, 0, 0])
    assert "below" in observer.fault([-14, 9.5, -1, 0, 0])
    with pytest.raises(pi.Error, match="x_m: expected"):
        observer.fault([np.nan, 0, 6, 0, 0])
    with pytest.raises(pi.Error, match="lane"):
        observer.observe([-20, 2, 2, 0, 0], [], [40])


def test_other_frames_than_those_of_the_observer_are_refused(
    observer: simulation.Observer,
) -> None:
    with pytest.raises(
        pi.Error, match="frames: expected a frame for which the observer was made, got 41"
    ):
        observer.present([41])
    with pytest.raises(pi.Error, match="frames: expected 0 to 4999, got 5000"):
        simulation.load_observer(scene_file("crossroad"), [5000])
