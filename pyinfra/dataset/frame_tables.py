"""Reads the boxes of many frames into one table: objects, labels or predictions.

Files are parsed in groups of some hundred, about ten times as fast as one by one. If a group does
not parse, its files are read again one by one, for an error that names file and line.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn, TypeVar

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, NameArray
from pyinfra.core.errors import FormatError
from pyinfra.core.vocabulary import OTHER_TYPES, VEHICLE_TYPES, LabelTime
from pyinfra.formats import kitti
from pyinfra.formats.kitti.read import (
    LABEL_RULES,
    OBJECT_NUMBERS,
    OBJECT_RULES,
    RESULT_RULES,
    object_rows,
    scan_boxes,
)
from pyinfra.formats.text_table import is_whole, lines_of, rules_hold

CSV_COLUMNS = ("class", "x", "y", "z", "dx", "dy", "dz", "heading", "score")
_FILES = 256  # files per group
_LABEL_NUMBERS = kitti.LABEL_COLUMNS[8:]


@dataclass(frozen=True, eq=False)
class Vehicles:
    """The n objects of several frames, in the levelled LiDAR frame."""

    frame: IntArray  # (n,) index into the requested frames, ascending
    ids: IntArray  # (n,) -1 if read from labels
    names: NameArray  # (n,) class
    boxes: FloatArray  # (n, 7) at the label time
    mid_frame: FloatArray  # (n, 7) at mid-frame; the region tests use these boxes
    points: IntArray  # (n,) number of returns of this LiDAR; 1 if read from labels
    visibility: FloatArray  # (n,) -1 outside the region; NaN if read from labels

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, keep: BoolArray) -> Vehicles:
        return replace(self, **{name: column[keep] for name, column in vars(self).items()})


@dataclass(frozen=True, eq=False)
class Predictions:
    """The n predicted boxes of several frames, in the levelled LiDAR frame."""

    frame: IntArray  # (n,) index into the requested frames, ascending
    line: IntArray  # (n,) line number in its file
    names: NameArray  # (n,) class
    boxes: FloatArray  # (n, 7)
    scores: FloatArray  # (n,)
    angle: FloatArray  # (n,) rotation_y or heading, unchanged from the file

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, keep: BoolArray) -> Predictions:
        return replace(self, **{name: column[keep] for name, column in vars(self).items()})


@dataclass(frozen=True, eq=False)
class Cameras:
    """The calibrations of many frames; identical ones are stored once."""

    different: tuple[kitti.Calibration, ...]
    of_frame: IntArray  # (frames,) index into `different`

    def boxes(self, values: FloatArray, frame: IntArray) -> FloatArray:
        """Converts h w l x y z rotation_y (n, 7) to boxes (n, 7); frame: (n,) of each row."""
        out = np.empty_like(values)
        for i, calibration in enumerate(self.different):
            rows = self.of_frame[frame] == i
            out[rows] = kitti.boxes_from_camera(values[rows], calibration)
        return out


Table = TypeVar("Table", Vehicles, Predictions)


def read_vehicles(lidar_folder: Path, frames: Sequence[int]) -> Vehicles:
    """Reads the objects of the frames, or their labels if the folder has no objects.

    Raises FileNotFoundError for a frame without its file, and FormatError.
    """
    if (lidar_folder / "training/objects").is_dir():
        files = [kitti.frame_file(lidar_folder, "objects", frame) for frame in frames]
        time = kitti.read_label_time(lidar_folder)
        return _joined(files, lambda paths, index: _objects(paths, index, time))
    return read_labelled(lidar_folder, frames)


def read_labelled(lidar_folder: Path, frames: Sequence[int]) -> Vehicles:
    """Reads the labels of the frames. Raises FileNotFoundError and FormatError."""
    files = [kitti.frame_file(lidar_folder, "label_2", frame) for frame in frames]
    cameras = read_cameras(lidar_folder, frames)
    return _joined(files, lambda paths, index: _labels(paths, index, cameras))


def other_types(
    lidar_folder: Path, frames: Sequence[int], vehicles: Vehicles, types: Sequence[str]
) -> str | None:
    """Describes unknown class names in the ground truth, which are also not in `types`.

    Objects with such a name are never counted: `car` is not `Car`. Returns None if there is none.
    """
    other = ~np.isin(vehicles.names, [*types, *VEHICLE_TYPES, *OTHER_TYPES])
    if not other.any():
        return None
    names, counts = np.unique(vehicles.names[other], return_counts=True)
    listed = ", ".join(f"{name} ({count})" for name, count in zip(names, counts, strict=True))
    part: kitti.Part = "objects" if vehicles.ids.max(initial=-1) >= 0 else "label_2"
    first = int(np.flatnonzero(other)[0])
    file = kitti.frame_file(lidar_folder, part, frames[vehicles.frame[first]])
    name = str(vehicles.names[first])
    words = (line.replace(",", " ").split() for line in lines_of(file))
    line = next((i for i, row in enumerate(words, start=1) if name in row), 1)
    return f"{file}:{line}: counted nowhere: {listed}; expected {', '.join(types)}"


def read_predictions(files: Sequence[Path | None], cameras: Cameras) -> Predictions:
    """Reads predictions: KITTI result files (.txt), or CSV files in the LiDAR frame (.csv).

    files: one per frame, None for a frame without predictions. The first line of a CSV file names
    its columns: class, x, y, z, dx, dy, dz, heading (radians) and score, in any order.
    Raises FormatError with file and line.
    """
    return _joined(files, lambda paths, index: _predictions(paths, index, cameras))


def read_cameras(lidar_folder: Path, frames: Sequence[int]) -> Cameras:
    """Reads the frames' calibrations; a frame without one gets that of a simulated LiDAR.

    Raises FormatError with file and line.
    """
    number: dict[bytes, int] = {}
    different: list[kitti.Calibration] = []
    of_frame = np.empty(len(frames), dtype=np.int64)
    for i, frame in enumerate(frames):
        file = kitti.frame_file(lidar_folder, "calib", frame)
        text = file.read_bytes() if file.exists() else b""
        if text not in number:
            number[text] = len(different)
            different.append(kitti.read_calibration(file) if text else kitti.simulated())
        of_frame[i] = number[text]
    return Cameras(tuple(different), of_frame)


def _joined(
    files: Sequence[Path | None],
    read: Callable[[Sequence[Path], IntArray], Table],
) -> Table:
    """Concatenates the tables of groups of files; calls `read` with files and frame indices."""
    present = [(i, file) for i, file in enumerate(files) if file is not None]
    parts = []
    for start in range(0, max(1, len(present)), _FILES):
        group = present[start : start + _FILES]
        frames = np.array([i for i, _ in group], dtype=np.int64)
        parts.append(read([file for _, file in group], frames))
    return concatenated(parts)


def concatenated(parts: Sequence[Table]) -> Table:
    """Concatenates one or more tables."""
    columns = {name: [vars(part)[name] for part in parts] for name in vars(parts[0])}
    return type(parts[0])(**{name: np.concatenate(column) for name, column in columns.items()})


def without_points(frame: IntArray, ids: IntArray, names: NameArray, boxes: FloatArray) -> Vehicles:
    """Returns objects at mid-frame with 0 points and unknown visibility (-1)."""
    return Vehicles(
        frame=frame,
        ids=ids,
        names=names,
        boxes=boxes,
        mid_frame=boxes,
        points=np.zeros(len(frame), np.int64),
        visibility=np.full(len(frame), -1.0),
    )


def _objects(files: Sequence[Path], frames: IntArray, label_time: LabelTime) -> Vehicles:
    texts = _texts(files, whole=True)
    cells = [object_rows(text[0], text[1:]) if text else None for text in texts]
    # Move the class to the front, so that all numbers are adjacent.
    rows = [
        [*row[1:2], *row[:1], *row[2:]] for group in cells if group is not None for row in group
    ]
    known = None not in cells and all(row[0] for row in rows)
    values = _numbers(rows, len(kitti.OBJECT_COLUMNS), 1) if known else None
    if values is None or not rules_hold(values, OBJECT_NUMBERS, OBJECT_RULES):
        _fail(files, kitti.read_objects)
    frame = np.repeat(frames, [len(text) - 1 for text in texts])
    ids = values[:, 0].astype(np.int64)
    if len(np.unique(frame * 2**31 + ids)) < len(ids):
        _fail(files, kitti.read_objects)
    mid_frame = values[:, 1:8]
    scan = label_time == "scan"
    return Vehicles(
        frame=frame,
        ids=ids,
        names=np.array([row[0] for row in rows], dtype=np.str_),
        boxes=scan_boxes(mid_frame, values[:, 13:17]) if scan else mid_frame,
        mid_frame=mid_frame,
        points=values[:, 9].astype(np.int64),
        visibility=values[:, 12],
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
    )


def _predictions(files: Sequence[Path], frames: IntArray, cameras: Cameras) -> Predictions:
    if files and files[0].suffix == ".csv":
        return _csv_predictions(files, frames)
    frame, line, names, values = _kitti(files, frames, scores=True)
    boxes = cameras.boxes(values[:, :7], frame)
    return Predictions(frame, line, names, boxes, values[:, 7], values[:, 6])


def _kitti(
    files: Sequence[Path], frames: IntArray, *, scores: bool
) -> tuple[IntArray, IntArray, NameArray, FloatArray]:
    """Reads frame, line, class and the numbers from h on of label or result files."""
    texts = [
        [(i, content) for i, content in enumerate(text, 1) if content.strip()]
        for text in _texts(files)
    ]
    rows = [line.split() for text in texts for _, line in text]
    values = _numbers(rows, len(kitti.LABEL_COLUMNS) + scores, 8)
    names = np.array([row[0] for row in rows], dtype=np.str_) if values is not None else None
    rules = RESULT_RULES if scores else LABEL_RULES
    if values is None or names is None:
        _fail(files, lambda file: kitti.read_labels(file, scores=scores))
    known = names != "DontCare"
    if not rules_hold(values[known], _LABEL_NUMBERS, rules):
        _fail(files, lambda file: kitti.read_labels(file, scores=scores))
    line = np.array([number for text in texts for number, _ in text], dtype=np.int64)
    return (
        np.repeat(frames, [len(text) for text in texts])[known],
        line[known],
        names[known],
        values[known],
    )


def _csv_predictions(files: Sequence[Path], frames: IntArray) -> Predictions:
    tables = [_csv_rows(file) for file in files]
    counts = [len(rows) for rows in tables]
    rows = list(itertools.chain.from_iterable(tables))
    values = _numbers(rows, len(CSV_COLUMNS), 1)
    if values is None or (values[:, 3:6] <= 0).any():
        _fail(files, _check_csv)
    return Predictions(
        frame=np.repeat(frames, counts),
        line=np.array([n + 2 for count in counts for n in range(count)], dtype=np.int64),
        names=np.array([row[0] for row in rows], dtype=np.str_),
        boxes=values[:, :7],
        scores=values[:, 7],
        angle=values[:, 6],
    )


def _csv_rows(file: Path) -> list[list[str]]:
    """Returns the cells of a CSV prediction file in the order of CSV_COLUMNS, without header."""
    lines = _texts([file])[0]
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        raise FormatError(f"{file}:1: {', '.join(missing)}: expected a column, got none")
    order = [header.index(name) for name in CSV_COLUMNS]
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        cells = line.split(",")
        if len(cells) != len(header):
            raise FormatError(f"{file}:{number}: expected {len(header)} columns, got {len(cells)}")
        rows.append([cells[at].strip() for at in order])
    return rows


def _check_csv(file: Path) -> None:
    for number, row in enumerate(_csv_rows(file), start=2):
        for name, cell in zip(CSV_COLUMNS[1:], row[1:], strict=True):
            rule = "more than 0" if name in ("dx", "dy", "dz") else "a finite number"
            value = _number(cell)
            if not math.isfinite(value) or (rule == "more than 0" and value <= 0):
                raise FormatError(f"{file}:{number}: {name}: expected {rule}, got '{cell}'")


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _texts(files: Sequence[Path], *, whole: bool = False) -> list[list[str]]:
    """Returns the lines of each file, like `text_table.lines_of`."""
    texts = [file.read_bytes() for file in files]
    try:
        lines = [text.decode("utf-8-sig").splitlines() for text in texts]
    except UnicodeDecodeError:
        lines = None
    if lines is None or (whole and not all(map(is_whole, texts))):
        _fail(files, lambda file: lines_of(file, whole=whole))
    return lines


def _numbers(rows: Sequence[Sequence[str]], width: int, first: int) -> FloatArray | None:
    """Converts the cells from column `first` on to (n, width - first); None if that fails.

    It fails for a wrong number of columns and for cells that are not finite numbers.
    """
    if any(len(row) != width for row in rows):
        return None
    try:
        values = np.array([row[first:] for row in rows], dtype=np.float64)
    except ValueError:
        return None
    values = values.reshape(len(rows), width - first)
    return values if np.isfinite(values).all() else None


def _fail(files: Sequence[Path], read: Callable[[Path], object]) -> NoReturn:
    """Reads the files one by one, to raise the error that names file and line."""
    for file in files:
        read(file)
    raise AssertionError(f"{files[0]}: read alone but not in a group")
