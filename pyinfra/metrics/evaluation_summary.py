"""The summary of an evaluation as text for the terminal."""

import math
from typing import Any

import pandas as pd

from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY, shown_ap
from pyinfra.metrics.row_selection import AP_R1000

MEASURES = {"definition": AP_R1000, "r11": "AP (R11)", "kitti": "AP (R40), devkit"}


def summary(evaluation: Evaluation) -> str:
    """Returns AP, high-quality areas and causes of false positives as lines of text."""
    lines = [f"{evaluation.truth.name}: {len(evaluation.truth.frames)} frames"]
    iou = [f"{v:g}" if v > 0 else "" for v in evaluation.ap.iou]  # no IoU for the metric `centre`
    head = f"{'class':<12}{'ground truth':<14}{'IoU':>5} {'measure':<26}{'':>5}  "
    lines.append(f"{head}{'95 % interval':<14}{'objects':>8}{'predictions':>12}  hidden")
    for i, (_, row) in enumerate(evaluation.ap.iterrows()):
        value, low, high = shown_ap(row)
        lines.append(
            f"{row['class']:<12}{row.ground_truth:<14}{iou[i]:>5} {measure(row.protocol):<26}"
            f"{value:>5.1f}  {_span(low, high):<14}{row.objects:>8}{row.predictions:>12}"
            f"{_hidden(evaluation, row)}"
        )
    wide = max([12, *(len(road) + 1 for road in evaluation.areas.road)])
    lines.append(f"high-quality areas ({AP_R1000} > {HIGH_QUALITY:g}), including undecided ones")
    lines += [
        f"{row.road:<{wide}}{row.ground_truth:<14}{row.n_hqda:>5} of {row.n_tda:>3} "
        f"{row.p_hqda:>15.1f} %  {_span(row.p_low, row.p_high):<16}{row.undecided:>3} undecided"
        for _, row in evaluation.areas.iterrows()
    ]
    for which, rows in evaluation.false_positives.groupby("ground_truth", sort=False):
        causes = zip(rows["cause"], rows["count"], strict=True)
        listed = ", ".join(f"{count} {cause}" for cause, count in causes)
        lines.append(f"false positives, {which}: {listed}")
    for name, rows in evaluation.off_region.groupby("class", sort=False):
        if rows.boxes.notna().all():
            lines.append(f"boxes outside the region per minute, {name}: {_off_region(rows)}")
    if "difference" in evaluation.distance_ap:
        lines.append(
            "removing the boxes outside a window before matching changes the AP of the window by "
            f"up to {evaluation.distance_ap.difference.abs().max():.2f}"
        )
    return "\n".join(lines)


def measure(protocol: str) -> str:
    """Returns the name of a protocol's measure, such as `AP (R1000), centre`."""
    name, _, metric = protocol.partition("-")
    return f"{MEASURES[name]}, {metric}" if metric else MEASURES[name]


def _hidden(evaluation: Evaluation, row: Any) -> str:
    """Returns the percentage of hidden objects as text; empty unless the row is of subset `all`."""
    share = evaluation.hidden_percent.get(row["class"], math.nan)
    return f"{share:>6.0f} %" if row.ground_truth == "all" and share >= 0 else ""


def _off_region(rows: pd.DataFrame) -> str:
    """Returns as text the boxes per minute outside the region.

    The first number counts boxes with at least the lowest score of the table. The second number
    counts boxes with a score of 0.5 or more.
    """
    shown = [row for row in rows.itertuples() if row.score in (rows.score.min(), 0.5)]
    return ", ".join(
        f"{row.boxes_per_min:.1f} from score {row.score:g} ({row.on_people_per_min:.1f} on people)"
        for row in shown
    )


def _span(low: float, high: float) -> str:
    return "no interval" if math.isnan(low) else f"[{low:.1f}, {high:.1f}]"
