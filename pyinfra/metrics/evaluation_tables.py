"""Computes the tables of an evaluation.

AP and shares are 0 to 100. Columns with low and high in their names are the ends of 95 % intervals.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.vocabulary import Subset
from pyinfra.dataset.windows import EVERY_ROAD, Window
from pyinfra.metrics import ap
from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.intervals import ratio
from pyinfra.metrics.label_free_quality import CUTS
from pyinfra.metrics.match_input import MatchInput
from pyinfra.metrics.match_results import CAUSES, MatchResult, causes, count_matches, precision
from pyinfra.metrics.settings import Protocol

EVERYWHERE = "all"  # value of the column `road` for all roads together
LANES = "(lanes)"  # value of the column `road` for all lanes of a site; no road has this name
HIGH_QUALITY = 85.0  # AP above which an area has high quality
PR_RECALLS = 100
AP_COLUMNS = (
    "class ground_truth iou protocol ap ap_low ap_high ap_r1000 ap_r1000_low ap_r1000_high "
    "objects predictions frames block_s"
).split()
# An area with too few objects has quality `few`. Otherwise its quality is `high` or `low` if the
# whole interval of its AP is above or below HIGH_QUALITY, and else `undecided`.
QUALITIES = ("high", "undecided", "low", "few")


def ap_row(match_result: MatchResult, iou: float, protocol: Protocol) -> dict[str, Any]:
    """Returns the row of AP over all frames, without the columns class and ground_truth."""
    ranking = match_result.ranking()
    value = float(precision(ranking, protocol, None)[0])
    replicates = precision(ranking, protocol, match_result.weights)
    low, high = match_result.interval(value, replicates, ranking.objects)
    metric = match_result.match_input.metric
    return {
        "iou": iou,
        "protocol": protocol if metric == "bev" else f"{protocol}-{metric}",
        "ap": value,
        "ap_low": float(low),
        "ap_high": float(high),
        **r1000_columns(match_result, ap_r1000_of(match_result)),
        "objects": match_result.objects,
        "predictions": len(ranking.slot),
        "frames": len(match_result.match_input.truth.frames),
        "block_s": match_result.blocks.block_s,
    }


def ap_r1000_of(match_result: MatchResult, ranking: ap.Ranking | None = None) -> Bootstrapped:
    """Returns AP (R1000) over all frames, with its replicates.

    The replicates are NaN if too few blocks of time have objects.

    ranking: predictions and objects of a part of the region; by default of the whole region.
    """
    ranking = match_result.ranking() if ranking is None else ranking
    value = float(ap.average_precision(ranking, ap.R1000_RECALLS)[0])
    replicates = ap.average_precision(ranking, ap.R1000_RECALLS, match_result.weights)
    known = match_result.known(replicates, ranking.objects)
    return Bootstrapped(value, known, match_result.blocks.count)


def r1000_columns(
    match_result: MatchResult, r1000: Bootstrapped, ranking: ap.Ranking | None = None
) -> dict[str, float]:
    """Returns the columns of AP (R1000) and its interval, which is clipped to 0 to 100."""
    ranking = match_result.ranking() if ranking is None else ranking
    low, high = match_result.interval(r1000.value, r1000.replicates, ranking.objects)
    return {"ap_r1000": r1000.value, "ap_r1000_low": float(low), "ap_r1000_high": float(high)}


def shown_ap(row: Any) -> tuple[float, float, float]:
    """Returns the AP to show for a row of `ap.csv`, with the ends of its interval.

    For protocol `definition` this is AP (R1000). For other protocols it is the AP of the protocol.
    """
    if str(row.protocol).startswith("definition"):
        return row.ap_r1000, row.ap_r1000_low, row.ap_r1000_high
    return row.ap, row.ap_low, row.ap_high


def pr_table(match_result: MatchResult) -> pd.DataFrame:
    """Returns the highest precision (0 to 1) at or above each of the recalls 0.01 .. 1.

    The precision is 0 for a recall that is not reached. Column score is the highest score threshold
    at which the recall is reached, or NaN.
    """
    ranking = match_result.ranking()
    recalls = np.arange(1, PR_RECALLS + 1)
    value = ap.precision_at_recalls(ranking, PR_RECALLS)[0]
    replicates = ap.precision_at_recalls(ranking, PR_RECALLS, weights=match_result.weights)
    low, high = match_result.interval(100 * value, 100 * replicates, ranking.objects)
    needed = -(-recalls * match_result.objects // PR_RECALLS)
    point = np.searchsorted(ranking.true_positives_upto, needed)
    return pd.DataFrame(
        {
            "recall": recalls / PR_RECALLS,
            "precision": value,
            "precision_low": low / 100,
            "precision_high": high / 100,
            "score": np.append(ranking.scores, np.nan)[point],
        }
    )


def distance_table(match_result: MatchResult, min_objects: int) -> tuple[pd.DataFrame, FloatArray]:
    """Returns a table with AP (R40) and AP (R1000) of each window, and replicates of AP (R1000).

    The replicates have the shape (windows, replicates).
    """
    truth = match_result.match_input.truth
    names = dict(enumerate(road.name for road in truth.roads)) or {0: "distance"}
    names[EVERY_ROAD] = LANES
    windows = {w: {"road": names[w.road], "s": w.middle} for w in truth.windows()}
    return _ap_of(match_result, windows, min_objects)


def cell_table(match_result: MatchResult, min_objects: int) -> tuple[pd.DataFrame, FloatArray]:
    """Returns AP of each grid cell, and its replicates, in the form of `distance_table`.

    Columns x, y are the middle of a cell in the world frame, in metres. Column distance_m is the
    horizontal distance of the middle from the sensor.
    """
    truth = match_result.match_input.truth
    pose = truth.lidar.T_world_levelled if truth.lidar else None
    cells = {
        cell: {
            "x": cell.x,
            "y": cell.y,
            "distance_m": math.hypot(cell.x - pose.x, cell.y - pose.y) if pose else math.nan,
        }
        for cell in truth.cells()
    }
    return _ap_of(match_result, cells, min_objects)


def _ap_of(
    match_result: MatchResult, parts: Mapping[Any, dict[str, Any]], min_objects: int
) -> tuple[pd.DataFrame, FloatArray]:
    """Returns a row for each window or grid cell, and the replicates of its AP (R1000).

    parts: the windows or cells, with the columns that name them.
    """
    rows, replicates = [], []
    for part, named in parts.items():
        ranking = match_result.ranking(part)
        (value,), (r1000,) = ap.r40_and_r1000(ranking)
        r40_replicates, r1000_replicates = ap.r40_and_r1000(ranking, match_result.weights)
        low, high = match_result.interval(value, r40_replicates, ranking.objects)
        r1000_low, r1000_high = match_result.interval(r1000, r1000_replicates, ranking.objects)
        row = {
            **named,
            "ap": float(value),
            "ap_low": float(low),
            "ap_high": float(high),
            "ap_r1000": float(r1000),
            "ap_r1000_low": float(r1000_low),
            "ap_r1000_high": float(r1000_high),
            "objects": int(ranking.objects.sum()),
            "predictions": len(ranking.slot),
        }
        row["quality"] = area_quality(row, min_objects)
        rows.append(row)
        replicates.append(r1000_replicates)
    return pd.DataFrame(rows), np.array(replicates)


def cut_first_ap(
    match_input: MatchInput, which: Subset, iou: float, min_points: int, windows: Sequence[Window]
) -> list[float]:
    """Returns AP (R1000) of each window after removing boxes outside the window before matching."""
    values = []
    for window in windows:
        matches = match_input.match(iou, strict=False, within=window)
        alone = count_matches(match_input, which, matches, min_points)
        values.append(float(ap.average_precision(alone.ranking(window), ap.R1000_RECALLS)[0]))
    return values


def area_quality(row: dict[str, Any], min_objects: int) -> str:
    """Returns the quality of an area, one of QUALITIES."""
    if row["objects"] < min_objects:
        return "few"
    if (
        math.isnan(row["ap_r1000_low"])
        or row["ap_r1000_low"] <= HIGH_QUALITY < row["ap_r1000_high"]
    ):
        return "undecided"
    return "high" if row["ap_r1000"] > HIGH_QUALITY else "low"


def area_table(
    match_result: MatchResult, distance: pd.DataFrame, replicates: FloatArray
) -> pd.DataFrame:
    """Returns the number of high-quality areas of each road, and of all roads (road `all`).

    - n_tda: areas with enough objects
    - n_hqda: areas with enough objects and an AP above HIGH_QUALITY, significantly or not
    - undecided: areas with enough objects whose interval includes HIGH_QUALITY or is unknown
    """
    names = list(dict.fromkeys(distance.road))
    groups = [(EVERYWHERE, np.ones(len(distance), dtype=np.bool_))] if len(names) > 1 else []
    groups += [(name, (distance.road == name).to_numpy()) for name in names]
    return pd.DataFrame(
        [
            {"road": name, **_areas(match_result, distance[in_road], replicates[in_road])}
            for name, in_road in groups
        ]
    )


def _areas(
    match_result: MatchResult, distance: pd.DataFrame, replicates: FloatArray
) -> dict[str, Any]:
    counts = (distance.quality != "few").to_numpy()
    total = int(counts.sum())
    high = int((distance.ap_r1000[counts] > HIGH_QUALITY).sum())
    share = 100 * high / total if total > 0 else math.nan
    objects = match_result.per_slot(match_result.match_input.vehicles.frame[match_result.counted])
    low, top = match_result.interval(share, high_quality_share(distance, replicates), objects)
    return {
        "n_tda": total,
        "n_hqda": high,
        "p_hqda": share,
        "p_low": float(low),
        "p_high": float(top),
        "undecided": int((distance.quality == "undecided").sum()),
        "objects": int(distance.objects.sum()),
    }


def high_quality_share(distance: pd.DataFrame, replicates: FloatArray) -> FloatArray:
    """Returns the percentage of high-quality areas in each replicate.

    Only areas with enough objects and a known interval count. The percentage is NaN for a replicate
    in which no area has an AP.
    """
    shown = ((distance.quality != "few") & distance.ap_r1000_low.notna()).to_numpy()
    defined = (~np.isnan(replicates[shown])).sum(0)
    return ratio(100.0 * (replicates[shown] > HIGH_QUALITY).sum(0), defined)


def error_table(match_result: MatchResult) -> pd.DataFrame:
    """Returns the errors of true positives: the predicted box minus the vehicle's box.

    Rows ahead, left and up are errors of the centre along the vehicle's axes. Row horizontal is the
    horizontal distance of the centres. Row heading is the error modulo 180 degrees. Row reversed is
    the share of boxes that point backwards. Columns low and high are the interval of mean_absolute.
    """
    match_input = match_result.match_input
    p = match_input.predictions.boxes[match_result.true_positive]
    v = match_input.vehicles.boxes[match_result.matches[match_result.true_positive]]
    dx, dy = p[:, 0] - v[:, 0], p[:, 1] - v[:, 1]
    cos, sin = np.cos(v[:, 6]), np.sin(v[:, 6])
    turn = np.degrees(p[:, 6] - v[:, 6])
    errors = {
        "horizontal": ("m", np.hypot(dx, dy)),
        "ahead": ("m", cos * dx + sin * dy),
        "left": ("m", cos * dy - sin * dx),
        "up": ("m", p[:, 2] - v[:, 2]),
        "length": ("m", p[:, 3] - v[:, 3]),
        "width": ("m", p[:, 4] - v[:, 4]),
        "height": ("m", p[:, 5] - v[:, 5]),
        "heading": ("deg", (turn + 90) % 180 - 90),
        "reversed": ("percent", 100.0 * (np.abs((turn + 180) % 360 - 180) > 90)),
    }
    slot = match_result.blocks.slot[match_input.predictions.frame[match_result.true_positive]]
    return pd.DataFrame(
        [
            {"error": name, "unit": unit, **_error(match_result, values, slot)}
            for name, (unit, values) in errors.items()
        ]
    )


def _error(match_result: MatchResult, values: FloatArray, slot: IntArray) -> dict[str, Any]:
    weights = match_result.weights
    absolute = np.abs(values)
    sums = np.bincount(slot, absolute, minlength=weights.shape[1])
    counts = np.bincount(slot, minlength=weights.shape[1])
    has_values = len(values) > 0
    mean = float(absolute.mean()) if has_values else math.nan
    replicates = ratio(weights @ sums, weights @ counts)
    low, high = match_result.interval(mean, replicates, counts, most=math.inf)
    return {
        "mean": values.mean() if has_values else math.nan,
        "mean_absolute": mean,
        "low": float(low),
        "high": float(high),
        "absolute_95_percent": np.percentile(absolute, 95) if has_values else math.nan,
        "objects": len(values),
    }


def false_positive_table(match_result: MatchResult, iou: float, *, strict: bool) -> pd.DataFrame:
    """Returns the number of false positives by cause, and their share in percent."""
    names = causes(match_result, iou, strict=strict)
    match_input, weights = match_result.match_input, match_result.weights
    slot = match_result.blocks.slot[match_input.predictions.frame[match_result.false_positive]]
    total = np.bincount(slot, minlength=weights.shape[1])
    rows = []
    for cause in CAUSES:
        counts = np.bincount(slot[names == cause], minlength=weights.shape[1])
        count = int(counts.sum())
        share = 100 * count / len(names) if len(names) > 0 else math.nan
        replicates = 100 * ratio(weights @ counts, weights @ total)
        low, high = map(float, match_result.interval(share, replicates, total))
        rows.append({"cause": cause, "count": count, "share": share, "low": low, "high": high})
    return pd.DataFrame(rows)


def off_region_table(match_input: MatchInput, matches: IntArray) -> pd.DataFrame:
    """Returns the number of unmatched boxes whose centre is outside the region, by minimum score.

    Columns *_per_min are numbers per minute of the frames' time. Columns on_people* count the
    vehicle boxes on labelled pedestrians and cyclists; these boxes are false positives. Counts are
    NaN if no region is known.
    """
    truth, scores = match_input.truth, match_input.predictions.scores
    off = (matches < 0) & ~match_input.prediction_places.inside
    minutes = len(truth.frames) * truth.period_s / 60
    rows = []
    for cut in CUTS:
        row: dict[str, Any] = {"score": cut, "minutes": minutes}
        for name, counted in (("boxes", off), ("on_people", off & match_input.on_people)):
            count = np.count_nonzero(counted & (scores >= cut)) if truth.has_region else math.nan
            row |= {name: count, f"{name}_per_min": count / minutes}
        rows.append(row)
    return pd.DataFrame(rows)
