"""CSV tables of results, which several processes fill and from which a benchmark resumes.

The benchmark and the stress test use them. An experiment that has a row is finished and does not
run again (`fill`).
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import pandas as pd
from pandas.api.types import is_string_dtype

from pyinfra.core.files import held
from pyinfra.formats.csv_table import WORDS, read_csv, write_csv
from pyinfra.formats.earlier_names import existing

Key = TypeVar("Key")


def read(file: Path, words: Sequence[str] = ()) -> pd.DataFrame:
    """Returns the table of a file, empty if there is no file.

    words: text columns in addition to those of WORDS.
    """
    file = existing(file)
    return read_csv(file, WORDS.union(words)) if file.is_file() else pd.DataFrame()


def put(file: Path, rows: pd.DataFrame, key: Sequence[str]) -> None:
    """Adds rows to the table of a file. They replace rows with the same key."""
    if rows.empty:
        return
    words = [name for name in rows if is_string_dtype(rows[name])]
    with held(lock(file), wait=True):
        kept = without(read(file, words), rows, key)
        write_csv(file, pd.concat([t for t in (kept, rows) if len(t)], ignore_index=True))


def drop(file: Path, rows: pd.DataFrame, key: Sequence[str]) -> None:
    """Removes the rows of a file's table that have the key of one of `rows`."""
    with held(lock(file), wait=True):
        write_csv(file, without(read(file), rows, key))


def lock(file: Path) -> Path:
    """Returns the lock file of a folder's tables, which all writers share."""
    return file.parent / "locks/tables"


def without(table: pd.DataFrame, rows: pd.DataFrame, key: Sequence[str]) -> pd.DataFrame:
    return table[~among(table, rows, key)] if len(table) else table


def among(table: pd.DataFrame, rows: pd.DataFrame, key: Sequence[str]) -> pd.Series:
    """Returns a boolean for each row of `table`: whether it has the key of one of `rows`."""
    wanted = pd.MultiIndex.from_frame(rows[list(key)].astype(str))
    mask = pd.MultiIndex.from_frame(table[list(key)].astype(str)).isin(wanted)
    return pd.Series(mask, index=table.index)


def fill(lock: Path, is_done: Callable[[], bool], run: Callable[[], None]) -> bool:
    """Runs an experiment unless it is done or another process runs it; returns whether it ran."""
    with held(lock, wait=False) as ours:
        if not ours or is_done():
            return False
        run()
    return True


def has(table: pd.DataFrame, key: Mapping[str, object]) -> bool:
    return has_each(table, [key])[0]


def has_each(table: pd.DataFrame, keys: Sequence[Mapping[str, object]]) -> list[bool]:
    """Returns a boolean for each key: whether the table has a row with this key.

    All keys must have the same columns.
    """
    if table.empty or not keys:
        return [False] * len(keys)
    wanted = pd.DataFrame(keys)
    return list(among(wanted, table, list(wanted)))


def with_row(keys: Sequence[Key], table: pd.DataFrame, *, present: bool = True) -> list[Key]:
    """Returns the keys that have a row in the table or, if not `present`, those without a row.

    keys: objects of one class, whose attributes are the key of a row.
    """
    there = has_each(table, [vars(key) for key in keys])
    return [key for key, has_row in zip(keys, there, strict=True) if has_row == present]
