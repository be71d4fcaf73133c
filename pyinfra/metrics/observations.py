"""The vehicles of a data set, the points of each LiDAR on them, and subsets for comparisons."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, Rows, concatenated
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import VEHICLE_TYPES
from pyinfra.dataset.data_set import (
    MIN_VISIBILITY,
    DataSet,
    field_of_view_mask,
    read_owners,
    road_level,
)
from pyinfra.dataset.frame_readers import track_ids
from pyinfra.dataset.frames import usual_step
from pyinfra.formats import kitti
from pyinfra.metrics.intervals import Blocks, block_seconds, time_blocks


@dataclass(frozen=True, eq=False)
class Observations:
    """Observations: a row for each vehicle and frame within range of at least one LiDAR.

    There are n rows and L LiDARs.
    """

    lidars: tuple[str, ...]  # L names, in the order of the columns of the arrays below
    frame: IntArray  # (n,) frame number
    ids: IntArray  # (n,) track number of the vehicle; -1 if unknown
    centre: FloatArray  # (n, 3) centre of the box, levelled LiDAR frame, metres
    distance: FloatArray  # (n,) horizontal distance from the sensor to the box centre, metres
    speed: FloatArray  # (n,) speed of the vehicle, m/s
    visibility: FloatArray  # (n,) visible share in [0, 1]; -1 outside the evaluation region
    points: IntArray  # (n, L) returns from the vehicle; 0 if it is beyond the LiDAR's range
    points_in_box: IntArray  # (n, L) returns from the vehicle that lie in its box
    in_angles: BoolArray  # (n, L) whether the LiDAR's azimuths and elevations include the centre
    in_range: BoolArray  # (n, L) whether the centre is also within the LiDAR's range

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, keep: BoolArray) -> "Observations":
        """Returns the rows where the mask `keep` (n,) is True."""
        return replace(self, **{name: getattr(self, name)[keep] for name in _COLUMNS})

    def visible(self) -> BoolArray:
        """Returns which vehicles are in the evaluation region and not hidden: (n,)."""
        return self.visibility >= MIN_VISIBILITY

    def common(self) -> BoolArray:
        """Returns which visible vehicles are in the field of view and range of all LiDARs: (n,)."""
        return self.visible() & self.in_range.all(axis=1)

    def view(self) -> BoolArray:
        """Returns which visible vehicles are in the field of view of all LiDARs: (n,).

        Unlike in `common`, the range does not matter.
        """
        return self.visible() & self.in_angles.all(axis=1)

    def column(self, lidar: str) -> int:
        """Returns the column of a LiDAR. Raises ValueError for an unknown name."""
        return self.lidars.index(lidar)


_COLUMNS = (
    *("frame", "ids", "centre", "distance", "speed", "visibility"),
    *("points", "points_in_box", "in_angles", "in_range"),
)


def blocks_of(data: DataSet, vehicles: Observations, frames: IntArray | None = None) -> Blocks:
    """Returns the bootstrap blocks of a data set's frames.

    vehicles: all vehicles of the data set. The block length is the mean stay of a visible vehicle.
    frames: numbers of the frames to use; by default all.
    """
    visible, numbers = vehicles.visible(), np.array(data.frames, dtype=np.int64)
    apart_s = data.period_s * usual_step(data.frames)
    block_s = block_seconds(vehicles.frame[visible], vehicles.ids[visible], apart_s)
    return time_blocks(numbers if frames is None else frames, data.period_s, block_s=block_s)


def read_observations(data: DataSet, *, above_road: bool = False) -> Observations:
    """Reads all vehicles of all frames; rows of several LiDARs are joined by frame and id.

    Rows with the id -1 (unknown) are not joined.

    above_road: whether to count only points above road level; `points_in_box` does not change. With
    `above_road`, raises Error if the roads are not level, and FileNotFoundError if the folder
    `fields` is missing.
    """
    levels = [road_level(data, lidar) for lidar in data.lidars] if above_road else None
    tables = [
        _read_objects(data, i, None if levels is None else levels[i])
        for i in range(len(data.lidars))
    ]
    every = concatenated(tables)
    unique, first = np.unique(every.keys, axis=0, return_index=True)
    rows = [_rows(unique, table.keys) for table in tables]
    values = every.values[first]
    points = np.zeros((2, len(unique), len(tables)), dtype=np.int64)
    for i, (table, at) in enumerate(zip(tables, rows, strict=True)):
        points[:, at, i] = table.points.T
    centre = values[:, :3]
    views = [
        field_of_view_mask(lidar, tilt, centre)
        for lidar, tilt in zip(data.lidars, data.tilts, strict=True)
    ]
    return Observations(
        lidars=data.names,
        frame=unique[:, 0],
        ids=np.maximum(unique[:, 1], -1),
        centre=centre,
        distance=values[:, 3],
        speed=values[:, 4],
        visibility=values[:, 5],
        points=points[0],
        points_in_box=points[1],
        in_angles=np.stack([angles for angles, _ in views], axis=1),
        in_range=np.stack([ranges for _, ranges in views], axis=1),
    )


def ends_of_runs(frames: Sequence[int], count: int) -> IntArray:
    """Returns the last frame of each run of `count` consecutive frames, ascending.

    Raises Error if there are not `count` consecutive frames.
    """
    numbers = np.array(sorted(frames), dtype=np.int64)
    runs = np.lib.stride_tricks.sliding_window_view(numbers, min(count, len(numbers)))
    ends = runs[runs[:, -1] - runs[:, 0] == count - 1, -1]
    if len(ends) == 0:
        raise Error(f"accumulate: expected {count} consecutive frames, got none")
    return np.asarray(ends)


def accumulated(vehicles: Observations, frames: Sequence[int], count: int) -> Observations:
    """Returns the vehicles in the last frame of each run of `count` consecutive frames.

    The points on a vehicle are summed over the run. All other columns are those of the last frame.
    Raises Error if there is no such run, or if the id of a vehicle is unknown.
    """
    if (vehicles.ids < 0).any():
        raise Error("accumulate: expected vehicles with track ids, got a recording without tracks")
    newest = vehicles.select(np.isin(vehicles.frame, ends_of_runs(frames, count)))
    keys = np.stack([vehicles.frame, vehicles.ids], axis=1)
    points, in_box = np.zeros_like(newest.points), np.zeros_like(newest.points_in_box)
    for back in range(count):
        wanted = np.stack([newest.frame - back, newest.ids], axis=1)
        row = np.minimum(_rows(keys, wanted), len(keys) - 1)
        has_row = (keys[row] == wanted).all(axis=1)
        points[has_row] += vehicles.points[row[has_row]]
        in_box[has_row] += vehicles.points_in_box[row[has_row]]
    return replace(newest, points=points, points_in_box=in_box)


def hit_counts(data: DataSet, lidar: kitti.Lidar, *, above_road: bool = False) -> IntArray:
    """Counts the returns of each frame: (f,), in the order of data.frames.

    above_road: whether to count only returns above road level.
    """
    folder = data.lidar_folder(lidar.name)
    if not above_road:
        sizes = [kitti.frame_file(folder, "velodyne", k).stat().st_size for k in data.frames]
        return np.array(sizes, dtype=np.int64) // 16
    level = road_level(data, lidar)
    counts = [
        np.count_nonzero(kitti.read_points(kitti.frame_file(folder, "velodyne", k))[:, 2] > level)
        for k in data.frames
    ]
    return np.array(counts, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _ObjectTable(Rows):
    """The objects of one LiDAR in all frames."""

    keys: IntArray  # (n, 2) frame and id of each object
    values: FloatArray  # (n, 6) x y z distance speed visibility
    points: IntArray  # (n, 2) points on the vehicle, and points on the vehicle in its box


def _read_objects(data: DataSet, lidar: int, level: float | None) -> _ObjectTable:
    folder = data.lidar_folder(data.lidars[lidar].name)
    parts = []
    nameless = 0  # number of rows without an id so far; their keys are -1, -2, ...
    for frame in data.frames:
        k = kitti.read_objects(kitti.frame_file(folder, "objects", frame))
        vehicle = np.isin(k.names, VEHICLE_TYPES)
        on_vehicle = k.points if level is None else _points_above(folder, frame, k.ids, level)
        ids = track_ids(folder, k.ids)
        unknown = ids < 0
        ids = np.where(unknown, -nameless - np.cumsum(unknown), ids)
        nameless += int(unknown.sum())
        objects = _ObjectTable(
            keys=np.stack([np.full(len(k), frame), ids], axis=1),
            values=np.column_stack([k.boxes[:, :3], k.distance, k.speed, k.visibility]),
            points=np.stack([on_vehicle, k.points_in_box], axis=1),
        )
        parts.append(objects.select(vehicle))
    return concatenated(parts)


def _points_above(folder: Path, frame: int, ids: IntArray, level: float) -> IntArray:
    """Counts the points with z above `level` (metres) on each vehicle: (k,)."""
    points = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
    owner = read_owners(folder, frame, len(points))
    owned = owner[(points[:, 2] > level) & (owner >= 0)]
    owners, counts = np.unique(owned, return_counts=True)
    per_vehicle = np.zeros(len(ids), dtype=np.int64)
    _, vehicle_index, owner_index = np.intersect1d(ids, owners, return_indices=True)
    per_vehicle[vehicle_index] = counts[owner_index]
    return per_vehicle


def _rows(sorted_keys: IntArray, keys: IntArray) -> IntArray:
    """Returns the position (m,) at which each key (m, 2) would be inserted in sorted keys (n, 2).

    It is the index of the first sorted key that is not smaller than the key.
    """
    ids = np.concatenate([sorted_keys[:, 1], keys[:, 1], [0]])
    low, base = int(ids.min()), int(np.ptp(ids)) + 1
    wanted, known = (k[:, 0] * base + k[:, 1] - low for k in (keys, sorted_keys))
    return np.searchsorted(known, wanted).astype(np.int64)


def moving(vehicles: Observations, min_speed: float = 1.0) -> BoolArray:
    """Returns which vehicles are faster than `min_speed` in m/s: (n,)."""
    return vehicles.speed > min_speed


def same_rows(a: Observations, b: Observations) -> tuple[BoolArray, BoolArray]:
    """Returns masks of the rows in two tables that have the same frame and id in both."""
    first, second = (pd.MultiIndex.from_arrays([t.frame, t.ids]) for t in (a, b))
    return first.isin(second), second.isin(first)
