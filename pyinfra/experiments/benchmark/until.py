"""Repeats a benchmark with further traffic until a comparison is precise enough.

A replicate has its own traffic and its own training seed. The first replicate chooses the two
options (LiDAR and detector) with the highest AP of each scene and preset. After 3, 5 and 10 further
replicates, the two options are compared over the further replicates only. The choice and the
comparison therefore have no data in common. The numbers of replicates are fixed beforehand and each
comparison has a level of 1 - 0.05 / 3. The probability that any of the three intervals of a pair
excludes the true difference is therefore at most 5 %.
"""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
import yaml

from pyinfra.core.errors import Error, refuse
from pyinfra.experiments import pool, store
from pyinfra.experiments.benchmark import inputs
from pyinfra.experiments.benchmark.matrix import Plan
from pyinfra.experiments.benchmark.runner import benchmark
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.pool import Progress, silent
from pyinfra.metrics.comparison import over_replicates
from pyinfra.metrics.intervals import LEVEL
from pyinfra.metrics.row_selection import with_whole

LOOKS = (3, 5, 10)  # numbers of replicates after which options are compared
LEVEL_OF_LOOK = 1 - (1 - LEVEL) / len(LOOKS)


def benchmark_until(
    plan: Plan,
    workspace: Workspace,
    where: pool.Pool,
    half_width_ap: float,
    *,
    device: str = "cpu",
    progress: Progress = silent,
) -> pd.DataFrame:
    """Runs replicates of a benchmark until the best two options are compared precisely enough.

    The first replicate is the benchmark itself; replicate N is in the folders `replicate_N`.

    Parameters
    ----------
    half_width_ap : largest half-width of the interval of the difference, in AP

    Returns
    -------
    DataFrame with the columns of `comparison_table`. Its rows are also added to the table `until`.

    Raises Error if the benchmark has several seeds or recorded traffic, or if an experiment failed.
    """
    seeds = sorted({experiment.seed for experiment in plan.experiments})
    refuse(
        (
            len(seeds) != 1,
            f"seeds: expected one seed, got {', '.join(map(str, seeds))}; the seeds of the "
            "replicates are computed from this seed",
        ),
        (
            not half_width_ap > 0,
            f"until: expected a half-width above 0 (in AP), got {half_width_ap:g}",
        ),
    )
    for name in dict.fromkeys(experiment.scene for experiment in plan.experiments):
        file = plan.files["scenes", name]
        if not yaml.safe_load(inputs.resolved(file)).get("traffic"):
            raise Error(
                f"{file}: traffic: expected simulated traffic, got recorded trajectories; each "
                "replicate needs different traffic"
            )
    tables: list[pd.DataFrame] = []
    for look in LOOKS:
        for number in range(len(tables) + 1, look + 2):
            progress(f"pyinfra: replicate {number}")
            tables.append(_replicate(plan, workspace, where, number, device, progress))
        table = comparison_table(tables)
        workspace.put({"until": table})
        if (table.half_width <= half_width_ap).all():
            break
    return table


def _replicate(
    plan: Plan, workspace: Workspace, where: pool.Pool, number: int, device: str, progress: Progress
) -> pd.DataFrame:
    """Runs one replicate and returns its rows. Raises Error if one of its experiments failed."""
    if number > 1:
        plan = _with_other_traffic(plan, number - 1)
        name = f"replicate_{number}"
        workspace = replace(workspace, work=workspace.work / name, results=workspace.results / name)
    benchmark(plan, workspace, where, device=device, progress=progress)
    rows = workspace.finished()
    if failed := store.with_row(plan.experiments, rows, present=False):
        file = workspace.table("experiments")
        raise Error(f"{file}: expected a row of each experiment, got no row of {failed[0].title}")
    wanted = pd.DataFrame([vars(experiment) for experiment in plan.experiments])
    return rows[store.among(rows, wanted, list(wanted))]


def _with_other_traffic(plan: Plan, offset: int) -> Plan:
    experiments = tuple(replace(e, seed=e.seed + offset) for e in plan.experiments)
    return replace(plan, experiments=experiments, traffic_offset=plan.traffic_offset + offset)


def comparison_table(replicates: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Compares the best two options of the first replicate over the other replicates.

    Parameters
    ----------
    replicates : for each replicate the rows of its experiments, of each scene and preset

    Returns
    -------
    DataFrame with columns scene, preset, first, second, subset, replicates, difference, low, high
    and half_width, in AP (R1000). `first` and `second` are LiDAR and detector.
    """
    numbered = [rows.assign(replicate=number) for number, rows in enumerate(replicates)]
    table = with_whole(pd.concat(numbered, ignore_index=True))
    table = table.assign(option=table.lidar + " " + table.detector)
    rows = []
    for (scene, preset), part in table.groupby(["scene", "preset"], sort=False):
        aps = part.pivot(index="replicate", columns="option", values="ap_whole_r1000")
        best = aps.iloc[0].sort_values(ascending=False, kind="stable").index[:2]
        if len(best) < 2:
            raise Error(f"{scene} {preset}: expected two or more options to compare, got {best[0]}")
        mean = over_replicates((aps[best[0]] - aps[best[1]])[1:].to_list(), LEVEL_OF_LOOK)
        rows.append(
            {
                **{"scene": scene, "preset": preset, "first": best[0], "second": best[1]},
                **{"subset": table.whole.iloc[0], "replicates": len(replicates) - 1},
                **{"difference": mean.value, "low": mean.low, "high": mean.high},
                "half_width": (mean.high - mean.low) / 2,
            }
        )
    return pd.DataFrame(rows)
