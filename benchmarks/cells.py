"""What `pyinfra benchmark` adds to its cells, and two workers against one: results/cells.csv.

    .venv/bin/python benchmarks/cells.py

Smoke tier, where cells are shortest and the share of what surrounds them is largest. Two bare
processes with half of the cells each are the bound that the machine itself sets: they share its
memory.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pandas as pd

from pyinfra.core.files import replacing
from pyinfra.core.version import __version__, machine
from pyinfra.experiments.benchmark import measure
from pyinfra.experiments.benchmark.matrix import Cell, Plan, read_plan
from pyinfra.experiments.benchmark.runner import Workspace, benchmark, simulate_worlds
from pyinfra.experiments.pool import Pool
from pyinfra.models.training.recipe import read_recipe

ROOT = Path(__file__).resolve().parent.parent
MATRIX = """
matrix:
  - scenes: [highway]
    lidars: [livox_avia, helios_16]
    presets: [paper]
    detectors: [pointpillars, centerpoint-pillar]
"""


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def alone(plan: Plan, cells: Sequence[Cell], workspace: Workspace, name: str) -> None:
    """The cells one after the other in this process, no rows written."""
    for cell in cells:
        recipe = read_recipe(plan.files["detectors", cell.detector], cell.tier)
        folder = workspace.data(cell.world) / cell.lidar
        measure.tables(cell, recipe, folder, workspace.work / name / cell.name)


def side_by_side(plan: Plan, workspace: Workspace) -> None:
    """Half of the cells in each of two processes: one of each LiDAR and of each detector."""
    first, second, third, fourth = plan.cells
    halves = [(first, fourth), (second, third)]
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for done in [pool.submit(alone, plan, half, workspace, "beside") for half in halves]:
            done.result()


def through(plan: Plan, workspace: Workspace, jobs: int) -> None:
    """The same cells through the benchmark, from the start but for the frames."""
    shutil.rmtree(workspace.work / "runs", ignore_errors=True)
    shutil.rmtree(workspace.results, ignore_errors=True)
    benchmark(plan, workspace, Pool(jobs=jobs))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "cells.csv")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        (work / "cells.yaml").write_text(MATRIX)
        plan = read_plan(work / "cells.yaml", "smoke")
        workspace = Workspace(work, work / "results", "smoke")
        simulate_worlds(plan, workspace, Pool())
        times = {
            "cells alone": seconds(lambda: alone(plan, plan.cells, workspace, "alone")),
            "cells in two bare processes": seconds(lambda: side_by_side(plan, workspace)),
            "benchmark, one worker": seconds(lambda: through(plan, workspace, 1)),
            "benchmark, two workers": seconds(lambda: through(plan, workspace, 2)),
        }
    bare, beside, one, two = times.values()
    rows = [{"what": what, "value": value, "unit": "s"} for what, value in times.items()]
    rows.append({"what": "overhead", "value": 100 * (one / bare - 1), "unit": "%"})
    rows.append({"what": "two bare processes", "value": bare / beside, "unit": "speed-up"})
    rows.append({"what": "two workers against one", "value": one / two, "unit": "speed-up"})
    about = {"command": "benchmarks/cells.py", "version": __version__, "machine": machine()}
    table = pd.DataFrame(rows).assign(**about)
    with replacing(args.out) as file:
        table.to_csv(file, index=False, float_format="%.4g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
