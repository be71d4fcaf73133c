"""Reads predictions from CSV files with one line per box."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import IntArray
from pyinfra.core.errors import FormatError
from pyinfra.dataset.file_groups import fail_with_line, file_lines, numbers_of
from pyinfra.dataset.frame_tables import Predictions

CSV_COLUMNS = ("class", "x", "y", "z", "dx", "dy", "dz", "heading", "score")


def csv_predictions(files: Sequence[Path], frames: IntArray) -> Predictions:
    tables = [_csv_rows(file) for file in files]
    counts = [len(rows) for rows in tables]
    rows = list(itertools.chain.from_iterable(tables))
    values = numbers_of(rows, len(CSV_COLUMNS), 1)
    if values is None or (values[:, 3:6] <= 0).any():
        fail_with_line(files, _check_csv)
    return Predictions(
        frame=np.repeat(frames, counts),
        line=np.array([n + 2 for count in counts for n in range(count)], dtype=np.int64),
        names=np.array([row[0] for row in rows], dtype=np.str_),
        boxes=values[:, :7],
        scores=values[:, 7],
        angle=values[:, 6],
    )


def _csv_rows(file: Path) -> list[list[str]]:
    """Returns the cells of a CSV prediction file, without header, in the order of CSV_COLUMNS."""
    lines = file_lines([file])[0]
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        names = ", ".join(missing)
        raise FormatError(f"{file}:1: expected the columns {names}; got none of them")
    order = [header.index(name) for name in CSV_COLUMNS]
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        cells = line.split(",")
        if len(cells) != len(header):
            raise FormatError(f"{file}:{number}: expected {len(header)} columns, got {len(cells)}")
        rows.append([cells[at].strip() for at in order])
    return rows


def _check_csv(file: Path) -> None:
    for number, row in enumerate(_csv_rows(file), start=2):
        for name, cell in zip(CSV_COLUMNS[1:], row[1:], strict=True):
            rule = "more than 0" if name in ("dx", "dy", "dz") else "a finite number"
            value = _number(cell)
            if not math.isfinite(value) or (rule == "more than 0" and value <= 0):
                raise FormatError(f"{file}:{number}: {name}: expected {rule}, got '{cell}'")


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
