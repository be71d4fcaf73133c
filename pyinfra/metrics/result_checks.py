"""Warnings about the results of an evaluation."""

import math

import pandas as pd

from pyinfra.metrics.evaluation_tables import shown_ap
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.intervals import MIN_BLOCKS
from pyinfra.metrics.match_input import are_people, blocks_of
from pyinfra.metrics.matching import CENTRE_M
from pyinfra.metrics.prediction_checks import Finding
from pyinfra.metrics.settings import Settings

KITTI_LEAST = 41  # minimum number of objects for which the AP of KITTI's devkit can reach 100


def result_warnings(table: pd.DataFrame, truth: GroundTruth, settings: Settings) -> list[Finding]:
    """Returns warnings about the results."""
    warnings = []
    kinds = {which == "present" for which in settings.ground_truths}
    blocks_of_kinds = [blocks_of(truth, settings, present=kind) for kind in kinds]
    blocks = max(blocks_of_kinds, key=lambda candidate: candidate.block_s)
    if len(blocks.replicates) == 0:
        text = (
            f"expected {MIN_BLOCKS:g} or more time blocks of {blocks.block_s:g} s (the time that a "
            f"vehicle stays in view), got {blocks.count:.1f}; no intervals are computed"
        )
        warnings.append(("few-blocks", text))
    for name, row in zip(table["class"], table.itertuples(), strict=True):
        kind = name if are_people(settings.classes[name]) else "vehicle"
        near = f"centres within {CENTRE_M:g} m" if math.isnan(row.iou) else f"IoU {row.iou:g}"
        case = f"{row.ground_truth}, {near}, {row.protocol}"
        value = shown_ap(row)[0]
        if math.isnan(value):
            warnings.append(
                ("no-objects", f"{case}: no {kind} is in this subset, so AP is undefined")
            )
        elif value == 0:
            text = f"{case}: AP is 0 for {row.predictions} predictions and {row.objects} {kind}s"
            warnings.append(("ap-zero", f"{text}; `pyinfra validate` checks for common causes"))
        elif str(row.protocol).startswith("kitti") and row.objects < KITTI_LEAST:
            cap = 100 * (row.objects - 1) / (KITTI_LEAST - 1)
            text = f"{case}: with {row.objects} {kind}s, the AP of the devkit cannot exceed {cap:g}"
            warnings.append(("kitti-cap", text))
    return [Finding("warning", name, text) for name, text in warnings]
