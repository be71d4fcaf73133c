"""Measures of a detector on the frames of one LiDAR, for each ground-truth subset."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray
from pyinfra.core.vocabulary import SUBSETS
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.roads import Places
from pyinfra.dataset.windows import Near
from pyinfra.formats import kitti
from pyinfra.metrics import ap
from pyinfra.metrics.evaluate import match_results_of
from pyinfra.metrics.evaluation_tables import area_table, distance_table
from pyinfra.metrics.match_results import MatchResult, Part
from pyinfra.metrics.match_tables import sensor_of
from pyinfra.metrics.settings import Settings
from pyinfra.models.inference.detect import model_file
from pyinfra.models.inference.folder import detect_folder, place

SPLIT_M = 60.0  # distance that separates the near and the far part of the region
SETTINGS = Settings(ground_truths=SUBSETS)


@dataclass(frozen=True)
class Far:
    """The part of the region that is farther away than `near`."""

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
