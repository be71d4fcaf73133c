"""What a benchmark would do, without doing it."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pyinfra.experiments import store
from pyinfra.experiments.benchmark import inputs
from pyinfra.experiments.benchmark.matrix import Cell, Plan
from pyinfra.experiments.benchmark.provenance import stale
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.value import KEY

# CPU seconds of a cell on one core where no row says better: training, detection, evaluation.
SECONDS = {"smoke": 60.0, "quick": 400.0, "full": 4000.0}
BACKGROUND_S = 20.0


def outlook(plan: Plan, workspace: Workspace, jobs: int) -> str:
    """The cells that are not finished and how long they will take by those that are; stale rows.

    Raises what `benchmark` would raise of scenes and LiDARs, such as a preset that a LiDAR has not.
    """
    inputs.check_names(plan)
    inputs.digests(plan)
    table = workspace.finished()
    known = store.has_each(table, [vars(cell) for cell in plan.cells])
    left = [cell for cell, there in zip(plan.cells, known, strict=True) if not there]
    old = stale(plan, table)
    seconds = expected_seconds(left, table)
    lines = [f"{cell.title}: {s:.0f} s" for cell, s in zip(left, seconds, strict=True)]
    names = old[KEY].astype(str).agg(" ".join, axis=1) if len(old) else ()
    lines += [f"{name}: stale, of another recipe or other frames" for name in names]
    total = sum(seconds)
    lines.append(
        f"{len(left)} of {len(plan.cells)} cells to do: {total / 60:.0f} core-minutes, "
        f"about {total / 60 / jobs:.0f} minutes with {jobs} jobs"
    )
    return "\n".join(lines)


def expected_seconds(cells: Sequence[Cell], table: pd.DataFrame) -> list[float]:
    """Of each cell: the median of its detector's rows, else what the tier allows."""
    known = table.groupby("detector").train_seconds.median() if len(table) else {}
    usual = {"background": BACKGROUND_S}
    return [
        float(known.get(cell.detector, usual.get(cell.detector, SECONDS[cell.tier])))
        for cell in cells
    ]
