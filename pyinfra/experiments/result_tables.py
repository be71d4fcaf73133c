"""Reads and checks the tables of a folder of results for the report.

A missing file gives a table without rows. A missing column, a value that is not a number or is out
of range, and a duplicate row are errors. The message names the file, the row and the column.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error, FormatError, not_found
from pyinfra.core.vocabulary import TIERS
from pyinfra.experiments.value import SITE_ITEMS
from pyinfra.formats.csv_table import numbers, read_words
from pyinfra.formats.earlier_names import existing
from pyinfra.metrics.row_selection import (
    AP_COLUMNS,
    EXPERIMENT,
    OFF_REGION,
    first_seed,
    with_whole,
)

Ends = tuple[float, float]


@dataclass(frozen=True, eq=False)
class TableFile:
    """A CSV file that is written with the report: a file of the results, or a computed table."""

    name: str
    content: Path | pd.DataFrame


@dataclass(frozen=True)
class Kind:
    """The file name of a table, in which {tier} stands for the tier, and its columns.

    texts, numbers: required columns.
    later: columns of numbers that tables of earlier versions lack; missing columns are read as NaN.
    ranges: allowed ranges of columns that are not in RANGES.
    """

    file: str
    texts: tuple[str, ...]
    numbers: tuple[str, ...]
    key: tuple[str, ...]  # columns whose values together must be unique; if empty, not checked
    later: tuple[str, ...]
    ranges: Mapping[str, Ends] = field(default_factory=dict)


def kind(
    file: str, texts: str, numbers: str, key: str = "", later: str = "", **ranges: Ends
) -> Kind:
    first, second, third, fourth = (tuple(w.split()) for w in (texts, numbers, key, later))
    return Kind(file, first, second, third, fourth, ranges)


SHARE = (0.0, 100.0)
_FROM_ZERO = (0.0, sys.float_info.max)
FINITE = (-sys.float_info.max, sys.float_info.max)
_ANY = (-math.inf, math.inf)  # ends of intervals can be infinite if there are few replicates
# Allowed ranges of numeric columns in all tables; other numeric columns allow 0 or more.
RANGES = {
    **dict.fromkeys(AP_COLUMNS, SHARE),
    **dict.fromkeys("recall recall_low recall_high".split(), SHARE),
    **dict.fromkeys("p_hqda p_low p_high".split(), SHARE),
    **dict.fromkeys("value low high".split(), _ANY),
    **dict.fromkeys("s x y".split(), FINITE),
    "units": (1.0, 1e6),
}
ENDS = (  # columns with the low and the high end of an interval
    *((name, f"{name.removesuffix('_low')}_high") for name in AP_COLUMNS if name.endswith("_low")),
    ("recall_low", "recall_high"),
    ("p_low", "p_high"),
    ("ci_low", "ci_high"),
    ("low", "high"),
    ("price_low_usd", "price_high_usd"),
    ("from_m", "to_m"),
)


PRETRAINED = "generalist-as-is"  # the pretrained detector without further training
# Words that messages and reports show in place of a detector's identifier
DETECTOR_WORDS = {PRETRAINED: "pretrained", "generalist": "fine-tuned"}
AS_THEY_COME = ("background", PRETRAINED)  # detectors that have no training steps
_EXPERIMENT = " ".join((*EXPERIMENT, "seed"))
KINDS = {
    "experiments": kind(
        "{tier}.csv",
        f"{_EXPERIMENT} command version",
        "ap ap_low ap_high ap_r1000 ap_common ap_all objects train_seconds latency_p50_ms "
        "latency_p95_ms",
        _EXPERIMENT,
        f"{' '.join(AP_COLUMNS)} objects_all objects_present {OFF_REGION} train_steps "
        "latency_low_ms latency_high_ms latency_other_cores latency_frames latency_threads",
    ),
    "replicates": kind(
        "{tier}_replicates.csv",
        f"{_EXPERIMENT} ground_truth measure vehicles_digest version label_time",
        "value blocks frames block_s replicates replicates_seed",
        f"{_EXPERIMENT} ground_truth measure",
    ),
    "areas": kind(
        "{tier}_areas.csv",
        f"{_EXPERIMENT} ground_truth road",
        "n_tda n_hqda p_hqda p_low p_high undecided objects",
        f"{_EXPERIMENT} ground_truth road",
    ),
    "distance": kind(
        "{tier}_distance.csv",
        f"{_EXPERIMENT} ground_truth road quality",
        "s ap ap_low ap_high ap_r1000 ap_r1000_low ap_r1000_high objects predictions",
        f"{_EXPERIMENT} ground_truth road s",
    ),
    "ranges": kind(
        "{tier}_ranges.csv",
        f"{_EXPERIMENT} ground_truth",
        "range_m ap_r1000 ap_r1000_low ap_r1000_high recall recall_low recall_high objects "
        "predictions",
        f"{_EXPERIMENT} ground_truth range_m",
    ),
    "squares": kind(
        "{tier}_squares.csv",
        f"{_EXPERIMENT} ground_truth quality",
        "x y distance_m ap_r1000 ap_r1000_low ap_r1000_high objects predictions",
        f"{_EXPERIMENT} ground_truth x y",
    ),
    "hits": kind(
        "{tier}_hits.csv", "scene lidar preset", "frames hits_per_frame", "scene lidar preset"
    ),
    "points": kind(
        "{tier}_points_per_vehicle.csv",
        "scene preset set lidar",
        "from_m to_m vehicles apv ci_low ci_high",
        "scene preset set lidar from_m",
    ),
    "value": kind(
        "{tier}_value.csv",
        f"{_EXPERIMENT} pareto dominated_by",
        "price_usd site_usd ap ap_all "
        "ap_per_1000_usd usd_per_hq_area usd_per_m_road points_per_1000_usd",
        _EXPERIMENT,
        f"{' '.join(SITE_ITEMS)} ap_r1000 ap_all_r1000 ap_whole ap_whole_r1000",
    ),
    "lidars": kind(
        "lidars.csv",
        "lidar price_source price_date",
        "units price_low_usd price_high_usd",
        "lidar preset",
        "period_s",
    ),
    "until": kind(
        "{tier}_until.csv",
        "scene preset first second subset",
        "replicates difference low high half_width",
        "scene preset",
        difference=FINITE,
        half_width=_ANY,
    ),
    "stress": kind(
        "stress.csv",
        "detector run lidar preset scene stressor severity unit seed frames",
        "ap ap_low ap_high ap_r1000 ap_r1000_low ap_r1000_high",
        "detector run lidar preset scene stressor severity seed frames",
    ),
    "stress_ranking": kind("stress_ranking.csv", "", ""),
    "stress_summary": kind("stress_summary.csv", "", ""),
}


@dataclass(frozen=True, eq=False)
class Results:
    """The tables of a folder by name; column `origin` names the file and the row of each row."""

    folder: Path
    tier: str
    tables: dict[str, pd.DataFrame]
    kinds: Mapping[str, Kind]

    def table(self, name: str) -> pd.DataFrame:
        """Returns the rows of a table; no rows if there is no file."""
        return self.tables[name]

    def done(self) -> pd.DataFrame:
        """Returns the experiments that have an AP, of the first seed that all of them have."""
        return first_seed(self.finished())

    def finished(self) -> pd.DataFrame:
        """Returns the experiments of all seeds that have an AP."""
        experiments = self.tables["experiments"]
        return experiments[experiments.ap.notna()]

    def file(self, name: str) -> str:
        return self.kinds[name].file.format(tier=self.tier)

    def sources(self) -> list[TableFile]:
        """Returns the files of all tables that have rows."""
        return [self.source(name) for name, table in self.tables.items() if len(table) > 0]

    def source(self, name: str) -> TableFile:
        return TableFile(self.file(name), self.folder / self.file(name))


def hardly_learnt(experiments: pd.DataFrame) -> pd.Series:
    """Returns which rows are networks trained in the smoke tier, whose AP has no meaning.

    Rows of earlier versions have no `train_steps`. In these rows all detectors except AS_THEY_COME
    count as trained.
    """
    guessed = (~experiments.detector.isin(AS_THEY_COME)).astype(float)
    steps = experiments.train_steps.fillna(guessed) if "train_steps" in experiments else guessed
    return (experiments.tier == "smoke") & (steps > 0)


def read_results(
    folder: Path, tier: str | None = None, more: Mapping[str, Kind] | None = None
) -> Results:
    """Reads all tables of a tier; by default the tier with the most finished experiments.

    more: kinds of tables in addition to KINDS.

    Raises FileNotFoundError for a missing folder, and Error for an invalid table, a tier without
    experiments and a folder without any table.
    """
    if not folder.is_dir():
        raise not_found(folder, "expected a folder of results, got none")
    chosen = tier if tier is not None else _richest(folder)
    kinds = {**KINDS, **(more or {})}
    tables = {name: _read(folder / k.file.format(tier=chosen), k) for name, k in kinds.items()}
    if tier is not None and tables["experiments"].empty:
        check_tier(folder, tier)
        raise Error(
            f"{folder / f'{tier}.csv'}: expected one or more finished experiments, got none"
        )
    if all(table.empty for table in tables.values()):
        raise Error(f"{folder}: expected tables of `pyinfra benchmark`, got none")
    tables["experiments"] = _with_reasons(with_whole(tables["experiments"]))
    return Results(folder, chosen, tables, kinds)


def check_tier(folder: Path, tier: str) -> None:
    """Raises Error if a folder has tables of other tiers and none of this one."""
    tiers = [name for name in TIERS if (folder / f"{name}.csv").is_file()]
    if tiers and tier not in tiers:
        raise Error(f"tier: expected a tier in {folder} ({' or '.join(tiers)}), got '{tier}'")


def _richest(folder: Path) -> str:
    """Returns the tier with the most finished experiments, or `quick` if there are none."""
    counts = {
        tier: int(_read(folder / f"{tier}.csv", KINDS["experiments"]).ap.notna().sum())
        for tier in TIERS
    }
    best = max(reversed(TIERS), key=lambda tier: counts[tier])
    return best if counts[best] > 0 else "quick"


def _with_reasons(experiments: pd.DataFrame) -> pd.DataFrame:
    """Returns the table with a column `reason`, which is filled for experiments without an AP."""
    given = (
        experiments["reason"]
        if "reason" in experiments
        else pd.Series("", index=experiments.index, dtype=str)
    )
    silent = experiments.ap.isna() & (given == "")
    return experiments.assign(reason=given.mask(silent, "no AP was measured, no reason was given"))


def _read(file: Path, kind: Kind) -> pd.DataFrame:
    file = existing(file)
    if not file.is_file():
        return _empty(kind)
    try:
        return _checked(file, kind)
    except FormatError as error:  # the user gave a folder whose files are not result tables
        raise Error(str(error)) from None


def _checked(file: Path, kind: Kind) -> pd.DataFrame:
    columns = [*kind.texts, *kind.numbers]
    table = read_words(file)
    missing = [column for column in columns if column not in table]
    if missing:
        names = ", ".join(columns)
        raise Error(f"{file}:1: expected the columns {names}; the column {missing[0]} is missing")
    origin = [f"{file.name}, row {row}" for row in range(1, len(table) + 1)]
    present = [*kind.numbers, *(name for name in kind.later if name in table)]
    values = {name: _in_range(file, table[name], kind.ranges) for name in present}
    _check_order(file, values)
    _check_key(file, table, kind.key)
    return table.assign(origin=origin, **dict.fromkeys(kind.later, np.nan) | values)


def _empty(kind: Kind) -> pd.DataFrame:
    texts = {name: pd.Series(dtype=str) for name in (*kind.texts, "origin")}
    values = {name: pd.Series(dtype=np.float64) for name in (*kind.numbers, *kind.later)}
    return pd.DataFrame(texts | values)


def _in_range(file: Path, column: pd.Series, ranges: Mapping[str, Ends]) -> pd.Series:
    """Returns a column as numbers, NaN where it is empty. Raises Error for a value out of range."""
    low, high = {**RANGES, **ranges}.get(str(column.name), _FROM_ZERO)
    values = numbers(file, column).astype(np.float64)
    wrong = values.notna() & ~values.between(low, high)
    if wrong.any():
        row = wrong.idxmax()
        allowed = f"{low:g} to {high:g}" if high < _FROM_ZERO[1] else "a finite number"
        allowed = "0 or more" if (low, high) == _FROM_ZERO else allowed
        raise Error(f"{file}:{row + 2}: {column.name}: expected {allowed}, got {column[row]}")
    return values


def _check_order(file: Path, values: dict[str, pd.Series]) -> None:
    for low, high in ENDS:
        if low not in values or high not in values:
            continue
        wrong = values[low] > values[high]
        if wrong.any():
            row = wrong.idxmax()
            raise Error(
                f"{file}:{row + 2}: {low}: expected at most the value of {high} "
                f"({values[high][row]:g}), got {values[low][row]:g}"
            )


def _check_key(file: Path, table: pd.DataFrame, key: tuple[str, ...]) -> None:
    """Raises Error for an empty value in the key, and for two rows with the same key."""
    here = [name for name in key if name in table]  # tables of earlier versions lack some columns
    for name in here:
        empty = table[name] == ""
        if empty.any():
            raise Error(f"{file}:{empty.idxmax() + 2}: {name}: expected a name, got an empty cell")
    twice = table.duplicated(here) if here else table.index < 0
    if twice.any():
        row = int(np.flatnonzero(twice)[0])
        first = int(np.flatnonzero((table[here] == table.loc[row, here]).all(axis=1))[0])
        raise Error(
            f"{file}:{row + 2}: {' '.join(table.loc[row, here])}: expected one row with "
            f"this key, got rows {first + 2} and {row + 2}"
        )
