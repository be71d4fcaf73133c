"""The parts of a report section: plain values that the page's template shows.

Every text is escaped and shown literally. Only an `Embed` and the panels of a `Figure` are markup,
which only this package writes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import pandas as pd

from pyinfra.experiments.result_tables import TableFile

NOTHING = "\N{EN DASH}"


@dataclass(frozen=True)
class TableCell:
    """A cell of a table.

    sort: the sort key; None sorts by the text. origin: the table row with the value of the cell.
    verdict: holds, fails, undecided or empty. below: a second, smaller line.
    """

    text: str
    sort: float | None = None
    origin: str = ""
    verdict: str = ""
    below: str = ""

    @property
    def key(self) -> str:
        """The sort key in the page. The key of a missing number is empty, which sorts last."""
        if self.sort is None:
            return self.verdict or self.text
        return f"{self.sort:.10g}" if math.isfinite(self.sort) else ""


@dataclass(frozen=True)
class Column:
    """The head of a column; numbers are right-aligned."""

    title: str
    number: bool = False


@dataclass(frozen=True, eq=False)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True, eq=False)
class Remarks:
    """A list of remarks. If `closed`, a click opens it."""

    caption: str
    lines: Sequence[str]
    closed: bool = False


@dataclass(frozen=True, eq=False)
class Table:
    """A table that the reader can sort by any column. If `closed`, a click opens it."""

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[TableCell]]
    source: TableFile
    closed: bool = False

    def without_empty_columns(self) -> Table:
        """Returns the table without the columns that have no value in any row."""
        kept = [
            k == 0 or any(row[k].text not in ("", NOTHING) or row[k].verdict for row in self.rows)
            for k in range(len(self.columns))
        ]
        rows = [list(compress(row, kept)) for row in self.rows]
        return replace(self, columns=list(compress(self.columns, kept)), rows=rows)


@dataclass(frozen=True)
class LegendEntry:
    """A legend label and the markup of its line or patch."""

    label: str
    swatch: str


@dataclass(frozen=True)
class Panel:
    """One drawing of a figure: its title and its SVG markup."""

    title: str
    svg: str


@dataclass(frozen=True, eq=False)
class Figure:
    """Drawings under one caption, side by side if there is room.

    layout: small, half (two side by side) or wide. Wide drawings scroll on a narrow screen. plate:
    whether the drawings keep a light background in dark mode.
    """

    name: str
    caption: str
    panels: Sequence[Panel]
    source: TableFile | None = None
    legend: Sequence[LegendEntry] = ()
    layout: str = "small"
    plate: bool = False
    closed: bool = False


@dataclass(frozen=True)
class CardLine:
    """The answer for one scene: the choice and its reason."""

    place: str
    choice: str
    reason: str
    origin: str


@dataclass(frozen=True, eq=False)
class Card:
    """An answer to one question, for each scene."""

    question: str
    lines: Sequence[CardLine]


@dataclass(frozen=True, eq=False)
class Cards:
    """Cards shown side by side."""

    cards: Sequence[Card]
    source: TableFile


@dataclass(frozen=True, eq=False)
class Steps:
    """Processing steps in their order: the title and a description of each."""

    label: str
    steps: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Entry:
    """A row of an index: a label, and the prefix of the anchor that the row links to.

    needs: text for the reader on what the page must contain for the link to exist.
    """

    label: str
    anchor: str
    needs: str


@dataclass(frozen=True, eq=False)
class Index:
    """A list of links; the page looks up the anchors."""

    heads: tuple[str, str]
    entries: Sequence[Entry]


@dataclass(frozen=True, eq=False)
class Embed:
    """Markup made by another part of this package."""

    markup: str
    caption: str


Block = Text | Remarks | Table | Figure | Cards | Steps | Index | Embed


@dataclass(frozen=True, eq=False)
class Section:
    """A part of the page; `name` is its anchor."""

    name: str
    title: str
    lead: str
    blocks: Sequence[Block]


# Maps the title of a column to a function, which takes a row and returns a cell or its text.
Columns = Mapping[str, Callable[[Any], TableCell | str]]


def table_of(
    caption: str,
    rows: pd.DataFrame,
    columns: Columns,
    source: TableFile,
    *,
    closed: bool = False,
) -> Table:
    """Returns a table with a line for each row.

    A column whose cells have a sort key is a column of numbers.
    """
    lines = [[of(row) for of in columns.values()] for row in rows.itertuples()]
    cells = [[TableCell(c) if isinstance(c, str) else c for c in line] for line in lines]
    heads = [
        Column(title, number=any(line[k].sort is not None for line in cells))
        for k, title in enumerate(columns)
    ]
    return Table(caption, heads, cells, source, closed)


def number_in(column: str, form: str = ".1f") -> Callable[[Any], TableCell]:
    """Returns a function of a row, which returns a cell with the row's number in `column`."""
    return lambda row: number(float(getattr(row, column)), form, str(getattr(row, "origin", "")))


def number(value: float, form: str = ".1f", origin: str = "") -> TableCell:
    """Returns a cell with a number, or with a dash if it is not finite."""
    return TableCell(shown(value, form), value, origin)


def shown(value: float, form: str = ".1f") -> str:
    """Returns a number as text, or a dash if it is not finite."""
    return format(value, form) if math.isfinite(value) else NOTHING


def span(low: float, high: float, form: str = ".1f") -> str:
    """Returns an interval as text, or an empty text if an end is not finite."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return ""
    return f"[{low:{form}}, {high:{form}}]"
