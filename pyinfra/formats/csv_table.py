"""A CSV reader that keeps text as text: a LiDAR may be named `007`, `NA`, `1e5` or `null`."""

from __future__ import annotations

import csv
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import FormatError

# Names of text columns in the tables that this project writes; all other columns are numbers.
WORDS = frozenset(
    (
        "scene lidar preset detector tier run stressor dial unit ground_truth measure world "
        "label_time road set quality aggregation detail source what claim statement verdict "
        "dominated_by pareto model class protocol place minus "
        "price_source price_date inputs recipe findings reason command commit version "
        "frames_version "
        "latency_version latency_machine machine"
    ).split()
)


def read_csv(file: Path, words: Collection[str] = WORDS) -> pd.DataFrame:
    """Reads a table: the columns `words` as text, the others as numbers, empty cells as NaN.

    Raises FileNotFoundError, and FormatError with file, line and column.
    """
    table = read_words(file)
    columns = {
        name: column.where(column != "", np.nan) if name in words else numbers(file, column)
        for name, column in table.items()
    }
    return pd.DataFrame(columns, index=table.index, columns=table.columns)


def read_words(file: Path) -> pd.DataFrame:
    """Reads all cells as text. Raises FileNotFoundError, and FormatError with file and line."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as stream:  # spreadsheets write a BOM
            rows = list(csv.reader(stream, strict=True))
    except (csv.Error, UnicodeDecodeError) as error:
        raise FormatError(f"{file}: is no table: {error}") from None
    header = rows[0] if rows else []
    for line, row in enumerate(rows, start=1):
        if len(row) != len(header) or not row:
            raise FormatError(f"{file}:{line}: expected {len(header)} columns, got {len(row)}")
    twice = [name for i, name in enumerate(header) if name in header[:i]]
    if twice or not rows:
        got = f"column {twice[0]} twice" if twice else "none"
        raise FormatError(f"{file}:1: expected columns, each once, got {got}")
    return pd.DataFrame(rows[1:], columns=header, dtype=str)


def numbers(file: Path, column: pd.Series) -> pd.Series:
    """Converts a text column to numbers; empty cells and `nan` become NaN. Raises FormatError."""
    values = pd.to_numeric(column.where(column != "", "nan"), errors="coerce")
    empty = values.isna()
    wrong = empty & (column != "") & (column.str.lower() != "nan") if empty.any() else empty
    if wrong.any():
        row = wrong.idxmax()
        raise FormatError(
            f"{file}:{row + 2}: {column.name}: expected a number or nothing, got '{column[row]}'"
        )
    return values
