"""A user's own detector: any callable that takes points and returns boxes."""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error
from pyinfra.dataset.box_tables import box_table
from pyinfra.dataset.object_rows import BOX
from pyinfra.models.detectors import Detections

OwnDetector: TypeAlias = Callable[[Points], Any]

LONGEST_M = 100.0  # largest side of a box, metres; a larger side is probably not in metres


def detections_of_own(number: int, model: OwnDetector, points: Points) -> Detections:
    """Calls a user's detector on a frame and returns the detector's boxes, best first.

    number: frame number, for messages. points: (n, 4) float32. Raises Error if the callable fails
    or does not return boxes.
    """
    prefix = f"model: frame {number}"
    try:
        result = model(points)
    except Exception as error:
        raise Error(f"{prefix}: the detector raised {type(error).__name__}: {error}") from error
    table = box_table(result, prefix)
    scores = table["score"] if "score" in table.columns else pd.Series(1.0, table.index)
    try:
        numbers = table[BOX].assign(score=scores).to_numpy(dtype=np.float64)
    except (TypeError, ValueError):
        kinds = ", ".join(f"{name} {table[name].dtype}" for name in BOX)
        raise Error(f"{prefix}: expected numbers in the columns of boxes, got {kinds}") from None
    if not np.isfinite(numbers).all():
        raise Error(f"{prefix}: expected finite numbers, got NaN or inf")
    boxes, values = numbers[:, :7], numbers[:, 7]
    if (boxes[:, 3:6] <= 0).any():
        raise Error(f"{prefix}: dx, dy, dz: expected values above 0, got {boxes[:, 3:6].min():g}")
    if (boxes[:, 3:6] > LONGEST_M).any():
        raise Error(
            f"{prefix}: dx, dy, dz: expected at most {LONGEST_M:g} m, got {boxes[:, 3:6].max():g}"
        )
    if (np.abs(boxes[:, 6]) > 2 * math.pi).any():
        turned = np.abs(boxes[:, 6]).max()
        raise Error(f"{prefix}: heading: expected radians, -2 pi to 2 pi, got {turned:g}")
    if ((values < 0) | (values > 1)).any():
        raise Error(f"{prefix}: score: expected 0 to 1, got {values.min():g} to {values.max():g}")
    kinds = table["type"] if "type" in table.columns else pd.Series("vehicle", table.index)
    if not all(isinstance(kind, str) for kind in kinds):
        wrong = next(kind for kind in kinds if not isinstance(kind, str))
        raise Error(f"{prefix}: type: expected a name such as 'Car', got {wrong!r:.40}")
    order = np.argsort(-values, kind="stable")
    return Detections(boxes[order], values[order], kinds.to_numpy(dtype=np.str_)[order])
