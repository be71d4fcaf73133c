"""`simulation.Observer`: what LiDARs see of a scene's objects from many poses, without clouds."""

import numpy as np
import pandas as pd
import pytest

import pyinfra as pi
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import lidar_file, scene_file

FRAMES = (40, 400)
POSE = [-14.0, 9.5, 5.0, -30.0, 8.0]
KEYS = dict(zip(["x_m", "y_m", "z_m", "yaw_deg", "pitch_deg"], POSE, strict=True))


@pytest.fixture(scope="module")
def observer() -> simulation.Observer:
    return simulation.load_observer(scene_file("crossroad"), FRAMES)


@pytest.mark.parametrize("name", ["helios_16", "livox_avia", "hesai_xt32"])
def test_counts_equal_those_of_the_full_simulation(
    observer: simulation.Observer, name: str
) -> None:
    lidar = simulation.load_lidar(lidar_file(name))
    rows = observer.observe(POSE, [lidar], [*FRAMES])
    region = {(int(one["frame"]), int(one["id"])) for one in observer.present([*FRAMES])}
    keys = {f"mounts.pole.{key}": value for key, value in KEYS.items()}
    world = simulation.load_scene(scene_file("crossroad"), set=keys)
    full = {
        (number, int(one["id"])): int(one["points"])
        for number, (frame,) in simulation.simulate(world, [lidar], FRAMES)
        for one in frame.objects
        if one["points"] and (number, int(one["id"])) in region
    }
    assert len(full) > 10
    assert {(int(r["frame"]), int(r["id"])): int(r["points"]) for r in rows} == full


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
    with pytest.raises(pi.Error, match="frames: expected frames of the observer, got 41"):
        observer.present([41])
    with pytest.raises(pi.Error, match="frames: expected 0 to 4999, got 5000"):
        simulation.load_observer(scene_file("crossroad"), [5000])
