"""Bootstrap replicates of an evaluation's figures, stored for paired comparisons.

A row has one figure of one detector and LiDAR. Columns `replicate_1`, `replicate_2` ... are the
values of this figure in the bootstrap replicates.
All LiDARs and detectors that are evaluated on the same traffic and frames use the same blocks of
time. Two rows can be compared if they agree in the columns SAME.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.dataset.frames_version import frames_version_of, written_versions
from pyinfra.metrics.comparison import Bootstrapped, Interval, mean_of, over_replicates
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY, ap_r1000_of, high_quality_share
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.intervals import Blocks, ratio
from pyinfra.metrics.match_results import MatchResult

# Columns that must be equal in two rows; otherwise their replicates cannot be compared.
SAME = (
    "vehicles_digest",
    "frames_version",
    "label_time",
    "frames",
    "block_s",
    "replicates",
    "replicates_seed",
)
COLUMNS = ("ground_truth", "measure", "value", "blocks", "version", *SAME)
DIGITS = 3
AHEAD_M = (0.0, 100.0)  # range of stations on the first road, metres, to which `ap_slope` is fitted
LEAST_WINDOWS = 5


def measure_of(range_m: float) -> str:
    """Returns the name of AP (R1000) within a range, such as ap_r1000_60m."""
    return f"ap_r1000_{range_m:g}m"


def figures(
    match_result: MatchResult,
    distance: tuple[pd.DataFrame, FloatArray],
    areas: tuple[pd.DataFrame, FloatArray],
) -> Iterator[tuple[str, Bootstrapped]]:
    """Yields the figures of one ground truth, by name.

    - ap_r1000: AP (R1000)
    - n_hqda, p_hqda: number and percentage of high-quality areas
    - ap_slope: change of AP per 10 m along the first road, if enough windows have an AP
    - recall: recall in percent of all counted predictions

    If too few blocks of time have objects, all replicates are NaN.

    distance, areas: tables with their replicates, each as `distance_table` returns them.
    """
    blocks, objects = match_result.blocks.count, match_result.ranking().objects
    yield "ap_r1000", ap_r1000_of(match_result)
    table, replicates = areas
    counts = (table.quality != "few").to_numpy()
    high = (table.ap_r1000[counts] > HIGH_QUALITY).sum()
    number = (replicates[counts] > HIGH_QUALITY).sum(0).astype(float)
    yield "n_hqda", Bootstrapped(float(high), match_result.known(number, objects), blocks)
    if counts.any():
        share = match_result.known(high_quality_share(table, replicates), objects)
        yield "p_hqda", Bootstrapped(100 * float(high) / int(counts.sum()), share, blocks)
    windows, ap_replicates = distance
    ahead = ((windows.road == windows.road.iloc[0]) & windows.s.between(*AHEAD_M)).to_numpy()
    aps = np.column_stack([windows.ap_r1000[ahead], ap_replicates[ahead]])
    per_10_m, *changes = slope(windows.s[ahead].to_numpy(np.float64), aps)
    if np.isfinite(per_10_m):
        known = match_result.known(np.array(changes), objects)
        yield "ap_slope", Bootstrapped(float(per_10_m), known, blocks)
    yield "recall", recall(match_result)


def recall(match_result: MatchResult) -> Bootstrapped:
    """Returns the recall in percent of all counted predictions."""
    ranking, weights = match_result.ranking(), match_result.weights
    objects = ranking.objects.astype(np.float64)
    true_positives = np.bincount(ranking.true_positive_slot, minlength=len(objects)).astype(
        np.float64
    )
    ones = np.ones((1, len(objects)))
    value, *replicates = 100 * ratio(
        np.vstack([ones, weights]) @ true_positives, np.vstack([ones, weights]) @ objects
    )
    known = match_result.known(np.array(replicates), ranking.objects)
    return Bootstrapped(float(value), known, match_result.blocks.count)


def slope(s: FloatArray, aps: FloatArray) -> FloatArray:
    """Returns the change of AP per 10 m (replicates,), from a least-squares line.

    All windows with an AP have the same weight, so that LiDARs with different AP are compared over
    the same distances. The change is NaN if fewer than LEAST_WINDOWS windows have an AP. s:
    (windows,) metres. aps: (windows, replicates), NaN where undefined.
    """
    known, tens = ~np.isnan(aps), s[:, None] / 10
    count = known.sum(0)
    away = known * (tens - ratio((known * tens).sum(0), count))
    changes = ratio((away * np.nan_to_num(aps)).sum(0), (away**2).sum(0))
    return np.where(count >= LEAST_WINDOWS, changes, np.nan)


def same_of(truth: GroundTruth, blocks: Blocks, seed: int) -> dict[str, object]:
    """Returns the columns SAME of an evaluation, and the version that wrote the frames."""
    frames_version, version = truth.versions or written_versions(truth.folder)
    return {
        "vehicles_digest": vehicles_digest(truth),
        "version": version,
        "frames_version": frames_version,
        "label_time": truth.lidar.label_time if truth.lidar else "",
        "frames": len(truth.frames),
        "block_s": blocks.block_s,
        "replicates": len(blocks.replicates),
        "replicates_seed": seed,
    }


def replicate_rows(
    same: Mapping[str, object], which: str, estimates: Iterable[tuple[str, Bootstrapped]]
) -> pd.DataFrame:
    """Returns the rows of one ground truth, with the columns COLUMNS and the replicates.

    same: the result of `same_of`, and further columns.
    """
    rows = []
    for measure, figure in estimates:
        head = {"ground_truth": which, "measure": measure, "value": figure.value}
        values = {
            f"replicate_{i + 1}": round(v, DIGITS) for i, v in enumerate(figure.replicates.tolist())
        }
        rows.append({**head, "blocks": figure.blocks, **same, **values})
    return pd.DataFrame(rows)


def vehicles_digest(truth: GroundTruth) -> str:
    """Returns a digest of the frames and the vehicles in the region.

    It is the same for all LiDARs that see the same traffic.
    """
    v = truth.vehicles
    in_region = v.visibility >= 0 if truth.has_objects else np.ones(len(v), np.bool_)
    frames = np.array(truth.frames)[v.frame[in_region]]
    sizes = np.round(v.mid_frame[in_region, 3:6] * 100).astype(np.int64)
    rows = np.unique(np.column_stack([frames, v.ids[in_region], sizes]), axis=0)
    parts = [np.array(truth.frames, np.int64), rows.astype(np.int64)]
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()[:16]


def _same(row: pd.Series, name: str) -> str:
    """Returns the text of a column of SAME.

    Rows of version 0.3 have no `frames_version`; it is derived from their version.
    """
    text = str(row[name]) if name in row and pd.notna(row[name]) else ""
    return text or frames_version_of(str(row["version"])) if name == "frames_version" else text


def bootstrapped_of(row: pd.Series) -> Bootstrapped:
    """Returns a row of the table as a figure with its replicates. Raises Error."""
    columns = [name for name in row.index if str(name).startswith("replicate_")]
    if not 0 <= row.replicates <= len(columns):
        raise Error(
            f"{row.get('origin', 'replicates')}: replicates: expected 0 to {len(columns)}, the "
            f"number of columns of replicates, got {row.replicates:g}"
        )
    names = [f"replicate_{i + 1}" for i in range(int(row.replicates))]
    return Bootstrapped(float(row.value), row[names].to_numpy(np.float64), float(row.blocks))


def check_pair(a: pd.Series, b: pd.Series, also: Sequence[str] = ()) -> None:
    """Raises Error if the replicates of two rows cannot be paired. The error names the column.

    also: further columns that must be equal.
    """
    for name in (*also, *SAME):
        if _same(a, name) != _same(b, name):
            origins = [str(row["origin"]) for row in (a, b) if "origin" in row]
            prefix = f"{' and '.join(origins)}: " if origins else ""
            why = (
                "; bootstrap replicates can only be paired if vehicles, number of frames and label "
                "time are the same"
            )
            raise Error(
                f"{prefix}{name}: expected the same value in both rows, got {_same(a, name)} and "
                f"{_same(b, name)}{why if name in SAME else ''}"
            )


def difference(a: pd.Series, b: pd.Series, also: Sequence[str] = ()) -> Bootstrapped:
    """Returns the first figure minus the second, in each replicate.

    The argument `also` and the exceptions are as in `check_pair`.
    """
    check_pair(a, b, also)
    return bootstrapped_of(a).less(bootstrapped_of(b))


def over_seeds(figures: Sequence[Bootstrapped], rows: Sequence[pd.Series]) -> Interval:
    """Returns the mean of a figure over seeds, with its interval.

    Seeds of the same vehicles and frames are trainings on the same traffic. Their replicates are
    averaged, and the interval is the bootstrap over blocks of time. For different traffic it is
    Student's t interval over the traffic.

    rows: for each seed, a row of the table from which its figure was computed. Raises Error for
    seeds of the same traffic with replicates of different blocks.
    """
    by_traffic: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        by_traffic.setdefault(_same(row, "vehicles_digest"), []).append(k)
    for same in by_traffic.values():
        for k in same[1:]:
            check_pair(rows[same[0]], rows[k])
    means = [mean_of([figures[k] for k in same]) for same in by_traffic.values()]
    return means[0].measured() if len(means) == 1 else over_replicates([m.value for m in means])
