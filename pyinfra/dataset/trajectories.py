"""Reads all objects of a data set at mid-frame, including those outside the LiDARs' range."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import FormatError
from pyinfra.dataset.frame_tables import Vehicles, without_points
from pyinfra.dataset.world_frame import to_levelled
from pyinfra.formats.kitti import WorldPose
from pyinfra.formats.text_table import is_whole

INSTANT_S = 0.1  # interval between instants; frame k lies between instants k and k + 1
_NUMBERS = ["x", "y", "z", "dx", "dy", "dz", "heading"]


def read_objects_at(file: Path, frames: Sequence[int], pose: WorldPose) -> Vehicles:
    """Returns the objects of trajectories.csv at the middle of the given ascending frames.

    Boxes are in the levelled LiDAR frame with the given pose. For all objects, `points` is 0 and
    `visibility` is -1, because the file contains no data about LiDARs. Raises FormatError.
    """
    rows = read_rows(file, ["t", "id", "class", *_NUMBERS])
    instant = np.round(rows.t.to_numpy() / INSTANT_S).astype(np.int64)
    index = pd.Series(np.arange(len(frames)), index=np.array(frames, dtype=np.int64))
    before = rows.assign(frame=index.reindex(instant).to_numpy()).dropna(subset="frame")
    after = rows.assign(frame=index.reindex(instant - 1).to_numpy()).dropna(subset="frame")
    pairs = before.merge(after, on=["frame", "id"], suffixes=("", "_after"))
    pairs = pairs.sort_values(["frame", "id"], kind="stable")
    first = pairs[_NUMBERS].to_numpy(np.float64)
    last = pairs[[f"{name}_after" for name in _NUMBERS]].to_numpy(np.float64)
    boxes = (first + last) / 2
    turned = (last[:, 6] - first[:, 6] + np.pi) % (2 * np.pi) - np.pi
    boxes[:, 6] = (first[:, 6] + turned / 2 - pose.yaw + np.pi) % (2 * np.pi) - np.pi
    boxes[:, :2] = to_levelled(boxes[:, :2], pose)
    boxes[:, 2] -= pose.z
    return without_points(
        frame=pairs.frame.to_numpy(np.int64),
        ids=pairs.id.to_numpy(np.int64),
        names=pairs["class"].to_numpy(dtype=np.str_),
        boxes=boxes,
    )


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
    except ValueError as error:  # a cell is not a number, a column is missing, or it is not UTF-8
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
