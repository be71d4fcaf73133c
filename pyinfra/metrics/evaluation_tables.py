"""Tables of an evaluation. AP and shares are 0 to 100; low and high are 95 % interval ends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray, FloatArray, IntArray
from pyinfra.core.vocabulary import Subset
from pyinfra.dataset.regions import EVERY_ROAD, Window
from pyinfra.metrics import ap
from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.label_free_quality import CUTS
from pyinfra.metrics.match_results import (
    CAUSES,
    Contest,
    Judgement,
    Protocol,
    causes,
    judge,
    precision,
)

EVERYWHERE = "all"  # in column `road`: all roads together
LANES = "(lanes)"  # in column `road`: all lanes of a site together; no road has this name
HIGH_QUALITY = 85.0  # AP above which an area has high quality
PR_RECALLS = 100
AP_COLUMNS = (
    "class ground_truth iou protocol ap ap_low ap_high ap_fine ap_fine_low ap_fine_high "
    "objects predictions frames block_s"
).split()
# Quality of an area: `high` or `low` if its whole interval is above or below HIGH_QUALITY, else
# `undecided`; `few` if it has too few objects.
QUALITIES = ("high", "undecided", "low", "few")


def ap_row(judgement: Judgement, iou: float, protocol: Protocol) -> dict[str, Any]:
    """Returns the row of AP over all frames, without the columns class and ground_truth."""
    ranking = judgement.ranking()
    value, low, high = _ap_with_interval(judgement, ranking, protocol)[:3]
    metric = judgement.contest.metric
    return {
        "iou": iou,
        "protocol": protocol if metric == "bev" else f"{protocol}-{metric}",
        "ap": value,
        "ap_low": low,
        "ap_high": high,
        **fine_columns(judgement, fine_ap(judgement)),
        "objects": judgement.objects,
        "predictions": len(ranking.slot),
        "frames": len(judgement.contest.truth.frames),
        "block_s": judgement.blocks.block_s,
    }


def fine_ap(judgement: Judgement, ranking: ap.Ranking | None = None) -> Bootstrapped:
    """Returns AP (R1000) over all frames, with its replicates.

    ranking: that of a part of the region; by default of the whole region.
    """
    ranking = judgement.ranking() if ranking is None else ranking
    value = float(ap.average_precision(ranking, ap.FINE_RECALLS)[0])
    draws = ap.average_precision(ranking, ap.FINE_RECALLS, judgement.weights)
    return Bootstrapped(value, draws, judgement.blocks.count)


def fine_columns(
    judgement: Judgement, fine: Bootstrapped, ranking: ap.Ranking | None = None
) -> dict[str, float]:
    """Returns the columns of AP (R1000) and its interval, which is clipped to 0 to 100."""
    ranking = judgement.ranking() if ranking is None else ranking
    low, high = judgement.interval(fine.value, fine.draws, ranking.objects)
    return {"ap_fine": fine.value, "ap_fine_low": float(low), "ap_fine_high": float(high)}


def shown_ap(row: Any) -> tuple[float, float, float]:
    """Returns the AP to show for a row of `ap.csv`, with the ends of its interval.

    It is AP (R1000) for protocol `definition`, and the AP of the protocol for others.
    """
    if str(row.protocol).startswith("definition"):
        return row.ap_fine, row.ap_fine_low, row.ap_fine_high
    return row.ap, row.ap_low, row.ap_high


def pr_table(judgement: Judgement) -> pd.DataFrame:
    """Returns the highest precision at or above the recalls 0.01 .. 1; 0 if not reached.

    Column score is the score of the operating point at which a recall is reached.
    """
    ranking = judgement.ranking()
    recalls = np.arange(1, PR_RECALLS + 1)
    value = ap.precision_at_recalls(ranking, PR_RECALLS)[0]
    draws = ap.precision_at_recalls(ranking, PR_RECALLS, weights=judgement.weights)
    low, high = judgement.interval(100 * value, 100 * draws, ranking.objects)
    needed = -(-recalls * judgement.objects // PR_RECALLS)
    at = np.searchsorted(ranking.hits_upto, needed)
    score = np.append(ranking.scores, np.nan)[at]
    ends = {"precision_low": low / 100, "precision_high": high / 100}
    columns = {"precision": value, **ends, "score": score}
    return pd.DataFrame({"recall": recalls / PR_RECALLS, **columns})


def distance_table(judgement: Judgement, min_objects: int) -> tuple[pd.DataFrame, FloatArray]:
    """Returns AP (R40) and AP (R1000) of each window, and the replicates of the latter.

    The replicates are (windows, replicates).
    """
    truth = judgement.contest.truth
    names = dict(enumerate(road.name for road in truth.roads)) or {0: "distance"}
    names[EVERY_ROAD] = LANES
    windows = {w: {"road": names[w.road], "s": w.middle} for w in truth.windows()}
    return _ap_of(judgement, windows, min_objects)


def cell_table(judgement: Judgement, min_objects: int) -> tuple[pd.DataFrame, FloatArray]:
    """Returns AP and replicates of each grid cell, as `distance_table` does of each window.

    Columns x, y are the middle of a cell, distance_m its distance from the sensor.
    """
    truth = judgement.contest.truth
    pose = truth.lidar.T_world_levelled if truth.lidar else None
    cells = {
        cell: {
            "x": cell.x,
            "y": cell.y,
            "distance_m": math.hypot(cell.x - pose.x, cell.y - pose.y) if pose else math.nan,
        }
        for cell in truth.cells()
    }
    return _ap_of(judgement, cells, min_objects)


def _ap_of(
    judgement: Judgement, parts: Mapping[Any, dict[str, Any]], min_objects: int
) -> tuple[pd.DataFrame, FloatArray]:
    """Returns a row for each window or grid cell, and the replicates of its AP (R1000).

    parts: the windows or cells, with the columns that name them.
    """
    rows, draws = [], []
    for part, named in parts.items():
        ranking = judgement.ranking(part)
        (value,), (fine,) = ap.coarse_and_fine(ranking)
        drawn, fine_drawn = ap.coarse_and_fine(ranking, judgement.weights)
        low, high = judgement.interval(value, drawn, ranking.objects)
        fine_low, fine_high = judgement.interval(fine, fine_drawn, ranking.objects)
        row = {
            **named,
            "ap": float(value),
            "ap_low": float(low),
            "ap_high": float(high),
            "ap_fine": float(fine),
            "ap_fine_low": float(fine_low),
            "ap_fine_high": float(fine_high),
            "objects": int(ranking.objects.sum()),
            "predictions": len(ranking.slot),
        }
        row["quality"] = area_quality(row, min_objects)
        rows.append(row)
        draws.append(fine_drawn)
    return pd.DataFrame(rows), np.array(draws)


def cut_first_ap(
    contest: Contest, which: Subset, iou: float, min_points: int, windows: Sequence[Window]
) -> list[float]:
    """Returns AP (R1000) of each window, if boxes outside it are removed before matching."""
    values = []
    for window in windows:
        matches = contest.match(iou, strict=False, within=window)
        alone = judge(contest, which, matches, min_points)
        values.append(float(ap.average_precision(alone.ranking(window), ap.FINE_RECALLS)[0]))
    return values


def area_quality(row: dict[str, Any], min_objects: int) -> str:
    """Returns the quality of an area, one of QUALITIES."""
    if row["objects"] < min_objects:
        return "few"
    if math.isnan(row["ap_fine_low"]) or row["ap_fine_low"] <= HIGH_QUALITY < row["ap_fine_high"]:
        return "undecided"
    return "high" if row["ap_fine"] > HIGH_QUALITY else "low"


def area_table(judgement: Judgement, distance: pd.DataFrame, draws: FloatArray) -> pd.DataFrame:
    """Returns the number of high-quality areas of each road, and of all roads (road `all`).

    n_tda: areas with enough objects. n_hqda: those of them with an AP above HIGH_QUALITY,
    significantly or not. undecided: those of n_tda whose interval includes HIGH_QUALITY, or that
    have no interval.
    """
    names = list(dict.fromkeys(distance.road))
    groups = [(EVERYWHERE, np.ones(len(distance), dtype=np.bool_))] if len(names) > 1 else []
    groups += [(name, (distance.road == name).to_numpy()) for name in names]
    return pd.DataFrame(
        [{"road": name, **_areas(judgement, distance[at], draws[at])} for name, at in groups]
    )


def _areas(judgement: Judgement, distance: pd.DataFrame, draws: FloatArray) -> dict[str, Any]:
    counts = (distance.quality != "few").to_numpy()
    total = int(counts.sum())
    high = int((distance.ap_fine[counts] > HIGH_QUALITY).sum())
    share = 100 * high / total if total > 0 else math.nan
    objects = judgement.per_slot(judgement.contest.vehicles.frame[judgement.counted])
    low, top = judgement.interval(share, high_quality_share(distance, draws), objects)
    return {
        "n_tda": total,
        "n_hqda": high,
        "p_hqda": share,
        "p_low": float(low),
        "p_high": float(top),
        "undecided": int((distance.quality == "undecided").sum()),
        "objects": int(distance.objects.sum()),
    }


def high_quality_share(distance: pd.DataFrame, draws: FloatArray) -> FloatArray:
    """Returns the percentage of high-quality areas in each replicate.

    Only areas with an interval count. It is NaN for a replicate in which no area has an AP.
    """
    shown = ((distance.quality != "few") & distance.ap_fine_low.notna()).to_numpy()
    defined = (~np.isnan(draws[shown])).sum(0)
    return _ratio(100.0 * (draws[shown] > HIGH_QUALITY).sum(0), defined)


def error_table(judgement: Judgement) -> pd.DataFrame:
    """Returns the errors of true positives, prediction less vehicle, along the vehicle's axes.

    ahead, left, up: errors of the centre. heading: error modulo 180 degrees. reversed: share of
    boxes that point backwards. The interval belongs to mean_absolute.
    """
    contest = judgement.contest
    p = contest.predictions.boxes[judgement.hit]
    v = contest.vehicles.boxes[judgement.matches[judgement.hit]]
    dx, dy = p[:, 0] - v[:, 0], p[:, 1] - v[:, 1]
    cos, sin = np.cos(v[:, 6]), np.sin(v[:, 6])
    turn = np.degrees(p[:, 6] - v[:, 6])
    away = (turn + 180) % 360 - 180
    errors = {
        "horizontal": ("m", np.hypot(dx, dy)),
        "ahead": ("m", cos * dx + sin * dy),
        "left": ("m", cos * dy - sin * dx),
        "up": ("m", p[:, 2] - v[:, 2]),
        "length": ("m", p[:, 3] - v[:, 3]),
        "width": ("m", p[:, 4] - v[:, 4]),
        "height": ("m", p[:, 5] - v[:, 5]),
        "heading": ("deg", (turn + 90) % 180 - 90),
        "reversed": ("percent", 100.0 * (np.abs(away) > 90)),
    }
    slot = judgement.blocks.slot[contest.predictions.frame[judgement.hit]]
    return pd.DataFrame(
        [
            {"error": name, "unit": unit, **_error(judgement, values, slot)}
            for name, (unit, values) in errors.items()
        ]
    )


def _error(judgement: Judgement, values: FloatArray, slot: IntArray) -> dict[str, Any]:
    weights = judgement.weights
    absolute = np.abs(values)
    sums = np.bincount(slot, absolute, minlength=weights.shape[1])
    counts = np.bincount(slot, minlength=weights.shape[1])
    some = len(values) > 0
    mean = float(absolute.mean()) if some else math.nan
    drawn = _ratio(weights @ sums, weights @ counts)
    low, high = judgement.interval(mean, drawn, counts, most=math.inf)
    return {
        "mean": values.mean() if some else math.nan,
        "mean_absolute": mean,
        "low": float(low),
        "high": float(high),
        "absolute_95_percent": np.percentile(absolute, 95) if some else math.nan,
        "objects": len(values),
    }


def false_positive_table(judgement: Judgement, iou: float, *, strict: bool) -> pd.DataFrame:
    """Returns the number of false positives by cause, and their share in percent."""
    names = causes(judgement, iou, strict=strict)
    contest, weights = judgement.contest, judgement.weights
    slot = judgement.blocks.slot[contest.predictions.frame[judgement.wrong]]
    total = np.bincount(slot, minlength=weights.shape[1])
    rows = []
    for cause in CAUSES:
        counts = np.bincount(slot[names == cause], minlength=weights.shape[1])
        count = int(counts.sum())
        share = 100 * count / len(names) if len(names) > 0 else math.nan
        drawn = 100 * _ratio(weights @ counts, weights @ total)
        low, high = map(float, judgement.interval(share, drawn, total))
        rows.append({"cause": cause, "count": count, "share": share, "low": low, "high": high})
    return pd.DataFrame(rows)


def off_region_table(contest: Contest, matches: IntArray) -> pd.DataFrame:
    """Returns how many unmatched boxes have their centre outside the region, by least score.

    *_per_min: number per minute of the frames' time. on_people: boxes of vehicles on labelled
    pedestrians and cyclists, which count as false positives. Counts are NaN if no region is known.
    """
    truth, scores = contest.truth, contest.predictions.scores
    off = (matches < 0) & ~contest.prediction_places.inside
    minutes = len(truth.frames) * truth.period_s / 60
    rows = []
    for cut in CUTS:
        row: dict[str, Any] = {"score": cut, "minutes": minutes}
        for name, which in (("boxes", off), ("on_people", off & contest.on_people)):
            count = np.count_nonzero(which & (scores >= cut)) if truth.has_region else math.nan
            row |= {name: count, f"{name}_per_min": count / minutes}
        rows.append(row)
    return pd.DataFrame(rows)


def _ratio(above: AnyArray, below: AnyArray) -> FloatArray:
    out = np.full(above.shape, np.nan)
    return np.asarray(np.divide(above, below, out=out, where=below > 0))


def _ap_with_interval(
    judgement: Judgement, ranking: ap.Ranking, protocol: Protocol
) -> tuple[float, float, float, FloatArray]:
    value = float(precision(ranking, protocol, None)[0])
    draws = precision(ranking, protocol, judgement.weights)
    low, high = judgement.interval(value, draws, ranking.objects)
    return value, float(low), float(high), draws
