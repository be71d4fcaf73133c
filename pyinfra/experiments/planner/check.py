"""Simulates the best options of a plan in full and measures what the detector finds.

The frames are some of those of the predictions, which the choice has not used. Several LiDARs are
fused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.dataset import simulation
from pyinfra.dataset.world_frame import to_world
from pyinfra.experiments.planner.answer import LATER, OTHER, false_boxes
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.measure import Measured, measure
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.metrics.evaluation_result import Evaluation

FRAMES = 30
YAW_ERROR_DEG = 0.5
BEST = 3  # options that are simulated, and one more of another kind


@dataclass(frozen=True)
class Checked:
    """Measured figures of an option; shares in percent, NaN without objects."""

    ap: float
    ap_low: float
    ap_high: float
    recall: float
    people_recall: float
    false_per_frame: float
    position_m: float  # 95 % of the positions of found vehicles are within this distance


def to_check(options: pd.DataFrame, best: int = BEST) -> list[int]:
    """Returns the numbers of the best options, and of the best one of another kind.

    The kind of an option is its LiDARs, and its number of poles.
    """
    first = options.drop_duplicates("option").option.tolist()[:best]
    kinds = options.groupby("option").agg(lidars=("lidar", lambda x: tuple(sorted(x))))
    poles = options.drop_duplicates("option").set_index("option").poles
    kind = [(kinds.lidars[one], poles[one]) for one in kinds.index]
    chosen = {kind[one - 1] for one in first}
    other = next((n for n, one in zip(kinds.index, kind, strict=True) if one not in chosen), None)
    return first if other is None else [*first, int(other)]


@dataclass(frozen=True)
class YawError:
    """Measured recall (percent) of an option with and without an error of the assumed yaw."""

    option: int
    with_error: float
    without: float


def check(
    site: PlanSite,
    options: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    detector: str,
    within_m: float,
    *,
    frames: int = FRAMES,
    progress: Callable[[str], None] = lambda _: None,
) -> pd.DataFrame:
    """Returns the options with the measured figures of those that were simulated."""
    numbers = site.other_frames(frames)
    out = options.copy()
    for number in to_check(options):
        rows = out.option == number
        parts = units_at(options, number, lidars)
        result = measure(site, parts, numbers, detector, seed=site.other_seed)
        cut = float(out[rows].score.iloc[0])
        one = figures(result, site.centre, within_m, cut)
        out.loc[rows, ["ap_simulated", "ap_simulated_low", "ap_simulated_high"]] = [
            one.ap,
            one.ap_low,
            one.ap_high,
        ]
        out.loc[rows, "recall_simulated"] = one.recall
        out.loc[rows, "people_recall_simulated"] = one.people_recall
        out.loc[rows, "false_per_frame_simulated"] = one.false_per_frame
        out.loc[rows, "position_m_simulated"] = one.position_m
        progress(f"option {number}: AP {one.ap:.1f} simulated")
    return out


def check_yaw(
    site: PlanSite,
    options: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    detector: str,
    within_m: float,
    *,
    frames: int = FRAMES,
) -> list[YawError]:
    """Returns what option 1 and the last simulated option find with an error of the yaw.

    The boxes are compared with the true positions of the vehicles, so that the error counts for a
    single LiDAR too. Several LiDARs are turned alternately to the left and to the right.
    """
    first = options.drop_duplicates("option").set_index("option")
    out = []
    for number in dict.fromkeys((1, to_check(options)[-1])):
        result = measure(
            site,
            units_at(options, number, lidars),
            site.other_frames(frames),
            detector,
            seed=site.other_seed,
            yaw_error_deg=YAW_ERROR_DEG,
        )
        cut = float(first.score[number])
        recall = recall_near(result.vehicles, site.centre, within_m, cut)
        out.append(YawError(number, recall, float(first.recall_simulated[number])))
    return out


def units_at(
    options: pd.DataFrame, number: int, lidars: Sequence[PlanLidar]
) -> list[tuple[list[float], simulation.Lidar]]:
    """Returns pose and LiDAR of each unit of an option."""
    units = {lidar.name: lidar.unit for lidar in lidars}
    rows = options[options.option == number]
    return [(list(row[POSE].to_numpy(float)), units[row.lidar]) for _, row in rows.iterrows()]


def figures(result: Measured, centre: FloatArray, within_m: float, cut: float) -> Checked:
    """Returns the figures of an option for boxes of a score of `cut` or above."""
    ap = result.vehicles.ap.iloc[0]
    false = result.false_scores()
    return Checked(
        float(ap.ap_r1000),
        float(ap.ap_r1000_low),
        float(ap.ap_r1000_high),
        recall_near(result.vehicles, centre, within_m, cut),
        recall_near(result.people, centre, within_m, cut) if result.people else float("nan"),
        float((false >= cut).sum() / result.frames),
        position_error(result.vehicles, cut),
    )


def recall_near(result: Evaluation, centre: FloatArray, within_m: float, cut: float) -> float:
    """Returns the percent of the present objects near the centre that have a box."""
    matches = result.matches
    counted = matches[matches.outcome.isin(["true positive", "missed"])]
    near = counted[_near(result, counted, centre, within_m)]
    if near.empty:
        return float("nan")
    return float(100 * ((near.outcome == "true positive") & (near.score >= cut)).mean())


def position_error(result: Evaluation, cut: float) -> float:
    """Returns the 95th percentile of the distance from a box to its vehicle, metres."""
    matches = result.matches
    detected = matches[(matches.outcome == "true positive") & (matches.score >= cut)]
    vehicles, numbers = result.truth.vehicles, np.array(result.truth.frames)
    truth = pd.DataFrame(
        {
            "frame": numbers[vehicles.frame],
            "object_id": vehicles.ids,
            "true_x": vehicles.boxes[:, 0],
            "true_y": vehicles.boxes[:, 1],
        }
    )
    both = detected.merge(truth, on=["frame", "object_id"])
    if both.empty:
        return float("nan")
    return float(np.hypot(both.x - both.true_x, both.y - both.true_y).quantile(0.95))


def _near(result: Evaluation, rows: pd.DataFrame, centre: FloatArray, within_m: float) -> BoolArray:
    lidar = result.truth.lidar
    xy = rows[["x", "y"]].to_numpy(float)
    world = xy if lidar is None else to_world(xy, lidar.T_world_levelled)
    return np.asarray(np.hypot(*(world - centre).T) <= within_m)


def checked_lines(
    options: pd.DataFrame, request: Request, frames: int, *, recorded: bool
) -> Iterator[str]:
    """Yields prediction and measurement of each option that was simulated in full."""
    first = options.drop_duplicates("option")
    done = first[first.ap_simulated.notna()]
    if len(done):
        yield f"Simulated in full {LATER if recorded else OTHER}, {frames} frames each:"
    for row in done.itertuples():
        if math.isnan(row.recall_simulated):
            yield f"Option {row.option}: no vehicle is within {request.within_m:g} m."
            continue
        people, positions, ap_ends = "", "", ""
        if math.isfinite(row.people_recall_simulated):
            people = f" and {row.people_recall_simulated:.0f} of 100 pedestrians"
        if math.isfinite(row.position_m_simulated):
            positions = f", 95 % of the positions within {row.position_m_simulated:.1f} m"
        if math.isfinite(row.ap_simulated_low):
            ap_ends = f" [{row.ap_simulated_low:.0f} to {row.ap_simulated_high:.0f}]"
        yield (
            f"Option {row.option}: finds {row.recall_simulated:.0f} of 100 vehicles (predicted "
            f"{row.recall:.0f}){people} within {request.within_m:g} m, "
            f"{false_boxes(row.false_per_frame_simulated)}{positions}; AP {row.ap_simulated:.0f}"
            f"{ap_ends} (predicted {row.ap_predicted:.0f})."
        )
