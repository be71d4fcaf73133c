"""Compares the verdicts of version 0.4 with those of the present version.

results/0.4/ has the verdicts of version 0.4, on frames with `frames_version` 3.
"""

import math
from collections.abc import Callable
from functools import partial

import pandas as pd

from pyinfra.core.vocabulary import PRESETS
from reproduction.claims.two_detectors import PRIMARY, TOO_FEW
from reproduction.commands.experiments import at_catalogue_law
from reproduction.frames_number import common_number, number_of, sentence
from reproduction.tables import verdicts
from reproduction.tables.common import (
    Rows,
    results,
    with_heads,
    with_interval,
)
from reproduction.tables.findings import OF_SCANNING, rows_of

BEFORE, NOW = "0.4", "0.5"
KEY = ["claim", "scene", "preset", "training", "detector", "subset"]
COLUMNS = ["value", "low", "high", "verdict"]


def of_detection() -> pd.DataFrame:
    """Returns the verdicts of single detectors in both versions: `KEY` and `COLUMNS` of each.

    The detectors are those that decide. Verdicts that one of the versions does not have are left
    out.
    """
    now = at_catalogue_law(results("claims")).drop(columns="law_exponent")
    tables = []
    for table in (results(f"{BEFORE}/claims"), now):
        decides = pd.MultiIndex.from_frame(table[["training", "detector"]]).isin(PRIMARY)
        measured = decides & (table.label_time == "scan") & (table.verdict != TOO_FEW)
        tables.append(table[measured][KEY + COLUMNS])
    before, now = tables
    return now.merge(before, on=KEY, suffixes=("", "_before"))


def of_scanning() -> pd.DataFrame:
    """Returns the verdicts on the claims about scanning in both versions."""
    before, now = (
        table.assign(statement=table.statement.str.replace(" less ", " minus "))
        for table in (results(f"{BEFORE}/scanning_claims"), results("scanning_claims"))
    )
    key = ["preset", "claim", "statement"]
    both = now.merge(before[[*key, *COLUMNS]], on=key, suffixes=("", "_before"))
    if len(both) != len(now):
        raise ValueError(f"expected {len(now)} scanning claims in both versions, got {len(both)}")
    return both


def difference_is_clear(row: pd.Series) -> bool:
    """Returns True if the values of two versions differ significantly.

    The interval of the difference has the confidence level of both intervals. The traffic and the
    trainings of the versions are independent.
    """
    widths = (row.high - row.low, row.high_before - row.low_before)
    return bool(abs(row.value - row.value_before) > math.hypot(*widths) / 2)


def with_frames_of_both(make: Callable[[], str]) -> Callable[[], str]:
    """Returns a function that makes a table, and names below it the frames of both versions."""

    def text() -> str:
        numbers = []
        for folder in (f"{BEFORE}/", ""):
            names = (f"{folder}claims", f"{folder}scanning_claims")
            numbers.append(common_number({name: number_of(results(name), name) for name in names}))
        return f"{make()}\n{sentence(*numbers)}\n"

    return text


def counts_of(table: pd.DataFrame) -> tuple[int, int, int, int]:
    """Returns the numbers of verdicts, changed verdicts, reversed verdicts and changed values.

    A reversed verdict was `holds` and is `fails`, or the other way round.
    """
    changed = changed_verdicts(table)
    reversed_ones = sum(
        {verdict.split()[0].strip(",") for verdict in pair} == {"holds", "fails"}
        for pair in zip(changed.verdict, changed.verdict_before, strict=True)
    )
    values = sum(difference_is_clear(row) for _, row in table.iterrows())
    return len(table), len(changed), reversed_ones, values


@with_frames_of_both
@with_heads(
    "claims about",
    "verdicts in both versions",
    "changed",
    "`holds` became `fails`, or the reverse",
    "value differs",
)
def counts() -> Rows:
    """Returns how many verdicts and values differ between the versions."""
    for name, table in (("detection", of_detection()), ("scanning", of_scanning())):
        yield [name, *map(str, counts_of(table))]


def answer() -> str:
    """Returns the numbers of changed verdicts as sentences."""
    return f"{_sentences('detection', of_detection())} {_sentences('scanning', of_scanning())}"


def _sentences(subject: str, table: pd.DataFrame) -> str:
    every, changed, reversed_ones, values = (number or "none" for number in counts_of(table))
    return (
        f"Of the {every} verdicts on {subject}, {changed} changed, and {reversed_ones} changed "
        f"from `holds` to `fails` or the reverse. Of the {every} values, {values} changed "
        "significantly."
    )


def changed_verdicts(table: pd.DataFrame) -> pd.DataFrame:
    return table[table.verdict != table.verdict_before]


@with_frames_of_both
@with_heads("claim", "scene", "preset", "detector", "vehicles", BEFORE, NOW, "value differs")
def detection() -> Rows:
    """Returns the verdicts on detection that changed."""
    for _, row in changed_verdicts(of_detection()).iterrows():
        where = [row.scene, row.preset, verdicts.TRAININGS[row["training"]], f"`{row.subset}`"]
        yield [f"`{row.claim}`", *where, *_cells(row, partial(verdicts.with_interval, row.claim))]


@with_frames_of_both
@with_heads("claim", "vehicles, distance", "preset", BEFORE, NOW, "value differs")
def scanning() -> Rows:
    """Returns the verdicts on scanning that changed."""
    table = changed_verdicts(of_scanning())
    for claim, words, statement, where in OF_SCANNING:
        for preset in PRESETS:
            for _, row in rows_of(table, claim, words, preset=preset).iterrows():
                yield [statement or f"`{claim}`", where, preset, *_cells(row, with_interval)]


def _cells(row: pd.Series, form: Callable[[float, float, float], str]) -> list[str]:
    """Returns the value and verdict of both versions, and whether the values differ."""
    before, now = (
        f"{form(*row[[value + end, low + end, high + end]])} {row[verdict + end]}"
        for end in ("_before", "")
        for value, low, high, verdict in [COLUMNS]
    )
    return [before, now, "yes" if difference_is_clear(row) else "no"]
