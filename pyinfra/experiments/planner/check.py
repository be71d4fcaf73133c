"""Simulates options of a plan in full, and measures what the detector finds.

The frames are of traffic that neither the choice nor the predictions have used: of three further
traffic seeds or, for recorded traffic, of its last third. Several LiDARs are fused.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.dataset import simulation
from pyinfra.dataset.world_frame import to_world
from pyinfra.experiments.planner.areas import weighted
from pyinfra.experiments.planner.measure import Measured, measure
from pyinfra.experiments.planner.predict import UNKNOWN
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.planner.verdict import SIMULATED, Standing
from pyinfra.metrics.comparison import Interval
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.intervals import student

FRAMES = 30
SEEDS = 3  # of the traffic
YAW_ERROR_DEG = 0.5

Parts = Sequence[tuple[Sequence[float], simulation.Lidar]]  # pose and LiDAR of each unit
Counted = Callable[[pd.DataFrame], np.ndarray]  # which objects count for a goal


@dataclass(frozen=True, eq=False)
class Found:
    """The objects in the frames of a simulated option, and which of them have a box."""

    objects: pd.DataFrame  # frame (index), person, x, y (world), found, away (of its box, metres)
    frames: int
    false: FloatArray  # (frames,) false boxes of each frame
    ap: Interval
    position_m: float


def traffic_of(site: PlanSite, frames: int) -> list[tuple[int, tuple[int, ...]]]:
    """Returns the traffic seeds of a simulation, and the frames of each."""
    order = site.other_frames(frames)
    if site.recorded:
        return [(site.other_seed, order)]
    seeds = min(SEEDS, len(order))
    return [(site.other_seed + 1 + k, order[k::seeds]) for k in range(seeds)]


def simulate_option(
    site: PlanSite,
    parts: Parts,
    detector: str,
    cut: float,
    frames: int = FRAMES,
    *,
    traffic: Sequence[tuple[int, tuple[int, ...]]] = (),
    scene: Mapping[str, object] | None = None,
    yaw_error_deg: float = 0.0,
) -> Found:
    """Simulates an option, and returns what boxes of a score of `cut` or above find.

    traffic: seeds and the frames of each; by default those of `traffic_of`. scene: overrides of
    keys of the scene. yaw_error_deg: error of the assumed yaw of each LiDAR; several LiDARs are
    turned alternately to the left and to the right.
    """
    tables, false, aps, start = [], [], [], 0
    for seed, numbers in traffic or traffic_of(site, frames):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".* used on frames")  # the answer says it once
            result = measure(
                site, parts, numbers, detector, seed=seed, scene=scene, yaw_error_deg=yaw_error_deg
            )
        at = {number: start + k for k, number in enumerate(sorted(numbers))}
        start += len(numbers)
        for one in (result.vehicles, result.people):
            if one is not None:
                objects = _objects(one, cut)
                tables.append(objects.assign(frame=objects.frame.map(at)))
        false.append(_false(result, sorted(numbers), cut))
        aps.append(result.vehicles.ap.iloc[0])
    every = pd.concat(tables, ignore_index=True)
    away = every.away[every.found & ~every.person]
    return Found(
        every,
        start,
        np.concatenate(false),
        _mean_ap(aps),
        float(away.quantile(0.95)) if len(away) else math.nan,
    )


def _objects(result: Evaluation, cut: float) -> pd.DataFrame:
    """Returns the objects that count: frame, person, x, y (world frame), found, away."""
    vehicles, numbers = result.truth.vehicles, np.array(result.truth.frames)
    xy = vehicles.boxes[:, :2]
    truth = pd.DataFrame(
        {"frame": numbers[vehicles.frame], "object_id": vehicles.ids, "true_x": xy[:, 0],
         "true_y": xy[:, 1], "person": np.array(vehicles.names) == "Pedestrian"}
    )  # fmt: skip
    matches = result.matches[result.matches.outcome.isin(["true positive", "missed"])]
    rows = matches.merge(truth, on=["frame", "object_id"])
    found = (rows.outcome == "true positive") & (rows.score >= cut)
    world = rows[["true_x", "true_y"]].to_numpy(float)
    if (lidar := result.truth.lidar) is not None:
        world = to_world(world, lidar.T_world_levelled)
    away = np.hypot(rows.x - rows.true_x, rows.y - rows.true_y)
    return pd.DataFrame(
        {"frame": rows.frame, "person": rows.person, "x": world[:, 0],
         "y": world[:, 1], "found": found, "away": away}
    )  # fmt: skip


def _false(result: Measured, numbers: Sequence[int], cut: float) -> FloatArray:
    matches = result.vehicles.matches
    wrong = matches[(matches.outcome == "false positive") & (matches.score >= cut)]
    counts = wrong.groupby("frame").size().reindex(numbers, fill_value=0)
    return np.asarray(counts, float)


def _mean_ap(rows: Sequence[pd.Series]) -> Interval:
    """Returns the mean AP of the seeds, with the variance of its time blocks and of the seeds."""
    values = np.array([row.ap_r1000 for row in rows], float)
    values = values[np.isfinite(values)]
    if not len(values):
        return UNKNOWN
    mean, half = float(values.mean()), math.nan
    if len(values) > 1:
        half = float(student(len(values)) * values.std(ddof=1) / len(values) ** 0.5)
    elif math.isfinite(rows[0].ap_r1000_low):
        half = float(rows[0].ap_r1000_high - rows[0].ap_r1000_low) / 2
    return Interval(mean, max(0.0, mean - half), min(100.0, mean + half))


def share(found: Found, counted: np.ndarray) -> Interval:
    """Returns the share of the counted objects that is found, for an hour of other traffic.

    The interval has the frames as clusters. Its variance is at least that of independent objects.
    """
    some = found.objects[counted]
    total = len(some)
    if total == 0:
        return UNKNOWN
    value = float(some.found.mean())
    sums = np.bincount(some.frame, some.found, found.frames)
    counts = np.bincount(some.frame, minlength=found.frames)
    n = max(found.frames, 2)
    clusters = float((sums - value * counts).var(ddof=1)) * n / total**2 if found.frames > 1 else 1
    smoothed = (some.found.sum() + 1) / (total + 2)
    variance = max(clusters, float(smoothed * (1 - smoothed)) / total)
    half = student(n) * math.sqrt(variance)
    return Interval(value, max(0.0, value - half), min(1.0, value + half))


def false_rate(found: Found) -> Interval:
    """Returns the false boxes of a frame."""
    value, n = float(found.false.mean()), max(found.frames, 2)
    variance = max(float(found.false.var(ddof=1)) if found.frames > 1 else value, value, 1 / n) / n
    half = student(n) * math.sqrt(variance)
    return Interval(value, max(0.0, value - half), value + half)


def near_of(objects: pd.DataFrame, site: PlanSite, within_m: float) -> BoolArray:
    """Returns which objects are within a distance of the centre of the site: (n,)."""
    away = np.hypot(objects.x - site.centre[0], objects.y - site.centre[1])
    return np.asarray(away <= within_m)


def near_vehicles(found: Found, site: PlanSite, within_m: float) -> BoolArray:
    """Returns which objects are vehicles within a distance of the centre of the site: (n,)."""
    near = near_of(found.objects, site, within_m)
    return np.asarray(near & ~found.objects.person.to_numpy(bool))


def standing(
    found: Found, goals: Mapping[str, Counted], site: PlanSite, request: Request
) -> Standing:
    """Returns the measured figures of an option. goals: which objects count, by column."""
    objects = found.objects
    near, person = near_of(objects, site, request.within_m), objects.person.to_numpy(bool)
    weight = weighted(objects, np.where(person, request.people, 1.0) * near, request.areas)
    return Standing(
        share(found, near & ~person),
        share(found, near & person),
        {name: share(found, counted(objects)) for name, counted in goals.items()},
        float((weight * objects.found).sum() / max(weight.sum(), 1e-12)),
        false_rate(found),
        found.ap,
        found.position_m,
        SIMULATED,
    )


def paired(before: Found, after: Found, site: PlanSite, within_m: float) -> Interval:
    """Returns by how much the share of the vehicles within a distance changes, -1 to 1.

    Both are of the same frames. The interval is over the frames, in each of which the difference
    counts by the number of its vehicles.
    """

    def per_frame(one: Found) -> tuple[FloatArray, FloatArray]:
        some = one.objects[near_vehicles(one, site, within_m)]
        return (
            np.bincount(some.frame, some.found, one.frames).astype(float),
            np.bincount(some.frame, minlength=one.frames).astype(float),
        )

    (a, of_a), (b, of_b) = per_frame(before), per_frame(after)
    if not of_a.sum() or not of_b.sum():
        return UNKNOWN
    first, then, n = a.sum() / of_a.sum(), b.sum() / of_b.sum(), max(before.frames, 2)
    parts = (b - then * of_b) / of_b.sum() - (a - first * of_a) / of_a.sum()
    half = student(n) * math.sqrt(n * parts.var(ddof=1)) if n > 1 else 1.0
    return Interval(float(then - first), float(then - first - half), float(then - first + half))
