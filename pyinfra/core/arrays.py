"""Type aliases of NumPy arrays, and tables whose columns are arrays.

Each function documents the shapes, units and frames it uses.
"""

from collections.abc import Sequence
from typing import Any, Self, TypeVar

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
NameArray = npt.NDArray[np.str_]

Points = npt.NDArray[np.float32]  # points (n, 4) x y z intensity, or (n, 3) x y z
Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]
Records = npt.NDArray[np.void]  # structured array (n,), such as the fields of n points

Floats = npt.NDArray[np.floating]  # float32 for large arrays such as clouds, else float64
AnyArray = npt.NDArray[Any]
# Decorator for functions that read numbers from files before checking them. It suppresses NumPy's
# warnings, for example about signalling NaN.
unchecked = np.errstate(invalid="ignore", over="ignore")


class Rows:
    """Base of dataclasses whose fields are arrays (n, ...) with n rows."""

    def __len__(self) -> int:
        return len(next(iter(vars(self).values())))

    def select(self, rows: BoolArray | IntArray) -> Self:
        """Returns some rows, by a mask (n,) or by their numbers."""
        return type(self)(**{name: column[rows] for name, column in vars(self).items()})


Table = TypeVar("Table", bound=Rows)


def concatenated(parts: Sequence[Table]) -> Table:
    """Concatenates one or more tables of one class."""
    columns = {name: [vars(part)[name] for part in parts] for name in vars(parts[0])}
    return type(parts[0])(**{name: np.concatenate(column) for name, column in columns.items()})
