"""Measures how often a 95 % interval contains the true AP, with an artificial detector.

The artificial detector runs on simulated traffic and has known detection probabilities. A
detection probability falls with distance, differs between vehicles and changes within seconds.
False positives occur in bursts. The true AP is the AP of the boxes of all simulated runs together.
The command writes out/coverage.csv for three scenes and three test spans:

    python -m reproduction coverage --work data/coverage
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.dataset.catalogue import scene_file
from pyinfra.dataset.roads import Road, locate, read_roads
from pyinfra.dataset.runs import infrasim
from pyinfra.metrics import ap, intervals
from pyinfra.metrics.comparison import Bootstrapped
from reproduction import provenance
from reproduction.arguments import Out, Work, command

SCENES = ("highway", "curve", "crossroad")
SPANS_S = (90, 250, 500)
RUN_S, APART_S = 500, 0.5
REPLICATES = 200
# correlation times (s) of a vehicle's detection probability and of the rate of false positives
CHANGES_S, BOUTS_S = 4.0, 5.0
OF_THE_VEHICLE = 0.6  # share of the spread that is constant in time for each vehicle
LOSS_PER_M = 1.2 / 50  # decrease of the logit of the detection probability per metre


@dataclass(frozen=True)
class Detector:
    """An artificial detector.

    Attributes
    ----------
    logit : logit of the mean detection probability at distance 0
    spread : standard deviation of the logit over vehicles and time
    background : mean number of false positives per frame
    """

    logit: float
    spread: float
    background: float


DETECTORS = {
    "good": Detector(4.0, 1.2, 0.6),
    "middling": Detector(2.0, 1.5, 1.5),
    "poor": Detector(0.4, 1.5, 3.0),
}


@dataclass(frozen=True, eq=False)
class Traffic:
    """The vehicles in the region; each array (n,) has one entry per frame and vehicle."""

    frame: IntArray
    ids: IntArray
    distance: FloatArray


@dataclass(frozen=True, eq=False)
class ScoredBoxes:
    """Scores and frames of detected vehicles and of false positives; each array is (n,)."""

    scores: FloatArray
    frame: IntArray
    true_positive: np.ndarray


def traffic(scene: str, seed: int, roads: list[Road], work: Path) -> Traffic:
    file = work / f"{scene}.csv"
    sets = ["--set", f"seed={seed}", f"duration_s={RUN_S}"]
    infrasim("trajectories", scene_file(scene), *sets, "--out", file)
    rows = pd.read_csv(file, usecols=["t", "id", "x", "y"])
    number = np.round(rows.t / APART_S, 3)
    rows = rows[(number == np.round(number)) & (rows.t < RUN_S)]
    rows = rows[locate(rows[["x", "y"]].to_numpy(np.float64), roads).inside]
    frame = np.round(rows.t / APART_S).astype(np.int64).to_numpy()
    return Traffic(frame, rows.id.to_numpy(np.int64), np.hypot(rows.x, rows.y).to_numpy())


def autoregressive(noise: FloatArray, seconds: float) -> FloatArray:
    """Filters white noise of unit variance so that its correlation falls to 1/e in `seconds`.

    The result also has unit variance.
    """
    keep = np.exp(-APART_S / seconds)
    return np.asarray(lfilter([np.sqrt(1 - keep**2)], [1, -keep], noise))


def detected_by(
    detector: Detector, t: Traffic, liking: FloatArray, random: np.random.Generator
) -> ScoredBoxes:
    """Returns random detections of one simulated run.

    Parameters
    ----------
    liking : (n,) offset of the logit for each entry's vehicle; constant in time, unit variance
    """
    order = np.lexsort((t.frame, t.ids))
    moods = np.empty(len(order))
    moods[order] = autoregressive(random.normal(size=len(order)), CHANGES_S)
    bias = OF_THE_VEHICLE * liking + np.sqrt(1 - OF_THE_VEHICLE**2) * moods
    logit = detector.logit - LOSS_PER_M * t.distance + detector.spread * bias
    true_positive = random.random(len(logit)) < 1 / (1 + np.exp(-logit))
    scores = 0.6 * logit + 0.8 * random.normal(size=len(logit))
    frames = round(RUN_S / APART_S)
    bouts = 0.6 * autoregressive(random.normal(size=frames), BOUTS_S)
    background = np.repeat(
        np.arange(frames), random.poisson(detector.background * np.exp(bouts - 0.18))
    )
    return ScoredBoxes(
        scores=np.concatenate([scores[true_positive], random.normal(-0.8, 1.0, len(background))]),
        frame=np.concatenate([t.frame[true_positive], background]),
        true_positive=np.concatenate(
            [np.ones(true_positive.sum(), np.bool_), np.zeros(len(background), np.bool_)]
        ),
    )


def studies(scene: str, count: int, work: Path) -> Iterator[tuple[Traffic, dict[str, ScoredBoxes]]]:
    infrasim("run", scene_file(scene), "--lidar", "helios_16", "--frames", "0:1", "--out", work)
    roads = read_roads(work / "roads.csv")
    for seed in range(1, count + 1):
        t, random = traffic(scene, seed, roads, work), np.random.default_rng(seed)
        index = np.unique(t.ids, return_inverse=True)[1]
        shared = random.normal(size=index.max() + 1)
        by_detector = {}
        for name, detector in DETECTORS.items():
            liking = 0.7 * shared + np.sqrt(1 - 0.49) * random.normal(size=len(shared))
            by_detector[name] = detected_by(detector, t, liking[index], random)
        yield t, by_detector


def ranking(t: Traffic, boxes: ScoredBoxes, first: int, blocks: intervals.Blocks) -> ap.Ranking:
    """Ranks the boxes in frame `first` and all frames after it by score."""
    use, later = boxes.frame >= first, t.frame >= first
    slots = blocks.replicates.shape[1]
    objects = np.bincount(blocks.slot[t.frame[later] - first], minlength=slots)
    at = blocks.slot[boxes.frame[use] - first]
    return ap.rank(boxes.scores[use], boxes.true_positive[use], objects, at)


def figures(
    t: Traffic, by_detector: dict[str, ScoredBoxes], span_s: int, length_s: float
) -> dict[str, Bootstrapped]:
    """Returns the AP of each detector and two AP differences, over the last `span_s` of a run."""
    first = round((RUN_S - span_s) / APART_S)
    frames = np.arange(round(span_s / APART_S))
    blocks = intervals.time_blocks(frames, APART_S, block_s=length_s, replicates=REPLICATES)
    out = {}
    for name, boxes in by_detector.items():
        r = ranking(t, boxes, first, blocks)
        value = float(ap.average_precision(r, ap.R1000_RECALLS)[0])
        replicates = ap.average_precision(r, ap.R1000_RECALLS, blocks.replicates)
        out[name] = Bootstrapped(value, replicates, blocks.count)
    out["good less middling"] = out["good"].less(out["middling"])
    out["middling less poor"] = out["middling"].less(out["poor"])
    return out


def truths(every: list[tuple[Traffic, dict[str, ScoredBoxes]]]) -> dict[str, float]:
    """Returns the AP and the differences over all runs together."""
    objects = sum(len(t.frame) for t, _ in every)
    out = {}
    for name in DETECTORS:
        scores = np.concatenate([by_detector[name].scores for _, by_detector in every])
        true_positive = np.concatenate(
            [by_detector[name].true_positive for _, by_detector in every]
        )
        out[name] = float(
            ap.average_precision(ap.rank(scores, true_positive, objects), ap.R1000_RECALLS)[0]
        )
    out["good less middling"] = out["good"] - out["middling"]
    out["middling less poor"] = out["middling"] - out["poor"]
    return out


def rows(scene: str, count: int, work: Path) -> Iterator[dict[str, object]]:
    runs = list(studies(scene, count, work))
    truth = truths(runs)
    stays_s = [intervals.block_seconds(t.frame, t.ids, APART_S) for t, _ in runs]
    stay_s = float(np.median(stays_s))
    for span_s in SPANS_S:
        if span_s < intervals.MIN_BLOCKS * stay_s:
            continue
        ends: dict[str, list[tuple[float, float]]] = {name: [] for name in truth}
        for t, by_detector in runs:
            for name, figure in figures(t, by_detector, span_s, stay_s).items():
                interval = figure.measured()
                ends[name].append((interval.low, interval.high))
        for name, bounds in ends.items():
            low, high = np.array(bounds).T
            held = 100 * np.mean((low <= truth[name]) & (truth[name] <= high))
            settings = {"scene": scene, "span_s": span_s, "block_s": stay_s}
            yield {**settings, "figure": name, "truth": round(truth[name], 2)} | {
                "held_percent": round(float(held), 1),
                "width": round(float((high - low).mean()), 2),
                "studies": len(bounds),
            }


@command
def main(*, work: Work, studies: int = 200, out: Out = Path("coverage.csv")) -> None:
    """
    Parameters
    ----------
    work : working folder for simulated data
    studies : number of simulated studies (default: %(default)s)
    """
    all_rows: list[dict[str, object]] = []
    for scene in SCENES:
        (work / scene).mkdir(parents=True, exist_ok=True)
        all_rows += rows(scene, studies, work / scene)
        made_by = provenance(f"coverage --studies {studies}")
        table = pd.DataFrame(all_rows).assign(seed=1, **made_by)
        table.to_csv(out, index=False)
        print(table[table.scene == scene].iloc[:, :8].to_string(index=False), flush=True)
