"""Frames of several LiDARs at several poses, put together in memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pyinfra.core.arrays import AnyArray, BoolArray, Float32Array, FloatArray, Records
from pyinfra.core.boxes import wrapped
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset import simulation
from pyinfra.dataset.loading import with_overrides
from pyinfra.dataset.made import recipe_of
from pyinfra.dataset.object_rows import type_names
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.dataset.returns import ids_once_per_ray, with_points_in_boxes
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.dataset.world_frame import rotation, to_levelled, to_world
from pyinfra.formats.kitti import WorldPose
from pyinfra.formats.yaml_file import read_keys

AT_TIMES = ("", "scan_")  # prefixes of the columns of an object's pose, at mid-frame and scan time


PoseError = tuple[FloatArray, FloatArray]  # rotation (3, 3) and shift (3,) of a LiDAR's points


@dataclass(eq=False, repr=False)
class FusedFrames(SimulatedFrames):
    """Frames with the points of several LiDARs, in the levelled frame of the first LiDAR.

    Clocks have no error. The points of each LiDAR are moved by the error of its assumed pose.
    Objects have the rows that `infrasim run` writes for them. `fields` has the column `mount`: the
    index of the LiDAR of each point.
    """

    others: tuple[SimulatedFrames, ...] = field(default=())
    errors: tuple[PoseError | None, ...] = ()  # pose error of each LiDAR; () for no errors

    def of(self, numbers: Sequence[int]) -> FusedFrames:
        return replace(
            self, numbers=tuple(numbers), others=tuple(one.of(numbers) for one in self.others)
        )

    def _cast(self, numbers: Sequence[int]) -> Iterator[tuple[int, tuple[Float32Array, Records]]]:
        pose = self.lidar.T_world_levelled
        streams = [super()._cast(numbers), *(one._cast(numbers) for one in self.others)]
        errors = self.errors or (None,) * len(streams)
        for casts in zip(*streams, strict=True):
            (number, (points, fields)), rows = casts[0], [self.rows[casts[0][0]]]
            clouds, every_field = [with_error(points, errors[0])], [with_mount(fields, 0)]
            others = zip(self.others, casts[1:], errors[1:], strict=True)
            for i, (one, (_, (more, more_fields)), error) in enumerate(others, 1):
                more = with_error(more, error)
                clouds.append(moved_points(more, one.lidar.T_world_levelled, pose))
                every_field.append(with_mount(more_fields, i))
                rows.append(moved_rows(one.rows[number], one.lidar.T_world_levelled, pose))
            cloud = np.concatenate(clouds), np.concatenate(every_field)
            merged = self._merged(rows)
            self.rows[number] = with_points_in_boxes(merged, cloud[0], ids_once_per_ray(cloud[1]))
            self.clouds[number] = cloud
            while len(self.clouds) > self.kept:
                self.clouds.popitem(last=False)
            yield number, cloud

    def _merged(self, parts: Sequence[AnyArray]) -> AnyArray:
        """Returns one row per object: poses of the first LiDAR, at the mean time of all points.

        `parts` are the rows of each LiDAR in the levelled frame of the first. The visibility is the
        highest one, and -1 outside the region of the first LiDAR.
        """
        every = np.concatenate(parts)
        every = every[np.argsort(every["id"], kind="stable")]
        first = np.flatnonzero(np.diff(every["id"], prepend=-(2**31)))
        out = every[first].copy()
        if not len(out):
            return out
        inside = out["visibility"] >= 0
        unseen = ~np.isin(out["id"], parts[0]["id"])  # objects beyond the first LiDAR's range
        inside[unseen] = self._is_in_region(out[unseen])
        highest = np.maximum.reduceat(every["visibility"], first)
        out["visibility"] = np.where(inside, highest, -1)
        middle = self.unit.period_s / 2
        late = every["scan_time_s"] - middle
        out["points"] = np.add.reduceat(every["points"], first)
        mean = np.add.reduceat(every["points"] * late, first) / np.maximum(out["points"], 1)
        out["scan_time_s"] = middle + mean
        # Each position is interpolated linearly between mid-frame and the most distant scan time.
        order = np.lexsort((-np.abs(late), every["id"]))[first]
        far, most = every[order], late[order]
        share = np.divide(mean, most, out=np.zeros_like(mean), where=most != 0)
        for name in ("x", "y", "z"):
            out[f"scan_{name}"] = out[name] + share * (far[f"scan_{name}"] - far[name])
        turn = share * wrapped(far["scan_heading"] - far["heading"])
        out["scan_heading"] = wrapped(out["heading"] + turn)
        return np.asarray(out)

    def _is_in_region(self, rows: AnyArray) -> BoolArray:
        xy = np.stack([rows["x"], rows["y"]], axis=1)
        are_people = np.isin(type_names(rows), PERSON_TYPES)
        holds = self.region.holds
        return np.where(are_people, holds(xy, FOOTWAYS_M), holds(xy, 0.0))


def fused(
    sequences: Sequence[SimulatedFrames],
    yaw_error_deg: float = 0.0,
    errors: Sequence[PoseError | None] = (),
) -> SimulatedFrames:
    """Returns one sequence whose frames have the points of all sequences.

    A single sequence without errors is returned unchanged.

    yaw_error_deg: error of the assumed yaw of each LiDAR, alternately to the left and to the right.
    errors: errors of the assumed poses; used unless yaw_error_deg is given.
    """
    first, *others = sequences
    if yaw_error_deg:
        errors = [yaw_error(yaw_error_deg * (-1) ** k) for k in range(len(sequences))]
    if not others and not any(errors):
        return first
    one = FusedFrames(
        first.world,
        first.unit,
        first.numbers,
        first.threads,
        first.kept,
        others=tuple(others),
        errors=tuple(errors),
        returns=first.returns,
    )
    one.roads = first.roads
    return one


def yaw_error(yaw_deg: float) -> PoseError:
    return rotation(yaw=math.radians(yaw_deg)), np.zeros(3)


def keys_of(world: simulation.World) -> dict[str, Any]:
    """Returns the keys of a world's scene as the user gave them, with all mounts and overrides."""
    recipe = recipe_of(world)
    source, is_file = recipe.args[0], recipe.func is simulation.World
    keys = read_keys(Path(source)) if is_file else yaml.safe_load(source)
    pairs = (text.partition("=")[::2] for text in (recipe.args[1] if is_file else ()))
    return with_overrides(keys, {name: yaml.safe_load(value) for name, value in pairs})


def check_clocks(worlds: Mapping[str, simulation.World]) -> None:
    """Raises Error if the clocks of the mounts differ, because fused frames have one clock."""
    late = {
        name: keys_of(x)["mounts"][name].get("clock_offset_s") or 0 for name, x in worlds.items()
    }
    first, *others = late
    for name in others:
        if late[name] != late[first]:
            raise Error(
                f"mounts.{name}.clock_offset_s: expected {late[first]:g} as at mount '{first}', "
                f"got {late[name]:g}; for different clocks, use `infrasim run`"
            )


def error_of(world: simulation.World, name: str) -> PoseError | None:
    """Returns the error of the assumed pose of a mount with `calibration_error`; None without.

    A wrong tilt gives a wrong levelled frame. Points are levelled with the assumed tilt, not with
    the true one.
    """
    mount = keys_of(world)["mounts"][name]
    error = mount.get("calibration_error")
    if not error:
        return None
    yaw, pitch, roll = (math.radians(mount.get(f"{n}_deg", 0)) for n in ("yaw", "pitch", "roll"))
    turn, up, side = (math.radians(error.get(f"{n}_deg", 0)) for n in ("yaw", "pitch", "roll"))
    tilted = rotation(turn, pitch + up, roll + side) @ rotation(0, pitch, roll).T
    shift = np.array([error.get(f"{axis}_m", 0.0) for axis in "xyz"])
    return tilted, rotation(yaw).T @ shift


def with_error(points: Float32Array, error: PoseError | None) -> Float32Array:
    """Returns points (n, 4) at the positions that follow from the wrong pose of their LiDAR."""
    if error is None:
        return points
    xyz = points[:, :3].astype(np.float64) @ error[0].T + error[1]
    return np.column_stack([xyz.astype(np.float32), points[:, 3:]])


def with_mount(fields: Records, mount: int) -> Records:
    """Returns fields (n,) with the column `mount`."""
    out = np.empty(len(fields), [*fields.dtype.descr, ("mount", "<u2")])
    for name in fields.dtype.names or ():
        out[name] = fields[name]
    out["mount"] = mount
    return out


def moved_points(points: Float32Array, pose: WorldPose, to: WorldPose) -> Float32Array:
    """Transforms points (n, 4) from the levelled frame at `pose` to that at `to`."""
    out = points.copy()
    out[:, :2] = to_levelled(to_world(points[:, :2].astype(np.float64), pose), to)
    out[:, 2] += np.float32(pose.z - to.z)
    return out


def moved_rows(rows: AnyArray, pose: WorldPose, to: WorldPose) -> AnyArray:
    """Transforms the poses of object rows from the levelled frame at `pose` to that at `to`."""
    out = rows.copy()
    for at in AT_TIMES:
        xy: FloatArray = np.stack([rows[f"{at}x"], rows[f"{at}y"]], axis=1).astype(np.float64)
        out[f"{at}x"], out[f"{at}y"] = to_levelled(to_world(xy, pose), to).T
        out[f"{at}z"] += pose.z - to.z
        out[f"{at}heading"] = wrapped(rows[f"{at}heading"] + pose.yaw - to.yaw)
    out["distance"] = np.hypot(out["x"], out["y"])
    return out
