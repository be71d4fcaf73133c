"""Names, number formats and rows for all tables."""

import functools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple
from typing import Any, ParamSpec

import pandas as pd

from pyinfra.metrics.comparison import Interval, over_replicates
from reproduction import ROOT
from reproduction.frames_number import common_number, number_of, sentence

LEAST_SEEDS = 3  # minimum number of seeds or replicates from which an interval is shown
LEAST_BOXES = 10  # minimum number of boxes from which a site's precision is computed
DETECTORS = {
    "background": "Background",
    "pointpillars": "PointPillars",
    "centerpoint-pillar": "CenterPoint-Pillar",
    "pv-rcnn": "PV-RCNN",
    "dsvt": "DSVT",
    "pointrcnn-remedied": "PointRCNN, remedied",
    "pointrcnn": "PointRCNN",
}
LIDARS = {
    "ruby_plus": "Ruby Plus",
    "livox_avia": "Avia",
    "pandar_64": "Pandar64",
    "helios_16": "Helios 16",
}

Rows = Iterator[Sequence[str]]
P = ParamSpec("P")  # arguments of a function that makes a table

# Tables of results whose values do not depend on simulated frames.
WITHOUT_FRAMES = frozenset(("evaluation", "impossible_sites", "lidars", "ops", "steps"))
_used: set[str] = set()  # tables of results that were read since `with_frames` began


def results(name: str) -> pd.DataFrame:
    _used.add(name)
    return _read(name)


@functools.cache
def _read(name: str) -> pd.DataFrame:
    return pd.read_csv(ROOT / "results" / f"{name}.csv")


def rows_with(table: pd.DataFrame, **values: object) -> pd.DataFrame:
    """Returns the rows of a table that have these values in their columns."""
    for column, value in values.items():
        table = table[table[column] == value]
    return table


def with_frames(make: Callable[[], str]) -> str:
    """Returns a table, followed by a sentence that names its `frames_version`.

    Raises Error if the table is made from results with different values of `frames_version`.
    """
    _used.clear()
    text = make()
    numbers = {
        f"results/{name}.csv": number_of(_read(name), f"results/{name}.csv")
        for name in _used - WITHOUT_FRAMES
    }
    return f"{text}\n{sentence(common_number(numbers))}\n"


def frames_of_results() -> str:
    """Returns the sentence on the `frames_version` of all results, or a table of the versions."""
    names: dict[int, list[str]] = {}
    for file in sorted((ROOT / "results").glob("*.csv")):
        if file.stem not in WITHOUT_FRAMES:
            names.setdefault(number_of(_read(file.stem), file.name), []).append(f"`{file.stem}`")
    if len(names) == 1:
        return f"{sentence(*names)}\n"
    rows = ([sentence(number), ", ".join(some)] for number, some in sorted(names.items()))
    return markdown(["frames", "tables of `results/`"], rows)


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a Markdown table.

    Raises ValueError if a cell is not a number (NaN); a cell without a value is empty.
    """
    lines = [f"| {' | '.join(cells)} |\n" for cells in (heads, *rows)]
    if missing := next((line for line in lines if re.search(r"\bnan\b", line)), None):
        raise ValueError(f"expected a value in each cell of a table, got the row {missing.strip()}")
    return "".join([lines[0], "|" + "---|" * len(heads) + "\n", *lines[1:]])


def with_heads(*heads: str) -> Callable[[Callable[P, Rows]], Callable[P, str]]:
    """Decorates a function that yields the rows of a table; it then returns the Markdown table."""

    def decorated(rows: Callable[P, Rows]) -> Callable[P, str]:
        @functools.wraps(rows)
        def table(*args: P.args, **kwargs: P.kwargs) -> str:
            return markdown(heads, rows(*args, **kwargs))

        return table

    return decorated


# Maps the head of a column to a template of its cells, such as `{objects:,}`, or to a function that
# takes a row and returns a cell.
Columns = Mapping[str, str | Callable[[Any], str]]


def of_rows(rows: pd.DataFrame, columns: Columns) -> str:
    """Returns a Markdown table with a line for each row."""
    lines = (
        [cell.format_map(row) if isinstance(cell, str) else cell(row) for cell in columns.values()]
        for row in rows.to_dict("records")
    )
    return markdown(list(columns), lines)


def number(value: float) -> str:
    """Formats a number with two decimals if it is below 1, otherwise with one decimal."""
    return f"{value:.2f}" if abs(value) < 1 else f"{value:.1f}"


def with_interval(value: float, low: float, high: float) -> str:
    if value == low == high:
        return f"{value:g}"
    digits = 1 if abs(value) >= 10 else 3
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def interval(values: pd.Series) -> Interval:
    """Returns the mean over seeds with its 95 % interval; NaN as ends if there are too few."""
    known = values.dropna().to_list()
    mean = over_replicates(known)
    return mean if len(known) >= LEAST_SEEDS else Interval(mean.value, math.nan, math.nan)


def mean_of_ap(values: pd.Series) -> str:
    """Formats the mean AP over seeds or replicates, with a 95 % interval if there are enough."""
    return with_interval_of_ap(*astuple(interval(values)))


def with_interval_of_ap(value: float, low: float, high: float) -> str:
    return tenth(value) if math.isnan(low) else f"{tenth(value)} [{low:.1f}, {high:.1f}]"


def tenth(value: float) -> str:
    """Formats a number with one decimal, without the sign of a rounded 0."""
    return f"{round(value, 1) + 0.0:.1f}"


def signed(mean: Interval) -> str:
    """Formats a difference with its interval."""
    if math.isnan(mean.low):
        return f"{mean.value:+.1f}"
    return f"{mean.value:+.1f} [{mean.low:+.1f}, {mean.high:+.1f}]"


def ends(row: Mapping[str, Any] | pd.Series, name: str) -> list[float]:
    return [float(row[column]) for column in (name, f"{name}_low", f"{name}_high")]
