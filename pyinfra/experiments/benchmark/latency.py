"""Measures the latency of detectors, one at a time, after the experiments of a benchmark.

A detector can take four times as long while other experiments run. Therefore no latency is measured
during the experiments.
"""

from collections.abc import Sequence
from dataclasses import asdict

import pandas as pd

from pyinfra.core.errors import keep_traceback
from pyinfra.core.files import held
from pyinfra.experiments import store
from pyinfra.experiments.benchmark import inputs, measure
from pyinfra.experiments.benchmark.matrix import Experiment, Plan
from pyinfra.experiments.benchmark.provenance import check_experiments, claim_run, inputs_of
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.gpus import exclusive_gpu
from pyinfra.experiments.pool import Progress, silent
from pyinfra.experiments.value import KEY
from pyinfra.models.training.recipe import read_recipe

LOCK = "latency.lock"  # lock file, shared by all commands that use the same work folder


def time_untimed(
    plan: Plan, workspace: Workspace, *, device: str = "cpu", progress: Progress = silent
) -> None:
    """Times the finished experiments that have no latency, after all experiments of the plan.

    If another command still runs experiments of the plan, that command times all of them.
    """
    if workspace.without_row(plan.experiments):
        progress("pyinfra: another command still runs experiments; it will measure the latencies")
        return
    with held(workspace.work / LOCK, wait=True):
        table = workspace.finished()
        untimed = table[table.latency_p50_ms.isna()] if len(table) else table
        left = store.with_row(plan.experiments, untimed)
        digests = inputs.digests(plan)
        for experiment in with_run(left, workspace):
            try:
                time_experiment(experiment, plan, workspace, digests, device, progress)
            except Exception as error:  # after any error, the other experiments are still timed
                keep_traceback(error, workspace.work / "runs" / f"{experiment.name}.traceback.txt")
                progress(f"{experiment.title}: no latency: {type(error).__name__}: {error}")


def with_run(experiments: Sequence[Experiment], workspace: Workspace) -> list[Experiment]:
    return [
        experiment
        for experiment in experiments
        if (workspace.work / "runs" / experiment.name).is_dir()
    ]


def time_experiment(
    experiment: Experiment,
    plan: Plan,
    workspace: Workspace,
    digests: pd.DataFrame,
    device: str,
    progress: Progress,
) -> None:
    """Measures the latency of a finished experiment and adds it to the experiment's row.

    Raises the errors of detectors and of reading files.
    """
    run = workspace.work / "runs" / experiment.name
    recipe = read_recipe(plan.files["detectors", experiment.detector], experiment.tier)
    claim_run(run, inputs_of(experiment, recipe, digests))
    with exclusive_gpu(device, workspace.work) as gpu:
        folder = workspace.data(experiment.data_set) / experiment.lidar
        columns, load = measure.timed_alone(run, folder, gpu)
    put_latency(experiment, workspace, columns)
    progress(f"{experiment.title}: {columns['latency_p50_ms']} ms a frame; {load.text}")


def put_latency(experiment: Experiment, workspace: Workspace, columns: dict[str, object]) -> None:
    """Replaces the latency in the row of an experiment, if the experiment is finished."""
    table = workspace.finished()
    rows = (
        table[store.among(table, pd.DataFrame([asdict(experiment)]), KEY)] if len(table) else table
    )
    if len(rows):
        workspace.put({"experiments": rows.assign(**columns)})


def time_again(
    plan: Plan, workspace: Workspace, *, device: str = "cpu", progress: Progress = silent
) -> None:
    """Times every finished experiment whose trained detector is in the work folder.

    Raises FileNotFoundError if the work folder has no trained detector.
    """
    check_experiments(workspace.table("experiments"), plan, progress)
    finished = store.with_row(plan.experiments, workspace.finished())
    here = with_run(finished, workspace)
    if not here:
        runs = workspace.work / "runs"
        raise FileNotFoundError(
            2, f"The folder has no run of the {len(finished)} finished experiments", str(runs)
        )
    with held(workspace.work / LOCK, wait=True):
        digests = inputs.digests(plan)
        for experiment in here:
            time_experiment(experiment, plan, workspace, digests, device, progress)
