"""Reads boxes from the objects in which detectors and users hold them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion
from pyinfra.dataset.object_rows import BOX

# Names of boxes, scores and types in the dicts of other tools (OpenPCDet, MMDetection3D).
BOXES = ("boxes", "pred_boxes", "boxes_3d", "bboxes_3d")
SCORES = ("score", "scores", "pred_scores", "scores_3d")
TYPES = ("type", "types", "class", "classes", "name", "names", "label", "labels")
EXPECTED = (
    "expected a table, an array (n, 7) or (n, 8), a list of such rows, or a dict with `boxes`"
)


def box_table(value: Any, prefix: str) -> pd.DataFrame:
    """Returns boxes as a table with the columns type (if it is known), BOX and score (if known).

    Parameters
    ----------
    value : a table; an array or tensor (n, 7), or (n, 8) with the score last; a list of such rows,
        or of dicts; a dict of columns, or with `boxes` and, optionally, `scores` and `names`; or an
        object with the attributes `boxes`, `scores` and `names`. A column `class` is the type
    prefix : beginning of messages

    Raises
    ------
    Error : for any other value, an unknown shape, and types that are numbers
    """
    if all(hasattr(value, name) for name in ("boxes", "scores", "names")):
        value = {name: getattr(value, name) for name in ("boxes", "scores", "names")}
    if isinstance(value, Mapping) and (key := _first(value, BOXES)):
        table = box_table(value[key], prefix)
        for column, names in (("score", SCORES), ("type", TYPES)):
            if name := _first(value, names):
                table = _with_column(table, column, value[name], f"{prefix}: {name}")
        return table
    first = value[0] if isinstance(value, (list, tuple)) and len(value) else None
    if isinstance(value, Mapping) or isinstance(first, Mapping):
        try:
            value = pd.DataFrame(value)
        except ValueError as error:
            raise Error(f"{prefix}: expected columns of equal length: {error}") from None
    if isinstance(value, pd.DataFrame):
        name = _first(value, TYPES)
        if "type" not in value.columns and name:
            value = value.rename(columns={name: "type"})
        check_columns(value, BOX, prefix)
        return value
    return _of_array(value, prefix)


def check_columns(table: pd.DataFrame, columns: Sequence[str], prefix: str) -> None:
    """Raises Error for a missing column. prefix: beginning of the message."""
    for column in columns:
        if column not in table.columns:
            near = suggestion(column, map(str, table.columns))
            raise Error(f"{prefix}: expected the column '{column}', got none{near}")


def _of_array(value: Any, prefix: str) -> pd.DataFrame:
    if value is None or isinstance(value, (str, bytes)):
        raise Error(f"{prefix}: {EXPECTED}, got {type(value).__name__}")
    try:
        values = np.asarray(on_cpu(value), dtype=np.float64)
    except (TypeError, ValueError):
        raise Error(f"{prefix}: {EXPECTED}, got {type(value).__name__}") from None
    if values.size == 0:
        values = np.empty((0, 8))
    if values.ndim != 2 or values.shape[1] not in (7, 8):
        raise Error(f"{prefix}: {EXPECTED}, got {type(value).__name__} {values.shape}")
    return pd.DataFrame(values, columns=[*BOX, "score"][: values.shape[1]])


def _with_column(table: pd.DataFrame, column: str, values: Any, prefix: str) -> pd.DataFrame:
    cells = np.asarray(on_cpu(values))
    if cells.shape != (len(table),):
        raise Error(
            f"{prefix}: expected {len(table)} values, one for each box, got an array of shape "
            f"{cells.shape}"
        )
    if column == "type" and len(cells) and cells.dtype.kind not in "UO":
        raise Error(f"{prefix}: expected names of types, such as 'Car', got numbers")
    return table.assign(**{column: cells.astype(object) if column == "type" else cells})


def on_cpu(value: Any) -> Any:
    """Returns a tensor as a NumPy array; any other value unchanged."""
    return value.detach().cpu().numpy() if hasattr(value, "detach") else value


def _first(columns: Any, names: tuple[str, ...]) -> str:
    return next((name for name in names if name in columns), "")
