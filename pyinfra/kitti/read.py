"""Readers of the parts of a frame. All results are in the levelled LiDAR frame."""

from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.arrays import AnyArray, Float32Array, Records
from pyinfra.kitti.camera import Calibration, boxes_from_camera, simulated
from pyinfra.kitti.layout import (
    FIELDS,
    LABEL_COLUMNS,
    OBJECT_COLUMNS,
    FormatError,
    Labels,
    Objects,
)
from pyinfra.kitti.table import MOST_RADIANS, RADIANS, NamedRows, lines_of


def read_points(file: Path) -> Float32Array:
    """Returns of one frame: (n, 4) float32, x y z intensity, intensity in [0, 1].

    Raises FormatError if the file is cut short or a value is not finite.
    """
    points = _records(file, np.dtype(("<f4", 4)), "x y z intensity, float32")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad) > 0:
        raise FormatError(f"{file}: point {bad[0]}: found {points[bad[0]]}, allowed finite values")
    return points


def read_fields(file: Path) -> Records:
    """What else is known of each return, in the order of velodyne: (n,) records of FIELDS.

    time_s: since the start of the frame; ring: 0 at the lowest elevation; class: of the object or
    of the background's material; object_id: -1 for background.
    Raises FormatError if the file is cut short.
    """
    return _records(file, FIELDS, "time_s ring class object_id")


def read_objects(file: Path, *, in_radians: bool = False) -> Objects:
    """The vehicles of one frame; a frame without vehicles gives k = 0.

    in_radians: headings beyond 2 pi, which must be degrees, are an error.
    Raises FormatError with file and line.
    """
    lines = lines_of(file)
    header = lines[0] if lines else ""
    if header != ",".join(OBJECT_COLUMNS):
        raise FormatError(f"{file}:1: found '{header}', allowed '{','.join(OBJECT_COLUMNS)}'")
    rows = [line.split(",") for line in lines[1:]]
    table = NamedRows(file, range(2, 2 + len(rows)), rows, OBJECT_COLUMNS, "class")
    table.check(["dx", "dy", "dz"], lambda v: v > 0, "more than 0")
    if in_radians:
        table.check(["heading"], lambda v: np.abs(v) <= MOST_RADIANS, RADIANS)
    table.check(["id"], lambda v: v == np.floor(v), "a whole number")
    table.check(
        ["points", "points_in_box"],
        lambda v: (v >= 0) & (v == np.floor(v)),
        "a whole number from 0",
    )
    table.check(["visibility"], lambda v: (v == -1) | ((v >= 0) & (v <= 1)), "0 to 1, or -1")
    return Objects(
        ids=table["id"].astype(np.int64),
        names=table.names,
        boxes=np.stack([table[c] for c in OBJECT_COLUMNS[2:9]], axis=1),
        speed=table["speed"],
        points=table["points"].astype(np.int64),
        points_in_box=table["points_in_box"].astype(np.int64),
        distance=table["distance"],
        visibility=table["visibility"],
    )


def read_labels(
    file: Path,
    *,
    scores: bool = False,
    calibration: Calibration | None = None,
    dont_care: bool = False,
    in_radians: bool = False,
) -> Labels:
    """The boxes of a label file, or with `scores` of a prediction file, in the LiDAR frame.

    calibration: of the frame's camera; that of a simulated LiDAR by default. DontCare regions are
    left out unless asked for; an empty file gives k = 0. in_radians: a rotation_y beyond 2 pi,
    which must be in degrees, is an error.
    Raises FormatError with file and line, also for scores in a label file and none in predictions.
    """
    columns = [*LABEL_COLUMNS, "score"] if scores else LABEL_COLUMNS
    rows = [line.split() for line in lines_of(file)]
    table = NamedRows(file, range(1, 1 + len(rows)), rows, columns, "type")
    known = table.names != "DontCare"
    table.check(["h", "w", "l"], lambda v: (v > 0) | ~known, "more than 0")
    if in_radians:
        table.check(["rotation_y"], lambda v: (np.abs(v) <= MOST_RADIANS) | ~known, RADIANS)
    keep = known | dont_care
    values = table.values[keep]
    return Labels(
        names=table.names[keep],
        boxes=boxes_from_camera(values[:, 7:14], calibration or simulated()),
        scores=values[:, 14] if scores else None,
        image=values[:, :7],
    )


def _records(file: Path, record: np.dtype[Any], what: str) -> AnyArray:
    size = file.stat().st_size
    if size % record.itemsize != 0:
        raise FormatError(
            f"{file}: found {size} bytes, allowed a multiple of {record.itemsize} ({what})"
        )
    return np.fromfile(file, dtype=record)
