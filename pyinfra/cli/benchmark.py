"""`pyinfra benchmark configs/benchmarks/NAME.yaml --tier TIER --out RESULTS`."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import TIERS
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.dry_run import dry_run_lines
from pyinfra.experiments.benchmark.latency import time_again
from pyinfra.experiments.benchmark.matrix import read_plan
from pyinfra.experiments.benchmark.runner import benchmark
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.pool import BACKENDS, Pool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs an experiment for each combination of scene, LiDAR, preset, detector and seed, and "
        "writes one row of results each. A row holds everything needed to repeat its experiment. "
        "Run the same command again to resume."
    )
    parser.epilog = (
        "example: pyinfra benchmark configs/benchmarks/demo.yaml --tier smoke --out out/demo"
    )
    parser.add_argument("config", type=Path, help="a benchmark file, as in configs/benchmarks")
    parser.add_argument(
        "--tier", choices=TIERS, default="quick", help="size of the benchmark; default: quick"
    )
    parser.add_argument(
        "--scene", default="", help="a scene's file or name; replaces the scenes of the config"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the tables of results")
    parser.add_argument(
        "--work",
        type=Path,
        default=Path("data/benchmark"),
        help="folder for simulated frames and trained detectors; default: data/benchmark",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        help="number of experiments to run at the same time; default: one per core",
    )
    parser.add_argument("--backend", choices=BACKENDS, default="local")
    parser.add_argument(
        "--address",
        default="",
        help="address of a running cluster, with --backend ray or dask; default: start one on "
        "this machine",
    )
    parser.add_argument(
        "--device",
        default="cpu",
        help="cpu, cuda (any free GPU) or one GPU such as cuda:1; default: cpu",
    )
    parser.add_argument(
        "--latency",
        action="store_true",
        help="only measure the latency of finished experiments again, one at a time",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="only print the unfinished experiments and their expected run time",
    )


def run(args: argparse.Namespace) -> int:
    if args.jobs < 1:
        raise Error(f"--jobs: expected 1 or more, got {args.jobs}")
    plan = read_plan(args.config, args.tier, args.scene)
    workspace = Workspace(args.work, args.out, args.tier)
    if args.dry_run:
        print(dry_run_lines(plan, workspace, args.jobs))
        return 0
    if args.latency:
        time_again(plan, workspace, device=args.device, progress=progress)
        return 0
    where = Pool(args.backend, args.jobs, args.address, gpu=args.device != "cpu")
    if where.gpu and where.backend == "local":
        from pyinfra.models.detectors.network import device_of

        device_of(args.device)
    benchmark(plan, workspace, where, device=args.device, progress=progress)
    table = workspace.finished()
    done = store.has_each(table, [vars(experiment) for experiment in plan.experiments])
    print(f"{sum(done)} of {len(plan.experiments)} experiments in {workspace.table('experiments')}")
    return 0 if all(done) else 1


def progress(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
