"""Trains a detector of configs/detectors on the frames of one LiDAR, as the study's commands do."""

from dataclasses import replace
from pathlib import Path

from pyinfra.core.vocabulary import Tier
from pyinfra.formats.csv_table import read_csv
from pyinfra.models.training.accumulation import Accumulation
from pyinfra.models.training.recipe import read_recipe
from pyinfra.models.training.sources import ONE_FRAME, read_source
from pyinfra.models.training.train import train
from reproduction import ROOT


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
