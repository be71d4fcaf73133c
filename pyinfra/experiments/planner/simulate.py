"""Simulates options of a plan in full: what a detector finds, and which passages its tracks count.

The frames are of traffic that neither the choice nor the predictions have used: of three further
traffic seeds or, for recorded traffic, of the last third of the recording. The points of several
LiDARs are fused. Every pose has the evaluation region of the site's mount, so that the same objects
are included for all options.

A share of vehicles that are found in a frame says little about counts: a vehicle that is missed in
some frames is counted if its track continues. For counts, an option is simulated without gaps.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.dataset import simulation
from pyinfra.dataset.fused import fused
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.dataset.world_frame import to_world
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.predict import Z95
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.metrics.comparison import UNKNOWN, Interval, clipped, over_replicates
from pyinfra.metrics.evaluate import evaluated
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.settings import Settings
from pyinfra.models.detectors.background import DEFAULT, Background
from pyinfra.models.inference.boxes_table import TrainedDetector, detect, load_detector
from pyinfra.tracking.evaluation import evaluate_tracks
from pyinfra.tracking.lines import lines_of
from pyinfra.tracking.tracks import track

FRAMES = 30
SEEDS = 3  # number of traffic seeds of a simulation
VEHICLES = Settings(ground_truths=("present",))
PEOPLE = Settings(
    classes={"pedestrian": ("Pedestrian",)}, ground_truths=("present",), metrics=("centre",)
)
REPLICATES, FEWEST = 200, 2  # numbers of bootstrap replicates with and without intervals
LEARNING_FRAMES = 30  # number of frames from which Background learns; they are not measured
SECONDS = 30.0  # duration of the simulated traffic for counts
WITHIN_M = 80.0  # largest distance of the vehicles whose speeds are compared

Parts = Sequence[tuple[Sequence[float], simulation.Lidar]]  # pose and LiDAR of each unit


@dataclass(frozen=True, eq=False)
class Found:
    """The objects in the frames of a simulated option, and which of them have a box."""

    objects: pd.DataFrame  # columns frame, person, x, y (world), found, away (box error, m)
    frames: int
    false: FloatArray  # (frames,) number of false boxes in each frame
    ap: Interval
    position_m: float  # 95th percentile of the position error of found vehicles


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
    """Simulates an option, and returns the objects that boxes with scores of at least `cut` find.

    traffic: seeds and the frames of each; by default those of `traffic_of`. scene: overrides of
    keys of the scene. yaw_error_deg: error of the assumed yaw of each LiDAR; several LiDARs are
    turned alternately to the left and to the right.
    """
    tables, false, aps, start = [], [], [], 0
    replicates = FEWEST if yaw_error_deg else REPLICATES  # no intervals are used with a yaw error
    for seed, numbers in traffic or traffic_of(site, frames):
        alone = [frames_at(site, *part, numbers, seed=seed, scene=scene) for part in parts]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".* used on frames")  # the plan gives this warning
            result = measure_frames(fused(alone, yaw_error_deg), detector, replicates)
        at = {number: start + k for k, number in enumerate(sorted(numbers))}
        start += len(numbers)
        for one in (result.vehicles, result.people):
            if one is not None:
                objects = _objects(one, cut)
                tables.append(objects.assign(frame=objects.frame.map(at)))
        boxes = result.vehicles.matches.query("outcome == 'false positive' and score >= @cut")
        false.append(boxes.groupby("frame").size().reindex(sorted(numbers), fill_value=0))
        aps.append(result.vehicles.ap.iloc[0])
    every = pd.concat(tables, ignore_index=True)
    away = every.away[every.found & ~every.person]
    return Found(
        every,
        start,
        np.concatenate(false).astype(float),
        _mean_ap(aps),
        float(away.quantile(0.95)) if len(away) else math.nan,
    )


def _objects(result: Evaluation, cut: float) -> pd.DataFrame:
    """Returns the rows of `Found.objects` for one evaluation; `frame` is the frame number."""
    vehicles, numbers = result.truth.vehicles, np.array(result.truth.frames)
    xy = vehicles.boxes[:, :2]
    truth = pd.DataFrame(
        {"frame": numbers[vehicles.frame], "object_id": vehicles.ids, "true_x": xy[:, 0],
         "true_y": xy[:, 1], "person": np.array(vehicles.names) == "Pedestrian"}
    )  # fmt: skip
    rows = result.matches.query("outcome in ('true positive', 'missed')")
    rows = rows.merge(truth, on=["frame", "object_id"])
    world = rows[["true_x", "true_y"]].to_numpy(float)
    if (lidar := result.truth.lidar) is not None:
        world = to_world(world, lidar.T_world_levelled)
    return pd.DataFrame(
        {
            "frame": rows.frame,
            "person": rows.person,
            "x": world[:, 0],
            "y": world[:, 1],
            "found": (rows.outcome == "true positive") & (rows.score >= cut),
            "away": np.hypot(rows.x - rows.true_x, rows.y - rows.true_y),
        }
    )


def _mean_ap(rows: Sequence[pd.Series]) -> Interval:
    """Returns the mean AP of the seeds with Student's t interval over the seeds.

    If only one seed has an AP, the half-width is that of the bootstrap interval of this seed.
    """
    known = [row for row in rows if math.isfinite(row.ap_r1000)]
    ap = over_replicates([float(row.ap_r1000) for row in known])
    if len(known) == 1:
        half = float(known[0].ap_r1000_high - known[0].ap_r1000_low) / 2
        ap = Interval(ap.value, ap.value - half, ap.value + half)
    return clipped(ap, 0, 100)


@dataclass(frozen=True, eq=False)
class Measured:
    """The evaluations of a detector in the frames of an option."""

    vehicles: Evaluation
    people: Evaluation | None  # None if the frames have no pedestrians


def frames_at(
    site: PlanSite,
    pose: Sequence[float],
    lidar: simulation.Lidar,
    numbers: Sequence[int],
    *,
    seed: int | None = None,
    scene: Mapping[str, object] | None = None,
    threads: int | None = None,
) -> SimulatedFrames:
    """Returns the frames of a LiDAR at a pose (x y z yaw pitch; m, deg), in ascending order.

    scene: overrides of keys of the scene.
    """
    keys: dict[str, object] = dict(scene or {})
    keys |= {f"mounts.{site.mount}.{key}": float(v) for key, v in zip(POSE, pose, strict=True)}
    keys[f"mounts.{site.mount}.roll_deg"] = 0.0
    world = simulation.load_scene(
        site.file,
        preset=site.preset,
        seed=site.seed if seed is None else seed,
        set=keys,
        mount=site.mount,
    )
    sequence = SimulatedFrames(world, lidar, tuple(sorted(numbers)), threads)
    sequence.roads = site.roads
    return sequence


def measure_frames(
    frames: SimulatedFrames, detector: str, replicates: int = REPLICATES
) -> Measured:
    """Evaluates a detector on the frames of an option."""
    detections = detect(detector_for(frames, detector), frames)
    vehicles = evaluated(frames, detections, replace(VEHICLES, replicates=replicates))
    if "Pedestrian" not in vehicles.truth.vehicles.names or detector == "background":
        return Measured(vehicles, None)
    return Measured(vehicles, evaluated(frames, detections, replace(PEOPLE, replicates=replicates)))


def detector_for(frames: SimulatedFrames, detector: str) -> TrainedDetector | Background:
    """Returns the detector for the frames; Background learns from other frames of the scene."""
    if detector != "background":
        return load_detector(detector, threads=frames.threads)
    every = [k for k in frames.known if k not in set(frames.numbers)]
    if not every:
        raise Error(
            f"frames: expected less than all {len(frames.numbers)} frames of the scene, got all; "
            "the detector background learns from the other frames"
        )
    learning = every[:: max(1, len(every) // LEARNING_FRAMES)][:LEARNING_FRAMES]
    clouds = [frame.points for frame in frames.of(learning)]
    return Background.learn(clouds, DEFAULT, frames.region, frames.ground)


@dataclass(frozen=True)
class Counting:
    """Passages that the tracks of an option counted, and the error of their speeds."""

    seconds: float
    passages: int  # true passages over all lines
    counted: int  # true passages that match a passage of a track
    extra: int  # passages of tracks that match no true passage
    speed_error_km_h: float  # median error of the speeds of the tracks
    has_lines: bool = True  # whether a line can be drawn across the roads

    @property
    def share(self) -> Interval:
        """The share of the passages that is counted, with a Wilson interval of 95 %."""
        if not self.passages:
            return UNKNOWN
        n, share, z2 = self.passages, self.counted / self.passages, Z95**2
        middle = (share + z2 / (2 * n)) / (1 + z2 / n)
        half = Z95 * math.sqrt(share * (1 - share) / n + z2 / (4 * n * n)) / (1 + z2 / n)
        return Interval(share, max(0.0, middle - half), min(1.0, middle + half))


def count_option(site: PlanSite, parts: Parts, detector: str, seconds: float = SECONDS) -> Counting:
    """Simulates an option without gaps and counts its vehicles over the lines of the site's roads.

    Simulated traffic has a seed that neither the choice nor the predictions have used. Of recorded
    traffic, the last part is used.
    """
    frames = max(2, min(round(seconds / site.period_s), site.every_frame))
    first = site.every_frame - frames if site.recorded else 0
    numbers, seed = range(first, first + frames), site.other_seed + (not site.recorded)
    sequence = fused([frames_at(site, *part, numbers, seed=seed) for part in parts])
    try:
        lines = lines_of(sequence)
    except Error:
        return Counting(frames * site.period_s, 0, 0, 0, math.nan, has_lines=False)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* used on frames")  # the plan gives this warning
        tracks = track(detect(detector_for(sequence, detector), sequence), sequence)
    result = evaluate_tracks(sequence, tracks, within_m=WITHIN_M, lines=lines)
    extra = int((result.passages.true_id < 0).sum())
    counted = len(result.passages) - extra
    return Counting(
        frames * site.period_s,
        counted + len(result.missed),
        counted,
        extra,
        float(result.measures.speed_error_km_h),
    )
