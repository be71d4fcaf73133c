"""The tables of a folder of results, as the report reads them.

A table that is not there is one without rows; a column that is needed and not there, or a number
that is none, is an error that names file, row and column.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.benchmark.value import SITE_ITEMS
from pyinfra.statistics.selection import CELL, first_seed
from pyinfra.training.sources import TIERS


@dataclass(frozen=True, eq=False)
class TableFile:
    """A CSV file beside the page: one of the results as it stands, or a table made from them."""

    name: str
    content: Path | pd.DataFrame


@dataclass(frozen=True)
class Kind:
    """The file of a table, {tier} standing for the tier, and the columns that are needed.

    later: numbers that tables of earlier versions lack; they are NaN there.
    """

    file: str
    texts: tuple[str, ...]
    numbers: tuple[str, ...]
    later: tuple[str, ...] = ()


def _kind(file: str, texts: str, numbers: str, later: str = "") -> Kind:
    return Kind(file, tuple(texts.split()), tuple(numbers.split()), tuple(later.split()))


_CELL = " ".join((*CELL, "seed"))
KINDS = {
    "cells": _kind(
        "{tier}.csv",
        f"{_CELL} command version",
        "ap ap_low ap_high ap_common ap_all objects train_seconds latency_p50_ms latency_p95_ms",
        "ap_all_low ap_all_high",
    ),
    "areas": _kind(
        "{tier}_areas.csv",
        f"{_CELL} ground_truth road",
        "n_tda n_hqda p_hqda p_low p_high undecided objects",
    ),
    "distance": _kind(
        "{tier}_distance.csv",
        f"{_CELL} ground_truth road quality",
        "s ap ap_low ap_high objects predictions",
    ),
    "hits": _kind("{tier}_hits.csv", "scene lidar preset", "frames hits_per_frame"),
    "points": _kind(
        "{tier}_points_per_vehicle.csv",
        "scene preset set lidar",
        "from_m to_m vehicles apv ci_low ci_high",
    ),
    "value": _kind(
        "{tier}_value.csv",
        f"{_CELL} pareto dominated_by",
        "price_usd site_usd ap ap_all "
        "ap_per_1000_usd usd_per_hq_area usd_per_m_road points_per_1000_usd",
        " ".join(SITE_ITEMS),
    ),
    "lidars": _kind(
        "lidars.csv", "lidar price_source price_date", "units price_low_usd price_high_usd"
    ),
    "claims": _kind("claims.csv", "claim preset statement verdict", "value low high"),
    "ap_claims": _kind(
        "{tier}_claims.csv", "scene preset claim statement verdict", "value low high"
    ),
    "paper": _kind("{tier}_paper.csv", "scene preset", "cells rank_correlation mean_difference"),
    "stress": _kind(
        "stress.csv",
        "detector run lidar preset scene stressor dial unit seed frames",
        "ap ap_low ap_high",
    ),
    "stress_ranking": _kind("stress_ranking.csv", "", ""),
    "stress_summary": _kind("stress_summary.csv", "", ""),
    "fidelity": _kind(
        "fidelity.csv",
        "detail lidar distance_m",
        "points_per_vehicle change_percent relative_time",
    ),
    "aggregation": _kind(
        "aggregation.csv",
        "aggregation lidar",
        "points_per_vehicle outside_box_percent ms_per_frame_set",
    ),
    "ladder": _kind(
        "ladder.csv",
        "detail aggregation frames lidar",
        "ap ap_low ap_high vehicle_points_per_frame ms_per_frame_set",
    ),
    "beam": _kind("beam.csv", "lidar distance", "vehicles points_per_vehicle in_box"),
    "speed": _kind("speed.csv", "what unit", "value"),
}


@dataclass(frozen=True, eq=False)
class Results:
    """The tables of a folder by name; their column `origin` says in which row of which file."""

    folder: Path
    tier: str
    tables: dict[str, pd.DataFrame]

    def table(self, name: str) -> pd.DataFrame:
        """The rows, none if the file is not there."""
        return self.tables[name]

    def done(self) -> pd.DataFrame:
        """The cells that have an AP, of the lowest seed of each."""
        cells = self.tables["cells"]
        return first_seed(cells[cells.ap.notna()])

    def file(self, name: str) -> str:
        return KINDS[name].file.format(tier=self.tier)

    def sources(self) -> list[TableFile]:
        """All tables that have rows."""
        return [self.source(name) for name, table in self.tables.items() if len(table) > 0]

    def source(self, name: str) -> TableFile:
        return TableFile(self.file(name), self.folder / self.file(name))


def read_results(folder: Path, tier: str | None = None) -> Results:
    """All tables of a folder; by default of the tier with the most finished cells.

    Raises FileNotFoundError for a folder that is not there, and ValueError for a wrong table, a
    tier without cells and a folder without any table.
    """
    if not folder.is_dir():
        raise FileNotFoundError(2, "found no folder of results", str(folder))
    chosen = tier if tier is not None else _richest(folder)
    tables = {name: _read(folder / k.file.format(tier=chosen), k) for name, k in KINDS.items()}
    if tier is not None and tables["cells"].empty:
        raise ValueError(f"{folder / f'{tier}.csv'}: found no cells, allowed a tier with cells")
    if all(table.empty for table in tables.values()):
        raise ValueError(f"{folder}: found no table of results, allowed one or more")
    tables["cells"] = _with_reasons(tables["cells"])
    return Results(folder, chosen, tables)


def _richest(folder: Path) -> str:
    """The tier with the most finished cells; `quick` if there is none."""
    counts = {
        tier: int(_read(folder / f"{tier}.csv", KINDS["cells"]).ap.notna().sum()) for tier in TIERS
    }
    best = max(reversed(TIERS), key=lambda tier: counts[tier])
    return best if counts[best] > 0 else "quick"


def _with_reasons(cells: pd.DataFrame) -> pd.DataFrame:
    """With a column `reason`, which says of every cell without an AP that it has none."""
    given = cells["reason"] if "reason" in cells else pd.Series("", index=cells.index, dtype=str)
    silent = cells.ap.isna() & (given == "")
    return cells.assign(reason=given.mask(silent, "no AP was measured, no reason was given"))


def _read(file: Path, kind: Kind) -> pd.DataFrame:
    columns = [*kind.texts, *kind.numbers]
    if not file.is_file():
        return _empty(kind)
    try:
        table = pd.read_csv(file, dtype=str, keep_default_na=False)
    except ValueError as error:
        raise ValueError(f"{file}: is no table: {error}") from None
    missing = [column for column in columns if column not in table]
    if missing:
        raise ValueError(f"{file}:1: found no column {missing[0]}, needed {', '.join(columns)}")
    origin = [f"{file.name}, row {row}" for row in range(1, len(table) + 1)]
    there = [*kind.numbers, *(name for name in kind.later if name in table)]
    numbers = dict.fromkeys(kind.later, np.nan) | {n: _numbers(file, table[n]) for n in there}
    return table.assign(origin=origin, **numbers)


def _empty(kind: Kind) -> pd.DataFrame:
    texts = {name: pd.Series(dtype=str) for name in (*kind.texts, "origin")}
    numbers = {name: pd.Series(dtype=np.float64) for name in (*kind.numbers, *kind.later)}
    return pd.DataFrame(texts | numbers)


def _numbers(file: Path, column: pd.Series) -> pd.Series:
    """A column as numbers, NaN where a cell is empty."""
    values = pd.to_numeric(column.where(column != "", "nan"), errors="coerce")
    wrong = values.isna() & (column != "") & (column.str.lower() != "nan")
    if wrong.any():
        row = wrong.idxmax()
        raise ValueError(
            f"{file}:{row + 2}: {column.name}: found '{column[row]}', allowed a number or nothing"
        )
    return values.astype(np.float64)
