"""Intervals of a dozen differences, as 0.2.0 had them and as they are: pairs of LiDARs.

Background, tested on 800 frames of 400 s, two scenes. As 0.2.0: AP at 40 recalls, percentiles over
blocks of 5 s, differences as if the two were independent. Then one thing at a time: paired, fine,
and blocks as long as a vehicle stays. Writes results/differences.csv, and how long the detections
themselves say that errors last as results/correlation.csv:
    .venv/bin/python benchmarks/differences.py --work data/differences
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frame_tables import read_cameras, read_predictions
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments.benchmark.frames import split_by_time
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.formats import kitti
from pyinfra.metrics import ap
from pyinfra.metrics.comparison import Bootstrapped, Measured
from pyinfra.metrics.ground_truth import SETS, Set, read_ground_truth
from pyinfra.metrics.match_results import Settings, contest, judge
from pyinfra.metrics.prediction_checks import find_files
from pyinfra.models.inference import detect
from pyinfra.models.training.recipe import read_recipe
from pyinfra.models.training.sources import read_source
from pyinfra.models.training.train import train

ROOT = Path(__file__).resolve().parent.parent
LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
SCENES = ("highway", "crossroad")
OLD_BLOCK_S = 5.0
LONG_TEST = Parts(train_until_s=90, val_from_s=100)  # 400 s hold four stays at a signal


@dataclass(frozen=True)
class Rule:
    """A way to an interval."""

    name: str
    recalls: int
    old_blocks: bool
    paired: bool


RULES = (
    Rule("0.2: R40, 5 s, unpaired", ap.RECALLS, old_blocks=True, paired=False),
    Rule("paired", ap.RECALLS, old_blocks=True, paired=True),
    Rule("paired, fine", ap.FINE_RECALLS, old_blocks=True, paired=True),
    Rule("paired, fine, as long as a stay", ap.FINE_RECALLS, old_blocks=False, paired=True),
)


def simulated(scene: str, work: Path) -> Path:
    lidars = [lidar_file(name) for name in LIDARS]
    words = ["--preset", "paper", "--frames", "0:5000:5"]
    infrasim("run", scene_file(scene), "--lidar", *lidars, *words, "--out", work / scene)
    split_by_time(work / scene, LONG_TEST)
    return work / scene


def predictions(folder: Path) -> Path:
    run = folder.parent / f"{folder.name}_run"
    train(
        read_recipe(ROOT / "configs/detectors/background.yaml", "quick"),
        [read_source(folder, "quick")],
        run,
        quiet=True,
    )
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    detect.detect(detect.load_detector(run), files, run / "predictions")
    return run / "predictions"


def figures(folder: Path, pred: Path) -> Iterator[tuple[Set, int, bool, Bootstrapped]]:
    """AP by ground truth and recalls, with draws of old blocks and of new."""
    frames = frame_numbers(folder)
    truth = read_ground_truth(folder, frames, beyond_range=True)
    files = find_files(pred, frames, frames).files
    own = read_predictions(files, read_cameras(folder, frames))
    for old in (True, False):
        settings = Settings(ground_truths=SETS, block_s=OLD_BLOCK_S if old else None)
        one = contest(truth, own, "vehicle", settings, "bev")
        took = one.match(settings.ious[0], strict=False)
        for which, recalls in itertools.product(SETS, (ap.RECALLS, ap.FINE_RECALLS)):
            judged = judge(one, which, took, settings.min_points)
            ranking = judged.ranking()
            value = float(ap.average_precision(ranking, recalls)[0])
            drawn = ap.average_precision(ranking, recalls, judged.weights)
            yield which, recalls, old, Bootstrapped(value, drawn, one.blocks.count)


def correlation(folder: Path, pred: Path) -> Iterator[dict[str, object]]:
    """By ground truth the integrated correlation of the frames' influence on fine AP, seconds."""
    frames = frame_numbers(folder)
    truth = read_ground_truth(folder, frames, beyond_range=True)
    files = find_files(pred, frames, frames).files
    own = read_predictions(files, read_cameras(folder, frames))
    one = contest(truth, own, "vehicle", Settings(), "bev")
    took = one.match(Settings().ious[0], strict=False)
    for which in SETS:
        judged = judge(one, which, took, 1)
        use = np.flatnonzero(judged.hit | judged.wrong)
        counts = np.bincount(one.vehicles.frame[judged.counted], minlength=len(frames))
        ranking = ap.rank(
            one.predictions.scores[use], judged.hit[use], counts, one.predictions.frame[use]
        )
        without = np.ones((len(frames), len(frames)), np.int64) - np.eye(
            len(frames), dtype=np.int64
        )
        influence = ap.average_precision(ranking, ap.FINE_RECALLS, without)
        apart_s = float(np.median(np.diff(frames))) * truth.period_s
        lasts = apart_s * integrated(influence)
        figures = {"correlation_s": round(lasts, 2), "block_s": one.blocks.block_s}
        yield {"ground_truth": which, **figures}


def integrated(series: FloatArray) -> float:
    """Sum of the autocorrelation over both sides, to where it first falls to 0.05."""
    centred = series - series.mean()
    spectrum = np.fft.rfft(centred, 2 * len(series))
    at = np.fft.irfft(spectrum * np.conj(spectrum))[: len(series)]
    at /= np.arange(len(series), 0, -1)
    at /= at[0]
    ends = int(np.argmax(at <= 0.05))
    return float(1 + 2 * at[1:ends].sum())


def percentiles(one: Bootstrapped) -> Measured:
    low, high = np.percentile(one.draws, [2.5, 97.5])
    return Measured(one.value, float(low), float(high))


def difference(a: Bootstrapped, b: Bootstrapped, rule: Rule) -> Measured:
    if rule.paired:
        return percentiles(a.less(b)) if rule.old_blocks else a.less(b).measured()
    one, other = percentiles(a), percentiles(b)
    value = one.value - other.value
    down = math.hypot(one.value - one.low, other.high - other.value)
    up = math.hypot(one.high - one.value, other.value - other.low)
    return Measured(value, value - down, value + up)


def rows(scene: str, data: Path) -> Iterator[dict[str, object]]:
    found = {
        (lidar, which, recalls, old): one
        for lidar in LIDARS
        for which, recalls, old, one in figures(data / lidar, predictions(data / lidar))
    }
    for (a, b), which, rule in itertools.product(itertools.combinations(LIDARS, 2), SETS, RULES):
        pair = [found[name, which, rule.recalls, rule.old_blocks] for name in (a, b)]
        m = difference(pair[0], pair[1], rule)
        ends = {"value": m.value, "low": m.low, "high": m.high}
        yield {"scene": scene, "lidar": a, "less": b, "ground_truth": which, "rule": rule.name} | {
            key: round(v, 2) for key, v in ends.items()
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of frames; about 2 GB")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "differences.csv")
    args = parser.parse_args()
    data = {scene: simulated(scene, args.work) for scene in SCENES}
    lasts = [
        {"scene": scene, "lidar": lidar} | row
        for scene, folder in data.items()
        for lidar in LIDARS
        for row in correlation(folder / lidar, predictions(folder / lidar))
    ]
    about = {"command": "benchmarks/differences.py", "seed": 1, "version": __version__}
    about |= {"machine": machine()}
    for file, table in (
        (args.out.with_name("correlation.csv"), pd.DataFrame(lasts)),
        (args.out, pd.DataFrame([row for s in SCENES for row in rows(s, data[s])])),
    ):
        table.assign(**about).to_csv(file, index=False)
        print(table.to_string(index=False))


if __name__ == "__main__":
    main()
