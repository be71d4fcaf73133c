"""Transforms between the world frame and the levelled frame of a LiDAR; rotations."""

import math

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


def boxes_to_world(boxes: FloatArray, pose: WorldPose) -> FloatArray:
    """Transforms boxes (n, 7) of a levelled frame to the world frame."""
    moved = [to_world(boxes, pose), boxes[:, 2:3] + pose.z, boxes[:, 3:6], boxes[:, 6:] + pose.yaw]
    return np.concatenate(moved, axis=1)


def rotation(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> FloatArray:
    """Returns Rz(yaw) Ry(pitch) Rx(roll), (3, 3), from angles in radians.

    As in the simulator, positive pitch is downwards and positive roll lifts the left side.
    """
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a), math.sin(a)) for a in (yaw, pitch, roll))
    yaw_matrix = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch_matrix = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll_matrix = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(yaw_matrix @ pitch_matrix @ roll_matrix)
