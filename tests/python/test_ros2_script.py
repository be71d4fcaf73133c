"""The script of the docs that joins `detect --follow` to ROS 2, with stand-ins for its modules."""

from __future__ import annotations

import importlib.util
import itertools
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pyinfra as pi
from pyinfra.core.arrays import Points

SCRIPT = Path(__file__).resolve().parents[2] / "docs/scripts/ros2_tracks.py"
ZERO = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}


class Message(SimpleNamespace):
    """A message whose fields are set by name; Hypothesis and box have parts of their own."""

    def __init__(self, **fields: Any) -> None:
        parts = {
            "hypothesis": SimpleNamespace(),
            "pose": SimpleNamespace(),
            "bbox": SimpleNamespace(),
        }
        super().__init__(**(ZERO | parts | fields))


class FakeNode:
    def __init__(self, name: str) -> None:
        self.published: list[Any] = []

    def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
        assert topic == "tracks"
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, kind: Any, topic: str, call: Any, quality: Any) -> None:
        assert topic == "points"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"init": None, "spin": None},
        "rclpy.node": {"Node": FakeNode},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "rclpy.utilities": {"remove_ros_args": None},
        "geometry_msgs.msg": dict.fromkeys(("Point", "Pose", "Quaternion", "Vector3"), Message),
        "sensor_msgs.msg": {"PointCloud2": Message},
        "sensor_msgs_py": {"point_cloud2": SimpleNamespace(read_points=lambda m, **_: m.points)},
        "vision_msgs.msg": dict.fromkeys(
            ("Detection3D", "Detection3DArray", "ObjectHypothesisWithPose"), Message
        ),
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("ros2_tracks", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


@pytest.mark.nightly
def test_clouds_of_a_topic_become_tracks(script: ModuleType, tmp_path: Path) -> None:
    frames = pi.simulate(pi.load_scene("highway", seed=1), "ruby_plus", range(4))
    node = script.TracksNode(["--height-m", "6"], tmp_path)
    stamps = itertools.count()

    def publish(points: Points, patience_s: float) -> None:
        names = np.dtype([(name, "f4") for name in script.FIELDS])
        stamp = SimpleNamespace(sec=1_777_883_410, nanosec=100_000_000 * next(stamps))
        records = np.ascontiguousarray(points).view(names)[:, 0]
        node.save(Message(header=Message(stamp=stamp), points=records))
        since = time.monotonic()
        while time.monotonic() - since < patience_s:
            if node.published and node.published[-1].header.stamp is stamp:
                break
            time.sleep(0.02)

    try:
        while not node.published:  # the command reads its network first
            publish(np.empty((0, 4), np.float32), 1.0)
        for number in frames.numbers:
            publish(frames.frame(number).points[:, :4], 30.0)
    finally:
        node.end()
    last = node.published[-1].detections
    truth = frames.frame(3).labels
    near = truth[(truth.points > 100) & (np.hypot(truth.x, truth.y) < 40)]
    centres = np.array([[d.bbox.center.position.x, d.bbox.center.position.y] for d in last])
    away = np.linalg.norm(near[["x", "y"]].to_numpy()[:, None] - centres[None], axis=2).min(axis=1)
    assert (away < 1).all()
    assert len(near) > 2
    assert len(list(tmp_path.glob("*.bin"))) <= script.KEPT
