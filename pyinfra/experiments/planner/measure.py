"""Simulates poses in full, runs a detector and measures what it finds.

Every pose has the evaluation region of the site's mount, so that the same objects count for all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.dataset import simulation
from pyinfra.dataset.frame_sequence import SimulatedFrames
from pyinfra.dataset.fused import fused
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.metrics.evaluate import evaluated
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.settings import Settings
from pyinfra.models.detectors.background import DEFAULT, Background
from pyinfra.models.inference.boxes_table import TrainedDetector, detect, load_detector

VEHICLES = Settings(ground_truths=("present",))
PEOPLE = Settings(
    classes={"pedestrian": ("Pedestrian",)}, ground_truths=("present",), metrics=("centre",)
)
REPLICATES, FEWEST = 200, 2  # of the bootstrap
LEARNING_FRAMES = 30  # frames from which Background learns, beside those that are measured


@dataclass(frozen=True, eq=False)
class Measured:
    """What a detector found in the frames of an option."""

    vehicles: Evaluation
    people: Evaluation | None  # None without pedestrians in the frames
    frames: int

    def detected(self, *, person: bool = False) -> pd.DataFrame:
        """Returns frame, id and score of each found object that counts."""
        result = self.people if person else self.vehicles
        if result is None:
            return pd.DataFrame({"frame": [], "id": [], "score": []})
        rows = result.matches[result.matches.outcome == "true positive"]
        table = rows[["frame", "object_id", "score"]]
        return table.rename(columns={"object_id": "id"}).reset_index(drop=True)

    def false_scores(self, *, person: bool = False) -> np.ndarray:
        """Returns the scores of the false boxes."""
        result = self.people if person else self.vehicles
        if result is None:
            return np.empty(0)
        matches = result.matches
        return np.asarray(matches.score[matches.outcome == "false positive"], float)


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


def measure(
    site: PlanSite,
    units: Sequence[tuple[Sequence[float], simulation.Lidar]],
    numbers: Sequence[int],
    detector: str = "generalist",
    *,
    seed: int | None = None,
    scene: Mapping[str, object] | None = None,
    yaw_error_deg: float = 0.0,
) -> Measured:
    """Simulates an option, fused where it has several LiDARs, and evaluates a detector.

    scene: overrides of keys of the scene. yaw_error_deg: error of the assumed yaw of each LiDAR.
    With an error there are no intervals.
    """
    alone = [frames_at(site, pose, lidar, numbers, seed=seed, scene=scene) for pose, lidar in units]
    replicates = FEWEST if yaw_error_deg else REPLICATES
    return measure_frames(fused(alone, yaw_error_deg), detector, replicates)


def measure_frames(
    frames: SimulatedFrames, detector: str, replicates: int = REPLICATES
) -> Measured:
    """Evaluates a detector on the frames of an option."""
    detections = detect(detector_for(frames, detector), frames)
    vehicles = evaluated(frames, detections, replace(VEHICLES, replicates=replicates))
    types = vehicles.truth.vehicles.names
    people = None
    if "Pedestrian" in types and detector != "background":
        people = evaluated(frames, detections, replace(PEOPLE, replicates=replicates))
    return Measured(vehicles, people, len(frames))


def detector_for(frames: SimulatedFrames, detector: str) -> TrainedDetector | Background:
    """Returns the detector for the frames; Background learns from other frames of the scene."""
    if detector != "background":
        return load_detector(detector, threads=frames.threads)
    every = [k for k in frames.known if k not in set(frames.numbers)]
    if not every:
        raise Error("detector: expected frames to learn the background from, got none")
    step = max(1, len(every) // LEARNING_FRAMES)
    learning = frames.of(every[::step][:LEARNING_FRAMES])
    clouds = [frame.points for frame in learning]
    return Background.learn(clouds, DEFAULT, frames.region, frames.ground)
