"""Measures how the number of training steps and the split affect AP.

    python -m reproduction training --work data/benchmark

The command writes out/budget.csv and out/split.csv. The experiments use the highway, the Avia,
preset `paper` and tier `quick`. Existing rows are not computed again. The rows with all training
steps and with the split by time are copied from a benchmark. They are read from quick.csv in the
output folder, otherwise from results/quick.csv. Run `pyinfra benchmark` first.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import pandas as pd

from pyinfra.dataset import split
from pyinfra.dataset.catalogue import configs
from pyinfra.dataset.data_set import read_data_set
from pyinfra.experiments import store
from pyinfra.experiments.benchmark import measure
from pyinfra.experiments.benchmark.matrix import Experiment
from pyinfra.experiments.value import KEY
from pyinfra.models.training.recipe import Recipe, read_recipe
from reproduction import RECORDED, ROOT, add_out

LIDAR = "livox_avia"
BUDGETS = (0.25, 0.5)
STARVED = ("pv-rcnn", "dsvt", "pointrcnn-remedied")
LEAKING = ("pointpillars", "centerpoint-pillar")
SPLIT_SEED = 1


def experiment_of(detector: str) -> Experiment:
    return Experiment("highway", LIDAR, "paper", detector, "quick", 1)


def split_at_random(data: Path) -> Path:
    """Links all files of a data set into a new folder with a random split; returns the folder."""
    twin = data.with_name(f"{data.name}_random")
    for file in data.glob("*.*"):
        link(twin / file.name, file)
    for folder in data.glob("*/lidar.yaml"):
        for name in ("lidar.yaml", "training"):
            link(twin / folder.parent.name / name, folder.parent / name)
    source = read_data_set(twin)
    split.write(source, split.by_random(source.frames, SPLIT_SEED))
    return twin


def link(at: Path, to: Path) -> None:
    at.parent.mkdir(parents=True, exist_ok=True)
    if not at.exists():
        at.symlink_to(to.resolve())


def add(
    file: Path, experiment: Experiment, change: dict[str, object], recipe: Recipe, folder: Path
) -> None:
    """Runs an experiment with a changed setting and adds its row, unless the row exists."""
    key = dataclasses.asdict(experiment) | change
    if store.has(store.read(file, list(change)), key):
        return
    words = "_".join(str(value) for value in change.values())
    run = folder.parents[2] / "runs" / f"{experiment.name}_{words}"
    rows = measure.tables(experiment, recipe, folder, run)["experiments"].assign(**change)
    rows["command"] = "python -m reproduction training"
    store.put(file, rows, list(key))
    print(*rows.iloc[0][["detector", *change, "ap", "ap_low", "ap_high"]], flush=True)


def add_known(file: Path, detectors: tuple[str, ...], change: dict[str, object]) -> None:
    """Copies the rows of a benchmark that have the unchanged setting."""
    known = file.with_name("quick.csv")
    table = store.read(known if known.is_file() else RECORDED / "quick.csv")
    wanted = pd.DataFrame([dataclasses.asdict(experiment_of(name)) for name in detectors])
    rows = table[store.among(table, wanted, KEY)].assign(**change)
    if len(rows):
        store.put(file, rows, [*KEY, *change])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--work",
        type=Path,
        default=ROOT / "data/benchmark",
        help="working folder of a benchmark (default: data/benchmark)",
    )
    add_out(parser)
    args = parser.parse_args()
    data = args.work / "data/highway_paper"
    for detector in STARVED:
        recipe = read_recipe(configs() / f"detectors/{detector}.yaml", "quick")
        for budget in BUDGETS:
            file = args.out / "budget.csv"
            add(
                file,
                experiment_of(detector),
                {"budget": budget},
                recipe.for_budget(budget),
                data / LIDAR,
            )
    add_known(args.out / "budget.csv", STARVED, {"budget": 1.0})
    twin = split_at_random(data)
    for detector in LEAKING:
        recipe = read_recipe(configs() / f"detectors/{detector}.yaml", "quick")
        add(
            args.out / "split.csv",
            experiment_of(detector),
            {"split": "random"},
            recipe,
            twin / LIDAR,
        )
    add_known(args.out / "split.csv", LEAKING, {"split": "time"})
