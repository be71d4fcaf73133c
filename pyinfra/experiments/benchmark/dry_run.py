"""Dry run of a benchmark: the experiments that it would run, and how long they would take."""

from collections.abc import Sequence

import pandas as pd

from pyinfra.experiments import store
from pyinfra.experiments.benchmark import inputs
from pyinfra.experiments.benchmark.matrix import Experiment, Plan
from pyinfra.experiments.benchmark.provenance import stale
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.value import KEY

# Expected CPU time of an experiment in seconds, used until the first experiment is finished.
SECONDS = {"smoke": 60.0, "quick": 400.0, "full": 4000.0}
BACKGROUND_S = 20.0  # expected CPU time with the detector `background`, in all tiers


def dry_run_lines(plan: Plan, workspace: Workspace, jobs: int) -> str:
    """Returns a text with the unfinished experiments, their expected time, and rows out of date.

    The time is estimated from finished experiments. Raises the errors that `benchmark` would raise
    for scenes and LiDARs, for instance if a LiDAR does not have a preset.
    """
    inputs.check_names(plan)
    inputs.digests(plan)
    table = workspace.finished()
    left = store.with_row(plan.experiments, table, present=False)
    old = stale(plan, table)
    seconds = expected_seconds(left, table)
    lines = [f"{experiment.title}: {s:.0f} s" for experiment, s in zip(left, seconds, strict=True)]
    names = old[KEY].astype(str).agg(" ".join, axis=1) if len(old) else ()
    lines += [
        f"{name}: out of date (measured with another recipe or other frames)" for name in names
    ]
    total = sum(seconds)
    lines.append(
        f"{len(left)} of {len(plan.experiments)} experiments to do: {total / 60:.0f} core-minutes, "
        f"about {total / 60 / jobs:.0f} minutes with {jobs} jobs"
    )
    return "\n".join(lines)


def expected_seconds(experiments: Sequence[Experiment], table: pd.DataFrame) -> list[float]:
    """Returns the expected CPU seconds of each experiment.

    An experiment is expected to take the median training time of the detector's rows. If the
    detector has no rows, the result is BACKGROUND_S, or the value of the tier in SECONDS.
    """
    known = table.groupby("detector").train_seconds.median() if len(table) else {}
    usual = {"background": BACKGROUND_S}
    return [
        float(
            known.get(experiment.detector, usual.get(experiment.detector, SECONDS[experiment.tier]))
        )
        for experiment in experiments
    ]
