"""Frames of several LiDARs at several poses, put together in memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pyinfra.core.arrays import AnyArray, Float32Array, FloatArray, Records
from pyinfra.dataset.frame_sequence import SimulatedFrames
from pyinfra.dataset.world_frame import rotation, to_levelled, to_world
from pyinfra.formats.kitti import WorldPose

AT_TIMES = ("", "scan_")  # prefixes of the columns of an object's poses


@dataclass(eq=False)
class FusedFrames(SimulatedFrames):
    """The frames of a LiDAR with the points of others added, in the levelled frame of the first.

    Clocks are exact. The points of each LiDAR are turned about it by an error of its yaw, which is
    0 by default. The label of an object is that of the LiDAR with most points on it.
    """

    others: tuple[SimulatedFrames, ...] = field(default=())
    yaw_errors_deg: tuple[float, ...] = ()  # assumed yaw minus true yaw of each LiDAR; () for none

    def of(self, numbers: Sequence[int]) -> FusedFrames:
        return replace(
            self, numbers=tuple(numbers), others=tuple(one.of(numbers) for one in self.others)
        )

    def _cast(self, numbers: Sequence[int]) -> Iterator[tuple[int, tuple[Float32Array, Records]]]:
        pose = self.lidar.T_world_levelled
        streams = [super()._cast(numbers), *(one._cast(numbers) for one in self.others)]
        errors_deg = self.yaw_errors_deg or (0.0,) * len(streams)
        for casts in zip(*streams, strict=True):
            (number, (points, fields)), rows = casts[0], [self.rows[casts[0][0]]]
            clouds, every_field = [turned_points(points, errors_deg[0])], [fields]
            others = zip(self.others, casts[1:], errors_deg[1:], strict=True)
            for one, (_, (more, more_fields)), error_deg in others:
                more = turned_points(more, error_deg)
                clouds.append(moved_points(more, one.lidar.T_world_levelled, pose))
                every_field.append(more_fields)
                rows.append(moved_rows(one.rows[number], one.lidar.T_world_levelled, pose))
            cloud = np.concatenate(clouds), np.concatenate(every_field)
            self.rows[number], self.clouds[number] = merged_rows(rows), cloud
            while len(self.clouds) > self.kept:
                self.clouds.popitem(last=False)
            yield number, cloud


def fused(sequences: Sequence[SimulatedFrames], yaw_error_deg: float = 0.0) -> SimulatedFrames:
    """Returns one sequence whose frames have the points of all sequences.

    A single sequence without a yaw error is returned unchanged.

    yaw_error_deg: error of the assumed yaw of each LiDAR, alternately to the left and to the right.
    """
    first, *others = sequences
    if not others and not yaw_error_deg:
        return first
    errors_deg = tuple(yaw_error_deg * (-1) ** k for k in range(len(sequences)))
    one = FusedFrames(
        first.world,
        first.unit,
        first.numbers,
        first.threads,
        first.kept,
        others=tuple(others),
        yaw_errors_deg=errors_deg,
    )
    one.roads = first.roads
    return one


def moved_points(points: Float32Array, pose: WorldPose, to: WorldPose) -> Float32Array:
    """Transforms points (n, 4) from the levelled frame at `pose` to that at `to`."""
    out = points.copy()
    out[:, :2] = to_levelled(to_world(points[:, :2].astype(np.float64), pose), to)
    out[:, 2] += np.float32(pose.z - to.z)
    return out


def turned_points(points: Float32Array, yaw_deg: float) -> Float32Array:
    """Turns points (n, 4) to the left about the vertical axis of the LiDAR."""
    if not yaw_deg:
        return points
    out = points.copy()
    turn = rotation(yaw=math.radians(yaw_deg))[:2, :2]
    out[:, :2] = points[:, :2].astype(np.float64) @ turn.T
    return out


def moved_rows(rows: AnyArray, pose: WorldPose, to: WorldPose) -> AnyArray:
    """Transforms the poses of object rows from the levelled frame at `pose` to that at `to`."""
    out = rows.copy()
    for at in AT_TIMES:
        xy: FloatArray = np.stack([rows[f"{at}x"], rows[f"{at}y"]], axis=1).astype(np.float64)
        out[f"{at}x"], out[f"{at}y"] = to_levelled(to_world(xy, pose), to).T
        out[f"{at}z"] += pose.z - to.z
        turned = rows[f"{at}heading"] + pose.yaw - to.yaw
        out[f"{at}heading"] = (turned + np.pi) % (2 * np.pi) - np.pi
    out["distance"] = np.hypot(out["x"], out["y"])
    return out


def merged_rows(parts: Sequence[AnyArray]) -> AnyArray:
    """Returns one row per object: that with most points, with the sum of all points."""
    every = np.concatenate(parts)
    order = np.lexsort((-every["points"], every["id"]))
    every = every[order]
    first = np.flatnonzero(np.diff(every["id"], prepend=-(2**31)))
    out = every[first].copy()
    if len(out):
        out["points"] = np.add.reduceat(every["points"], first)
        out["visibility"] = np.maximum.reduceat(every["visibility"], first)
    return np.asarray(out)
