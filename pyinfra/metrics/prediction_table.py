"""Checks a table of predicted boxes and converts it for the evaluation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion
from pyinfra.dataset.frame_sequence import BOX
from pyinfra.dataset.frame_tables import Predictions

COLUMNS = ["frame", "type", *BOX, "score"]
FARTHEST_M = 10_000.0


def predictions_of(table: pd.DataFrame, frames: Sequence[int]) -> Predictions:
    """Returns the rows of a table as predictions, ordered by frame.

    Parameters
    ----------
    table : columns frame, type, x y z dx dy dz heading (metres, radians, levelled LiDAR frame),
        score (0 to 1)
    frames : numbers of the evaluated frames, ascending; rows of other frames are an error

    Raises
    ------
    Error : for a missing column, a value out of range, or a row of another frame
    """
    for name in COLUMNS:
        if name not in table.columns:
            near = suggestion(name, map(str, table.columns))
            raise Error(f"pred: expected the column '{name}', got none{near}")
    wrong = [i for i, kind in enumerate(table["type"]) if not isinstance(kind, str)]
    if wrong:
        got = table["type"].iloc[wrong[0]]
        raise Error(f"pred: row {wrong[0]}: type: expected a name, got {got!r}")
    numbers = {name: _numbers(table, name) for name in COLUMNS if name != "type"}
    _check(numbers["score"], "score", 0, 1)
    for name in ("x", "y", "z"):
        _check(numbers[name], name, -FARTHEST_M, FARTHEST_M)
    for name in ("dx", "dy", "dz"):
        _check(numbers[name], name, 1e-3, FARTHEST_M)
    known = np.asarray(frames, dtype=np.int64)
    index = np.searchsorted(known, numbers["frame"])
    is_known = known[np.minimum(index, len(known) - 1)] == numbers["frame"]
    if not is_known.all():
        row = int(np.flatnonzero(~is_known)[0])
        raise Error(
            f"pred: row {row}: frame: expected one of the {len(known)} evaluated frames, "
            f"got {numbers['frame'][row]:g}"
        )
    order = np.argsort(index, kind="stable")
    return Predictions(
        frame=index[order].astype(np.int64),
        line=np.arange(len(table), dtype=np.int64)[order],
        names=table["type"].to_numpy(dtype=np.str_)[order],
        boxes=np.stack([numbers[name] for name in BOX], axis=1).reshape(-1, 7)[order],
        scores=numbers["score"][order],
        angle=numbers["heading"][order],
    )


def _numbers(table: pd.DataFrame, name: str) -> FloatArray:
    try:
        values: FloatArray = table[name].to_numpy(dtype=np.float64)
    except (TypeError, ValueError):
        raise Error(f"pred: {name}: expected numbers, got {table[name].dtype}") from None
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values))[0])
        raise Error(f"pred: row {row}: {name}: expected a finite number, got {values[row]}")
    return values


def _check(values: FloatArray, name: str, low: float, high: float) -> None:
    outside = (values < low) | (values > high)
    if outside.any():
        row = int(np.flatnonzero(outside)[0])
        raise Error(f"pred: row {row}: {name}: expected {low:g} to {high:g}, got {values[row]:g}")
