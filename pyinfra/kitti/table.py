"""Rows of words and numbers whose errors name file, line and column."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from pyinfra.arrays import BoolArray, FloatArray, NameArray
from pyinfra.kitti.layout import FormatError

MOST_RADIANS = 2 * math.pi + 0.01  # rounded; an angle beyond it is in degrees
RADIANS = "-2 pi to 2 pi, in radians"


def lines_of(file: Path) -> list[str]:
    """Lines without the byte order mark of spreadsheet programs.

    Raises FormatError if the text is not UTF-8.
    """
    try:
        return file.read_bytes().decode().removeprefix("\ufeff").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{file}: found byte {error.start} that is not UTF-8") from None


class NamedRows:
    """Rows of numbers with one column of names; errors name file, line and column.

    lines: where the rows stand in the file.
    """

    def __init__(
        self,
        file: Path,
        lines: Sequence[int],
        rows: Sequence[Sequence[str]],
        columns: Sequence[str],
        name_column: str,
    ) -> None:
        self.file, self.lines = file, lines
        self.columns = [c for c in columns if c != name_column]
        at = columns.index(name_column)
        for i, row in enumerate(rows):
            if len(row) != len(columns):
                self._fail(i, f"found {len(row)} columns", f"{len(columns)}: {' '.join(columns)}")
            if not row[at]:
                self._fail(i, f"{name_column}: found nothing", "a name")
        self.names: NameArray = np.array([row[at] for row in rows], dtype=np.str_)
        cells = [[*row[:at], *row[at + 1 :]] for row in rows]
        try:
            values = np.array(cells, dtype=np.float64).reshape(len(rows), len(self.columns))
        except ValueError:
            self._fail_at_word(cells)
        self.values: FloatArray = values
        self.check(self.columns, np.isfinite, "a finite number")

    def __getitem__(self, column: str) -> FloatArray:
        return self.values[:, self.columns.index(column)]

    def check(
        self, columns: Sequence[str], ok: Callable[[FloatArray], BoolArray], rule: str
    ) -> None:
        for column in columns:
            bad = np.flatnonzero(~ok(self[column]))
            if len(bad) > 0:
                self._fail(int(bad[0]), f"{column}: found {self[column][bad[0]]:g}", rule)

    def _fail(self, row: int, found: str, allowed: str) -> NoReturn:
        raise FormatError(f"{self.file}:{self.lines[row]}: {found}, allowed {allowed}")

    def _fail_at_word(self, cells: Sequence[Sequence[str]]) -> NoReturn:
        for i, row in enumerate(cells):
            for column, cell in zip(self.columns, row, strict=True):
                try:
                    float(cell)
                except ValueError:
                    self._fail(i, f"{column}: found '{cell}'", "a number")
        raise AssertionError(cells)
