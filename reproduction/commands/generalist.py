"""Compares the pretrained detector with site-trained detectors, by AP at sites new to both.

An experiment is a site, a traffic seed and a LiDAR. A site is a scene of the study, or a generated
one that no training used. Each experiment tests the pretrained detector unchanged (`none`), after
some training steps with the site's own simulated labels (`tuned_30`, `tuned_120`: about 30 and 120
s of one core), and a network of the same kind trained only there (`specialist`). Rows with their
bootstrap replicates are added to results/generalist.csv as they are made. Existing rows of the same
weights (`start`) are not computed again.

    python -m reproduction generalist --work data/generalist

`--paper`: the experiments of a first trial, simulated as in the study.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.version import __version__, machine
from pyinfra.core.vocabulary import Tier
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frame_tables import read_vehicles
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.frames import split_by_time
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import judged
from pyinfra.metrics.evaluation_tables import fine_ap, fine_columns
from pyinfra.metrics.match_results import Judgement, Settings
from pyinfra.metrics.replicates import draw_rows, same_of
from pyinfra.models.inference import detect
from pyinfra.models.training import checkpoint
from pyinfra.models.training.recipe import Recipe, read_recipe
from pyinfra.models.training.sources import read_source
from pyinfra.models.training.train import train
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.random_stream import VERSION
from reproduction import ROOT

RECIPES = ROOT / "configs/detectors"
SCENES = ("highway", "crossroad", "curve")
FIRST_SITE = 2_000_000  # seeds from here on were in no training and no calibration
HELD_OUT = ("hesai_ot128", "hesai_xt32", "livox_horizon")  # of configs/streams/generalist.yaml
STUDIED = ("ruby_plus", "livox_avia", "helios_16", "pandar_64")
FRAMES = "0:5000:10"  # of 500 s; training uses the first 400 s, the test the last 90 s
CUT = 0.5  # calibrated score from which a box is shown
TRIAL = (  # experiments of a first trial, simulated as in the study
    *((site, lidar) for site in SCENES for lidar in ("ruby_plus", "livox_avia")),
    ("highway", "helios_16"),
)
ARMS = ("none", "tuned_30", "tuned_120", "specialist")
SETTINGS = Settings(ground_truths=("captured",))
KEY = ["site", "seed", "lidar", "preset", "arm"]


@dataclass(frozen=True)
class Cell:
    """One LiDAR at one site with one traffic seed."""

    site: str
    seed: int
    lidar: str
    preset: str = "datasheet"

    @property
    def name(self) -> str:
        return "_".join(map(str, asdict(self).values()))


def cells(sites: int, seeds: int) -> Iterator[Cell]:
    """Yields every site with every seed.

    The LiDARs rotate over the sites and shift with the seed.
    """
    lidars = (*STUDIED, *HELD_OUT)
    generated = [f"site_v{VERSION}_{FIRST_SITE + i}" for i in range(sites)]
    chosen = enumerate((*SCENES, *generated))
    for seed, (turn, site) in itertools.product(range(1, seeds + 1), chosen):
        yield Cell(site, seed, lidars[(turn + len(SCENES) * (seed - 1)) % len(lidars)])


def cells_of_trial(seeds: int) -> Iterator[Cell]:
    for seed, (site, lidar) in itertools.product(range(1, seeds + 1), TRIAL):
        yield Cell(site, seed, lidar, "paper")


def simulated(cell: Cell, work: Path) -> Path:
    """Simulates an experiment, splits it by time and returns the LiDAR's folder."""
    scene = scene_file(cell.site) if cell.site in SCENES else work / f"{cell.site}.yaml"
    if cell.site not in SCENES:
        work.mkdir(parents=True, exist_ok=True)
        keys = make_site(int(cell.site.split("_")[-1])) | {"duration_s": 500.0, "name": cell.site}
        scene.write_text(yaml.safe_dump(keys))
    words = ["--preset", cell.preset, "--seed", str(cell.seed), "--label-time", "scan"]
    words += ["--frames", FRAMES, "--out", str(work / cell.name), "--threads", "1"]
    infrasim("run", scene, "--lidar", lidar_file(cell.lidar), *words)
    split_by_time(work / cell.name, Parts())
    return work / cell.name / cell.lidar


def shows_vehicles(folder: Path) -> bool:
    """Returns whether both the training and the test part have vehicles with points."""
    parts = (read_vehicles(folder, frame_numbers(folder, part)) for part in ("train", "val"))
    return all((vehicles.points > 0).any() for vehicles in parts)


def recipe_of(arm: str, model: Path) -> Recipe:
    """Returns the training recipe of an arm at the site."""
    if arm == "specialist":
        return read_recipe(RECIPES / "centerpoint-pillar.yaml", "quick")
    tier: Tier = "smoke" if arm == "tuned_30" else "quick"
    return read_recipe(RECIPES / "generalist.yaml", tier).begun_with(model)


def model_of(arm: str, model: Path, folder: Path, run: Path) -> tuple[Path, int, float]:
    """Returns the arm's model, its training steps and their CPU seconds."""
    if arm == "none":
        return model, 0, 0.0
    recipe = recipe_of(arm, model)
    source = read_source(folder, "quick", classes=recipe.classes)
    file = train(recipe, [source], run, quiet=True)
    seconds = float(pd.read_csv(run / "log.csv").cpu_seconds.sum())
    return file, recipe.learning.steps, seconds


def row(folder: Path, arm: str, model: Path) -> dict[str, object]:
    run = folder.parent / f"{folder.name}_{arm}"
    file, steps, seconds = model_of(arm, model, folder, run)
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    _, times = detect.detect(detect.detector_at(file, folder), files, run / "predictions")
    (judgement,) = judged(folder, run / "predictions", SETTINGS)
    bootstrapped = fine_ap(judgement)
    same = same_of(judgement.contest.truth, judgement.contest.blocks, SETTINGS.seed)
    draws = draw_rows(same, "captured", [("ap_fine", bootstrapped)]).iloc[0]
    return {
        "steps": steps,
        "train_cpu_s": round(seconds, 1),
        "latency_p50_ms": round(float(np.median(times)), 1),
        **{name: round(v, 3) for name, v in fine_columns(judgement, bootstrapped).items()},
        "objects": judgement.objects,
        **at_cut(judgement),
        **draws.to_dict(),
    }


def at_cut(judgement: Judgement) -> dict[str, float]:
    """Returns precision and recall of the shown boxes, and the values that the scores predict.

    A site-trained detector's scores are uncalibrated. The other arms' scores use the calibration of
    the weights that they started from.
    """
    scores, hit = judgement.contest.predictions.scores, judgement.hit
    counted = hit | judgement.wrong
    shown = counted & (scores >= CUT)
    figures = {
        "precision": hit[shown].mean() if shown.any() else np.nan,
        "precision_said": scores[shown].mean() if shown.any() else np.nan,
        "recall": hit[shown].sum() / judgement.objects,
        "recall_said": scores[shown].sum() / max(scores[counted].sum(), 1e-9),
    }
    return {name: round(float(value), 4) for name, value in figures.items()}


def start_of(arm: str, model: Path) -> str:
    """Identifies the weights that an arm starts from."""
    return "drawn" if arm == "specialist" else checkpoint.digest(detect.model_file(model))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--work", type=Path, required=True, help="working folder for frames, about 1 GB"
    )
    parser.add_argument(
        "--model", type=Path, default=Path("generalist"), help="run folder, model file or name"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "generalist.csv")
    parser.add_argument(
        "--sites", type=int, default=13, help="number of generated sites (default: 13)"
    )
    parser.add_argument("--seeds", type=int, default=3, help="traffic seeds per site (default: 3)")
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS))
    parser.add_argument(
        "--paper", action="store_true", help="run the experiments of the first trial"
    )
    args = parser.parse_args()
    chosen = cells_of_trial(args.seeds) if args.paper else cells(args.sites, args.seeds)
    provenance = {
        "commit": __version__,
        "machine": machine(),
        "command": "python -m reproduction generalist",
    }
    for cell in chosen:
        key = asdict(cell)
        table = store.read(args.out, [*KEY, "start"])
        starts = {arm: start_of(arm, args.model) for arm in args.arms}
        wanted = {arm: {**key, "arm": arm, "start": start} for arm, start in starts.items()}
        arms = [arm for arm, values in wanted.items() if not store.has(table, values)]
        if not arms:
            continue
        folder = simulated(cell, args.work)
        if not shows_vehicles(folder):
            print(cell.name, "shows no vehicle: left out", flush=True)
            arms = []
        for arm in arms:
            record = {**wanted[arm], **row(folder, arm, args.model), **provenance}
            store.put(args.out, pd.DataFrame([record]), KEY)
            print(*(record[name] for name in (*KEY, "ap_fine", "train_cpu_s")), flush=True)
        shutil.rmtree(folder.parent)
