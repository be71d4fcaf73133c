"""Trains small versions of the pretrained detector that differ in one input, with equal budgets.

Each pilot begins with the weights of version 3 and learns from the stream of
`configs/streams/pilots.yaml`, with the settings of the tier `full` of
`configs/detectors/pilots.yaml` and fewer steps. New inputs begin with weights of 0. A stopped pilot
resumes at its last checkpoint. The command writes RUNS/ARM_SEED and prints the CPU seconds of each
pilot; `detector_goals` measures them:

    python -m reproduction pilots --work data/pilots --steps 400 --seeds 1 2
    python -m reproduction detector_goals generalist-3 data/pilots/single_1 data/pilots/past_1 \\
        --work data/goals --sites 20 8 --out out/pilots.csv
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import pandas as pd

from pyinfra.models.training.generated_sites import read_stream
from pyinfra.models.training.recipe import Recipe, read_recipe
from pyinfra.models.training.train import train
from reproduction import ROOT
from reproduction.arguments import Work, command

STREAM = ROOT / "configs/streams/pilots.yaml"
RECIPE = ROOT / "configs/detectors/pilots.yaml"
# The inputs of each pilot beside x, y and z of points.
ARMS: dict[str, dict[str, Any]] = {
    "single": {"past_s": 0.0, "intensity": False},
    "past": {"past_s": 60.0, "intensity": False},
    "past_intensity": {"past_s": 60.0, "intensity": True},
}


def recipe_of(arm: str, steps: int) -> Recipe:
    """Returns the recipe of a pilot."""
    recipe = read_recipe(RECIPE, "full")
    network = replace(recipe.network, **ARMS[arm])
    return replace(recipe, network=network, learning=replace(recipe.learning, steps=steps))


@command
def main(
    *,
    work: Work,
    steps: int = 400,
    seeds: Sequence[int] = (1,),
    arms: Annotated[Sequence[str], {"choices": ARMS}] = ("single", "past"),
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 1 GB
    steps : steps of a pilot (default: 400)
    seeds : seeds (default: 1)
    arms : pilots to train
    """
    for seed in seeds:
        for arm in arms:
            recipe, run = recipe_of(arm, steps), work / f"{arm}_{seed}"
            stream = read_stream(STREAM, recipe.classes, recipe.past_s)
            train(recipe, stream, run, seed=seed, quiet=True)
            cpu_s = pd.read_csv(run / "log.csv").cpu_seconds.sum()
            print(run, f"{cpu_s:.0f} CPU s", flush=True)
