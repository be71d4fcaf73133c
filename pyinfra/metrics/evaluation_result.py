"""The result of an evaluation: its tables, and methods that save, plot and print them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.files import alone
from pyinfra.core.names import StrPath, path_of
from pyinfra.core.present import Presented
from pyinfra.core.vocabulary import Subset
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.formats.csv_table import write_tables
from pyinfra.formats.earlier_names import existing
from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.evaluation_tables import (
    HIGH_QUALITY,
    shown_ap,
)
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.match_input import are_people, match_input
from pyinfra.metrics.match_results import MatchResult, primary_results
from pyinfra.metrics.match_tables import match_table, rings
from pyinfra.metrics.prediction_checks import Finding
from pyinfra.metrics.row_selection import AP_R1000
from pyinfra.metrics.settings import Settings

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEEN_AND_PRESENT: tuple[Subset, Subset] = ("all", "present")
MEASURES = {"definition": AP_R1000, "r11": "AP (R11)", "kitti": "AP (R40), devkit"}

OPTIONAL = ("cells", "ranges")  # tables that only some evaluations have


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
        named = {"lidar": self.truth.name, "frames": len(self.truth.frames), "class": row["class"]}
        ap = f"{value:.1f} {_span(low, high)} of {row.objects} {row.ground_truth}"
        return named | {"ap": ap, "findings": len(self.findings)}

    @cached_property
    def by_distance(self) -> pd.DataFrame:
        """AP (R1000) in rings of 20 m around the sensor, for each ground-truth subset.

        Columns: ground_truth, distance_m (middle of the ring, horizontal), ap_r1000,
        ap_r1000_low and ap_r1000_high (95 % interval), objects, predictions.
        """
        rows = []
        for which, result in self._results.items():
            rows += [{"ground_truth": which, **row} for row, _ in rings(result)]
        return pd.DataFrame(rows)

    def save(self, folder: StrPath) -> list[Path]:
        """Writes the tables as CSV files to a folder, and returns the files."""
        path = path_of(folder, "folder")
        with alone(path):
            # Old files are removed first. Otherwise they could remain next to the new AP if this
            # evaluation has no such table, or if the process is interrupted.
            for name in ("replicates", *OPTIONAL):
                existing(path / f"{name}.csv").unlink(missing_ok=True)
            return write_tables(path, self.tables())

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draws AP (R1000) by distance, as `plot_ap_by_distance`."""
        import pyinfra

        return pyinfra.plot_ap_by_distance(self, ax=ax)

    def rings(self, which: str) -> dict[float, Bootstrapped]:
        """Returns AP (R1000) of the rings of a ground-truth subset, by the middle of the ring."""
        return {row["distance_m"]: figure for row, figure in rings(self._results[which])}

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
        one = match_input(self.truth, self.predictions, first, self.settings, metric)
        return {str(k): result for k, result in primary_results(one, self.settings).items()}

    def tables(self) -> dict[str, pd.DataFrame]:
        names = "ap pr_curve distance_ap areas errors false_positives replicates off_region".split()
        tables = {name: getattr(self, name) for name in names}
        more = {name: getattr(self, name) for name in OPTIONAL}
        return {**tables, **{name: rows for name, rows in more.items() if rows is not None}}


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

    The first number is for boxes with at least the lowest score of the table. The second number
    is for boxes with a score of 0.5 or more.
    """
    shown = [row for row in rows.itertuples() if row.score in (rows.score.min(), 0.5)]
    return ", ".join(
        f"{row.boxes_per_min:.1f} from score {row.score:g} ({row.on_people_per_min:.1f} on people)"
        for row in shown
    )


def _span(low: float, high: float) -> str:
    return "no interval" if math.isnan(low) else f"[{low:.1f}, {high:.1f}]"
