"""Readers for the parts of a frame. All results are in the levelled LiDAR frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import AnyArray, Float32Array, FloatArray, Records
from pyinfra.core.errors import FormatError
from pyinfra.formats.kitti.camera import Calibration, boxes_from_camera, simulated
from pyinfra.formats.kitti.layout import (
    FARTHEST_M,
    FIELDS,
    LABEL_COLUMNS,
    OBJECT_COLUMNS,
    PITCH_COLUMN,
    SCAN_COLUMNS,
    Labels,
    Objects,
)
from pyinfra.formats.text_table import (
    MOST_RADIANS,
    RADIANS,
    ColumnRule,
    NamedRows,
    between,
    lines_of,
)

_SHORTEST_M, _LONGEST_M = 0.001, 1000.0  # minimum and maximum length of a box side
_MOST = 2**31 - 1  # largest id and largest number of points
_ROUNDED_M = 0.05  # tolerance of `distance` against the distance from x and y, as all are rounded
_LONGEST_FRAME_S = 60.0
# Lower limit of scan_time_s. It is negative, because fused data sets use the clock of the first
# mount. Frames of the other mounts may start up to 0.1 s earlier or later.
_EARLIEST_S = -0.2
_COUNTS_IN_BOXES = ("points_in_box", "points_in_scan_box")


def _position(columns: str) -> ColumnRule:
    return between(columns.split(), -FARTHEST_M, FARTHEST_M)


def _sides(columns: str) -> ColumnRule:
    allowed = f"more than {_SHORTEST_M:g}, at most {_LONGEST_M:g}"
    return ColumnRule(
        tuple(columns.split()), lambda v: (v > _SHORTEST_M) & (v <= _LONGEST_M), allowed
    )


def _angle(column: str) -> ColumnRule:
    return ColumnRule((column,), lambda v: np.abs(v) <= MOST_RADIANS, RADIANS)


OBJECT_NUMBERS = tuple(name for name in OBJECT_COLUMNS if name != "class")
BOX_RULES = (_position("x y z"), _sides("dx dy dz"), _angle("heading"))
OBJECT_RULES: tuple[ColumnRule, ...] = (
    *BOX_RULES,
    between(["speed"], 0, 1000),
    _position("scan_x scan_y scan_z"),
    _angle("scan_heading"),
    between(["scan_time_s"], _EARLIEST_S, _LONGEST_FRAME_S),
    between(["id"], -1, _MOST, whole=True),
    between(["points", *_COUNTS_IN_BOXES], 0, _MOST, whole=True),
    ColumnRule(
        _COUNTS_IN_BOXES,
        lambda v, points: v <= points,
        "at most the value of `points`",
        beside=("points",),
    ),
    ColumnRule(
        ("distance",),
        lambda v, x, y: np.abs(v - np.hypot(x, y)) <= _ROUNDED_M,
        "the horizontal distance of x, y from the sensor",
        beside=("x", "y"),
    ),
    ColumnRule(("visibility",), lambda v: (v == -1) | ((v >= 0) & (v <= 1)), "0 to 1, or -1"),
)
LABEL_RULES = (_sides("h w l"), _position("x y z"), _angle("rotation_y"))
# Predictions may be poor, but must have values with which overlaps can be computed.
LARGEST = 10_000.0  # largest size and coordinate (metres) and heading (radians) of a prediction
MOST_PREDICTIONS = 1000  # maximum number of predictions in a frame; nuScenes evaluates up to 500


def result_rules(sizes: Sequence[str], others: Sequence[str]) -> tuple[ColumnRule, ...]:
    """Returns rules for predictions. others: the columns of position and heading."""
    allowed = f"more than 0, at most {LARGEST:g}"
    return (
        ColumnRule(tuple(sizes), lambda v: (v > 0) & (v <= LARGEST), allowed),
        between(others, -LARGEST, LARGEST),
    )


RESULT_RULES = result_rules(("h", "w", "l"), ("x", "y", "z", "rotation_y"))


def read_points(file: Path) -> Float32Array:
    """Reads the points of one frame: (n, 4) float32, x y z intensity, intensity in [0, 1].

    Raises FormatError if the file is truncated, or a value is not finite or beyond 10 km.
    """
    points = _records(file, np.dtype(("<f4", 4)), "x y z intensity, float32")
    bad = np.flatnonzero(~(np.abs(points) <= FARTHEST_M).all(axis=1))
    if len(bad) > 0:
        raise FormatError(
            f"{file}: point {bad[0]}: expected finite values from {-FARTHEST_M:g} to "
            f"{FARTHEST_M:g}, got {points[bad[0]]}"
        )
    return points


def read_fields(file: Path, count: int | None = None) -> Records:
    """Reads the additional fields of each point: (n,) records of FIELDS, in the points' order.

    `time_s` counts from the start of the frame. `ring` is 0 at the lowest elevation. `class` is the
    class of the object, or the material of the background. `echo` is 1 for the second point of a
    ray. `object_id` is -1 for background.
    count: number of points; if None, the number of records is not checked. Raises FormatError if
    the file is truncated, or has another number of records.
    """
    fields = _records(file, FIELDS, "time_s ring class echo object_id")
    if count is not None and len(fields) != count:
        raise FormatError(
            f"{file}: expected {count} records, one for each point, got {len(fields)}"
        )
    return fields


PITCHED_RULES = (*OBJECT_RULES, _angle(PITCH_COLUMN))
PITCHED_HEADER = ",".join([*OBJECT_COLUMNS, PITCH_COLUMN])


def object_rows(header: str, lines: Sequence[str]) -> list[list[str]] | None:
    """Returns the cells of OBJECT_COLUMNS of each line, or None if the header is not valid.

    The optional column `pitch` is dropped, because label boxes have no pitch.
    """
    rows = [line.split(",") for line in lines]
    if header == PITCHED_HEADER:
        return [r[:-1] for r in rows]
    return rows if header == ",".join(OBJECT_COLUMNS) else None


def read_objects(file: Path) -> Objects:
    """Reads the objects of one frame. A frame without objects gives k = 0.

    Raises FormatError with file and line.
    """
    lines = lines_of(file, whole=True)
    header = lines[0] if lines else ""
    columns = ",".join(OBJECT_COLUMNS)
    if header not in (columns, PITCHED_HEADER):
        raise FormatError(f"{file}:1: expected the header '{columns}', got '{header}'")
    rows = [line.split(",") for line in lines[1:]]
    table = NamedRows(file, range(2, 2 + len(rows)), rows, header.split(","), "class")
    table.check(PITCHED_RULES if header == PITCHED_HEADER else OBJECT_RULES)
    known = np.flatnonzero(table["id"] >= 0)
    ids, first = np.unique(table["id"][known], return_index=True)
    if len(ids) < len(known):
        again = int(np.delete(known, first).min())
        table.fail(again, f"{table['id'][again]:.0f} twice", "each id once per frame", "id")
    boxes = np.stack([table[c] for c in OBJECT_COLUMNS[2:9]], axis=1)
    scan = np.stack([table[c] for c in SCAN_COLUMNS[:4]], axis=1)
    return Objects(
        ids=table["id"].astype(np.int64),
        names=table.names,
        boxes=boxes,
        speed=table["speed"],
        points=table["points"].astype(np.int64),
        points_in_box=table["points_in_box"].astype(np.int64),
        distance=table["distance"],
        visibility=table["visibility"],
        scan_boxes=scan_boxes(boxes, scan),
        scan_time_s=table["scan_time_s"],
        points_in_scan_box=table["points_in_scan_box"].astype(np.int64),
        pitch=table[PITCH_COLUMN] if header == PITCHED_HEADER else None,
    )


def scan_boxes(boxes: FloatArray, scan: FloatArray) -> FloatArray:
    """Moves mid-frame boxes (k, 7) to their poses at scan time, x y z heading (k, 4)."""
    return np.column_stack([scan[:, :3], boxes[:, 3:6], scan[:, 3]])


def read_labels(
    file: Path,
    *,
    scores: bool = False,
    calibration: Calibration | None = None,
    dont_care: bool = False,
) -> Labels:
    """Reads the boxes of a label file, or of a prediction file (`scores`), in the LiDAR frame.

    `calibration` describes the frame's camera. The default is the camera of a simulated LiDAR.
    DontCare regions are only returned with `dont_care`. Blank lines are skipped. An empty file
    gives k = 0. Raises FormatError with file and line, also for scores in a label file, for missing
    scores in a prediction file, and for a label whose rotation_y is too large for radians.
    """
    columns = [*LABEL_COLUMNS, "score"] if scores else LABEL_COLUMNS
    rows = {i: line.split() for i, line in enumerate(lines_of(file), start=1) if line.strip()}
    table = NamedRows(file, list(rows), list(rows.values()), columns, "type")
    known = table.names != "DontCare"
    table.check(RESULT_RULES if scores else LABEL_RULES, known)
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
            f"{file}: expected a size that is a multiple of {record.itemsize} bytes ({what}), got "
            f"{size} bytes"
        )
    return np.fromfile(file, dtype=record)
