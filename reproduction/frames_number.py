"""The version of the frames from which recorded tables were measured (`frames_version`)."""

import pandas as pd

from pyinfra.core.errors import Error

COLUMN = "frames_version"
FIRST = 3  # frames_version of rows in tables without the column
VERSIONS = {3: "0.4", 4: "0.5"}  # last version of the package with each frames_version


def number_of(table: pd.DataFrame, name: str) -> int:
    """Returns the `frames_version` of the frames from which all rows of a table were measured.

    name: name of the table in messages. Raises Error if rows have different values.
    """
    if COLUMN not in table:
        return FIRST
    numbers = sorted(set(pd.to_numeric(table[COLUMN]).fillna(FIRST).astype(int)))
    if len(numbers) > 1:
        listed = " and ".join(map(str, numbers))
        raise Error(
            f"{name}: {COLUMN}: expected the same value in all rows, got {listed}; measure the "
            f"rows with {COLUMN} {numbers[0]} again"
        )
    return numbers[0] if numbers else FIRST


def common_number(numbers: dict[str, int]) -> int:
    """Returns the `frames_version` that all tables share. numbers: by name of the table.

    Raises Error if the tables have different values.
    """
    if len(set(numbers.values())) > 1:
        each = ", ".join(f"{name} {number}" for name, number in sorted(numbers.items()))
        raise Error(
            f"{COLUMN}: expected the same value in all tables, got {each}; measure the older "
            "tables again"
        )
    return next(iter(numbers.values()), FIRST)


def sentence(*numbers: int) -> str:
    """Returns the sentence that names the values of `frames_version` of a table."""
    versions = [f"version {VERSIONS[number]} (`{COLUMN}` {number})" for number in numbers]
    return f"The frames are from simulator {' and '.join(versions)}."
