"""`pyinfra.evaluate`: the average precision (AP) of predictions, step by step.

The steps stand in this file in their order. Each is explained where its function is defined.

1. Frames, predictions and settings are read (evaluation_input.py), the vehicles with their places
   and visibility too (ground_truth.py), and suspicious input is noted (prediction_checks.py).
2. The vehicles and predictions of each class are paired where they overlap (match_input.py).
3. Predictions are matched in the order of their scores, each with the free vehicle that it overlaps
   most (matching.py).
4. Each prediction becomes a true positive, a false positive or ignored, and each vehicle counts or
   not, for each subset of the ground truth (match_results.py).
5. AP is computed from the ranking by score (ap.py), for all frames and for each replicate of a
   bootstrap.
6. The replicates, which resample blocks of time, give the 95 % interval (intervals.py).
7. The tables are made (evaluation_tables.py), and warnings about the results (result_checks.py).

Predictions can come from any detector, as KITTI result files or as CSV in the LiDAR frame. The
rules are in the section "AP and matching" of docs/conventions/evaluation.md.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error, FindingWarning
from pyinfra.core.public import CALLER, public
from pyinfra.dataset.frame_readers import read_cameras, read_predictions
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.dataset.frames import frame_numbers
from pyinfra.metrics.evaluation_input import (
    chosen_frames,
    predictions_in,
    settings_of,
)
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.evaluation_tables import (
    AP_COLUMNS,
    EVERYWHERE,
    ap_row,
    area_table,
    cell_table,
    cut_first_ap,
    distance_table,
    error_table,
    false_positive_table,
    off_region_table,
    pr_table,
)
from pyinfra.metrics.ground_truth import GroundTruth, ground_truth_of, read_ground_truth
from pyinfra.metrics.ground_truth_checks import ground_truth_findings
from pyinfra.metrics.match_input import MatchInput, match_input
from pyinfra.metrics.match_results import MatchResult, count_matches, primary_results
from pyinfra.metrics.match_tables import by_range
from pyinfra.metrics.matching import Metric, threshold_of
from pyinfra.metrics.prediction_checks import (
    Finding,
    check_predictions,
    few_predicted,
    find_files,
)
from pyinfra.metrics.prediction_table import AnyPredictions
from pyinfra.metrics.replicates import figures, measure_of, replicate_rows, same_of
from pyinfra.metrics.result_checks import result_warnings
from pyinfra.metrics.settings import Settings

SEEN_IN_TABLES = ("few-blocks",)  # warnings not issued, because the tables show NaN


@public()
def evaluate(
    gt: FrameSequence | str | os.PathLike[str],
    pred: AnyPredictions,
    settings: Settings | None = None,
    *,
    object_class: str | None = None,
    frames: Sequence[int] | None = None,
    split: str | None = None,
    allow_missing: bool = False,
    ranges: bool = False,
) -> Evaluation:
    """Computes the average precision (AP) of predictions, with intervals.

    Parameters
    ----------
    gt : frames in memory (`simulate`, `load_dataset`), or a LiDAR's folder
    pred : a table with the columns frame, type, x y z dx dy dz heading, score (levelled LiDAR
        frame, metres, radians), or a folder of KITTI results or CSV files. Or a list with the boxes
        of each frame, or a dict from frame numbers to boxes, which are whatever a detector may
        return to `detect`
    settings : classes, ground-truth subsets, thresholds; by default vehicles at BEV IoU 0.5
    object_class : a name of OBJECT_CLASSES (`vehicle`, `pedestrian`, `cyclist`), by default
        `vehicle`. Give either this or `settings`
    frames : frame numbers to evaluate; by default all frames in memory, or all frames of the split.
        Give either this or `split`
    split : name of a list in the folder's ImageSets, or `all`; by default `val` if it exists
    allow_missing : whether a frame without a prediction file counts as a frame without boxes
    ranges : whether to also compute AP and recall within 10, 20 ... 100 m of the sensor
        (`result.ranges`)

    Returns
    -------
    Tables: `result.ap`, `result.by_distance`, `result.matches`, `result.distance_ap` (along the
    roads), `result.areas`, `result.errors`, `result.pr_curve`, and `result.findings`. Suspicious
    input is also a warning: headings in degrees, boxes far from all vehicles or at another height,
    frames without predictions.

    Raises
    ------
    Error : for a table with a missing column, a value out of range or a frame that is not
        evaluated, and for arguments that exclude each other
    FormatError : for an invalid file, with its line
    FileNotFoundError : for a folder without frames or predictions

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 500, 100))
    >>> perfect = frames.labels.assign(score=1.0)
    >>> float(pi.evaluate(frames, perfect).ap.ap_r1000.iloc[0])
    100.0
    """
    result = evaluated(
        gt,
        pred,
        settings,
        object_class=object_class,
        frames=frames,
        split=split,
        allow_missing=allow_missing,
        ranges=ranges,
    )
    for finding in result.findings:
        if finding.level != "note" and finding.name not in SEEN_IN_TABLES:
            warnings.warn(f"{finding.name}: {finding.text}", FindingWarning, stacklevel=CALLER)
    return result


@public()
def evaluated(
    gt: FrameSequence | str | os.PathLike[str],
    pred: AnyPredictions,
    settings: Settings | None = None,
    *,
    object_class: str | None = None,
    frames: Sequence[int] | None = None,
    split: str | None = None,
    allow_missing: bool = False,
    ranges: bool = False,
) -> Evaluation:
    """Returns the result of `evaluate`, whose findings are no warnings here."""
    if settings and object_class:
        raise Error("object_class: use object_class or settings, not both")
    if frames is not None and split is not None:
        raise Error("frames: use frames or split, not both")
    in_memory = isinstance(gt, FrameSequence) or not isinstance(pred, (str, os.PathLike))
    sequence = chosen_frames(gt, pred, frames, split)
    folder = sequence.folder if isinstance(sequence, RecordedFrames) else None
    prediction_files, predictions = predictions_in(
        pred, sequence, folder, allow_missing=allow_missing
    )
    truth = ground_truth_of(sequence)
    if settings is None:
        settings = settings_of(object_class or "vehicle", has_objects=truth.has_objects)
    if in_memory and "common" in settings.ground_truths and len(truth.neighbours) < 2:
        raise Error(
            "ground_truths: expected frames of two or more LiDARs for `common`, got one LiDAR"
        )
    if settings.min_points > 1 and not truth.has_objects:
        raise Error(
            f"min_points: expected 1 for labels, got {settings.min_points}; labels have no "
            "numbers of points"
        )
    types, numbers = settings.types, sequence.numbers
    of_types = truth.vehicles.select(np.isin(truth.vehicles.names, types))
    findings = [
        *(ground_truth_findings(folder, numbers, truth.vehicles, types) if folder else ()),
        *prediction_files.findings,
        *few_predicted(predictions, of_types.select(of_types.points > 0), numbers),
        *check_predictions(
            predictions, prediction_files.files, of_types, types, settings.min_score
        ),
    ]
    return evaluate_tables(truth, predictions, settings, findings, ranges=ranges)


def evaluate_tables(
    truth: GroundTruth,
    predictions: Predictions,
    settings: Settings,
    findings: Sequence[Finding] = (),
    *,
    ranges: bool = False,
) -> Evaluation:
    """Evaluates predictions in memory.

    predictions.frame contains indices into truth.frames. ranges: whether to also compute AP and
    recall within ranges of the sensor, except for the subset `common`. The table `replicates` then
    also contains the AP within each range.
    """
    # Step 2: find the predictions and vehicles of each class that overlap.
    match_inputs = {
        (name, metric): match_input(truth, predictions, name, settings, metric)
        for name in settings.classes
        for metric in settings.metrics
    }
    # Steps 3 to 6: compute AP with its interval.
    table = pd.DataFrame(_ap_rows(match_inputs, settings), columns=AP_COLUMNS)
    # Step 7: make the other tables.
    first = next(iter(match_inputs.values()))
    parts = _primary_tables(first, settings, ranges=ranges)
    parts = {name: _named(rows, truth, settings) for name, rows in parts.items()}
    return Evaluation(
        truth=truth,
        ap=table,
        off_region=_off_region(match_inputs, settings),
        findings=(*findings, *result_warnings(table, truth, settings)),
        predictions=predictions,
        settings=settings,
        **parts,
    )


def _ap_rows(
    match_inputs: dict[tuple[str, Metric], MatchInput], settings: Settings
) -> list[dict[str, object]]:
    """Returns the rows of AP, ordered by class, metric, ground truth, threshold and protocol.

    The first row is the primary result.
    """
    rows = []
    for (name, metric), class_input in match_inputs.items():
        ious = settings.ious_of(metric)
        matches = {
            (iou, strict): class_input.match(threshold_of(metric, iou), strict=strict)
            for iou in ious
            for strict in {protocol == "kitti" for protocol in settings.protocols}
        }
        for which in settings.ground_truths:
            for iou in ious:
                for protocol in settings.protocols:
                    matched = matches[iou, protocol == "kitti"]  # step 3: matching
                    # Step 4: find true positives, false positives and ignored predictions.
                    match_result = count_matches(class_input, which, matched, settings.min_points)
                    row = ap_row(match_result, iou, protocol)  # steps 5 and 6: AP and its interval
                    rows.append({"class": name, "ground_truth": which, **row})
    return rows


def _off_region(
    match_inputs: dict[tuple[str, Metric], MatchInput], settings: Settings
) -> pd.DataFrame:
    """Returns table `off_region` of all classes, for the first metric and threshold."""
    metric = settings.metrics[0]
    enough = threshold_of(metric, settings.ious[0])
    parts = []
    for name in settings.classes:
        class_input = match_inputs[name, metric]
        rows = off_region_table(class_input, class_input.match(enough, strict=False))
        rows.insert(0, "lidar", class_input.truth.name)
        rows.insert(1, "class", name)
        parts.append(rows)
    return pd.concat(parts, ignore_index=True)


def _primary_tables(
    one: MatchInput, settings: Settings, *, ranges: bool
) -> dict[str, pd.DataFrame]:
    """Returns all tables except `ap` and `off_region`, with rows for each ground-truth subset.

    The tables use the first class, metric and threshold, and protocol `definition`.
    """
    enough = threshold_of(one.metric, settings.ious[0])
    tables: dict[str, list[pd.DataFrame]] = {}
    for which, match_result in primary_results(one, settings).items():
        distance, replicates = distance_table(match_result, settings.min_objects)
        if settings.cut_first:
            distance["ap_cut_first"] = cut_first_ap(
                one, which, enough, settings.min_points, one.truth.windows()
            )
            distance["difference"] = distance.ap_cut_first - distance.ap_r1000
        areas = (distance, replicates)
        by_table = {"pr_curve": pr_table(match_result), "distance_ap": distance}
        if one.truth.of_lanes:
            areas = cell_table(match_result, settings.min_objects)
            by_table["cells"] = areas[0].copy()
            areas[0].insert(0, "road", EVERYWHERE)
        measures = list(figures(match_result, (distance, replicates), areas))
        if ranges and which != "common":
            near = list(by_range(match_result))
            by_table["ranges"] = pd.DataFrame([row for row, _ in near])
            measures += [(measure_of(row["range_m"]), r1000) for row, r1000 in near]
        same = same_of(one.truth, match_result.blocks, settings.seed) | {
            "types": " ".join(sorted(next(iter(settings.classes.values())))),
            "min_points": settings.min_points if which == "captured" else math.nan,
            "min_score": settings.min_score,
        }
        by_table |= {
            "areas": area_table(match_result, *areas),
            "errors": error_table(match_result),
            "false_positives": false_positive_table(match_result, enough, strict=False),
        }
        for name, rows in by_table.items():
            rows.insert(0, "ground_truth", which)
            tables.setdefault(name, []).append(rows)
        tables.setdefault("replicates", []).append(replicate_rows(same, which, measures))
    return {name: pd.concat(parts, ignore_index=True) for name, parts in tables.items()}


def _named(rows: pd.DataFrame, truth: GroundTruth, settings: Settings) -> pd.DataFrame:
    rows.insert(0, "lidar", truth.name)
    rows.insert(1, "class", next(iter(settings.classes)))
    rows.insert(3, "iou", settings.ious_of(settings.metrics[0])[0])
    return rows


def match_results_of(
    gt: Path,
    pred: Path,
    settings: Settings,
    *,
    frames: Sequence[int] | None = None,
    split: str | None = None,
) -> list[MatchResult]:
    """Returns the match result of each ground-truth subset in the settings.

    Boxes are matched by the IoU of their footprints, for the first class and the first threshold of
    the settings. The arguments `frames` and `split` and the exceptions are as in `evaluate`.
    """
    frames = frame_numbers(gt, split) if frames is None else sorted(frames)
    truth = read_ground_truth(gt, frames, beyond_range=True)
    files = find_files(pred, frames, frame_numbers(gt, "all"), lidar_folder=gt).files
    predictions = read_predictions(files, read_cameras(gt, frames))
    one = match_input(truth, predictions, next(iter(settings.classes)), settings, "bev")
    return list(primary_results(one, settings).values())
