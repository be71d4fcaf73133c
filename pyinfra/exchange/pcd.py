"""Reads and writes PCD folders: points/NNNNNN.pcd with all point fields, and labels/NNNNNN.txt."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import AnyArray, FloatArray, Points, Records, unchecked
from pyinfra.core.errors import FormatError
from pyinfra.dataset.frame_readers import read_cameras
from pyinfra.exchange.box_text import write_boxes
from pyinfra.exchange.frame_times import seconds_of_stamp
from pyinfra.exchange.kitti_folder import known_objects
from pyinfra.exchange.label_files import LabelFiles, clouds_in, open_labels
from pyinfra.exchange.point_fields import (
    INTENSITIES,
    TIMES,
    intensity_field,
    named_fields,
    offset_note,
)
from pyinfra.exchange.record_clouds import FIRST, RecordClouds, readable
from pyinfra.exchange.recording import Options, Recording, as_points, read_splits
from pyinfra.exchange.series import point_records, read_fields
from pyinfra.formats import kitti
from pyinfra.formats.kitti.layout import FARTHEST_M
from pyinfra.formats.pcd_file import Header, Viewpoint, read_header, read_pcd, write_pcd

# Maps additional fields of the .pcd files to their names in kitti.FIELDS.
MORE = {
    "time": "time_s",
    "ring": "ring",
    "object_id": "object_id",
    "class": "class",
    "echo": "echo",
}


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes the frames in the levelled LiDAR frame, metres, seconds.

    Raises FormatError for an invalid frame.
    """
    for part in ("points", "labels"):
        (out / part).mkdir()
    cameras = read_cameras(lidar_folder, frames)
    for frame, camera in zip(frames, cameras.of_frame, strict=True):
        points = kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", frame))
        fields = read_fields(lidar_folder, frame, len(points))
        write_pcd(out / f"points/{frame:06d}.pcd", point_records(points, fields, MORE))
        file = kitti.frame_file(lidar_folder, "label_2", frame)
        labels = kitti.read_labels(file, calibration=cameras.different[camera])
        known = known_objects(kitti.frame_file(lidar_folder, "objects", frame), labels)
        write_boxes(out / f"labels/{frame:06d}.txt", labels.names, labels.boxes, known)


def read(source: Path, options: Options) -> Recording:
    """Opens a cloud, or a folder with clouds, also in points/ or lidar/. Labels are optional.

    Raises FileNotFoundError, and Error for labels that do not pair with clouds. Reading a frame
    raises FormatError.
    """
    labels = open_labels(clouds_in(source, [".pcd"]), source, options)
    recording = Clouds(labels, options).recording()
    splits, notes = read_splits(source / "ImageSets", recording.names)
    return replace(
        recording,
        splits=splits,
        times=lambda: stamps(labels.clouds),
        notes=lambda: [*notes, *recording.notes()],
        reads=(*recording.reads, source / "ImageSets"),
    )


class Clouds(RecordClouds):
    """The .pcd clouds of a recording, and information from the headers of all of them."""

    def __init__(self, labels: LabelFiles, options: Options) -> None:
        super().__init__(labels, read_pcd, options)

    def points(self, file: Path, records: Records) -> Points:
        return points_of(file, records, self.options, offset=self.fields.offset)

    def recording(self) -> Recording:
        return replace(super().recording(), origin=self.origin)

    @cached_property
    def _all(self) -> list[Header]:
        return list(readable(read_header, self.labels.clouds))

    def origin(self) -> FloatArray | None:
        """Returns the sensor's position (3,) in the frame of the points, in the source's unit.

        Returns None if the position is the origin or differs between clouds.
        """
        shifts = np.array([header.viewpoint.applied_shift for header in self._all])
        return shifts[0] if shifts[0].any() and (shifts == shifts[0]).all() else None

    def notes(self, *, shifted: bool = True, timed: bool = True) -> list[str]:
        """Describes how viewpoints, clouds without an intensity, and point times are treated."""
        moved = [header for header in self._all if not header.viewpoint.is_identity]
        notes = []
        if moved:
            text = _viewpoint_note(moved[0].viewpoint, shifted=shifted)
            poses = [np.vstack([h.viewpoint.turn, h.viewpoint.shift]) for h in self._all]
            if any(not np.array_equal(pose, poses[0]) for pose in poses):
                text += f" in {moved[0].file.name}; other clouds have another VIEWPOINT"
            notes.append(f"VIEWPOINT of {len(moved)} of {len(self.labels.clouds)} clouds: {text}")
            if self.labels.labelled:
                notes.append("labels are assumed to be in the frame of the moved points")
        dark = [h for h in self._all if not named_fields(h.record, INTENSITIES)]
        if dark:
            names = " ".join(dark[0].record.names or ())
            notes.append(
                f"{len(dark)} of {len(self.labels.clouds)} clouds have no intensity field "
                f"({names}): intensities are set to 0"
            )
        if self.fields.offset.any():
            notes.append(offset_note(self.fields.offset))
        return notes + self.fields.notes if timed else notes


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
    if all(_stamp_of(file) is None for file in clouds[:FIRST]):
        return None
    return np.array([_stamp_of(file) for file in clouds], dtype=np.float64)


def _stamp_of(file: Path) -> float | None:
    return next((_stamp(records) for records in readable(read_pcd, [file])), None)


def _stamp(records: Records) -> float | None:
    name = next(iter(named_fields(records.dtype, TIMES)), None)
    values = records[name] if name else np.empty(0)
    values = values[np.isfinite(values) & (values > 0)]
    return seconds_of_stamp(float(values.min())) if len(values) > 0 else None


@unchecked
def points_of(
    file: Path,
    records: Records,
    options: Options,
    *,
    shifted: bool = True,
    offset: FloatArray | None = None,
) -> Points:
    """Returns the points (n, 4) of a file's records, transformed by its viewpoint.

    `offset` (3,) is subtracted first. With `shifted` = False, points are only rotated, so that the
    sensor stays the origin. The intensity is 0 if the file has no field for it. Raises FormatError.
    """
    names = records.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise FormatError(f"{file}: FIELDS: expected the fields x, y and z, got {' '.join(names)}")
    intensity = intensity_field(records)
    columns = [_column(file, records, name) for name in ("x", "y", "z", intensity) if name]
    if intensity is None:
        columns.append(np.zeros(len(records)))
    if offset is not None and offset.any():
        columns[:3] = [c.astype(np.float64) - o for c, o in zip(columns[:3], offset, strict=True)]
    viewpoint = read_header(file).viewpoint
    if not viewpoint.is_identity:
        columns[:3] = viewpoint.apply(columns[:3], shifted=shifted)
    return as_points(file, columns, options)


def _column(file: Path, records: Records, name: str) -> AnyArray:
    column = records[name]
    if column.ndim > 1:
        raise FormatError(f"{file}: {name}: expected COUNT 1, got COUNT {column.shape[1]}")
    return column
