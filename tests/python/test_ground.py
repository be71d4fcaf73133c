"""The height of the road at a position, and detectors that use it."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.dataset.ground import Ground, ground_of, ground_of_boxes, ground_of_roads, level_ground
from pyinfra.dataset.roads import Road
from pyinfra.formats.kitti import WorldPose
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.ground_adapter import OnRoad


def road(y: float, z: FloatArray) -> Road:
    s = np.arange(float(len(z)))
    return Road("r", s, np.stack([s, s * 0 + y], axis=1), z, s * 0, s * 0 + 4)


def boxes_on(slope: float, count: int = 300) -> FloatArray:
    """Returns vehicles along x within 6 m of the axis. The road is 6 m below the sensor at x =
    0."""
    draw = np.random.default_rng(1)
    boxes = np.zeros((count, 7))
    boxes[:, 0], boxes[:, 1] = draw.uniform(-80, 80, count), draw.uniform(-6, 6, count)
    boxes[:, 3:6] = 4.3, 1.8, 1.6
    boxes[:, 2] = slope * boxes[:, 0] - 6 + 0.8 + draw.normal(0, 0.05, count)
    return boxes


def test_roads_of_one_level_are_a_plane() -> None:
    roads = [road(0, np.full(9, 2.0)), road(20, np.full(9, 2.0))]
    ground = ground_of_roads(roads, WorldPose(4, 3, 8, 1))
    assert ground.relief is None
    assert ground.plane == (0, 0, -6)


def test_a_place_is_as_high_as_the_nearest_centreline() -> None:
    # x points along the world's y, and y against the world's x
    pose = WorldPose(10, -4, 7, np.pi / 2)
    ground = ground_of_roads([road(0, 0.1 * np.arange(80.0)), road(60, np.full(80, -1.0))], pose)
    positions = np.array([[4.0, 0], [4.0, -30], [64.0, 0], [4.0, 500]])
    np.testing.assert_allclose(ground.height(positions), [-6, -3, -8, -7], atol=0.11)


def test_points_come_back_from_the_road() -> None:
    points = np.random.default_rng(2).uniform(-90, 90, (500, 4)).astype(np.float32)
    points[3, 0] = np.nan
    sloped = ground_of_roads([road(0, 0.05 * np.arange(200.0))], WorldPose(0, -8, 6, 0.3))
    for ground in (level_ground(-6.2), Ground((0.02, -0.01, -5.0)), sloped):
        above = ground.above(points)
        assert above.dtype == points.dtype
        np.testing.assert_array_equal(above[:, [0, 1, 3]], points[:, [0, 1, 3]])
        np.testing.assert_allclose(ground.back(above), points, atol=1e-4)
    level = level_ground(-6.2).above(points)
    np.testing.assert_allclose(level[4:, 2], points[4:, 2] + 6.2, atol=1e-5)


@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_vehicles_stand_on_a_plane_and_some_on_a_bridge(slope: float) -> None:
    boxes = boxes_on(slope)
    boxes[:40, 2] += 5
    plane = ground_of_boxes([boxes[:100], boxes[100:]]).plane
    assert plane == pytest.approx((slope, 0, -6), abs=0.02)


def test_few_vehicles_tell_no_slope() -> None:
    boxes = boxes_on(0.0, 3)
    boxes[:, :2] *= 0.01
    boxes[:, 2] += [0.1, 0, -0.1]
    a, b, _ = ground_of_boxes([boxes]).plane
    assert abs(a) + abs(b) < 0.01
    with pytest.raises(
        ValueError, match="expected one or more labelled vehicles in the training frames"
    ):
        ground_of_boxes([np.empty((0, 7))])


def lidar_yaml(preset: str, z: float) -> str:
    view = {"yaw_deg": 0, "pitch_deg": 0, "azimuth_deg": [-180, 180], "elevation_deg": [-25, 15]}
    content = {
        "name": "pole",
        "model": "pole",
        "preset": preset,
        "price_total_usd": {"low": 1, "high": 2},
        "period_s": 0.1,
        "label_time": "scan",
        "T_world_levelled": {"x_m": 0, "y_m": 0, "z_m": z, "yaw_deg": 0},
        "field_of_view": [view | {"range_m": [1, 200]}],
    }
    return str(yaml.safe_dump(content))


@pytest.mark.parametrize(
    ("preset", "z", "level"), [("recorded", 5.5, -5.5), ("recorded", 0, None), ("paper", 6, None)]
)
def test_without_roads_a_recording_says_how_high_it_was(
    tmp_path: Path, preset: str, z: float, level: float | None
) -> None:
    (tmp_path / "lidar.yaml").write_text(lidar_yaml(preset, z))
    ground = ground_of(tmp_path)
    assert (ground.plane[2] if ground else None) == level


class Lowest:
    """A detector that returns a vehicle at the lowest point."""

    def predict(self, points: Points) -> Detections:
        x, y, z = points[points[:, 2].argmin(), :3].astype(np.float64)
        return Detections(np.array([[x, y, z, 4, 2, 2, 0]]), np.ones(1), np.array(["vehicle"]))


def test_a_detector_on_a_slope_looks_from_the_road() -> None:
    ground = Ground((0.1, 0.0, -6.0))
    # heights above the road: 1 m and -0.5 m
    points = np.array([[-50, 0, -10.0, 0], [50, 0, -1.5, 0]], dtype=np.float32)
    detections = OnRoad(Lowest(), ground).predict(points)
    np.testing.assert_allclose(detections.boxes[0, :3], [50, 0, -1.5], atol=1e-5)
