"""Comparison of mounts over the same traffic: pole positions, heights, numbers of poles.

A place is one mount. It is an output folder of `pyinfra evaluate`, or a folder with one output
folder for each traffic seed. Evaluations of two places are paired if their vehicles and frames are
the same.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error, not_found
from pyinfra.core.vocabulary import Subset
from pyinfra.formats.csv_table import read_csv
from pyinfra.formats.earlier_names import existing
from pyinfra.metrics.comparison import clipped
from pyinfra.metrics.replicates import bootstrapped_of, check_pair, over_seeds

MEASURES = {
    "ap_r1000": "ap_r1000",
    "recall_percent": "recall",
}  # maps names of measures in the result to names in replicates.csv
MEASURED_BY = ("class", "metric", "iou")  # columns of a row that define its AP
# Further columns that define the AP of a row. Rows of earlier versions lack these columns.
SETTINGS = ("types", "min_points", "min_score")
# Columns that replicates.csv must have; the files of all versions have them.
REQUIRED = (
    *("ground_truth", "measure", "value", "blocks"),
    *("vehicles_digest", "frames", "replicates"),
)
# Subsets that can be compared between mounts, the preferred one first. Only `present` is the same
# for all mounts of a region: `all` has no vehicle that is hidden from its mount.
COMPARABLE: tuple[Subset, ...] = ("present", "all")
COLUMNS = ["place", "minus", "measure", "value", "low", "high", "seeds", "frames"]


@dataclass(frozen=True, eq=False)
class Place:
    """The evaluations of one mount, one for each traffic seed."""

    name: str
    rows: dict[str, dict[str, pd.Series]]  # rows by digest of vehicles and frames, then by measure
    hidden_percent: float  # percentage of the region's vehicles that are hidden; NaN if unknown


def compare_places(folders: Sequence[Path], which: Subset | None = None) -> pd.DataFrame:
    """Compares the AP and recall of mounts, with the paired differences of all pairs of mounts.

    Parameters
    ----------
    folders : a folder for each mount: an output folder of `pyinfra evaluate`, or a folder that has
        one output folder per traffic seed
    which : ground-truth subset; by default that of `shared_subset`

    Returns
    -------
    DataFrame : columns COLUMNS. If column `minus` is empty, the row has the figure of one mount.
        Otherwise the row has the difference of two mounts, `place` minus `minus`. The measures are
        ap_r1000, recall_percent and hidden_percent, 0 to 100. Columns low and high are the ends of
        the 95 % interval; they are NaN for hidden_percent. For one seed the interval comes from a
        bootstrap over blocks of time. For several seeds it is Student's t interval over the seeds.

    Raises
    ------
    Error : for places whose vehicles, frames, label times, classes, metrics or settings differ
    FileNotFoundError : for a folder without an evaluation
    """
    subset = which or shared_subset(folders)
    places = [read_place(folder, subset) for folder in folders]
    check_pairs(places)
    rows = []
    for place in places:
        rows += [_row(place, None, measure) for measure in MEASURES]
        frames, hidden = _frames(place), place.hidden_percent
        if math.isfinite(hidden):
            head = (place.name, "", "hidden_percent", hidden, math.nan, math.nan)
            rows.append(dict(zip(COLUMNS, (*head, len(place.rows), frames), strict=True)))
    for first, second in itertools.combinations(places, 2):
        rows += [_row(second, first, measure) for measure in MEASURES]
    return pd.DataFrame(rows, columns=COLUMNS)


def shared_subset(folders: Sequence[Path]) -> Subset:
    """Returns the first subset of COMPARABLE that all evaluations have; `present` without one.

    Raises FileNotFoundError for a folder without an evaluation.
    """
    tables = [read_csv(file, required=REQUIRED) for place in folders for file in _files(place)]
    have = [set(table.ground_truth[table.measure == "recall"]) for table in tables]
    return next((name for name in COMPARABLE if all(name in names for names in have)), "present")


def read_place(folder: Path, which: Subset) -> Place:
    """Reads the evaluations of a place, for one ground-truth subset.

    Raises Error if an evaluation lacks the subset, or if two evaluations have the same frames and
    vehicles. Raises FileNotFoundError for a folder without an evaluation.
    """
    tables: dict[str, dict[str, pd.Series]] = {}
    objects = dict.fromkeys((which, "all"), 0)
    for file in _files(folder):
        table = read_csv(file, required=REQUIRED)
        rows = table[table.ground_truth == which]
        if not set(MEASURES.values()) <= set(rows.measure):
            present = ", ".join(dict.fromkeys(table.ground_truth))
            raise Error(
                f"{file}: expected recall for the ground-truth subset {which}, got rows of the "
                f"subsets {present}; run `pyinfra evaluate` again with `ground_truth` "
                f"{' '.join(dict.fromkeys((which, 'all')))}"
            )
        digest = str(rows.vehicles_digest.iloc[0])
        if digest in tables:
            raise Error(
                f"{file}: expected different seeds, got the same vehicles and frames as in "
                f"{tables[digest]['ap_r1000']['origin']}"
            )
        ap = read_csv(file.with_name("ap.csv"), required=("protocol", "ground_truth", "objects"))
        metric = str(ap.protocol.iloc[0]).partition("-")[2] or "bev"
        rows = rows.assign(origin=str(file), metric=metric)
        tables[digest] = {r.measure: r for _, r in rows.iterrows()}
        counts = ap.groupby("ground_truth").objects.first()
        for name in objects:
            objects[name] += counts.get(name, math.nan)
    hidden = 1 - objects["all"] / objects[which] if which == "present" else math.nan
    return Place(str(folder), tables, 100 * hidden)


def _files(folder: Path) -> list[Path]:
    """Returns the files replicates.csv of a place, one for each seed. Raises FileNotFoundError."""
    files = [existing(folder / "replicates.csv")]
    if not files[0].is_file():
        files = sorted(existing(ap.with_name("replicates.csv")) for ap in folder.glob("*/ap.csv"))
    if not files:
        raise not_found(folder, "No replicates.csv; `pyinfra evaluate` writes it")
    return files


def check_pairs(places: Sequence[Place]) -> None:
    """Raises Error unless all places have evaluations of the same vehicles and frames.

    Class, threshold, metric and, if both rows have them, the settings must also be the same.
    """
    first = places[0]
    for other in places[1:]:
        alone = set(first.rows) ^ set(other.rows)
        if alone:
            unpaired = first.rows if set(first.rows) & alone else other.rows
            file = next(
                unpaired[digest]["ap_r1000"]["origin"] for digest in unpaired if digest in alone
            )
            raise Error(
                f"{first.name} and {other.name}: expected evaluations of the same vehicles and "
                f"frames, got no match for {file}; the seed, the frames or the region differ (with "
                "the key `regions` in the scene, all mounts have the same region)"
            )
        for digest, rows in other.rows.items():
            one, row = first.rows[digest]["ap_r1000"], rows["ap_r1000"]
            check_pair(one, row, (*MEASURED_BY, *(s for s in SETTINGS if s in one and s in row)))


def _row(place: Place, minus: Place | None, measure: str) -> dict[str, object]:
    name = MEASURES[measure]
    values = []
    for digest, rows in place.rows.items():
        one = bootstrapped_of(rows[name])
        values.append(one.less(bootstrapped_of(minus.rows[digest][name])) if minus else one)
    figure = over_seeds(values, [rows[name] for rows in place.rows.values()])
    figure = clipped(figure, -100.0 if minus else 0.0, 100.0)
    head = (place.name, minus.name if minus else "", measure, *astuple(figure))
    return dict(zip(COLUMNS, (*head, len(values), _frames(place)), strict=True))


def _frames(place: Place) -> int:
    """Returns the total number of frames of all seeds."""
    return int(sum(rows["ap_r1000"]["frames"] for rows in place.rows.values()))
