"""Reads and writes PCD folders: points/NNNNNN.pcd with all point fields, and labels/NNNNNN.txt."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import AnyArray, FloatArray, Points, Records
from pyinfra.core.errors import FormatError
from pyinfra.dataset.frame_readers import read_cameras
from pyinfra.exchange.box_text import read_boxes, write_boxes
from pyinfra.exchange.frame_times import seconds_of_stamp
from pyinfra.exchange.recording import (
    NO_BOXES,
    Options,
    RecordedFrame,
    Recording,
    as_points,
    label_files,
    read_splits,
    sorted_files,
    stem,
)
from pyinfra.formats import kitti
from pyinfra.formats.kitti.layout import FARTHEST_M
from pyinfra.formats.pcd_file import Header, Viewpoint, read_header, read_pcd, write_pcd

POINT_FIELDS: list[tuple[str, Any]] = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
# Maps additional fields of the .pcd files to their names in kitti.FIELDS.
MORE = {
    "time": "time_s",
    "ring": "ring",
    "object_id": "object_id",
    "class": "class",
    "echo": "echo",
}
# Lower-case field names that mean intensity. CloudCompare prefixes its fields with `scalar_`.
INTENSITIES = (
    *("intensity", "reflectivity", "i", "intensities", "reflectance", "remission"),
    *("scalar_intensity", "scalar_reflectivity", "scalar_reflectance"),
)
# Number of first clouds that are checked for time stamps. A single cloud is not enough, because an
# empty cloud has no time stamp.
FIRST = 3
STAMPS = ("timestamp", "time_stamp", "time", "t")  # fields of absolute or relative point times


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes the frames in the levelled LiDAR frame, metres, seconds.

    Raises FormatError for an invalid frame.
    """
    for part in ("points", "labels"):
        (out / part).mkdir()
    cameras = read_cameras(lidar_folder, frames)
    has_fields = (lidar_folder / "training/fields").is_dir()
    for frame, camera in zip(frames, cameras.of_frame, strict=True):
        points = kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", frame))
        file = kitti.frame_file(lidar_folder, "fields", frame)
        fields = kitti.read_fields(file) if has_fields else None
        if fields is not None and len(fields) != len(points):
            raise FormatError(f"{file}: expected {len(points)} records, got {len(fields)}")
        write_pcd(out / f"points/{frame:06d}.pcd", _records(points, fields))
        file = kitti.frame_file(lidar_folder, "label_2", frame)
        labels = kitti.read_labels(file, calibration=cameras.different[camera])
        write_boxes(out / f"labels/{frame:06d}.txt", labels.names, labels.boxes)


def read(source: Path, options: Options) -> Recording:
    """Opens a folder of clouds, or a folder with clouds in points/. Boxes in labels/ are optional.

    Raises FileNotFoundError, and Error for labels that do not pair with clouds. Reading a frame
    raises FormatError.
    """
    inside = source / "points"
    clouds = sorted_files(inside if inside.is_dir() else source, [".pcd"])
    folder = label_files(clouds, source / "labels", options)
    names = tuple(stem(file) for file in clouds)

    def frame(i: int) -> RecordedFrame:
        records = read_pcd(clouds[i])
        points = points_of(clouds[i], records, options)
        boxes = read_boxes(folder / f"{names[i]}.txt") if folder else NO_BOXES
        return RecordedFrame(points, boxes, _fields(clouds[i], records))

    splits, notes = read_splits(source / "ImageSets", names)
    headers = Headers(clouds, folder is not None)
    return Recording(
        names,
        frame,
        folder is not None,
        splits,
        times=lambda: stamps(clouds),
        notes=lambda: notes + headers.notes(),
        origin=headers.origin,
    )


class Headers:
    """Information from the headers of all clouds of a recording."""

    def __init__(self, files: Sequence[Path], labelled: bool) -> None:
        self.files, self.labelled = files, labelled

    @cached_property
    def _all(self) -> list[Header]:
        return [read_header(file) for file in self.files]

    def origin(self) -> FloatArray | None:
        """Returns the sensor's position (3,) in the frame of the points, in the source's unit.

        Returns None if the position is the origin or differs between clouds.
        """
        shifts = np.array([header.viewpoint.applied_shift for header in self._all])
        return shifts[0] if shifts[0].any() and (shifts == shifts[0]).all() else None

    def notes(self, *, shifted: bool = True) -> list[str]:
        """Describes how `points_of` treats viewpoints and clouds without an intensity."""
        moved = [header for header in self._all if not header.viewpoint.is_identity]
        notes = []
        if moved:
            text = _viewpoint_note(moved[0].viewpoint, shifted=shifted)
            poses = [np.vstack([h.viewpoint.turn, h.viewpoint.shift]) for h in self._all]
            if any(not np.array_equal(pose, poses[0]) for pose in poses):
                text += f" in {moved[0].file.name}; other clouds have another VIEWPOINT"
            notes.append(f"VIEWPOINT of {len(moved)} of {len(self.files)} clouds: {text}")
            if self.labelled:
                notes.append("labels are assumed to be in the frame of the moved points")
        dark = [h for h in self._all if not set(INTENSITIES) & set(h.record.names or ())]
        if dark:
            names = " ".join(dark[0].record.names or ())
            notes.append(
                f"{len(dark)} of {len(self.files)} clouds have no intensity field ({names}): "
                "intensities are set to 0"
            )
        return notes


def _viewpoint_note(viewpoint: Viewpoint, *, shifted: bool) -> str:
    shift = "({:.6g}, {:.6g}, {:.6g})".format(*viewpoint.shift)
    text = f"points are turned by {viewpoint.angle_deg:.2f} degrees"
    if viewpoint.is_far:
        return f"{text}, the shift {shift} is ignored because it is beyond {FARTHEST_M:g} m"
    if not shifted:
        return f"{text}, the shift {shift} is ignored because the sensor is the origin"
    return f"{text} and moved by {shift}"


def stamps(clouds: Sequence[Path]) -> FloatArray | None:
    """Returns the first time stamp of each cloud in seconds since 1970; NaN if it is missing.

    Returns None if the first clouds have no time stamps.
    """
    if all(_stamp(read_pcd(file)) is None for file in clouds[:FIRST]):
        return None
    return np.array([_stamp(read_pcd(file)) for file in clouds], dtype=np.float64)


def _stamp(records: Records) -> float | None:
    name = next((name for name in STAMPS if name in (records.dtype.names or ())), None)
    values = records[name] if name else np.empty(0)
    values = values[np.isfinite(values) & (values > 0)] if values.ndim == 1 else np.empty(0)
    return seconds_of_stamp(float(values.min())) if len(values) > 0 else None


def _records(points: Points, fields: Records | None) -> Records:
    more = [(name, kitti.FIELDS[field_name]) for name, field_name in MORE.items()]
    out = np.empty(len(points), dtype=POINT_FIELDS if fields is None else [*POINT_FIELDS, *more])
    for i, (name, _) in enumerate(POINT_FIELDS):
        out[name] = points[:, i]
    if fields is not None:
        for name, field_name in MORE.items():
            out[name] = fields[field_name]
    return out


def points_of(file: Path, records: Records, options: Options, *, shifted: bool = True) -> Points:
    """Returns the points (n, 4) of a file's records, transformed by its viewpoint.

    With `shifted` = False, points are only rotated, so that the sensor stays the origin. The
    intensity is 0 if the file has no field for it. Raises FormatError.
    """
    names = records.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise FormatError(f"{file}: FIELDS: expected the fields x, y and z, got {' '.join(names)}")
    intensity = next((name for name in INTENSITIES if name in names), None)
    columns = [_column(file, records, name) for name in ("x", "y", "z", intensity) if name]
    if intensity is None:
        columns.append(np.zeros(len(records)))
    viewpoint = read_header(file).viewpoint
    if not viewpoint.is_identity:
        columns[:3] = viewpoint.apply(columns[:3], shifted=shifted)
    return as_points(file, columns, options)


def _column(file: Path, records: Records, name: str) -> AnyArray:
    column = records[name]
    if column.ndim > 1:
        raise FormatError(f"{file}: {name}: expected COUNT 1, got COUNT {column.shape[1]}")
    return column


def _fields(file: Path, records: Records) -> Records | None:
    """Returns records (n,) of kitti.FIELDS if the file has time and ring, else None.

    A point without class and object_id counts as background. Raises FormatError.
    """
    names = records.dtype.names or ()
    if not {"time", "ring"} <= set(names):
        return None
    out = np.zeros(len(records), dtype=kitti.FIELDS)
    out["object_id"] = -1
    for name in set(MORE) & set(names):
        column, field_name = _column(file, records, name), MORE[name]
        if kitti.FIELDS[field_name].kind != "f":
            ends = np.iinfo(kitti.FIELDS[field_name])
            bad = np.flatnonzero(~((column >= ends.min) & (column <= ends.max)))
            if len(bad) > 0:
                problem = f"{file}: point {bad[0]}: {name}: expected {ends.min} to {ends.max}"
                raise FormatError(f"{problem}, got {column[bad[0]]:g}")
        out[field_name] = column
    return out
