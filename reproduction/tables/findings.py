"""Makes the tables of the paper's claims about scanning."""

import pandas as pd

from pyinfra.core.vocabulary import PRESETS
from reproduction.tables.common import (
    LIDARS,
    Rows,
    markdown,
    number,
    results,
    rows_with,
    with_heads,
    with_interval,
)

# Claims about scanning. An entry has the paper's statement, the claim's name, and words that select
# the test by its statement.
SCANNING = (
    (
        "the Avia has about twice the points at long distance",
        "far-range",
        " common,",
        "within range of all",
    ),
    ("", "far-range", " view,", "all vehicles"),
    ("the Ruby Plus has more points at short distance", "near-range", "", ""),
    ("twice the lines, twice the points", "ratio", "ruby_plus over pandar_64", "128 / 64"),
    ("four times the lines, four times the points", "ratio", "pandar_64 over helios_16", "64 / 16"),
    ("the Avia's points decrease more slowly with distance", "gentle", "", "points"),
    ("motion moves points out of the box", "deskew", "", ""),
    ("only the Avia has points on some far vehicles", "only-one", "view,", "all vehicles"),
)
# Rows of the table about scanning. An entry has the claim's name, words of its statement, the row's
# label, and the subset and distance.
OF_SCANNING = (
    (
        *("far-range", " common,", "`far-range`: Avia / best other LiDAR, 1.5 to 2.5"),
        "common, 90 to 120 m (paper: to 100 m)",
    ),
    ("far-range", " view,", "", "view, 90 to 120 m"),
    ("near-range", "", "`near-range`: Ruby Plus / Avia, above 1", "common, 30 to 50 m"),
    ("ratio", "ruby_plus over pandar_64", "`ratio`: 128 / 64 lines, 1.6 to 2.4", "common"),
    ("ratio", "pandar_64 over helios_16", "`ratio`: 64 / 16 lines, 3.2 to 4.8", "common"),
    (
        "gentle",
        "",
        "`gentle`: smallest exponent of the others minus that of the Avia, above 0",
        "common",
    ),
    *(
        (
            "deskew",
            f"box of {name} ",
            f"`deskew`: {words}, change of points in the box, %",
            "common",
        )
        for name, words in LIDARS.items()
    ),
    (
        *(
            "only-one",
            " common,",
            "`only-one`: vehicles hit by the Avia alone minus those hit by others alone, per 100",
        ),
        "common, 90 to 120 m (paper: to 100 m)",
    ),
    ("only-one", " view,", "", "view, 90 to 120 m"),
)


def rows_of(table: pd.DataFrame, claim: str, words: str, **equal: str) -> pd.DataFrame:
    """Returns a claim's rows that have `words` in their statement and the given column values."""
    of_words = table[table.statement.str.contains(words, regex=False)]
    return rows_with(of_words, claim=claim, **equal)


def in_short() -> str:
    """Returns a table with the verdict of each claim about scanning under each preset."""
    rows = [
        [statement, named(claim, note), *(scanned(claim, words, preset) for preset in PRESETS)]
        for statement, claim, words, note in SCANNING
    ]
    return markdown(["statement of the paper", "claim", *(f"`{p}`" for p in PRESETS)], rows)


def named(claim: str, note: str) -> str:
    """Returns the name of a claim, followed by its subject."""
    if claim == "gentle":
        return f"`{claim}` ({note})"
    return f"`{claim}` {note}" if claim == "ratio" else f"`{claim}`" + (f", {note}" if note else "")


def scanned(claim: str, words: str, preset: str) -> str:
    rows = rows_of(results("scanning_claims"), claim, words, preset=preset)
    verdicts = sorted(set(rows.verdict))
    times = f" ({number(rows.value.iloc[0])} times)" if claim == "far-range" else ""
    of_lidars = ", by LiDAR" if len(verdicts) > 1 else ""
    return " or ".join(verdicts) + of_lidars + times


@with_heads("claim", "vehicles, distance", *PRESETS)
def scanning() -> Rows:
    """Returns a table with the value, interval and verdict of each claim about scanning."""
    for claim, words, statement, where in OF_SCANNING:
        cells = (scanned_row(claim, words, preset) for preset in PRESETS)
        yield [statement, where, *cells]


def scanned_row(claim: str, words: str, preset: str) -> str:
    selected = rows_of(results("scanning_claims"), claim, words, preset=preset)
    ((value, low, high, verdict),) = selected[["value", "low", "high", "verdict"]].itertuples(
        index=False
    )
    return f"{with_interval(value, low, high)} {verdict}"
