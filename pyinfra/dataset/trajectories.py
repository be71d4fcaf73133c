"""Reads all objects of a data set at mid-frame, including those outside the LiDARs' range."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.boxes import wrapped
from pyinfra.core.errors import FormatError
from pyinfra.dataset.frame_tables import Vehicles, without_points
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.world_frame import to_levelled
from pyinfra.formats.kitti import WorldPose
from pyinfra.formats.text_table import is_whole

ROW_STEP_S = 0.1  # time between the rows of an object
_NUMBERS = ["x", "y", "z", "dx", "dy", "dz", "heading"]


def read_objects_at(
    file: Path, frames: Sequence[int], pose: WorldPose, period_s: float = PERIOD_S
) -> Vehicles:
    """Returns the objects of trajectories.csv at the middle of the given ascending frames.

    Boxes are in the levelled LiDAR frame with the given pose. For all objects, `points` is 0 and
    `visibility` is -1, because the file contains no data about LiDARs. Raises FormatError.
    """
    rows = read_rows(file, ["t", "id", "class", *_NUMBERS])
    rows = rows.sort_values(["id", "t"], kind="stable")
    numbers = np.array(frames, dtype=np.float64)
    spans = existing(rows, numbers * period_s, (numbers + 1) * period_s)
    values = rows[_NUMBERS].to_numpy(np.float64)
    first, last = between_rows(values, spans.start), between_rows(values, spans.end)
    boxes = (first + last) / 2
    turned = wrapped(last[:, 6] - first[:, 6])
    boxes[:, 6] = wrapped(first[:, 6] + turned / 2 - pose.yaw)
    boxes[:, :2] = to_levelled(boxes[:, :2], pose)
    boxes[:, 2] -= pose.z
    return without_points(
        frame=spans.span,
        ids=rows.id.to_numpy(np.int64)[spans.row],
        names=rows["class"].to_numpy(dtype=np.str_)[spans.row],
        boxes=boxes,
    )


@dataclass(frozen=True, eq=False)
class ExistingObjects:
    """The objects that exist in spans of time, ordered by span and object.

    row : (k,) a row of the object in the sorted table
    span : (k,) index of the span of time
    start, end : (k,) position of the span's start and end in the sorted table: 2.5 is between rows
        2 and 3
    """

    row: IntArray
    span: IntArray
    start: FloatArray
    end: FloatArray


def existing(rows: pd.DataFrame, starts: FloatArray, ends: FloatArray) -> ExistingObjects:
    """Returns the objects of trajectories.csv that exist in ascending spans of time.

    rows : columns t and id, sorted by id, then by t. An object exists from its first to its last
        row. Between two rows it moves linearly, so the file omits rows in which it stands.
    starts, ends : (m,) seconds
    """
    ids = rows.id.to_numpy(np.int64)
    steps = np.rint(rows.t.to_numpy(np.float64) / ROW_STEP_S).astype(np.int64)
    first = np.flatnonzero(np.diff(ids, prepend=-1) != 0)
    last = np.append(first[1:], len(ids))[: len(first)] - 1
    start, end = _positions(starts), _positions(ends)
    begin = np.searchsorted(start, steps[first])
    count = np.maximum(0, np.searchsorted(end, steps[last], side="right") - begin)
    which = np.repeat(np.arange(len(first)), count)
    span = np.repeat(begin - np.cumsum(count) + count, count) + np.arange(len(which))
    order = np.lexsort((which, span))
    which, span = which[order], span[order]
    # The times of all objects are placed on one axis, one object after the other.
    apart = int(steps.max(initial=0)) + 2
    number = np.cumsum(np.diff(ids, prepend=-1) != 0) - 1
    axis = (number * apart + steps).astype(np.float64)

    def place(positions: FloatArray) -> FloatArray:
        at = which * apart + positions[span]
        before = np.searchsorted(axis, at, side="right") - 1
        after = np.minimum(before + 1, last[which])
        gap = np.maximum(axis[after] - axis[before], 1)
        return np.asarray(before + (at - axis[before]) / gap)

    return ExistingObjects(first[which], span, place(start), place(end))


def _positions(times: FloatArray) -> FloatArray:
    """Returns times in units of ROW_STEP_S; a value within 1e-6 of a whole number is rounded."""
    positions = np.asarray(times, dtype=np.float64) / ROW_STEP_S
    nearest = np.rint(positions)
    return np.where(np.abs(positions - nearest) <= 1e-6, nearest, positions)


def between_rows(values: FloatArray, at: FloatArray) -> FloatArray:
    """Returns rows (k, m), interpolated in a table (n, m) at row positions (k,), such as 2.5.

    Column 6, if there is one, is an angle. It is interpolated in the direction of the smaller turn.
    """
    before = np.floor(at).astype(np.int64)
    share = (at - before)[:, None]
    after = np.minimum(before + (share[:, 0] > 0), len(values) - 1)
    change = values[after] - values[before]
    change[:, 6:7] = wrapped(change[:, 6:7])
    return np.asarray(values[before] + share * change)


def read_rows(file: Path, columns: Sequence[str]) -> pd.DataFrame:
    """Reads some columns of trajectories.csv. The index of the table is the row number.

    The column `class` is text. Rows of instants without any object are left out. Raises FormatError
    with file and line.
    """
    data = file.read_bytes()
    _check_lines(file, data)
    numbers = {name: np.float64 for name in columns if name != "class"}
    try:
        rows = pd.read_csv(io.BytesIO(data), usecols=list(columns), dtype=numbers)
    except ValueError as error:  # a wrong number, a missing column, or text that is not UTF-8
        raise FormatError(f"{file}: {error}") from None
    return rows[rows[[name for name in columns if name != "t"]].notna().any(axis=1)]


def _check_lines(file: Path, data: bytes) -> None:
    """Raises FormatError unless all lines are complete and have as many columns as the first."""
    if not is_whole(data[-1:]):
        raise FormatError(
            f"{file}: expected a newline at the end of the last line, got none; the file may be "
            "truncated"
        )
    characters = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(characters == ord("\n"))
    commas = np.diff(np.searchsorted(np.flatnonzero(characters == ord(",")), ends), prepend=0)
    wrong = np.flatnonzero(commas != commas[0])
    if len(wrong) > 0:
        line, actual, expected = wrong[0] + 1, commas[wrong[0]] + 1, commas[0] + 1
        raise FormatError(f"{file}:{line}: expected {expected} columns, got {actual}")
