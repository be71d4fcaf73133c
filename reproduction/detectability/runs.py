"""Simulates poses at generated sites, runs the detectors and stores the score of each object.

A run is one pose and LiDAR at one site with one traffic seed. Both detectors see the same frames.
The file of a run has every object of the evaluation region, with its points and scores, and the
scores of the false boxes.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import FloatArray
from pyinfra.core.files import replacing, write
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.simulation import Lidar, load_lidar
from pyinfra.experiments.planner.candidates import (
    POSE,
    PoseGrid,
    feasible,
    make_candidates,
    with_faults,
)
from pyinfra.experiments.planner.simulate import Measured, detector_for, frames_at, measure_frames
from pyinfra.experiments.planner.site import PlanSite, open_site
from pyinfra.experiments.stress.lidar import spins
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.models.inference.boxes_table import detect
from pyinfra.scenes.generator.generate import make_site

FIRST_SITE = 700_000  # first seed of the sites, which no training and no other measurement uses
FIRST_CHECK_SITE = FIRST_SITE + 100_000
LIDARS = (
    "ruby_plus", "helios_16", "pandar_64", "livox_avia", "hesai_xt32", "livox_horizon",
)  # fmt: skip
DETECTORS = ("generalist", "background")
FIT_POSES, CHECK_POSES = 4, 6
CHECK_SEEDS = (1, 2, 3)  # traffic seeds of the check's measurements; predictions use seed 0
DURATION_S = 120.0
WITHIN_M = 60.0  # maximum distance of a random pose from the centre of the site
TIMED_FRAMES = 5


@dataclass(frozen=True)
class Run:
    """One pose and LiDAR at a generated site, with one seed of the traffic."""

    site: int
    pose: int
    lidar: str
    seed: int = 0  # traffic seed; 0 for the site's own traffic
    detect: bool = True  # whether detectors run; if not, only what the LiDAR sees is stored

    @property
    def name(self) -> str:
        return f"{self.site}_{self.pose}_{self.lidar}_{self.seed}"


@dataclass(frozen=True, eq=False)
class Outcome:
    """The stored result of a run.

    `objects` has a row for each object and frame: frame, id, type, person, speed, points, along,
    across, up, distance, visibility, spinning, and score_DETECTOR (0 for an object without a box).
    """

    objects: pd.DataFrame
    spinning: bool
    frames: int
    ap: dict[str, float]  # AP of the vehicles, by detector
    false: dict[str, FloatArray]  # scores of false vehicle boxes, by detector
    false_people: dict[str, FloatArray]


def fit_runs(sites: int) -> Iterator[Run]:
    """Yields FIT_POSES poses of each site; successive poses have different LiDARs."""
    for i in range(sites):
        for k in range(FIT_POSES):
            yield Run(FIRST_SITE + i, k, LIDARS[(i * FIT_POSES + k) % len(LIDARS)])


def check_runs(sites: int) -> Iterator[Run]:
    """Yields CHECK_POSES poses with one LiDAR per site: without a detector, then with one."""
    for i in range(sites):
        for seed in (0, *CHECK_SEEDS):
            for k in range(CHECK_POSES):
                lidar = LIDARS[i % len(LIDARS)]
                yield Run(FIRST_CHECK_SITE + i, k, lidar, seed, detect=seed > 0)


def site_of(seed: int, frames: int, work: Path, *, traffic: int = 0) -> PlanSite:
    """Opens a generated site. traffic: number of the traffic seed, 0 for the site's own."""
    file = scene_file_of(seed, work)
    return open_site(file, frames, seed=seed + 1_000_000 * traffic if traffic else None)


def scene_file_of(seed: int, work: Path) -> Path:
    """Writes the scene file of a generated site, if it is missing, and returns its path."""
    file = work / f"site_{seed}.yaml"
    if not file.is_file():
        keys = make_site(seed) | {"duration_s": DURATION_S, "label_time": "scan"}
        keys["mounts"]["pole"].update({"pitch_deg": 0.0, "roll_deg": 0.0})
        write(file, yaml.safe_dump(keys))
    return file


def poses_of(site: PlanSite, count: int) -> FloatArray:
    """Returns the scene's pose, then random candidate poses within WITHIN_M: (count, 5)."""
    mount = site.keys["mounts"][site.mount]
    scene_pose = [mount["x_m"], mount["y_m"], mount["z_m"], mount["yaw_deg"], mount["pitch_deg"]]
    grid = PoseGrid(every_m=8.0, heights_m=(4.0, 5.0, 6.0, 7.0, 8.0, 10.0))
    made = feasible(with_faults(make_candidates(site, WITHIN_M, grid), site), site)
    rng = np.random.default_rng(int(yaml.safe_load(site.file.read_text())["seed"]))
    others = made[POSE].to_numpy(float)[rng.permutation(len(made))]
    return np.concatenate([[scene_pose], others])[:count]


def pose_of(run: Run, site: PlanSite) -> FloatArray:
    """Returns x, y, z, yaw and pitch of a run; the poses of a site do not depend on its traffic."""
    return np.asarray(poses_of(site, max(FIT_POSES, CHECK_POSES))[run.pose], float)


def store(run: Run, frames: int, work: Path) -> None:
    """Measures a run and writes its file, unless there is a file with this number of frames."""
    file = work / f"{run.name}.npz"
    if file.is_file():
        with np.load(file) as data:
            if int(data["frames"]) == frames:
                return
    started = time.process_time()
    site = site_of(run.site, frames, work, traffic=run.seed)
    pose = pose_of(run, site)
    lidar = load_lidar(lidar_file(run.lidar), site.preset)
    results: dict[str, Measured] = {}
    if run.detect:
        sequence = frames_at(site, [*pose], lidar, site.frames, threads=1)
        sequence.kept = 2 * frames + 1  # number of frames that stay in memory for both detectors
        results = {name: measure_frames(sequence, name) for name in DETECTORS}
    objects = objects_of(site, pose, lidar, results)
    arrays: dict[str, object] = {"frames": len(site.frames)}
    for name, result in results.items():
        arrays[f"ap_{name}"] = float(result.vehicles.ap.ap_r1000.iloc[0])
        arrays[f"false_{name}"] = boxes_of(result.vehicles, "false positive").score.to_numpy(float)
        arrays[f"false_people_{name}"] = boxes_of(result.people, "false positive").score.to_numpy(
            float
        )
    with replacing(file) as beside, beside.open("wb") as stream:
        np.savez_compressed(stream, objects=objects.to_records(index=False), **arrays)  # type: ignore[arg-type]
    print(f"{run.name}: {time.process_time() - started:.1f} CPU s", flush=True)


def boxes_of(result: Evaluation | None, outcome: str) -> pd.DataFrame:
    """Returns frame, object id and score of the boxes with this `outcome` of the matching."""
    if result is None:
        return pd.DataFrame({"frame": [], "id": [], "score": []}, dtype=float)
    rows = result.matches[result.matches.outcome == outcome]
    return rows[["frame", "object_id", "score"]].rename(columns={"object_id": "id"})


def objects_of(
    site: PlanSite, pose: FloatArray, lidar: Lidar, results: dict[str, Measured]
) -> pd.DataFrame:
    """Returns every present object with what the LiDAR sees of it, and its scores."""
    seen = pd.DataFrame(site.observer.observe([*pose], [lidar], [*site.frames]))
    key = ["frame", "id"]
    table = site.present.merge(seen.drop(columns="lidar"), how="left", on=key)
    for name, result in results.items():
        both = [boxes_of(one, "true positive") for one in (result.vehicles, result.people)]
        scores = pd.concat([part for part in both if len(part)] or both)
        scores = scores.rename(columns={"score": f"score_{name}"}).astype(dict.fromkeys(key, int))
        table = table.merge(scores, how="left", on=key)
    table["type"] = table["type"].astype("S12")
    zero = {name: 0.0 for name in table.columns if name == "points" or name.startswith("score_")}
    return table.fillna(zero)


@cache
def is_spinning(lidar: str) -> bool:
    """Returns whether a LiDAR of the catalogue spins."""
    return spins(yaml.safe_load(load_lidar(lidar_file(lidar), "datasheet").dump()))


def read(run: Run, work: Path) -> Outcome:
    """Reads the file of a run."""
    with np.load(work / f"{run.name}.npz") as data:
        objects = pd.DataFrame(data["objects"])
        objects["type"] = objects["type"].str.decode("ascii")
        names = [name for name in DETECTORS if f"ap_{name}" in data.files]
        spinning = is_spinning(run.lidar)
        return Outcome(
            objects.assign(spinning=spinning),
            spinning,
            int(data["frames"]),
            {name: float(data[f"ap_{name}"]) for name in names},
            {name: data[f"false_{name}"] for name in names},
            {name: data[f"false_people_{name}"] for name in names},
        )


def detection_ms(run: Run, detector: str, frames: int, work: Path) -> float:
    """Returns the CPU time (ms) of a detector per frame, without simulation and evaluation."""
    site = site_of(run.site, frames, work)
    pose, lidar = pose_of(run, site), load_lidar(lidar_file(run.lidar))
    sequence = frames_at(site, [*pose], lidar, site.frames[:TIMED_FRAMES])
    model = detector_for(sequence, detector)
    detect(model, sequence)  # not timed: reads the weights and keeps the simulated frames in memory
    started = time.process_time()
    detect(model, sequence)
    return 1000 * (time.process_time() - started) / TIMED_FRAMES
