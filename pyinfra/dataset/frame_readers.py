"""Reads the objects, labels or predictions of many frames into one table."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, NameArray
from pyinfra.core.vocabulary import OTHER_TYPES, VEHICLE_TYPES, LabelTime
from pyinfra.dataset.file_groups import fail_with_line, file_lines, joined, numbers_of
from pyinfra.dataset.frame_tables import Predictions, Vehicles
from pyinfra.dataset.frames import data_set_of
from pyinfra.dataset.prediction_csv import check_counts, csv_predictions
from pyinfra.formats import kitti
from pyinfra.formats.kitti.read import (
    LABEL_RULES,
    OBJECT_NUMBERS,
    OBJECT_RULES,
    RESULT_RULES,
    object_rows,
    scan_boxes,
)
from pyinfra.formats.text_table import lines_of, rules_hold

_LABEL_NUMBERS = kitti.LABEL_COLUMNS[8:]


@dataclass(frozen=True, eq=False)
class Cameras:
    """The calibrations of many frames. Identical calibrations are stored once."""

    different: tuple[kitti.Calibration, ...]
    of_frame: IntArray  # (frames,) index of each frame's calibration in `different`

    def boxes(self, values: FloatArray, frame: IntArray) -> FloatArray:
        """Converts h w l x y z rotation_y (n, 7) in the frames (n,) to boxes (n, 7)."""
        out = np.empty_like(values)
        for i, calibration in enumerate(self.different):
            rows = self.of_frame[frame] == i
            out[rows] = kitti.boxes_from_camera(values[rows], calibration)
        return out


def read_vehicles(lidar_folder: Path, frames: Sequence[int]) -> Vehicles:
    """Reads the objects of the frames, or their labels if the folder has no objects.

    Raises FileNotFoundError for a frame without its file, and FormatError.
    """
    if (lidar_folder / "training/objects").is_dir():
        files = [kitti.frame_file(lidar_folder, "objects", frame) for frame in frames]
        time = kitti.read_label_time(lidar_folder)
        vehicles = joined(files, lambda paths, index: _objects(paths, index, time))
        vehicles = replace(vehicles, ids=track_ids(lidar_folder, vehicles.ids))
        if has_key(lidar_folder, b"frames_version"):
            return vehicles
        # Objects of recordings have speed 0, although their speed is unknown.
        return replace(vehicles, speed=np.full(len(vehicles), np.nan))
    return read_labelled(lidar_folder, frames)


def track_ids(lidar_folder: Path, ids: IntArray) -> IntArray:
    """Returns ids (n,) of objects; all are -1 (unknown) in a data set whose ids are row numbers.

    Imports of earlier versions numbered the rows of recordings without tracks.
    """
    return np.full_like(ids, -1) if has_key(lidar_folder, b"ids", b" rows") else ids


def has_key(lidar_folder: Path, key: bytes, value: bytes = b"") -> bool:
    """Returns whether the dataset.yaml of a LiDAR's folder has a key, and, if given, this value."""
    file = data_set_of(lidar_folder) / "dataset.yaml"
    return file.is_file() and b"\n" + key + b":" + value in file.read_bytes()


def read_labelled(lidar_folder: Path, frames: Sequence[int]) -> Vehicles:
    """Reads the labels of the frames. Raises FileNotFoundError and FormatError."""
    files = [kitti.frame_file(lidar_folder, "label_2", frame) for frame in frames]
    cameras = read_cameras(lidar_folder, frames)
    return joined(files, lambda paths, index: _labels(paths, index, cameras))


def other_types(
    lidar_folder: Path,
    frames: Sequence[int],
    vehicles: Vehicles,
    types: Sequence[str],
    part: kitti.Part = "objects",
) -> str | None:
    """Returns a message about class names in the ground truth that are unknown and not in `types`.

    Objects with an unknown class name are never counted; for example, `car` is not `Car`. Returns
    None if there are no such names. part: files from which the vehicles were read; those of the
    labels if the folder has no `objects`.
    """
    other = ~np.isin(vehicles.names, [*types, *VEHICLE_TYPES, *OTHER_TYPES])
    if not other.any():
        return None
    names, counts = np.unique(vehicles.names[other], return_counts=True)
    listed = ", ".join(f"{name} ({count})" for name, count in zip(names, counts, strict=True))
    if not (lidar_folder / "training" / part).is_dir():
        part = "label_2"
    first = int(np.flatnonzero(other)[0])
    file = kitti.frame_file(lidar_folder, part, frames[vehicles.frame[first]])
    name = str(vehicles.names[first])
    words = (line.replace(",", " ").split() for line in lines_of(file))
    line = next((i for i, row in enumerate(words, start=1) if name in row), 1)
    expected = ", ".join(types)
    return f"{file}:{line}: objects of unknown classes are ignored: {listed}; expected {expected}"


def read_predictions(files: Sequence[Path | None], cameras: Cameras) -> Predictions:
    """Reads predictions: KITTI result files (.txt), or CSV files in the LiDAR frame (.csv).

    `files` contains one file per frame, or None for a frame without predictions. The first line of
    a CSV file names its columns. These are class, x, y, z, dx, dy, dz, heading (radians) and score,
    in any order.
    Raises FormatError with file and line.
    """
    return joined(files, lambda paths, index: _predictions(paths, index, cameras))


def read_cameras(lidar_folder: Path, frames: Sequence[int]) -> Cameras:
    """Reads the calibrations of frames.

    A frame without a calib file gets the calibration of a simulated LiDAR. Raises FormatError with
    file and line.
    """
    number: dict[bytes | None, int] = {}
    different: list[kitti.Calibration] = []
    of_frame = np.empty(len(frames), dtype=np.int64)
    for i, frame in enumerate(frames):
        file = kitti.frame_file(lidar_folder, "calib", frame)
        text = file.read_bytes() if file.exists() else None
        if text not in number:
            number[text] = len(different)
            different.append(kitti.simulated() if text is None else kitti.read_calibration(file))
        of_frame[i] = number[text]
    return Cameras(tuple(different), of_frame)


def _objects(files: Sequence[Path], frames: IntArray, label_time: LabelTime) -> Vehicles:
    texts = file_lines(files, whole=True)
    cells = [object_rows(text[0], text[1:]) if text else None for text in texts]
    # Move the class to the front, so that all numbers are adjacent.
    rows = [
        [*row[1:2], *row[:1], *row[2:]] for group in cells if group is not None for row in group
    ]
    complete = None not in cells and all(row[0] for row in rows)
    values = numbers_of(rows, len(kitti.OBJECT_COLUMNS), 1) if complete else None
    if values is None or not rules_hold(values, OBJECT_NUMBERS, OBJECT_RULES):
        fail_with_line(files, kitti.read_objects)
    frame = np.repeat(frames, [len(text) - 1 for text in texts])
    ids = values[:, 0].astype(np.int64)
    known = ids >= 0
    if len(np.unique(frame[known] * 2**31 + ids[known])) < np.count_nonzero(known):
        fail_with_line(files, kitti.read_objects)
    mid_frame = values[:, 1:8]
    return Vehicles(
        frame=frame,
        ids=ids,
        names=np.array([row[0] for row in rows], dtype=np.str_),
        boxes=scan_boxes(mid_frame, values[:, 13:17]) if label_time == "scan" else mid_frame,
        mid_frame=mid_frame,
        points=values[:, 9].astype(np.int64),
        visibility=values[:, 12],
        speed=values[:, 8],
    )


def _labels(files: Sequence[Path], frames: IntArray, cameras: Cameras) -> Vehicles:
    frame, _, names, values = _kitti(files, frames, scores=False)
    n = len(frame)
    boxes = cameras.boxes(values[:, :7], frame)
    return Vehicles(
        frame=frame,
        ids=np.full(n, -1),
        names=names,
        boxes=boxes,
        mid_frame=boxes,
        points=np.ones(n, dtype=np.int64),
        visibility=np.full(n, np.nan),
        speed=np.full(n, np.nan),
    )


def _predictions(files: Sequence[Path], frames: IntArray, cameras: Cameras) -> Predictions:
    if files and files[0].suffix == ".csv":
        return csv_predictions(files, frames)
    frame, line, names, values = _kitti(files, frames, scores=True)
    boxes = cameras.boxes(values[:, :7], frame)
    return Predictions(frame, line, names, boxes, values[:, 7], values[:, 6])


def _kitti(
    files: Sequence[Path], frames: IntArray, *, scores: bool
) -> tuple[IntArray, IntArray, NameArray, FloatArray]:
    """Reads label or result files.

    Returns frame, line number and class of each row, (n,) each, and the columns from h on (n, k).
    The function leaves out rows of the class DontCare.
    """
    texts = [
        [(i, content) for i, content in enumerate(text, 1) if content.strip()]
        for text in file_lines(files)
    ]
    if scores:
        check_counts(files, [len(text) for text in texts])
    rows = [line.split() for text in texts for _, line in text]
    values = numbers_of(rows, len(kitti.LABEL_COLUMNS) + scores, 8)
    names = np.array([row[0] for row in rows], dtype=np.str_) if values is not None else None
    rules = RESULT_RULES if scores else LABEL_RULES
    if values is None or names is None:
        fail_with_line(files, lambda file: kitti.read_labels(file, scores=scores))
    known = names != "DontCare"
    if not rules_hold(values[known], _LABEL_NUMBERS, rules):
        fail_with_line(files, lambda file: kitti.read_labels(file, scores=scores))
    line = np.array([number for text in texts for number, _ in text], dtype=np.int64)
    return (
        np.repeat(frames, [len(text) for text in texts])[known],
        line[known],
        names[known],
        values[known],
    )
