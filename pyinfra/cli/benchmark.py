"""`pyinfra benchmark configs/benchmarks/NAME.yaml --tier TIER --out RESULTS`."""

import argparse
import os
from pathlib import Path

import pandas as pd

from pyinfra.cli.messages import progress
from pyinfra.cli.parser import argument, usage
from pyinfra.core.errors import Error
from pyinfra.core.names import file_or_name
from pyinfra.core.vocabulary import TIERS
from pyinfra.dataset.catalogue import shipped
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.dry_run import dry_run_lines
from pyinfra.experiments.benchmark.latency import time_again
from pyinfra.experiments.benchmark.matrix import read_plan
from pyinfra.experiments.benchmark.runner import benchmark
from pyinfra.experiments.benchmark.until import benchmark_until
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.pool import BACKENDS, Pool

add_arguments = usage(
    "Runs an experiment for each combination of scene, LiDAR, preset, detector and seed, and "
    "writes one row of results each. A row has all that its experiment needs to be reproduced. "
    "Run the same command again to resume.",
    "example: pyinfra benchmark demo --tier smoke --out out/demo",
    argument(
        "config",
        metavar="CONFIG",
        help="a benchmark's name, such as demo, or a file as in configs/benchmarks",
    ),
    argument(
        "--tier", choices=TIERS, default="quick", help="size of the benchmark; default: quick"
    ),
    argument(
        "--scene", default="", help="a scene's file or name; replaces the scenes of the config"
    ),
    argument("--out", type=Path, required=True, help="folder for the tables of results"),
    argument(
        "--work",
        type=Path,
        default=Path("data/benchmark"),
        help="folder for simulated frames and trained detectors, one for each tier; default: "
        "data/benchmark",
    ),
    argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        help="number of experiments to run at the same time; default: one per core",
    ),
    argument(
        "--backend",
        choices=BACKENDS,
        default="local",
        help=(
            "where the experiments run: on this machine (local), or on a Dask cluster; "
            "default: local"
        ),
    ),
    argument(
        "--address",
        default="",
        help="address of a running Dask cluster, with --backend dask; default: start a cluster "
        "on this machine",
    ),
    argument(
        "--device",
        default="cpu",
        help="cpu, cuda (any free GPU) or one GPU such as cuda:1; default: cpu",
    ),
    argument(
        "--only-latency",
        action="store_true",
        help="only measure the latency of finished experiments again, one at a time",
    ),
    argument(
        "--until",
        dest="until_ap",
        type=float,
        metavar="AP",
        help="repeat the benchmark with other traffic, 3, 5 or 10 times, until the interval of the "
        "difference between the best two options has at most this half-width in AP, in every "
        "scene and preset; default: one run",
    ),
    argument(
        "--dry-run",
        action="store_true",
        help="only print the unfinished experiments and their expected run time",
    ),
)


def run(args: argparse.Namespace) -> int:
    if args.jobs < 1:
        raise Error(f"--jobs: expected 1 or more, got {args.jobs}")
    file = file_or_name(args.config, shipped("benchmarks"), "CONFIG")
    plan = read_plan(file, args.tier, args.scene)
    workspace = Workspace(args.work, args.out, args.tier)
    if args.dry_run:
        print(dry_run_lines(plan, workspace, args.jobs))
        return 0
    if args.only_latency:
        time_again(plan, workspace, device=args.device, progress=progress)
        return 0
    pool = Pool(args.backend, args.jobs, args.address, gpu=args.device != "cpu")
    if pool.gpu and pool.backend == "local":
        from pyinfra.models.detectors.network import device_of

        device_of(args.device)
    if args.until_ap is not None:
        table = benchmark_until(
            plan, workspace, pool, args.until_ap, device=args.device, progress=progress
        )
        print("\n".join(comparison_lines(table, args.until_ap)))
        return 0
    benchmark(plan, workspace, pool, device=args.device, progress=progress)
    table = workspace.finished()
    done = store.has_each(table, [vars(experiment) for experiment in plan.experiments])
    print(f"{sum(done)} of {len(plan.experiments)} experiments in {workspace.table('experiments')}")
    return 0 if all(done) else 1


def comparison_lines(table: pd.DataFrame, half_width_ap: float) -> list[str]:
    """Returns a sentence for each row (scene and preset) of the table of `benchmark_until`."""
    return [
        f"{row.scene}, {row.preset}: AP of {row.first} minus that of {row.second}, {row.subset}: "
        f"{row.difference:+.1f} [{row.low:.1f}, {row.high:.1f}] over {row.replicates} replicates"
        + ("" if row.half_width <= half_width_ap else f"; half-width above {half_width_ap:g} AP")
        for row in table.itertuples()
    ]
