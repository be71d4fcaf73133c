"""Runs a benchmark: simulation, tables of the data sets, experiments, prices and latencies."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import ConfigError, keep_traceback
from pyinfra.core.files import held
from pyinfra.experiments import pool, store
from pyinfra.experiments.benchmark import frames, inputs, measure
from pyinfra.experiments.benchmark.latency import time_untimed
from pyinfra.experiments.benchmark.matrix import Experiment, Plan
from pyinfra.experiments.benchmark.provenance import check_experiments, claim_run, inputs_of
from pyinfra.experiments.benchmark.workspace import KEYS, Workspace
from pyinfra.experiments.gpus import exclusive_gpu
from pyinfra.experiments.pool import Progress, silent
from pyinfra.experiments.value import KEY, mounts_of, value_table
from pyinfra.metrics.intervals import NO_INTERVAL
from pyinfra.metrics.row_selection import AP_R1000
from pyinfra.models.training.recipe import read_recipe

READ = ("experiments", "areas", "distance", "lidars", "hits")


def benchmark(
    plan: Plan,
    workspace: Workspace,
    where: pool.Pool,
    *,
    device: str = "cpu",
    progress: Progress = silent,
) -> None:
    """Runs the experiments that have no row yet, and writes the tables of results.

    Failed experiments are tried again. Latencies are measured at the end, one detector at a time,
    when no other part of the benchmark runs. An experiment that fails raises no error, but gets a
    row with the reason.

    progress: called with a line for each step and experiment, also in the processes of the pool.
    Raises SimulatorError if a data set cannot be made, and ConfigError if the tables were made from
    other inputs.
    """
    inputs.resolved.cache_clear()
    inputs.check_names(plan)
    for folder in (workspace.work, workspace.results):
        folder.mkdir(parents=True, exist_ok=True)  # an invalid folder raises an error at the start
    digests = inputs.digests(plan)
    inputs.check_frames(workspace.table("hits"), digests)
    check_experiments(workspace.table("experiments"), plan, progress)
    inputs.check_lidars(workspace.table("hits"), plan, workspace.data)
    check_costs(workspace, plan)
    forget_failed(workspace, plan)
    left = workspace.without_row(plan.experiments)
    if left:
        simulate_data_sets(plan, workspace, where, digests, progress)
        pool.run(
            partial(
                fill,
                plan=plan,
                workspace=workspace,
                digests=digests,
                device=device,
                progress=progress,
            ),
            left,
            where,
            left=workspace.without_row,
            lost=lambda experiment, error: workspace.put(measure.failed(experiment, error)),
            progress=progress,
        )
    conclude(workspace, plan)
    time_untimed(plan, workspace, device=device, progress=progress)


def check_costs(workspace: Workspace, plan: Plan) -> None:
    """Raises ConfigError if the site's costs in the price table differ from those of the plan."""
    table = store.read(workspace.table("value"))
    for mounts, rows in table.groupby(mounts_of(table)) if len(table) else ():
        allowed = plan.costs.of_mounts(mounts).site_usd
        # Tables keep six significant digits of a price with cents.
        other = [usd for usd in rows.site_usd if not math.isclose(usd, allowed, rel_tol=1e-5)]
        if other:
            raise ConfigError(
                f"{workspace.table('value')}: site_usd: expected {allowed:g} as in this "
                f"benchmark, got {other[0]:g}; choose a different `out`"
            )


def forget_failed(workspace: Workspace, plan: Plan) -> None:
    """Removes the rows of the plan's failed experiments from the table."""
    file = workspace.table("experiments")
    table = store.read(file)
    if "reason" not in table:
        return
    wanted = store.among(
        table, pd.DataFrame([asdict(experiment) for experiment in plan.experiments]), KEY
    )
    rows = table[table.reason.notna() & wanted]
    if len(rows):
        store.drop(file, rows, KEY)


def simulate_data_sets(
    plan: Plan,
    workspace: Workspace,
    where: pool.Pool,
    digests: pd.DataFrame,
    progress: Progress = silent,
) -> None:
    """Simulates and splits all data sets of the plan, and writes their tables."""
    for data_set, experiments in plan.data_sets().items():
        frames.check_data_set(workspace.data(data_set), plan)
        for name in frames.lidars_of(experiments):
            for file in lidar_files(workspace.work / "data" / data_set, name):
                inputs.renew_price(plan.files["lidars", name], experiments[0].preset, file)
    shards = frames.shards(plan, workspace.work, where.jobs)
    progress(f"pyinfra: {len(plan.data_sets())} data sets in {len(shards)} shards")
    for line in frames.warnings(plan):
        progress(f"pyinfra: warning: {line}")
    pool.call_all(frames.simulate, shards, replace(where, gpu=False))
    for data_set, experiments in plan.data_sets().items():
        frames.split_by_time(workspace.data(data_set), plan.parts)
        if not is_described(workspace, experiments):
            tables = frames.described(workspace.data(data_set), experiments)
            tables["hits"] = tables["hits"].merge(digests, on=inputs.FRAMES_OF, how="left")
            workspace.put(tables)


def lidar_files(folder: Path, name: str) -> list[Path]:
    """Returns every `lidar.yaml` of a LiDAR in a data set, including those of several mounts."""
    files = (folder / name / "lidar.yaml", *folder.glob(f"*/{name}/lidar.yaml"))
    return [file for file in files if file.is_file()]


def is_described(workspace: Workspace, experiments: Sequence[Experiment]) -> bool:
    """Returns whether every LiDAR of one data set's experiments has a row in table `hits`."""
    hits = store.read(workspace.table("hits"))
    wanted = [{key: getattr(experiment, key) for key in KEYS["hits"]} for experiment in experiments]
    return all(store.has_each(hits, wanted))


def fill(
    experiment: Experiment,
    plan: Plan,
    workspace: Workspace,
    digests: pd.DataFrame,
    device: str,
    progress: Progress = silent,
) -> None:
    """Runs one experiment and adds its rows, unless another process runs it.

    If the experiment raises an exception, its row has the message as the reason. The traceback is
    saved next to the training folder.
    """
    run = workspace.work / "runs" / experiment.name
    traceback = run.with_name(f"{run.name}.traceback.txt")

    def measured() -> None:
        try:
            recipe = read_recipe(plan.files["detectors", experiment.detector], experiment.tier)
            experiment_inputs = inputs_of(experiment, recipe, digests)
            claim_run(run, experiment_inputs)
            folder = workspace.data(experiment.data_set) / experiment.lidar
            with exclusive_gpu(device, workspace.work) as gpu:
                tables = measure.tables(experiment, recipe, folder, run, device=gpu)
            tables["experiments"] = tables["experiments"].assign(**experiment_inputs)
            traceback.unlink(missing_ok=True)
        except Exception as error:  # after any error, the other experiments continue
            keep_traceback(error, traceback)
            tables = measure.failed(experiment, error)
        workspace.put(tables)
        conclude(workspace, plan)
        progress(row_line(experiment, tables["experiments"].iloc[0]))

    lock = run.with_name(f"{run.name}.lock")
    store.fill(lock, lambda: not workspace.without_row([experiment]), measured)


def row_line(experiment: Experiment, row: pd.Series) -> str:
    if pd.notna(row.get("reason")):
        return f"{experiment.title}: failed: {row.reason}"
    span = f"[{row.ap_r1000_low:.1f}, {row.ap_r1000_high:.1f}]"
    ap = f"{AP_R1000} {row.ap_r1000:.1f} {span if pd.notna(row.ap_r1000_low) else NO_INTERVAL}"
    findings = f"; {row.findings}" if row.findings else ""
    return f"{experiment.title}: {ap}, {row.train_seconds} s{findings}"


def conclude(workspace: Workspace, plan: Plan) -> None:
    """Updates the table of prices, which has a row for each finished experiment."""
    with held(workspace.results / "locks/conclude", wait=True):
        tables = {name: store.read(workspace.table(name)) for name in READ}
        if all(len(table) for table in tables.values()):
            tables["lidars"] = inputs.with_prices(plan, tables["lidars"])
            workspace.put({"lidars": tables["lidars"]})
            workspace.put({"value": value_table(tables, plan.costs)})
