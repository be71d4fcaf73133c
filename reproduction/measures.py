"""Trains a detector on the frames of one LiDAR, as the study's commands do, and measures it."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import BoolArray
from pyinfra.core.vocabulary import SUBSETS, Tier
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.roads import Places
from pyinfra.dataset.windows import Near
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import read_csv
from pyinfra.metrics import ap
from pyinfra.metrics.evaluate import evaluated, match_results_of
from pyinfra.metrics.evaluation_tables import area_table, distance_table
from pyinfra.metrics.match_results import MatchResult, Part
from pyinfra.metrics.match_tables import sensor_of
from pyinfra.metrics.settings import Settings
from pyinfra.models.inference import detect
from pyinfra.models.inference.detect import model_file
from pyinfra.models.inference.folder import detect_folder, place
from pyinfra.models.training.accumulation import Accumulation
from pyinfra.models.training.recipe import read_recipe
from pyinfra.models.training.sources import ONE_FRAME, read_source
from pyinfra.models.training.train import train
from reproduction import ROOT

SPLIT_M = 60.0  # distance that separates the near and the far part of the region
SETTINGS = Settings(ground_truths=SUBSETS)


def train_detector(
    detector: str,
    folder: Path,
    run: Path,
    seed: int,
    tier: Tier = "quick",
    budget: float = 1.0,
    accumulation: Accumulation = ONE_FRAME,
) -> tuple[Path, float]:
    """Trains a detector; returns the model's file, and the CPU seconds of the training.

    budget: multiple of the tier's training steps. Background has no steps, so its CPU time is 0.
    accumulation: which frames are stacked into one cloud. If frames are stacked, the age of points
    is an input of the network.
    """
    recipe = read_recipe(ROOT / "configs/detectors" / f"{detector}.yaml", tier).for_budget(budget)
    if accumulation.frames > 1:
        recipe = replace(recipe, network=replace(recipe.network, age=True))
    source = read_source(folder, tier, accumulation, recipe.classes)
    file = train(recipe, [source], run, seed=seed, quiet=True)
    log = run / "log.csv"
    return file, float(read_csv(log).cpu_seconds.sum()) if log.is_file() else 0.0


def detected(model: Path, folder: Path, run: Path) -> Path:
    """Runs a model on the test frames of a LiDAR's folder; returns the folder of the boxes.

    run: folder in which the folder `predictions` is written
    """
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    detect.detect(detect.detector_at(model, folder), files, run / "predictions")
    return run / "predictions"


def ap_of_captured(folder: Path, predictions: Path) -> Any:
    """Returns the row of the evaluation of the vehicles that a LiDAR captures."""
    settings = Settings(ground_truths=("captured",))
    (row,) = evaluated(folder, predictions, settings).ap.itertuples()
    return row


@dataclass(frozen=True)
class Far:
    """The part of the region outside the part `near`."""

    near: Near

    def holds(self, places: Places) -> BoolArray:
        return np.asarray(places.inside & ~self.near.holds(places))


def rows_of_test(
    model: Path, folder: Path, predictions: Path, part: str = "all"
) -> list[dict[str, object]]:
    """Runs a model on frames of a LiDAR's folder; returns a row of measures per subset.

    Frames are stacked if the model needs stacked frames. The folder `predictions` is removed.
    part: list of frames in ImageSets, or `all`.
    """
    frames = frame_numbers(folder, part)
    if predictions.is_dir():  # an interrupted test left this folder behind
        shutil.rmtree(predictions)
    files = [kitti.frame_file(folder, "velodyne", k) for k in frames]
    site = place(folder)
    detect_folder(model_file(model), folder, predictions, files=files, where=site, warn=print)
    results = match_results_of(folder, predictions, SETTINGS, frames=frames)
    rows = [
        {"subset": subset, "frames": len(frames), **measures(result)}
        for subset, result in zip(SUBSETS, results, strict=True)
    ]
    shutil.rmtree(predictions)
    return rows


def measures(result: MatchResult) -> dict[str, object]:
    """Returns the measures of one ground-truth subset.

    ap_r1000_frames_sd is the standard deviation of AP over bootstrap replicates of the frames.
    `near` and `far` are the parts of the region within and beyond SPLIT_M.
    """
    near = Near(SPLIT_M, sensor_of(result.match_input.truth))
    areas = area_table(result, *distance_table(result, SETTINGS.min_objects)).iloc[0]
    ap_of_replicates = ap.average_precision(result.ranking(), ap.R1000_RECALLS, result.weights)
    return {
        "ap_r1000": ap_of(result),
        "ap_r1000_frames_sd": float(ap_of_replicates.std(ddof=1)),
        "ap_r1000_near": ap_of(result, near),
        "ap_r1000_far": ap_of(result, Far(near)),
        "n_hqda": areas.n_hqda,
        "p_hqda": areas.p_hqda,
        "objects": result.objects,
    }


def ap_of(result: MatchResult, part: Part | None = None) -> float:
    return float(ap.average_precision(result.ranking(part), ap.R1000_RECALLS)[0])
