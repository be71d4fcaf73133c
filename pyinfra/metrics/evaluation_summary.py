"""The summary of an evaluation on the terminal."""

from __future__ import annotations

import math

from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY


def summary(evaluation: Evaluation) -> str:
    """AP, areas and causes of false positives as lines of text."""
    lines = [f"{evaluation.truth.name}: {len(evaluation.truth.frames)} frames"]
    iou = [f"{v:g}" if v > 0 else "" for v in evaluation.ap.iou]  # none where centres decide
    head = f"{'class':<12}{'ground truth':<14}{'IoU':>5} {'protocol':<15}{'AP':>6}  "
    lines.append(f"{head}{'95 % interval':<16}{'objects':>8}{'predictions':>12}")
    lines += [
        f"{row['class']:<12}{row.ground_truth:<14}{iou[at]:>5} {row.protocol:<15}{row.ap:>6.2f}  "
        f"{_span(row.ap_low, row.ap_high):<16}{row.objects:>8}{row.predictions:>12}"
        for at, (_, row) in enumerate(evaluation.ap.iterrows())
    ]
    wide = max([12, *(len(road) + 1 for road in evaluation.areas.road)])
    lines.append(f"high-quality areas (AP > {HIGH_QUALITY:g}), undecided ones included")
    lines += [
        f"{row.road:<{wide}}{row.ground_truth:<14}{row.n_hqda:>5} of {row.n_tda:>3} "
        f"{row.p_hqda:>15.1f} %  {_span(row.p_low, row.p_high):<16}{row.undecided:>3} undecided"
        for _, row in evaluation.areas.iterrows()
    ]
    for which, rows in evaluation.false_positives.groupby("ground_truth", sort=False):
        causes = zip(rows["cause"], rows["count"], strict=True)
        listed = ", ".join(f"{count} {cause}" for cause, count in causes)
        lines.append(f"false positives, {which}: {listed}")
    if "difference" in evaluation.distance_ap:
        worst = evaluation.distance_ap.difference.abs().max()
        lines.append(f"cutting before matching changes the AP of a window by up to {worst:.2f}")
    return "\n".join(lines)


def _span(low: float, high: float) -> str:
    return "no interval" if math.isnan(low) else f"{low:.2f} to {high:.2f}"
