"""Transforms positions between the world frame and the levelled frame of a LiDAR."""

from __future__ import annotations

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.formats.kitti import WorldPose


def to_world(points: FloatArray, pose: WorldPose) -> FloatArray:
    """Transforms points (n, 2 or more) of a levelled frame to x y (n, 2) in the world frame."""
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    x, y = points[:, 0], points[:, 1]
    return np.stack([pose.x + cos * x - sin * y, pose.y + sin * x + cos * y], axis=1)


def to_levelled(points: FloatArray, pose: WorldPose) -> FloatArray:
    """Transforms world-frame points (n, 2) to x y (n, 2) in a levelled frame."""
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    x, y = points[:, 0] - pose.x, points[:, 1] - pose.y
    return np.stack([cos * x + sin * y, -sin * x + cos * y], axis=1)
