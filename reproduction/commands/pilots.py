"""Trains small versions of the pretrained detector that differ in one input, with equal budgets.

Each pilot begins with the weights of the present pretrained detector and learns from the stream of
`configs/streams/generalist_v4.yaml`, with the settings of the tier `full` of
`configs/detectors/generalist_v4.yaml` and fewer steps. New inputs begin with weights of 0. A
stopped pilot resumes at its last checkpoint. The command writes RUNS/ARM_SEED and prints the CPU
seconds of each pilot; `detector_goals` measures them:

    python -m reproduction pilots --work data/pilots --steps 400 --seeds 1 2
    python -m reproduction detector_goals generalist data/pilots/single_1 data/pilots/past_1 \\
        --work data/goals --sites 20 8 --out out/pilots.csv
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import pandas as pd

from pyinfra.models.training.generated_sites import read_stream
from pyinfra.models.training.recipe import Recipe, read_recipe
from pyinfra.models.training.train import train
from reproduction import ROOT, add_work

STREAM = ROOT / "configs/streams/generalist_v4.yaml"
RECIPE = ROOT / "configs/detectors/generalist_v4.yaml"
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_work(parser, gigabytes=1)
    parser.add_argument("--steps", type=int, default=400, help="steps of a pilot (default: 400)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="seeds (default: 1)")
    parser.add_argument(
        "--arms", nargs="+", choices=ARMS, default=["single", "past"], help="pilots to train"
    )
    args = parser.parse_args()
    for seed in args.seeds:
        for arm in args.arms:
            recipe, run = recipe_of(arm, args.steps), args.work / f"{arm}_{seed}"
            stream = read_stream(STREAM, recipe.classes, recipe.past_s)
            train(recipe, stream, run, seed=seed, quiet=True)
            cpu_s = pd.read_csv(run / "log.csv").cpu_seconds.sum()
            print(run, f"{cpu_s:.0f} CPU s", flush=True)
