"""Reads predictions from CSV files with one line per box."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import IntArray
from pyinfra.core.errors import FormatError
from pyinfra.dataset.file_groups import fail_with_line, file_lines, numbers_of
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.formats.kitti.read import MOST_PREDICTIONS, result_rules
from pyinfra.formats.text_table import NamedRows, rules_hold

_RULES = result_rules(("dx", "dy", "dz"), ("x", "y", "z", "heading"))
CSV_COLUMNS = ("class", "x", "y", "z", "dx", "dy", "dz", "heading", "score")


def csv_predictions(files: Sequence[Path], frames: IntArray) -> Predictions:
    tables = [_csv_rows(file) for file in files]
    counts = [len(rows) for rows in tables]
    rows = list(itertools.chain.from_iterable(tables))
    values = numbers_of(rows, len(CSV_COLUMNS), 1)
    if values is None or not rules_hold(values, CSV_COLUMNS[1:], _RULES):
        fail_with_line(files, _check_csv)
    return Predictions(
        frame=np.repeat(frames, counts),
        line=np.array([n + 2 for count in counts for n in range(count)], dtype=np.int64),
        names=np.array([row[0] for row in rows], dtype=np.str_),
        boxes=values[:, :7],
        scores=values[:, 7],
        angle=values[:, 6],
    )


def check_counts(files: Sequence[Path], counts: Sequence[int]) -> None:
    """Raises FormatError for a frame with more than MOST_PREDICTIONS predictions."""
    for file, count in zip(files, counts, strict=True):
        if count > MOST_PREDICTIONS:
            raise FormatError(
                f"{file}: expected up to {MOST_PREDICTIONS} predictions in a frame, got {count}; "
                "keep those with the highest scores"
            )


def _csv_rows(file: Path) -> list[list[str]]:
    """Returns the cells of a CSV prediction file, without header, in the order of CSV_COLUMNS."""
    lines = file_lines([file])[0]
    check_counts([file], [len(lines) - 1])
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        raise FormatError(f"{file}:1: expected the columns {', '.join(missing)}; got none of them")
    order = [header.index(name) for name in CSV_COLUMNS]
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        cells = line.split(",")
        if len(cells) != len(header):
            raise FormatError(f"{file}:{number}: expected {len(header)} columns, got {len(cells)}")
        rows.append([cells[at].strip() for at in order])
    return rows


def _check_csv(file: Path) -> None:
    rows = _csv_rows(file)
    NamedRows(file, range(2, 2 + len(rows)), rows, CSV_COLUMNS, "class").check(_RULES)
