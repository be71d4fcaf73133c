"""Reads and writes PCD folders: points/NNNNNN.pcd with all point fields, and labels/NNNNNN.txt."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, Points, Records
from pyinfra.dataset.frame_readers import read_cameras
from pyinfra.exchange import record_clouds
from pyinfra.exchange.box_text import write_boxes
from pyinfra.exchange.kitti_folder import known_objects
from pyinfra.exchange.label_files import LabelFiles, clouds_in, open_labels
from pyinfra.exchange.point_fields import INTENSITIES, TIMES, named_fields, offset_note
from pyinfra.exchange.record_clouds import RecordClouds, readable, start_of
from pyinfra.exchange.recording import Options, Recording, read_splits
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
    clouds = Clouds(labels, options)
    recording = clouds.recording()
    splits, notes = read_splits(source / "ImageSets", recording.names)
    return replace(
        recording,
        splits=splits,
        times=clouds.times,
        notes=lambda: [*notes, *recording.notes()],
        reads=(*recording.reads, source / "ImageSets"),
    )


class Clouds(RecordClouds):
    """The .pcd clouds of a recording, and information from the headers of all of them."""

    def __init__(self, labels: LabelFiles, options: Options) -> None:
        super().__init__(labels, read_pcd, options)

    def points(self, file: Path, records: Records) -> Points:
        return points_of(file, records, self.options, offset=self.fields.offset)

    def start(self, records: Records) -> float:
        return start_of(records, named_fields(records.dtype, TIMES)[:1])

    def recording(self) -> Recording:
        return replace(super().recording(), origin=self.origin)

    @cached_property
    def _all(self) -> list[Header]:
        return list(readable(read_header, self.labels.clouds))

    def origin(self) -> FloatArray | None:
        """Returns the sensor's position (3,) in the frame of the points, in the source's unit.

        Returns None if the position is the origin, differs between clouds, or if no header can be
        read.
        """
        shifts = np.array([header.viewpoint.applied_shift for header in self._all])
        return shifts[0] if shifts[:1].any() and (shifts == shifts[0]).all() else None

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
    viewpoint = read_header(file).viewpoint
    move = None if viewpoint.is_identity else partial(viewpoint.apply, shifted=shifted)
    return record_clouds.points_of(str(file), records, options, offset, move)
