"""Measures detectors with each LiDAR, in replicates with separate training and test traffic.

Replicate r trains a detector for each LiDAR on frames of traffic seed 1000 + r, with training seed
r. It tests the detector on all frames of traffic seeds 2 r - 1 and 2 r. Intervals over replicates
therefore include the variation of traffic, noise and training. docs/verdict_rules.md defines the
rules of the study.

Rows are added to the output as they are made; existing rows are kept. Several
processes can share the work.

    python -m reproduction experiments --work data/experiments --out results/experiments.csv
"""

from __future__ import annotations

import argparse
import itertools
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray
from pyinfra.core.files import held
from pyinfra.core.vocabulary import PRESETS, SUBSETS, LabelTime, Preset, Tier
from pyinfra.dataset import split
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.prediction_origin import origin_of, write_origin
from pyinfra.dataset.roads import Places
from pyinfra.dataset.runs import infrasim
from pyinfra.dataset.windows import Near
from pyinfra.experiments import store
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import read_csv
from pyinfra.metrics import ap
from pyinfra.metrics.evaluate import match_results_of
from pyinfra.metrics.evaluation_tables import area_table, distance_table
from pyinfra.metrics.match_results import MatchResult, Part
from pyinfra.metrics.ranges import sensor_of
from pyinfra.metrics.settings import Settings
from pyinfra.models.inference import detect
from pyinfra.models.training.recipe import read_recipe
from pyinfra.models.training.sources import read_source
from pyinfra.models.training.train import train
from reproduction import ROOT, add_out, provenance

# The steps 11 and 47 share no factor with 200, the number of frames after which the Avia's pattern
# repeats.
TRAIN_FRAMES, TEST_FRAMES = "0:5000:11", "0:5000:47"
TRAIN_SEEDS_FROM = 1000
TESTS = 2  # number of test seeds of a replicate
SPLIT_M = 60.0  # distance between the near and the far part of the region
LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
BUNDLES = {"crossroad": "bundle_5_livox_avia"}  # the LiDAR that replaces the single Avia in a scene
RECIPES = ROOT / "configs/detectors"
JUDGES: dict[str, tuple[str, Tier | None]] = {  # detector file and tier by judge
    "fine-tuned": ("generalist", "quick"),
    "background": ("background", "quick"),
    "pretrained": ("generalist", None),
}
KEY = "scene preset lidar detector judge replicate seed subset label_time".split()
SETTINGS = Settings(ground_truths=SUBSETS, replicates=1)


@dataclass(frozen=True)
class Replicate:
    """The traffic of one replicate in one scene, preset and label time, for all LiDARs."""

    scene: str
    preset: Preset
    label_time: LabelTime
    replicate: int

    @property
    def name(self) -> str:
        return "_".join(map(str, asdict(self).values()))

    @property
    def test_seeds(self) -> list[int]:
        return [TESTS * (self.replicate - 1) + i for i in range(1, TESTS + 1)]

    @property
    def lidars(self) -> list[str]:
        bundle = BUNDLES.get(self.scene)
        return [bundle if bundle and name == "livox_avia" else name for name in LIDARS]


@dataclass(frozen=True)
class Far:
    """The part of the region that is farther away than `near`."""

    near: Near

    def holds(self, places: Places) -> BoolArray:
        return np.asarray(places.inside & ~self.near.holds(places))


def simulated(replicate: Replicate, seed: int, frames: str, work: Path) -> Path:
    """Simulates frames of one traffic seed for all LiDARs; returns the data set's folder."""
    folder = work / "data" / f"{replicate.name}_{seed}"
    words = ["--preset", replicate.preset, "--label-time", replicate.label_time]
    words += ["--seed", str(seed), "--frames", frames, "--threads", "1", "--out", str(folder)]
    lidars = [lidar_file(name) for name in replicate.lidars]
    with held(folder.with_name(f"{folder.name}.lock"), wait=True):
        infrasim("run", scene_file(replicate.scene), "--lidar", *lidars, *words)
    return folder


def model_of(judge: str, replicate: Replicate, lidar: str, work: Path) -> tuple[Path, float]:
    """Returns the trained model of a detector in JUDGES, and the CPU seconds of its training."""
    name, tier = JUDGES[judge]
    if tier is None:
        return Path(name), 0.0
    run = work / "runs" / f"{replicate.name}_{lidar}_{judge}"
    recipe = read_recipe(RECIPES / f"{name}.yaml", tier)
    data = simulated(replicate, TRAIN_SEEDS_FROM + replicate.replicate, TRAIN_FRAMES, work)
    test = simulated(replicate, replicate.test_seeds[0], TEST_FRAMES, work)
    split.write(read_data_set(data), split.by_seed(read_data_set(data), read_data_set(test))[0])
    source = read_source(data / lidar, tier, classes=recipe.classes)
    train(recipe, [source], run, seed=replicate.replicate, quiet=True)
    log = run / "log.csv"
    return run, float(read_csv(log).cpu_seconds.sum()) if log.is_file() else 0.0


def rows_of_test(model: Path, folder: Path, predictions: Path) -> list[dict[str, object]]:
    """Runs a model on all frames of a LiDAR's folder.

    Returns one row of measures per ground-truth subset.
    """
    numbers = kitti.frames(folder)
    predictions.mkdir(parents=True, exist_ok=True)
    files = [kitti.frame_file(folder, "velodyne", k) for k in numbers]
    write_origin(predictions, origin_of(folder, detect.model_file(model)), anew=True)
    detect.detect(detect.detector_at(model, folder), files, predictions)
    results = match_results_of(folder, predictions, SETTINGS, frames=numbers)
    return [
        {"subset": subset, "frames": len(numbers), **measures(result)}
        for subset, result in zip(SUBSETS, results, strict=True)
    ]


def measures(result: MatchResult) -> dict[str, object]:
    near = Near(SPLIT_M, sensor_of(result.match_input.truth))
    areas = area_table(result, *distance_table(result, SETTINGS.min_objects)).iloc[0]
    return {
        "ap_r1000": ap_of(result),
        "ap_r1000_near": ap_of(result, near),
        "ap_r1000_far": ap_of(result, Far(near)),
        "n_hqda": areas.n_hqda,
        "p_hqda": areas.p_hqda,
        "objects": result.objects,
    }


def ap_of(result: MatchResult, part: Part | None = None) -> float:
    return float(ap.average_precision(result.ranking(part), ap.R1000_RECALLS)[0])


def key_of(judge: str, replicate: Replicate, lidar: str) -> dict[str, object]:
    return {**asdict(replicate), "lidar": lidar, "detector": JUDGES[judge][0], "judge": judge}


def is_done(judge: str, replicate: Replicate, lidar: str, out: Path) -> bool:
    """Returns whether the table has all rows of one trained detector."""
    wanted = [
        {**key_of(judge, replicate, lidar), "seed": seed, "subset": subset}
        for seed, subset in itertools.product(replicate.test_seeds, SUBSETS)
    ]
    return all(store.has_each(store.read(out, KEY), wanted))


def fill(judge: str, replicate: Replicate, lidar: str, work: Path, out: Path) -> None:
    """Adds the rows of one trained detector, unless another process is computing them."""
    key = key_of(judge, replicate, lidar)

    def run() -> None:
        model, seconds = model_of(judge, replicate, lidar, work)
        rows = []
        for seed in replicate.test_seeds:
            data = simulated(replicate, seed, TEST_FRAMES, work)
            predictions = work / "predictions" / f"{replicate.name}_{lidar}_{judge}_{seed}"
            tested = rows_of_test(model, data / lidar, predictions)
            rows += [{**key, "seed": seed, **row} for row in tested]
        words = f"experiments --scenes {replicate.scene} --presets {replicate.preset}"
        columns = {"train_cpu_s": round(seconds, 1), **provenance(words)}
        table = pd.DataFrame(rows).assign(**columns)
        store.put(out, table[[*KEY, *(name for name in table if name not in KEY)]], KEY)
        first = table[table.subset == "captured"].ap_r1000
        print(replicate.name, lidar, judge, *first.round(1), flush=True)

    lock = work / "locks" / f"{replicate.name}_{lidar}_{judge}"
    store.fill(lock, lambda: is_done(judge, replicate, lidar, out), run)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--work", type=Path, required=True, help="working folder for frames, about 3 GB"
    )
    add_out(parser, "experiments.csv")
    parser.add_argument("--scenes", nargs="+", default=["highway", "crossroad", "curve"])
    parser.add_argument("--presets", nargs="+", choices=PRESETS, default=["paper", "datasheet"])
    parser.add_argument("--judges", nargs="+", choices=JUDGES, default=list(JUDGES))
    parser.add_argument("--replicates", type=int, default=3, help="default: %(default)s")
    args = parser.parse_args()
    for scene, number, preset in itertools.product(
        args.scenes, range(1, args.replicates + 1), args.presets
    ):
        replicate = Replicate(scene, preset, "scan", number)
        for lidar, judge in itertools.product(replicate.lidars, args.judges):
            fill(judge, replicate, lidar, args.work, args.out)
        pairs = itertools.product(replicate.lidars, args.judges)
        if not all(is_done(judge, replicate, lidar, args.out) for lidar, judge in pairs):
            continue  # another process still uses the frames
        for made in (args.work / "data").glob(f"{replicate.name}_*[0-9]"):
            if made.is_dir():
                shutil.rmtree(made)
