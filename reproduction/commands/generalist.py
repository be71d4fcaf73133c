"""Compares the AP of the pretrained detector with the AP of site-trained detectors.

An experiment has a site, a traffic seed and a LiDAR. The sites are generated ones that the training
of the pretrained detector did not use. Each experiment tests four arms,
which are ways to train a detector:

- `none`: the pretrained detector without further training;
- `tuned_30` and `tuned_120`: the pretrained detector after about 30 and 120 s of training on one
  core, with simulated labels of the site;
- `site_trained`: a network that is trained from scratch at the site only.

The command adds each row to out/generalist.csv as soon as it is computed. Existing rows of the same
initial weights (column `start`) are not computed again.

    python -m reproduction generalist --work data/generalist
"""

import itertools
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import pandas as pd
import yaml

from pyinfra.core.vocabulary import Tier
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frames import frame_numbers
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.metrics.evaluate import match_results_of
from pyinfra.metrics.evaluation_tables import ap_r1000_of, r1000_columns
from pyinfra.metrics.settings import Settings
from pyinfra.models.inference import detect
from pyinfra.models.training import checkpoint
from pyinfra.models.training.recipe import Recipe, read_recipe
from pyinfra.models.training.sources import read_source
from pyinfra.models.training.train import train
from pyinfra.scenes.generator import random_stream
from pyinfra.scenes.generator.generate import make_site
from reproduction import ROOT, provenance
from reproduction.arguments import Out, Work, command
from reproduction.frozen_sites import HELD_OUT
from reproduction.measures import detected
from reproduction.simulate import simulate

RECIPES = ROOT / "configs/detectors"
FIRST_SITE = 2_000_000  # first seed of the sites; training and calibration used smaller seeds
SCENES = ("highway", "crossroad", "curve")
STUDIED = ("ruby_plus", "livox_avia", "helios_16", "pandar_64")
FRAMES = "0:5000:10"  # frames of 500 s; the first 400 s are for training, the last 90 s for tests
ARMS = ("none", "tuned_30", "tuned_120", "site_trained")
SETTINGS = Settings(ground_truths=("captured",))
KEY = ["site", "seed", "lidar", "preset", "arm"]


@dataclass(frozen=True)
class Experiment:
    """One LiDAR at one site with one traffic seed.

    site: a scene of the study, or the name of a generated site
    """

    site: str
    seed: int
    lidar: str
    preset: str = "datasheet"

    @property
    def name(self) -> str:
        return "_".join(map(str, asdict(self).values()))


def experiments(sites: int, seeds: int) -> Iterator[Experiment]:
    """Yields an experiment for every site and every seed.

    Successive sites have different LiDARs. Another seed gives a site another LiDAR.
    """
    lidars = (*STUDIED, *HELD_OUT)
    for seed, site in itertools.product(range(1, seeds + 1), range(sites)):
        name = f"site_v{random_stream.VERSION}_{FIRST_SITE + site}"
        yield Experiment(name, seed, lidars[(site + 3 * seed) % len(lidars)])


def simulated(experiment: Experiment, work: Path) -> Path:
    """Simulates an experiment's frames, splits them by time and returns the LiDAR's folder."""
    scene: str | Path = experiment.site
    if experiment.site not in SCENES:
        work.mkdir(parents=True, exist_ok=True)
        keys = make_site(int(experiment.site.split("_")[-1])) | {
            "duration_s": 500.0,
            "name": experiment.site,
        }
        scene = work / f"{experiment.site}.yaml"
        scene.write_text(yaml.safe_dump(keys))
    made = simulate(
        scene, [experiment.lidar], work / experiment.name, parts=Parts(), preset=experiment.preset,
        seed=experiment.seed, label_time="scan", frames=FRAMES, threads=1,
    )  # fmt: skip
    return made / experiment.lidar


def shows_vehicles(folder: Path) -> bool:
    """Returns True if the training part and the test part both have vehicles with points."""
    parts = (read_vehicles(folder, frame_numbers(folder, part)) for part in ("train", "val"))
    return all((vehicles.points > 0).any() for vehicles in parts)


def recipe_of(arm: str, model: Path) -> Recipe:
    """Returns the recipe with which an arm is trained at the site."""
    if arm == "site_trained":
        return read_recipe(RECIPES / "centerpoint-pillar.yaml", "quick")
    tier: Tier = "smoke" if arm == "tuned_30" else "quick"
    return read_recipe(RECIPES / "generalist.yaml", tier).begun_with(model)


def model_of(arm: str, model: Path, folder: Path, run: Path) -> tuple[Path, int, float]:
    """Returns the arm's model, the number of training steps and their CPU seconds."""
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
    (match_result,) = match_results_of(folder, detected(file, folder, run), SETTINGS)
    columns = r1000_columns(match_result, ap_r1000_of(match_result))
    return {
        "steps": steps,
        "train_cpu_s": round(seconds, 1),
        **{name: round(v, 3) for name, v in columns.items()},
        "objects": match_result.objects,
    }


def start_of(arm: str, model: Path) -> str:
    """Returns the digest of the weights that an arm starts from, or `random`."""
    return "random" if arm == "site_trained" else checkpoint.digest(detect.model_file(model))


@command
def main(
    *,
    work: Work,
    model: Path = Path("generalist"),
    out: Out = Path("generalist.csv"),
    sites: int = 13,
    seeds: int = 1,
    arms: Annotated[Sequence[str], {"choices": ARMS}] = tuple(ARMS),
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 1 GB
    model : run folder, model file or name of the pretrained detector (default: %(default)s)
    sites : number of generated sites (default: 13)
    seeds : traffic seeds per site (default: 1)
    arms : arms to test (default: all)
    """
    made_by = provenance(f"generalist --model {model} --seeds {seeds} --sites {sites}")
    for experiment in experiments(sites, seeds):
        key = asdict(experiment)
        table = store.read(out, [*KEY, "start"])
        starts = {arm: start_of(arm, model) for arm in arms}
        wanted = {arm: {**key, "arm": arm, "start": start} for arm, start in starts.items()}
        left = [arm for arm, values in wanted.items() if not store.has(table, values)]
        if not left:
            continue
        folder = simulated(experiment, work)
        if not shows_vehicles(folder):
            print(experiment.name, "shows no vehicle: left out", flush=True)
            left = []
        for arm in left:
            record = {**wanted[arm], **row(folder, arm, model), **made_by}
            store.put(out, pd.DataFrame([record]), KEY)
            print(*(record[name] for name in (*KEY, "ap_r1000", "train_cpu_s")), flush=True)
        shutil.rmtree(folder.parent)
