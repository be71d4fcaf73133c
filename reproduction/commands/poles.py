"""Compares the AP of one, two and four fused poles at a crossroad, without and with errors.

A detector is trained on 400 s of fused frames with exact clocks and poses. It is tested on a later
500 s of the same simulation: without errors, with late clocks, and with mounts that are turned by
an unknown angle. For each traffic seed the detector is trained again with other noise. The
ground-truth subset `all` has the vehicles that four poles together see, for any number of poles.
Differences are therefore of the same vehicles. The command adds each row to out/poles.csv as soon
as it is computed. Existing rows are not computed again, and several processes can share the work.

    python -m reproduction poles --work data/poles
"""

import itertools
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.files import held
from pyinfra.dataset.catalogue import scene_file
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frames import frame_numbers
from pyinfra.experiments import store
from pyinfra.experiments.stress import altered_scenes
from pyinfra.experiments.stress.score import as_predictions, box_errors
from pyinfra.formats import kitti
from pyinfra.metrics import ap
from pyinfra.metrics.ground_truth import GroundTruth, read_ground_truth, with_unreached
from pyinfra.metrics.match_input import match_input
from pyinfra.metrics.match_results import MatchResult, causes, count_matches
from pyinfra.metrics.matching import IOU
from pyinfra.metrics.settings import Settings
from pyinfra.models.inference import detect
from reproduction import provenance, shared_frames
from reproduction.arguments import Out, Work, command
from reproduction.measures import train_detector
from reproduction.simulate import simulate

SCENE = "crossroad_poles"
LIDARS = ("helios_16", "livox_avia", "ruby_plus", "pandar_64")
AGAIN = "-again"  # suffix of Background if it learns from the test frames, which include the errors
DETECTORS = ("background", "centerpoint-pillar", f"background{AGAIN}")
MOUNTS = {1: ("west",), 2: ("west", "east"), 4: ("west", "east", "south", "north")}
TRAINING_FRAMES, TEST_FRAMES = "0:4000:10", "5000:10000:50"
TEST_S = 1000
SETTINGS = Settings(ground_truths=("all", "captured"))
KEY = ["lidar", "poles", "detector", "error", "seed", "ground_truth"]
TEXT = ["error"]  # text columns of KEY, besides those of every table


@dataclass(frozen=True)
class Error:
    """A clock error or a yaw error between mounts; the first mount has no error."""

    clock_ms: float = 0
    yaw_deg: float = 0

    @property
    def name(self) -> str:
        if self.clock_ms:
            return f"clock_{self.clock_ms:g}_ms"
        return f"yaw_{self.yaw_deg:g}_deg" if self.yaw_deg else "none"

    def assignments(self, mounts: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Returns KEY=VALUE words that set the errors in the scene."""
        late, turned = altered_scenes.late_clocks, altered_scenes.wrong_turns
        words = late(mounts, self.clock_ms) if self.clock_ms else ()
        return [*words, *(turned(mounts, self.yaw_deg) if self.yaw_deg else ())]


NONE = Error()
ERRORS = (NONE, Error(clock_ms=20), Error(clock_ms=50), Error(yaw_deg=0.2), Error(yaw_deg=0.5))
ERROR_NAMES = [error.name for error in ERRORS]


def simulated(lidar: str, poles: int, seed: int, work: Path, error: Error | None = None) -> Path:
    """Simulates fused frames of a traffic seed and returns the LiDAR's folder.

    Parameters
    ----------
    error : pose or clock error of the test frames; with None, training frames are simulated
    """
    out = work / f"{lidar}_{poles}_{seed}_{error.name if error else 'training'}"
    folder = (out if poles == 1 else out / "fused") / lidar
    with held(work / f"{out.name}.lock", wait=True):
        if not (done := out / "done").is_file():
            run_simulator(out, lidar, poles, seed, error)
            (folder / "ImageSets").mkdir(exist_ok=True)
            for part in ("train", "val") if error else ("train",):
                numbers = "".join(f"{k:06d}\n" for k in kitti.frames(folder))
                (folder / "ImageSets" / f"{part}.txt").write_text(numbers)
            done.touch()
    return folder


def run_simulator(out: Path, lidar: str, poles: int, seed: int, error: Error | None) -> None:
    """Runs the simulator; the fused frames of several poles replace those of each pole."""
    mounts = MOUNTS[poles]
    keys = yaml.safe_load(scene_file(SCENE).read_text("utf-8"))
    keys["mounts"] = {name: keys["mounts"][name] | {"own_random_stream": True} for name in mounts}
    scene = out.parent / f"{out.name}.yaml"
    scene.write_text(yaml.safe_dump(keys, sort_keys=False))
    changes = [f"duration_s={TEST_S}", *error.assignments(keys["mounts"])] if error else []
    frames = TEST_FRAMES if error else TRAINING_FRAMES
    fuse = poles > 1
    simulate(scene, [lidar], out, frames=frames, threads=1, seed=seed, fuse=fuse, set=changes)
    for mount in mounts if fuse else ():
        shutil.rmtree(out / mount)


def truth_of(folder: Path, reference: Path) -> GroundTruth:
    """Returns a folder's ground truth with the vehicles and visibility of `reference`.

    The labels and the points are those of the folder.
    """
    truth = read_ground_truth(folder, frame_numbers(folder))
    others = read_vehicles(reference, truth.frames)
    vehicles = with_unreached(truth.vehicles, others)
    visible = dict(zip(zip(others.frame, others.ids, strict=True), others.visibility, strict=True))
    pairs = zip(vehicles.frame, vehicles.ids, strict=True)
    visibility = np.array([visible.get(pair, -1.0) for pair in pairs])
    return replace(truth, vehicles=replace(vehicles, visibility=visibility))


def model_of(detector: str, folder: Path, seed: int) -> tuple[Path, float]:
    """Trains a detector on a folder's frames; returns the model and the CPU seconds of training."""
    run = folder.parent / f"{folder.name}_{detector}"
    return train_detector(detector.removesuffix(AGAIN), folder, run, seed)


def match_results_of(model: Path, folder: Path, reference: Path) -> tuple[list[MatchResult], float]:
    """Returns a match result per ground-truth subset, and the median milliseconds per frame."""
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    detections, times = detect.detect(detect.detector_at(model, folder), files, None)
    truth = truth_of(folder, reference)
    inputs = match_input(truth, as_predictions(detections), "vehicle", SETTINGS, "bev")
    matches = inputs.match(IOU, strict=False)
    rows = [
        count_matches(inputs, which, matches, SETTINGS.min_points)
        for which in SETTINGS.ground_truths
    ]
    return rows, float(np.median(times))


def row(match_result: MatchResult, which: str) -> dict[str, object]:
    vehicles = match_result.match_input.vehicles
    false_positive = causes(match_result, IOU, strict=False)
    frames = len(match_result.match_input.truth.frames)
    return {
        "ground_truth": which,
        "ap_r1000": float(ap.average_precision(match_result.ranking(), ap.R1000_RECALLS)[0]),
        "objects": match_result.objects,
        "true_positives": int(match_result.true_positive.sum()),
        "points_per_vehicle": float(np.median(vehicles.points[match_result.counted])),
        "background_per_frame": np.count_nonzero(false_positive == "background") / frames,
        "misplaced_per_frame": np.count_nonzero(false_positive == "localisation") / frames,
        **box_errors(match_result),
    }


@dataclass(frozen=True)
class Experiment:
    """One detector with one LiDAR on a number of poles, one error and one traffic seed."""

    lidar: str
    poles: int
    detector: str
    error: Error
    seed: int

    @property
    def key(self) -> dict[str, object]:
        return asdict(self) | {"error": self.error.name}

    def is_done(self, out: Path) -> bool:
        return store.has(store.read(out, TEXT), self.key)

    def rows(self, work: Path) -> pd.DataFrame:
        """Trains and tests the detector; returns one row per ground-truth subset."""
        reference = simulated(self.lidar, max(MOUNTS), self.seed, work, NONE)
        folder = simulated(self.lidar, self.poles, self.seed, work, self.error)
        training = (
            folder
            if self.detector.endswith(AGAIN)
            else simulated(self.lidar, self.poles, self.seed, work)
        )
        model, seconds = model_of(self.detector, training, self.seed)
        match_results, ms = match_results_of(model, folder, reference)
        rows = [
            row(j, which) for j, which in zip(match_results, SETTINGS.ground_truths, strict=True)
        ]
        points = [
            kitti.frame_file(folder, "velodyne", k).stat().st_size / 16
            for k in kitti.frames(folder)
        ]
        more = {"points_per_frame": round(float(np.mean(points))), "train_cpu_s": round(seconds, 1)}
        more |= {"latency_p50_ms": round(ms, 1)}
        return pd.DataFrame(
            [{**self.key, **asdict(self.error), **more, **figures} for figures in rows]
        )


def fill(experiment: Experiment, work: Path, out: Path) -> None:
    """Adds the rows of one experiment, unless another process is computing them."""
    name = "_".join(map(str, experiment.key.values()))

    def run() -> None:
        words = f"poles --seeds {experiment.seed} --lidars {experiment.lidar}"
        rows = experiment.rows(work).assign(**provenance(words))
        store.put(out, rows[[*KEY, *(column for column in rows if column not in KEY)]], KEY)
        print(name, *rows.ap_r1000.round(1), flush=True)

    with shared_frames.in_use(work, f"{experiment.lidar}_{experiment.seed}"):
        store.fill(work / "locks" / name, lambda: experiment.is_done(out), run)


@command
def main(
    *,
    work: Work,
    out: Out = Path("poles.csv"),
    seeds: Sequence[int] = (1, 2, 3),
    lidars: Annotated[Sequence[str], {"choices": LIDARS}] = LIDARS[:3],
    detectors: Annotated[Sequence[str], {"choices": DETECTORS}] = DETECTORS,
    errors: Annotated[Sequence[str], {"choices": ERROR_NAMES}] = ERROR_NAMES,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 10 GB
    seeds : traffic seeds; a seed also seeds the training (default: 1 2 3)
    lidars : names of the LiDARs (default: %(default)s)
    detectors : detectors to test (default: all)
    errors : errors of clocks and poses with several poles (default: all)
    """
    chosen = [error for error in ERRORS if error.name in errors]
    for seed, lidar in itertools.product(seeds, lidars):
        experiments = [
            Experiment(lidar, poles, detector, error, seed)
            for detector, poles, error in itertools.product(detectors, MOUNTS, chosen)
            if poles > 1 or error == NONE
        ]
        for experiment in experiments:
            fill(experiment, work, out)
        if all(experiment.is_done(out) for experiment in experiments):
            made = work.glob(f"{lidar}_*_{seed}_*/")
            shared_frames.remove(work, f"{lidar}_{seed}", made)
