"""Tables in memory: dataclasses whose fields are arrays with one row for each entry."""

from collections.abc import Sequence
from typing import Self, TypeVar

import numpy as np

from pyinfra.core.arrays import BoolArray, IntArray


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
