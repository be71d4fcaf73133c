"""The base of tables in memory: dataclasses whose fields are arrays with one row for each entry."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import numpy as np

from pyinfra.core.arrays import BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class Rows:
    """Arrays (n, ...) of n rows, by the name of the field."""

    def __len__(self) -> int:
        return len(next(iter(vars(self).values())))

    def select(self, rows: BoolArray | IntArray) -> Self:
        """Returns some rows, by a mask (n,) or by their numbers."""
        return replace(self, **{name: column[rows] for name, column in vars(self).items()})


Table = TypeVar("Table", bound=Rows)


def concatenated(parts: Sequence[Table]) -> Table:
    """Concatenates one or more tables of one class."""
    columns = {name: [vars(part)[name] for part in parts] for name in vars(parts[0])}
    return replace(parts[0], **{name: np.concatenate(column) for name, column in columns.items()})
