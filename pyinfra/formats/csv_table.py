"""A CSV reader that does not convert text columns, and the writer of tables.

The name of a LiDAR may therefore be `007`, `NA`, `1e5` or `null`.
"""

import csv
import re
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import FormatError
from pyinfra.core.files import replacing
from pyinfra.core.names import suggestion
from pyinfra.formats.earlier_names import current_name, with_current_values

# Names of the text columns in the tables of this project. All other columns are numbers.
WORDS = frozenset(
    (
        "scene lidar preset detector tier run stressor severity unit ground_truth measure "
        "vehicles_digest label_time road set quality aggregation detail source what claim "
        "statement verdict "
        "dominated_by pareto model class protocol place minus "
        "types price_source price_date inputs recipe findings reason command commit version "
        "frames_version learnt_frames_version "
        "latency_version latency_machine machine"
    ).split()
)


def plain_cell(text: str) -> str:
    """Returns the text with `_` for a first letter that makes spreadsheets run it as a formula."""
    return re.sub(r"^[=+@\t\r-]", "_", text)


def number_text(value: float, digits: int = 6) -> str:
    """Returns the text of a number: whole numbers exact, others to `digits` significant digits."""
    whole = float(value).is_integer() and abs(value) < 2**53
    return f"{value:.0f}" if whole else f"{value:.{digits}g}"


def write_csv(
    file: Path, table: pd.DataFrame, number_format: str | Callable[[float], str] = number_text
) -> None:
    """Writes a table, and makes the folder of the file if there is none."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as beside:
        table.to_csv(beside, index=False, float_format=number_format)


def write_tables(
    folder: Path,
    tables: Mapping[str, pd.DataFrame],
    number_format: str | Callable[[float], str] = number_text,
) -> list[Path]:
    """Writes NAME.csv of each table to a folder, and returns the files."""
    files = {name: folder / f"{name}.csv" for name in tables}
    for name, file in files.items():
        write_csv(file, tables[name], number_format)
    return list(files.values())


def rounded(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table of tracks, rounded to 3 decimals, and variances to 4 significant digits."""
    variances = [name for name in table if re.search(r"_(var|cov)_", str(name))]
    exact = table[variances].map(lambda value: float(f"{value:.4g}"))
    return table.round(3).assign(**exact)


def read_csv(
    file: Path, words: Collection[str] = WORDS, required: Collection[str] = ()
) -> pd.DataFrame:
    """Reads a table.

    The columns `words` are text. All other columns are numbers, with NaN for empty cells. Raises
    FileNotFoundError, and FormatError with file, line and column, also if a required column is
    missing.
    """
    table = read_words(file)
    for name in required:
        if name not in table:
            raise FormatError(
                f"{file}:1: expected the column {name}, got the columns {', '.join(table)}"
            )
    columns = {
        name: column.where(column != "", np.nan) if name in words else numbers(file, column)
        for name, column in table.items()
    }
    return pd.DataFrame(columns, index=table.index, columns=table.columns)


def check_columns(
    file: Path, table: pd.DataFrame, known: Collection[str], suggested: Collection[str] = ()
) -> None:
    """Raises FormatError for a column that is not in `known`. suggested: names for the message."""
    for name in table:
        if name not in known:
            near = suggestion(name, suggested or known)
            raise FormatError(
                f"{file}:1: expected columns of this table, got the column '{name}'{near}"
            )


def expect(file: Path, column: pd.Series, good: pd.Series, expected: str) -> None:
    """Raises FormatError for the first row in which the mask `good` of a column is False."""
    if not good.all():
        row = int(good.to_numpy(bool).argmin())
        value = column.iloc[row]
        shown = f"'{value}'" if isinstance(value, str) else f"{value:g}".replace("nan", "none")
        raise FormatError(f"{file}:{row + 2}: {column.name}: expected {expected}, got {shown}")


def read_words(file: Path, separator: str = ",") -> pd.DataFrame:
    """Reads all cells as text.

    Raises FileNotFoundError, and FormatError with file and line.
    """
    try:
        # This encoding skips the byte-order mark that spreadsheet programs write.
        with file.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.reader(stream, strict=True, delimiter=separator))
    except (csv.Error, UnicodeDecodeError) as error:
        raise FormatError(f"{file}: cannot be read as a table: {error}") from None
    header = rows[0] if rows else []
    if len(header) == 1 and separator == "," and ";" in header[0]:
        raise FormatError(f"{file}:1: expected commas between columns, got semicolons")
    for line, row in enumerate(rows, start=1):
        if len(row) != len(header) or not row:
            raise FormatError(f"{file}:{line}: expected {len(header)} columns, got {len(row)}")
    header = [current_name(name) for name in header]
    twice = [name for i, name in enumerate(header) if name in header[:i]]
    if twice or not rows:
        got = f"column {twice[0]} twice" if twice else "an empty file"
        raise FormatError(f"{file}:1: expected each column name once, got {got}")
    return with_current_values(pd.DataFrame(rows[1:], columns=header, dtype=str))


def numbers(file: Path, column: pd.Series) -> pd.Series:
    """Converts a text column to numbers; empty cells and `nan` become NaN. Raises FormatError."""
    values = pd.to_numeric(column.where(column != "", "nan"), errors="coerce")
    empty = values.isna()
    wrong = empty & (column != "") & (column.str.lower() != "nan") if empty.any() else empty
    if wrong.any():
        row = wrong.idxmax()
        comma = "; write it with a decimal point" if "," in column[row] else ""
        raise FormatError(
            f"{file}:{row + 2}: {column.name}: expected a number or an empty cell, "
            f"got '{column[row]}'{comma}"
        )
    return values
