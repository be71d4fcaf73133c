"""Tables of experiments that resume: rows are added whole, by several processes.

The benchmark and the stress test stand on it: an experiment with a row is done (`fill`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd
from pandas.api.types import is_string_dtype

from pyinfra.core.files import held, replacing
from pyinfra.formats.csv_table import WORDS, read_csv


def read(file: Path, words: Sequence[str] = ()) -> pd.DataFrame:
    """The table, empty if there is none; `words` are columns of text beside those of WORDS."""
    return read_csv(file, WORDS.union(words)) if file.is_file() else pd.DataFrame()


def put(file: Path, rows: pd.DataFrame, key: Sequence[str]) -> None:
    """Adds rows; those of the table with the same key go."""
    if rows.empty:
        return
    words = [name for name in rows if is_string_dtype(rows[name])]
    with held(lock(file), wait=True):
        kept = without(read(file, words), rows, key)
        write(file, pd.concat([t for t in (kept, rows) if len(t)], ignore_index=True))


def drop(file: Path, rows: pd.DataFrame, key: Sequence[str]) -> None:
    """Takes out the rows with the same key."""
    with held(lock(file), wait=True):
        write(file, without(read(file), rows, key))


def lock(file: Path) -> Path:
    """Beside the tables, so that all who write them meet there."""
    return file.parent / "locks/tables"


def write(file: Path, table: pd.DataFrame, digits: int = 6) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as beside:
        table.to_csv(beside, index=False, float_format=f"%.{digits}g")


def without(table: pd.DataFrame, rows: pd.DataFrame, key: Sequence[str]) -> pd.DataFrame:
    return table[~among(table, rows, key)] if len(table) else table


def among(table: pd.DataFrame, rows: pd.DataFrame, key: Sequence[str]) -> pd.Series:
    """Which rows of the table have the key of one of the rows."""
    wanted = pd.MultiIndex.from_frame(rows[list(key)].astype(str))
    mask = pd.MultiIndex.from_frame(table[list(key)].astype(str)).isin(wanted)
    return pd.Series(mask, index=table.index)


def fill(lock: Path, is_done: Callable[[], bool], run: Callable[[], None]) -> bool:
    """Runs an experiment that is not done, unless another process is at it; whether it ran."""
    with held(lock, wait=False) as ours:
        if not ours or is_done():
            return False
        run()
    return True


def has(table: pd.DataFrame, key: Mapping[str, object]) -> bool:
    return has_each(table, [key])[0]


def has_each(table: pd.DataFrame, keys: Sequence[Mapping[str, object]]) -> list[bool]:
    """Of each key whether the table has a row with it; all keys have the same columns."""
    if table.empty or not keys:
        return [False] * len(keys)
    wanted = pd.DataFrame(keys)
    present: list[bool] = among(wanted, table, list(wanted)).to_list()
    return present
