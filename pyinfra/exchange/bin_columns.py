"""How many float32 a point has in .bin files, which say nothing of it: x y z, then intensity, ...

The sizes of all files leave some numbers, and the values of some files choose among these. Values
of one column are alike and those of different columns are not, so that the right number of columns
explains most of their variance. An intensity is nowhere below 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.exchange.recording import Options

USUAL = 4
TRIED = (4, 5, 6, 3)  # in the order of preference where values do not choose
FILES = 30  # whose values are looked at, spread over all
VALUES = 60 * 1000  # of each, a multiple of all that is tried
MOST = 1e7  # of a coordinate: 10 km in millimetres
CLEARLY = 0.1  # more of the variance explained than by another number of columns
FEWER = 2.0  # the same of few values, times the root of their number
FEW = 200  # values; of fewer nothing may be explained


def columns_of(files: Sequence[Path], options: Options, usual: int = USUAL) -> tuple[int, str]:
    """Float32 a point of some .bin files, and what was assumed; nothing of the usual ones.

    Raises OSError for a file that cannot be read. A number that fits no file is the usual one: the
    reader names what it does not fit.
    """
    if options.columns is not None:
        note = "points of .bin files have no intensity: taken as 0" if options.columns == 3 else ""
        return options.columns, note
    sizes = [file.stat().st_size for file in files]
    fit = [n for n in TRIED if all(size % (4 * n) == 0 for size in sizes)]
    if not any(sizes) or fit == [usual]:
        return usual, ""
    chosen = [file for file, size in zip(files, sizes, strict=True) if size > 0]
    step = -(-len(chosen) // FILES)
    values = [np.fromfile(file, dtype="<f4", count=VALUES) for file in chosen[::step]]
    columns = _chosen(np.concatenate(values).astype(np.float64), fit, usual)
    if columns is None:
        return usual, ""
    others = " and ".join(str(n) for n in sorted(fit) if n != columns)
    if columns == usual:
        why = f"as usual; {others} fit the sizes too"
    else:
        why = f"as the values rule out {others}" if others else "as no other number fits the sizes"
    zero = "; no intensity, taken as 0" if columns == 3 else ""
    note = f"points of .bin files are {columns} float32, {why}{zero}"
    return columns, f"{note}; `columns` of an import says another number"


def _chosen(values: FloatArray, fit: Sequence[int], usual: int) -> int | None:
    """None where the values are as of no number of columns."""
    likely = [n for n in fit if _is_likely(values, n)]
    shares = {n: explained(values, n) for n in likely or fit}
    few = len(values) < FEW
    if (few and not likely) or (not few and max(shares.values(), default=0) < CLEARLY):
        return None
    clearly = CLEARLY + FEWER / np.sqrt(len(values))
    near = [n for n in sorted(shares) if shares[n] > max(shares.values()) - clearly]
    return usual if usual in near else next(iter(near), None)


def _is_likely(values: FloatArray, columns: int) -> bool:
    rows = values.reshape(-1, columns)
    near = np.abs(rows[:, :3][np.isfinite(rows[:, :3])]) <= MOST
    return bool(near.all() and (columns == 3 or not (rows[:, 3] < 0).any()))


def explained(values: FloatArray, columns: int) -> float:
    """The share of the variance that lies between columns, about 0 where they are all alike."""
    size = np.log1p(np.abs(np.where(np.isfinite(values), values, 0)))
    whole = (values == np.floor(values)).astype(np.float64)
    shares = []
    for feature in (size, whole, np.sign(np.nan_to_num(values))):
        rows = feature.reshape(-1, columns)
        total = rows.var()
        shares.append(0.0 if total == 0 else float(rows.mean(axis=0).var() / total))
    by_chance = min(1.0, (columns - 1) / max(1, len(values) - 1))
    return (max(shares) - by_chance) / (1 - by_chance) if by_chance < 1 else 0.0
