"""Text tables of words and numbers. Errors name file, line and column."""

import csv
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, NameArray
from pyinfra.core.errors import FormatError

# Angles above this limit cannot be in radians. The 0.01 allows for rounding.
MOST_RADIANS = 2 * math.pi + 0.01
RADIANS = "-2 pi to 2 pi, in radians"


@dataclass(frozen=True)
class ColumnRule:
    """The allowed values of each of the named columns."""

    columns: tuple[str, ...]
    # Called with a column (n,) and the columns in `beside`. Returns a mask (n,) of allowed values.
    holds: Callable[..., BoolArray]
    allowed: str  # description of the allowed values, for messages
    beside: tuple[str, ...] = ()  # other columns that the rule depends on


def between(columns: Sequence[str], low: float, high: float, *, whole: bool = False) -> ColumnRule:
    """Returns a rule that allows numbers from low to high."""

    def holds(v: FloatArray) -> BoolArray:
        inside = (v >= low) & (v <= high)
        return np.asarray(inside & (v == np.floor(v)) if whole else inside)

    kind = "a whole number from " if whole else ""
    return ColumnRule(tuple(columns), holds, f"{kind}{low:.10g} to {high:.10g}")


def violations(
    column: Callable[[str], FloatArray], rules: Sequence[ColumnRule]
) -> Iterator[tuple[str, str, BoolArray]]:
    """Yields each column of each rule, its allowed values, and a mask (n,) of rows that violate it.

    column: returns the values (n,) of the column with a name.
    """
    for rule in rules:
        for name in rule.columns:
            yield name, rule.allowed, ~rule.holds(column(name), *map(column, rule.beside))


def columns_of(values: FloatArray, names: Sequence[str]) -> Callable[[str], FloatArray]:
    """Returns a function that maps a name to the column (n,) of `values` (n, columns)."""
    by_name = dict(zip(names, values.T, strict=False))
    return by_name.__getitem__


def rules_hold(values: FloatArray, names: Sequence[str], rules: Sequence[ColumnRule]) -> bool:
    """Returns whether the rows (n, columns) satisfy all rules."""
    return not any(wrong.any() for _, _, wrong in violations(columns_of(values, names), rules))


def lines_of(file: Path, *, whole: bool = False) -> list[str]:
    """Returns the lines of a text file, without a byte order mark.

    With `whole`, the last line must end with a newline, because otherwise the file was truncated.
    Raises FormatError if the text is truncated or not UTF-8.
    """
    data = file.read_bytes()
    try:
        lines = data.decode().removeprefix("\ufeff").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(
            f"{file}: expected UTF-8, got an invalid byte at offset {error.start}"
        ) from None
    if whole and not is_whole(data):
        raise FormatError(
            f"{file}:{len(lines)}: expected a newline at the end of the last line, got none; the "
            "file may be truncated"
        )
    return lines


def is_whole(data: bytes) -> bool:
    """Returns whether a text is empty or ends with a newline."""
    return not data or data.endswith(b"\n")


class NumberRows:
    """Rows of numbers. Errors name file, line and column.

    `lines` contains the line number of each row in the file.
    """

    def __init__(
        self, file: Path, lines: Sequence[int], cells: Sequence[Sequence[str]], columns: list[str]
    ) -> None:
        self.file, self.lines, self.columns = file, lines, columns
        try:
            values = np.array(cells, dtype=np.float64).reshape(len(cells), len(columns))
        except ValueError:
            self._fail_at_word(cells)
        self.values: FloatArray = values
        self.check([ColumnRule(tuple(columns), np.isfinite, "a finite number")])

    def __getitem__(self, column: str) -> FloatArray:
        return self.values[:, self.columns.index(column)]

    def check(self, rules: Sequence[ColumnRule], rows: BoolArray | None = None) -> None:
        """Raises FormatError if a value violates a rule.

        `rows` is a mask (n,) of the rows to check. By default all rows are checked.
        """
        for column, allowed, wrong in violations(self.__getitem__, rules):
            bad = np.flatnonzero(wrong if rows is None else wrong & rows)
            if len(bad) > 0:
                self.fail(int(bad[0]), f"{self[column][bad[0]]:g}", allowed, column)

    def fail(self, row: int, got: str, allowed: str, column: str = "") -> NoReturn:
        at = f"{self.file}:{self.lines[row]}: {column}{': ' * bool(column)}"
        raise FormatError(f"{at}expected {allowed}, got {got}")

    def _fail_at_word(self, cells: Sequence[Sequence[str]]) -> NoReturn:
        for i, row in enumerate(cells):
            for column, cell in zip(self.columns, row, strict=True):
                try:
                    float(cell)
                except ValueError:
                    self.fail(i, f"'{cell}'", "a number", column)
        raise AssertionError(cells)


class NamedRows(NumberRows):
    """Rows of numbers with one column of names."""

    def __init__(
        self,
        file: Path,
        lines: Sequence[int],
        rows: Sequence[Sequence[str]],
        columns: Sequence[str],
        name_column: str,
    ) -> None:
        self.file, self.lines = file, lines
        at = columns.index(name_column)
        for i, row in enumerate(rows):
            if len(row) != len(columns):
                self.fail(i, f"{len(row)}", f"{len(columns)} columns ({' '.join(columns)})")
            if not row[at]:
                self.fail(i, "an empty cell", "a name", name_column)
        self.names: NameArray = np.array([row[at] for row in rows], dtype=np.str_)
        cells = [[*row[:at], *row[at + 1 :]] for row in rows]
        super().__init__(file, lines, cells, [c for c in columns if c != name_column])


def rows_by_name(
    lines: Sequence[str], file: Path, columns: Sequence[str], rules: Sequence[ColumnRule]
) -> dict[str, FloatArray]:
    """Parses a CSV table. Maps each name in the first column to its rows (n, columns - 1).

    The first line names the columns. Raises FormatError, also for a table without rows.
    """
    try:
        rows = list(csv.reader(lines))
    except csv.Error as error:
        raise FormatError(f"{file}: {error}") from None
    if not rows or rows[0] != list(columns):
        header = ",".join(rows[0]) if rows else ""
        raise FormatError(f"{file}:1: expected the header '{','.join(columns)}', got '{header}'")
    table = NamedRows(file, range(2, 1 + len(rows)), rows[1:], columns, columns[0])
    table.check(rules)
    if len(rows) == 1:
        raise FormatError(f"{file}:1: expected one or more rows with a {columns[0]}, got none")
    return {name: table.values[table.names == name] for name in dict.fromkeys(table.names.tolist())}
