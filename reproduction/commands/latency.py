"""Measures the latency of a benchmark's networks on an idle machine, with reduced training.

    python -m reproduction latency configs/benchmarks/paper.yaml --scenes crossroad curve

The latency of a network depends on its layer widths and its grid size, and hardly on its weights.
Each network is therefore trained with a tenth of its steps. Two networks are trained at a time, but
the latency of each network is measured alone. PointRCNN is trained with half of its steps, because
its latency depends on the number of confident proposals. `--check` measures the experiments of
CHECKED after reduced and after full training, to show the difference. Existing rows of
out/latency.csv are not measured again. New values also replace those in out/quick.csv, if that
table has the experiment.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import pandas as pd

from pyinfra.experiments import store
from pyinfra.experiments.benchmark import measure
from pyinfra.experiments.benchmark.latency import put_latency
from pyinfra.experiments.benchmark.matrix import Experiment, Plan, read_plan
from pyinfra.experiments.benchmark.runner import simulate_data_sets
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.pool import Pool, call_all
from pyinfra.experiments.value import KEY
from pyinfra.models.training.recipe import read_recipe
from reproduction import ROOT, add_out

BUDGET = 0.1
BUDGETS = {"pointrcnn": 0.5, "pointrcnn-remedied": 0.5}
CHECKED = tuple(
    Experiment("highway", "ruby_plus", "paper", detector, "quick", 1)
    for detector in ("pointpillars", "pointrcnn-remedied", "pv-rcnn")
)


@dataclass(frozen=True)
class Task:
    """An experiment, and the share of its training steps that is run."""

    experiment: Experiment
    budget: float

    @property
    def key(self) -> dict[str, object]:
        return {**asdict(self.experiment), "budget": self.budget}

    def run(self, workspace: Workspace) -> Path:
        return workspace.work / "latency" / f"{self.experiment.name}_{self.budget:g}"


def tasks_of(plan: Plan, scenes: Sequence[str], check: bool) -> list[Task]:
    """Returns the tasks for all networks of the scenes.

    With `check`, returns two tasks for each experiment of CHECKED: reduced and full training.
    """
    if check:
        return [
            Task(experiment, budget)
            for experiment in CHECKED
            for budget in (budget_of(experiment), 1.0)
        ]
    experiments = [c for c in plan.experiments if c.detector != "background" and c.scene in scenes]
    return [Task(experiment, budget_of(experiment)) for experiment in experiments]


def budget_of(experiment: Experiment) -> float:
    return BUDGETS.get(experiment.detector, BUDGET)


def learn(task: Task, plan: Plan, workspace: Workspace) -> None:
    """Trains a task's network; resumes a stopped training."""
    recipe = read_recipe(plan.files["detectors", task.experiment.detector], task.experiment.tier)
    folder = workspace.data(task.experiment.data_set) / task.experiment.lidar
    measure.trained(
        task.experiment, recipe.for_budget(task.budget), folder, task.run(workspace), "cpu"
    )


def measured(task: Task, workspace: Workspace, every: int) -> None:
    """Measures the latency of a task's network on one thread and writes it to both tables."""
    folder = workspace.data(task.experiment.data_set) / task.experiment.lidar
    columns, _ = measure.timed_alone(task.run(workspace), folder, "cpu", every=every)
    provenance = {"frames": columns["latency_frames"], "command": "python -m reproduction latency"}
    row = pd.DataFrame([{**task.key, **columns, **provenance}])
    store.put(workspace.results / "latency.csv", row, [*KEY, "budget"])
    put_latency(task.experiment, workspace, columns)
    print(task.experiment.title, task.budget, columns["latency_p50_ms"], "ms", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", type=Path, help="benchmark file, as in configs/benchmarks")
    parser.add_argument(
        "--scenes",
        nargs="+",
        default=["highway", "crossroad", "curve"],
        help="names of the scenes (default: all three)",
    )
    parser.add_argument(
        "--check", action="store_true", help="measure the experiments of CHECKED only"
    )
    parser.add_argument(
        "--work",
        type=Path,
        default=ROOT / "data/benchmark",
        help="working folder of a benchmark (default: data/benchmark)",
    )
    add_out(parser)
    parser.add_argument(
        "--every", type=int, default=3, help="use every Nth test frame (default: 3)"
    )
    parser.add_argument(
        "--only-train", action="store_true", help="train the networks, but do not measure latencies"
    )
    args = parser.parse_args()
    plan, workspace = read_plan(args.config, "quick"), Workspace(args.work, args.out, "quick")
    table = store.read(args.out / "latency.csv")
    tasks = tasks_of(plan, args.scenes, args.check)
    tasks = [task for task in tasks if not store.has(table, task.key)]
    simulate_data_sets(plan, workspace, Pool(jobs=2))
    call_all(partial(learn, plan=plan, workspace=workspace), tasks, Pool(jobs=2))
    if args.only_train:
        return
    for task in tasks:
        measured(task, workspace, args.every)
