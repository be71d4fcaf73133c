"""What a section of the report is made of: plain values, which the template of the page shows.

Every text is shown as it is, whatever characters it has; only `Embed` and the panels of a `Figure`
are markup, and they are made by this package.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pyinfra.experiments.result_tables import TableFile

NOTHING = "\N{EN DASH}"


@dataclass(frozen=True)
class TableCell:
    """A cell of a table.

    sort: what it is sorted by, the text itself if None; origin: the row it comes from;
    verdict: holds, fails, undecided or nothing; below: a second, smaller line.
    """

    text: str
    sort: float | None = None
    origin: str = ""
    verdict: str = ""
    below: str = ""

    @property
    def key(self) -> str:
        """What the page sorts by; numbers that are not there have none, which comes last."""
        if self.sort is None:
            return self.verdict or self.text
        return f"{self.sort:.10g}" if math.isfinite(self.sort) else ""


@dataclass(frozen=True)
class Column:
    """The head of a column; numbers stand at the right."""

    title: str
    number: bool = False


@dataclass(frozen=True, eq=False)
class Text:
    """A paragraph."""

    text: str
    kind = "text"


@dataclass(frozen=True, eq=False)
class Table:
    """A table that sorts by any column; `closed` ones open with a click."""

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[TableCell]]
    source: TableFile
    closed: bool = False
    kind = "table"


@dataclass(frozen=True)
class LegendEntry:
    """A name and the picture of its line or patch."""

    label: str
    swatch: str


@dataclass(frozen=True)
class Panel:
    """One drawing of a figure: its markup, and what it shows, in words."""

    title: str
    svg: str


@dataclass(frozen=True, eq=False)
class Figure:
    """Drawings under one caption, beside each other where there is room.

    layout: small, half (two beside each other) or wide; wide ones scroll on a narrow screen.
    plate: they have a light ground in the dark too.
    """

    name: str
    caption: str
    panels: Sequence[Panel]
    source: TableFile | None = None
    legend: Sequence[LegendEntry] = ()
    layout: str = "small"
    plate: bool = False
    closed: bool = False
    kind = "figure"


@dataclass(frozen=True)
class CardLine:
    """An answer for one scene: what to take, and why."""

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
    """Answers beside each other."""

    cards: Sequence[Card]
    source: TableFile
    kind = "cards"


@dataclass(frozen=True, eq=False)
class Steps:
    """Things that follow from one another."""

    label: str
    steps: Sequence[tuple[str, str]]
    kind = "steps"


@dataclass(frozen=True)
class Entry:
    """A row of an index: a label, the start of an anchor, and what the page needs to have it."""

    label: str
    anchor: str
    needs: str


@dataclass(frozen=True, eq=False)
class Index:
    """Where things are; the page looks up the anchors."""

    heads: tuple[str, str]
    entries: Sequence[Entry]
    kind = "index"


@dataclass(frozen=True, eq=False)
class Embed:
    """Markup of another part of this package."""

    markup: str
    caption: str
    kind = "embed"


Block = Text | Table | Figure | Cards | Steps | Index | Embed


@dataclass(frozen=True, eq=False)
class Section:
    """A part of the page, `name` being its anchor."""

    name: str
    title: str
    lead: str
    blocks: Sequence[Block]


def number(value: float, form: str = ".1f", origin: str = "") -> TableCell:
    """A number as a cell; nothing if there is none."""
    return TableCell(shown(value, form), value, origin)


def shown(value: float, form: str = ".1f") -> str:
    """A number as text; nothing if there is none."""
    return format(value, form) if math.isfinite(value) else NOTHING


def span(low: float, high: float, form: str = ".1f") -> str:
    """An interval as text; empty if there is none."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return ""
    return f"[{low:{form}}, {high:{form}}]"
