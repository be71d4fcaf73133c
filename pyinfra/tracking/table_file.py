"""Reads and writes tracks.csv."""

from collections.abc import Collection
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error, FormatError
from pyinfra.formats.csv_table import read_csv, write_csv

TRACK_COLUMNS = [
    "frame", "t_s", "id", "type", "x", "y", "z", "dx", "dy", "dz", "heading",
    "speed_m_s", "acceleration_m_s2", "vx_m_s", "vy_m_s",
    "x_var_m2", "y_var_m2", "xy_cov_m2", "speed_var_m2_s2",
    "score", "frames_seen", "frames_missed", "state",
]  # fmt: skip
SEEN, MISSED, HIDDEN = "seen", "missed", "hidden"  # values of `state`
NUMBER_FORMAT = "%.6g"  # format of all columns except times


def check_columns(table: pd.DataFrame, names: Collection[str], argument: str) -> None:
    """Raises Error, which names the argument, for a table without some of the columns."""
    if missing := [name for name in names if name not in table]:
        raise Error(f"{argument}: expected the columns {', '.join(missing)}, got none of them")


def write_tracks(file: Path, tracks: pd.DataFrame) -> None:
    """Writes a table that `pyinfra.track` returned."""
    write_csv(file, with_time_text(tracks), NUMBER_FORMAT)


def with_time_text(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a table with its times as text with microseconds, also for times since 1970."""
    times = table[[name for name in ("t_s", "start_s") if name in table]].astype(float)
    return table.assign(**times.map(lambda t: f"{t:.6f}".rstrip("0").rstrip(".")))


def read_tracks(file: Path) -> pd.DataFrame:
    """Reads tracks.csv. Raises FormatError with file, line and column."""
    table = read_csv(file, words=("type", "state"))
    missing = [name for name in TRACK_COLUMNS if name not in table]
    if missing:
        raise FormatError(f"{file}:1: expected the columns {', '.join(missing)}, got none of them")
    whole = ["frame", "id", "frames_seen", "frames_missed"]
    numbers = table.drop(columns=["type", "state"])
    for name, column in numbers.items():
        wrong = column.isna() | ((column % 1 != 0) if name in whole else False)
        if wrong.any():
            kind = "a whole number" if name in whole else "a number"
            row = int(wrong.to_numpy().argmax())
            got = f"{column[row]:g}".replace("nan", "an empty cell")
            raise FormatError(f"{file}:{row + 2}: {name}: expected {kind}, got {got}")
    if table.duplicated(["frame", "id"]).any():
        row = int(table.duplicated(["frame", "id"]).idxmax())
        got = f"track {table['id'][row]:g} twice in frame {table['frame'][row]:g}"
        raise FormatError(f"{file}:{row + 2}: expected each track once in a frame, got {got}")
    times = table[["frame", "t_s"]].drop_duplicates()
    twice = times.duplicated("frame") | times.duplicated("t_s")
    if twice.any():
        row = int(twice.idxmax())
        got = f"{table.t_s[row]:.6f} in frame {table['frame'][row]:g}"
        raise FormatError(
            f"{file}:{row + 2}: t_s: expected one time for each frame, different from the times of "
            f"other frames, got {got}"
        )
    return table.astype(dict.fromkeys(numbers, "float64") | dict.fromkeys(whole, "int64"))
