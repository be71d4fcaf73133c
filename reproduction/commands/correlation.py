"""Compares the correlation time of Background's errors with the length of time blocks.

Each LiDAR is tested in two scenes, on 800 frames that span 400 s. The correlation time is the
integrated autocorrelation of each frame's influence on AP (R1000). The command writes
out/correlation.csv:

    python -m reproduction correlation --work data/correlation
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.vocabulary import SUBSETS
from pyinfra.dataset.frame_readers import read_cameras, read_predictions
from pyinfra.dataset.frames import frame_numbers
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.metrics import ap
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.match_input import match_input
from pyinfra.metrics.match_results import count_matches
from pyinfra.metrics.prediction_checks import find_files
from pyinfra.metrics.settings import Settings
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.measures import detected, train_detector
from reproduction.simulate import simulate

LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
SCENES = ("highway", "crossroad")
# The test part of 400 s is about four times as long as the wait at a signal.
LONG_TEST = Parts(train_until_s=90, val_from_s=100)


def simulated(scene: str, work: Path) -> Path:
    options = {"preset": "paper", "frames": "0:5000:5"}
    return simulate(scene, LIDARS, work / scene, parts=LONG_TEST, **options)


def predictions(folder: Path) -> Path:
    run = folder.parent / f"{folder.name}_run"
    train_detector("background", folder, run, seed=1)
    return detected(run, folder, run)


def correlation(folder: Path, pred: Path) -> Iterator[dict[str, object]]:
    """Yields the correlation time (s) of the frames' influence on AP, per ground-truth subset."""
    frames = frame_numbers(folder)
    truth = read_ground_truth(folder, frames, beyond_range=True)
    files = find_files(pred, frames, frames).files
    detections = read_predictions(files, read_cameras(folder, frames))
    inputs = match_input(truth, detections, "vehicle", Settings(), "bev")
    matches = inputs.match(Settings().ious[0], strict=False)
    for which in SUBSETS:
        match_result = count_matches(inputs, which, matches, 1)
        use = np.flatnonzero(match_result.true_positive | match_result.false_positive)
        counts = np.bincount(inputs.vehicles.frame[match_result.counted], minlength=len(frames))
        ranking = ap.rank(
            inputs.predictions.scores[use],
            match_result.true_positive[use],
            counts,
            inputs.predictions.frame[use],
        )
        without = np.ones((len(frames), len(frames)), np.int64) - np.eye(
            len(frames), dtype=np.int64
        )
        influence = ap.average_precision(ranking, ap.R1000_RECALLS, without)
        apart_s = float(np.median(np.diff(frames))) * truth.period_s
        lasts = apart_s * integrated(influence)
        figures = {"correlation_s": round(lasts, 2), "block_s": inputs.blocks.block_s}
        yield {"ground_truth": which, **figures}


def integrated(series: FloatArray) -> float:
    """Returns the two-sided sum of the autocorrelation up to its first value of at most 0.05."""
    centred = series - series.mean()
    spectrum = np.fft.rfft(centred, 2 * len(series))
    at = np.fft.irfft(spectrum * np.conj(spectrum))[: len(series)]
    at /= np.arange(len(series), 0, -1)
    at /= at[0]
    ends = int(np.argmax(at <= 0.05))
    return float(1 + 2 * at[1:ends].sum())


@command
def main(*, work: Work, out: Out = Path("correlation.csv")) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 2 GB
    """
    rows = []
    for scene in SCENES:
        data = simulated(scene, work)
        for lidar in LIDARS:
            computed = correlation(data / lidar, predictions(data / lidar))
            rows += [{"scene": scene, "lidar": lidar} | row for row in computed]
    table = pd.DataFrame(rows)
    table.assign(seed=1, **provenance("correlation")).to_csv(out, index=False)
    print(table.to_string(index=False))
