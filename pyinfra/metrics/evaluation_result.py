"""Computes all tables of an evaluation, and warnings about its results."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.core.names import StrPath, path_of
from pyinfra.core.present import Presented
from pyinfra.core.vocabulary import Subset
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.formats.csv_table import number_text
from pyinfra.metrics.comparison import Bootstrapped
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
    shown_ap,
)
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.intervals import MIN_BLOCKS
from pyinfra.metrics.match_input import MatchInput, are_people, blocks_of, match_input
from pyinfra.metrics.match_results import MatchResult, count_matches
from pyinfra.metrics.match_tables import match_table, ring_rows, rings
from pyinfra.metrics.matching import CENTRE_M, Metric, threshold_of
from pyinfra.metrics.prediction_checks import Finding
from pyinfra.metrics.ranges import by_range
from pyinfra.metrics.replicates import figures, measure_of, replicate_rows, same_of
from pyinfra.metrics.settings import Settings

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEEN_AND_PRESENT: tuple[Subset, Subset] = ("all", "present")
KITTI_LEAST = 41  # with fewer objects the AP of KITTI's devkit cannot reach 100


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Presented):
    """The tables of an evaluation, and findings about its inputs.

    The attribute of a table has the name of its CSV file.
    """

    truth: GroundTruth
    ap: pd.DataFrame
    pr_curve: pd.DataFrame
    distance_ap: pd.DataFrame
    areas: pd.DataFrame
    errors: pd.DataFrame
    false_positives: pd.DataFrame
    replicates: pd.DataFrame
    off_region: pd.DataFrame
    findings: tuple[Finding, ...]
    ranges: pd.DataFrame | None = None  # AP and recall within ranges; None if not requested
    cells: pd.DataFrame | None = (
        None  # AP of each grid cell; None unless the site consists of lanes
    )
    predictions: Predictions | None = None
    settings: Settings | None = None

    def facts(self) -> dict[str, object]:
        row = self.ap.iloc[0]
        value, low, high = shown_ap(row)
        ends = "no interval" if math.isnan(low) else f"[{low:.1f}, {high:.1f}]"
        named = {"lidar": self.truth.name, "frames": len(self.truth.frames), "class": row["class"]}
        ap = f"{value:.1f} {ends} of {row.objects} {row.ground_truth}"
        return named | {"ap": ap, "findings": len(self.findings)}

    @cached_property
    def by_distance(self) -> pd.DataFrame:
        """AP (R1000) in rings of 20 m around the sensor, for each ground-truth subset.

        Columns: ground_truth, distance_m (middle of the ring, horizontal), ap_r1000,
        ap_r1000_low and ap_r1000_high (95 % interval), objects, predictions.
        """
        rows = []
        for which, result in self._results.items():
            rows += [{"ground_truth": which, **row} for row in ring_rows(result)]
        return pd.DataFrame(rows)

    def save(self, folder: StrPath) -> list[Path]:
        """Writes the tables as CSV files to a folder, and returns the files."""
        out, files = path_of(folder, "folder"), []
        out.mkdir(parents=True, exist_ok=True)
        for name, table in self.tables().items():
            files.append(out / f"{name}.csv")
            with replacing(files[-1]) as beside:
                table.to_csv(beside, index=False, float_format=number_text)
        return files

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draws AP (R1000) by distance, as `plot_ap_by_distance`."""
        import pyinfra

        return pyinfra.plot_ap_by_distance(self, ax=ax)

    def rings(self, which: str) -> dict[float, Bootstrapped]:
        """Returns AP (R1000) of the rings of a ground-truth subset, by the middle of the ring."""
        return {middle_m: figure for middle_m, _, figure in rings(self._results[which])}

    @cached_property
    def matches(self) -> pd.DataFrame:
        """Match results of predictions and missed objects.

        The results belong to the first ground-truth subset, metric and threshold of the settings.

        Columns: frame, outcome (`true positive`, `false positive`, `missed`, `ignored`), type,
        x y z dx dy dz heading, score (NaN for a missed object), object_id (-1 if unmatched).
        """
        return match_table(next(iter(self._results.values())))

    @cached_property
    def hidden_percent(self) -> dict[str, float]:
        """Percentage of the region's objects that are hidden from the mount, for each class.

        These objects are in subset `present` but not in `all`. The percentage is NaN if no object
        is in the region. The result is empty if the frames do not list hidden objects.
        """
        if self.settings is None or not self.truth.has_objects:
            return {}
        shares = {}
        for name, types in self.settings.classes.items():
            vehicles = self.truth.vehicles.select(np.isin(self.truth.vehicles.names, types))
            beside_m = FOOTWAYS_M if are_people(types) else 0.0
            places = self.truth.places(vehicles.mid_frame, beside_m)
            visible, present = (
                int(self.truth.counted(which, vehicles, places, self.settings.min_points).sum())
                for which in SEEN_AND_PRESENT
            )
            shares[name] = 100 * (1 - visible / present) if present else math.nan
        return shares

    @cached_property
    def _results(self) -> dict[str, MatchResult]:
        if self.predictions is None or self.settings is None:
            raise Error("result: expected a result of evaluate, got tables without predictions")
        first, metric = next(iter(self.settings.classes)), self.settings.metrics[0]
        class_input = match_input(self.truth, self.predictions, first, self.settings, metric)
        matches = class_input.match(threshold_of(metric, self.settings.ious[0]), strict=False)
        return {
            which: count_matches(class_input, which, matches, self.settings.min_points)
            for which in self.settings.ground_truths
        }

    def tables(self) -> dict[str, pd.DataFrame]:
        names = "ap pr_curve distance_ap areas errors false_positives replicates off_region".split()
        tables = {name: getattr(self, name) for name in names}
        more = {"cells": self.cells, "ranges": self.ranges}
        return {**tables, **{name: rows for name, rows in more.items() if rows is not None}}


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
    match_inputs = {
        (name, metric): match_input(truth, predictions, name, settings, metric)
        for name in settings.classes
        for metric in settings.metrics
    }
    table = pd.DataFrame(_ap_rows(match_inputs, settings), columns=AP_COLUMNS)
    first = next(iter(match_inputs.values()))
    parts = _primary_tables(first, settings, ranges=ranges)
    parts = {name: _named(rows, truth, settings) for name, rows in parts.items()}
    off_region = _off_region(match_inputs, settings)
    all_findings = (*findings, *_warnings(table, truth, settings))
    return Evaluation(
        truth=truth,
        ap=table,
        off_region=off_region,
        findings=all_findings,
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
                    matched = matches[iou, protocol == "kitti"]
                    match_result = count_matches(class_input, which, matched, settings.min_points)
                    row = ap_row(match_result, iou, protocol)
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
    matches = one.match(enough, strict=False)
    tables: dict[str, list[pd.DataFrame]] = {}
    for which in settings.ground_truths:
        match_result = count_matches(one, which, matches, settings.min_points)
        distance, replicates = distance_table(match_result, settings.min_objects)
        if settings.cut_first:
            windows = one.truth.windows()
            cut = cut_first_ap(one, which, enough, settings.min_points, windows)
            distance["ap_cut_first"] = cut
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
        same = same_of(one.truth, match_result.blocks, settings.seed)
        replicate_table = replicate_rows(same, which, measures)
        by_table |= {
            "areas": area_table(match_result, *areas),
            "errors": error_table(match_result),
            "false_positives": false_positive_table(match_result, enough, strict=False),
        }
        for name, rows in by_table.items():
            rows.insert(0, "ground_truth", which)
            tables.setdefault(name, []).append(rows)
        tables.setdefault("replicates", []).append(replicate_table)
    return {name: pd.concat(parts, ignore_index=True) for name, parts in tables.items()}


def _named(rows: pd.DataFrame, truth: GroundTruth, settings: Settings) -> pd.DataFrame:
    rows.insert(0, "lidar", truth.name)
    rows.insert(1, "class", next(iter(settings.classes)))
    rows.insert(3, "iou", settings.ious_of(settings.metrics[0])[0])
    return rows


def _warnings(table: pd.DataFrame, truth: GroundTruth, settings: Settings) -> list[Finding]:
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
            warnings.append(("no-objects", f"{case}: no {kind} counts, so AP is undefined"))
        elif value == 0:
            text = f"{case}: AP is 0 for {row.predictions} predictions and {row.objects} {kind}s"
            warnings.append(("ap-zero", f"{text}; `pyinfra validate` checks for common causes"))
        elif str(row.protocol).startswith("kitti") and row.objects < KITTI_LEAST:
            cap = 100 * (row.objects - 1) / (KITTI_LEAST - 1)
            text = f"{case}: with {row.objects} {kind}s, the AP of the devkit cannot exceed {cap:g}"
            warnings.append(("kitti-cap", text))
    return [Finding("warning", name, text) for name, text in warnings]
