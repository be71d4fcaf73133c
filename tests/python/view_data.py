"""Artificial frames for the tests of the viewer."""

from typing import Any

import numpy as np

from pyinfra.formats.kitti import WorldPose
from pyinfra.viz.viewer.frames import ViewFrame

SENSOR = WorldPose(0, 0, 6, 0)


def view_frame(points: Any, *, frame: int = 0, **more: Any) -> ViewFrame:
    """Returns a frame of points (n, 3) with intensity 0.5. It has vehicles only if `more` contains
    them."""
    points = np.asarray(points, dtype=np.float32).reshape(-1, 3)
    standard: dict[str, Any] = {
        "frame": frame,
        "period_s": 0.1,
        "sensor": SENSOR,
        "points": points,
        "intensity": np.full(len(points), 0.5, np.float32),
        "boxes": np.empty((0, 7)),
        "names": np.empty(0, np.str_),
        "hits": np.empty(0, np.int64),
    }
    return ViewFrame(**standard | more)


def blob(x: float, y: float, z: float = 0.0, count: int = 4000, seed: int = 0) -> Any:
    """Returns random points in a cube with a side of 2 m around a position."""
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) + np.array([x, y, z])
