"""Checks a table of predicted boxes and converts it for the evaluation."""

import os
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.dataset.box_tables import box_table, check_columns
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.dataset.object_rows import BOX

COLUMNS = ["frame", "type", *BOX, "score"]
FARTHEST_M = 10_000.0


AnyPredictions: TypeAlias = (
    "pd.DataFrame | Mapping[int, object] | Sequence[object] | str | os.PathLike[str]"
)


def prediction_table(pred: object, frames: Sequence[int]) -> pd.DataFrame:
    """Returns predictions of several frames as one table.

    Parameters
    ----------
    pred : a table, a dict from frame numbers to the boxes of a frame, or a list with the boxes of
        each frame; boxes are any value of `box_table`. For one frame, its boxes alone are enough
    frames : numbers of the evaluated frames

    Raises
    ------
    Error : for any other value, and a list of another length
    """
    if isinstance(pred, pd.DataFrame):
        return box_table(pred, "pred")
    by_frame = isinstance(pred, Mapping) and all(isinstance(k, (int, np.integer)) for k in pred)
    if by_frame and isinstance(pred, Mapping):
        parts = dict(pred)
    elif len(frames) == 1 and not (isinstance(pred, (list, tuple)) and len(pred) == 1):
        parts = {frames[0]: pred}
    elif isinstance(pred, (list, tuple)) and len(pred) == len(frames):
        parts = dict(zip(frames, pred, strict=True))
    else:
        got = f"{len(pred)} entries" if isinstance(pred, (list, tuple)) else type(pred).__name__
        raise Error(
            f"pred: expected a table, a folder, a dict by frame number, or a list of the boxes of "
            f"each of the {len(frames)} frames, got {got}"
        )
    tables = [
        box_table(value, f"pred: frame {k}").assign(frame=int(k)) for k, value in parts.items()
    ]
    usual = {"type": "vehicle", "score": 1.0}
    filled = [t.assign(**{n: v for n, v in usual.items() if n not in t.columns}) for t in tables]
    none = pd.DataFrame(columns=COLUMNS).astype(dict.fromkeys(COLUMNS, float) | {"type": object})
    return pd.concat([t[COLUMNS] for t in filled if len(t)] or [none], ignore_index=True)


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
    check_columns(table, COLUMNS, "pred")
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
