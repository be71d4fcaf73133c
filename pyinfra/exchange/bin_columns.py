"""Detects the number of float32 columns of .bin clouds, which the files do not state.

The first three columns are x y z, and the fourth is usually intensity. The sizes of all files
restrict the possible numbers of columns. The values of some files decide between the possible
numbers. Values within a column are similar, and values of different columns are not. Therefore the
right number of columns explains most of the variance. An intensity is never negative.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, unchecked
from pyinfra.exchange.recording import Options

USUAL = 4
TRIED = (4, 5, 6, 3)  # possible numbers of columns
FILES = 30  # maximum number of files whose values are read, evenly distributed
MOST_FILES = 0.9  # minimum share of files with a whole number of rows; others may be truncated
VALUES = 60 * 1000  # number of values read per file, a multiple of all numbers in TRIED
MOST = 1e7  # largest plausible coordinate: 10 km in millimetres
# Two numbers of columns are distinguished if their shares of explained variance differ by more than
# CLEARLY + FEWER / sqrt(number of values).
CLEARLY = 0.1
FEWER = 2.0
FEW = 200  # number of values below which no minimum explained variance is required


@unchecked
def columns_of(files: Sequence[Path], options: Options) -> tuple[int, str]:
    """Returns the number of float32 values per point in .bin files, and a note on the assumption.

    The note is empty if no assumption was needed. If no number fits, the function returns the usual
    number, and the reader raises an error that names the file. Raises OSError for an unreadable
    file.
    """
    if options.columns is not None:
        note = (
            "points of .bin files have no intensity: intensities are set to 0"
            if options.columns == 3
            else ""
        )
        return options.columns, note
    sizes = [file.stat().st_size for file in files]
    counts = {n: sum(size % (4 * n) == 0 for size in sizes) for n in TRIED}
    most = max(counts.values())  # less than the number of files if some files are truncated
    fit = [n for n in TRIED if counts[n] == most and most >= MOST_FILES * len(files)]
    if not any(sizes) or fit == [USUAL] or not fit:
        return USUAL, ""
    least = 4 * math.lcm(*fit)
    chosen = [
        file for file, size in zip(files, sizes, strict=True) if size > 0 and size % least == 0
    ]
    if not chosen:
        return USUAL, ""
    step = -(-len(chosen) // FILES)
    values = [np.fromfile(file, dtype="<f4", count=VALUES) for file in chosen[::step]]
    columns = _chosen(np.concatenate(values).astype(np.float64), fit)
    if columns is None:
        return USUAL, ""
    other_fits = " and ".join(str(n) for n in sorted(fit) if n != columns)
    why = f"because the points' values exclude {other_fits}"
    if columns == USUAL:
        why = f"the usual number; the file sizes also allow {other_fits}"
    elif not other_fits:
        why = "the only number that fits"
    zero = "; intensities are set to 0" if columns == 3 else ""
    note = f"a point of a .bin file has {columns} float32 values, {why}{zero}"
    return columns, f"{note}; the argument `columns` sets another number"


def _chosen(values: FloatArray, fit: Sequence[int]) -> int | None:
    """Returns the most likely number of columns, or None if the values fit none."""
    likely = [n for n in fit if _is_likely(values, n)]
    shares = {n: explained(values, n) for n in likely or fit}
    few = len(values) < FEW
    if (few and not likely) or (not few and max(shares.values(), default=0) < CLEARLY):
        return None
    clearly = CLEARLY + FEWER / np.sqrt(len(values))
    near = [n for n in sorted(shares) if shares[n] > max(shares.values()) - clearly]
    return USUAL if USUAL in near else next(iter(near), None)


def _is_likely(values: FloatArray, columns: int) -> bool:
    rows = values.reshape(-1, columns)
    near = np.abs(rows[:, :3][np.isfinite(rows[:, :3])]) <= MOST
    return bool(near.all() and (columns == 3 or not (rows[:, 3] < 0).any()))


def explained(values: FloatArray, columns: int) -> float:
    """Returns the share of the variance between columns; about 0 if the columns are similar.

    values: (n,) values of several files, where n is a multiple of `columns`.
    """
    size = np.log1p(np.abs(np.where(np.isfinite(values), values, 0)))
    is_whole = (values == np.floor(values)).astype(np.float64)
    shares = []
    for feature in (size, is_whole, np.sign(np.nan_to_num(values))):
        rows = feature.reshape(-1, columns)
        total = rows.var()
        shares.append(0.0 if total == 0 else float(rows.mean(axis=0).var() / total))
    by_chance = min(1.0, (columns - 1) / max(1, len(values) - 1))
    return (max(shares) - by_chance) / (1 - by_chance) if by_chance < 1 else 0.0
