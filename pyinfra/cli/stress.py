"""`pyinfra stress RUN... --data DATA/LIDAR --out DIR`: where detectors fail, and what fails first.

The rules stand in docs/conventions.md, "Stress", and were written before the first run.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tqdm import tqdm

from pyinfra.cli.messages import message_of, note
from pyinfra.experiments.stress import runner, trials
from pyinfra.experiments.stress.stressors import STRESSORS
from pyinfra.viz import stress_plots


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Turns dials on clouds, worlds and training from none to breaking; rows go to stress.csv. "
        "A row that is there is not computed again, and several processes share the work. "
        "Stressors that cannot act on the data are left out with a note; trials that fail are "
        "named, and the exit status is then 1."
    )
    parser.epilog = (
        "example: pyinfra stress runs/background runs/pillars --data data/highway/ruby_plus "
        "--out out/stress --stressors rain tilt"
    )
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        metavar="RUN",
        help="folders of `pyinfra train` for this LiDAR; of several runs of a detector the first "
        "is stressed, and the others are its smaller trainings and other seeds",
    )
    parser.add_argument(
        "--data", type=Path, required=True, help="folder of a LiDAR; its val frames"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and figures")
    parser.add_argument(
        "--stressors",
        nargs="+",
        metavar="NAME",
        default=list(STRESSORS),
        help=f"default all: {', '.join(STRESSORS)}",
    )
    parser.add_argument("--dials", nargs="+", help="with one stressor: these in place of its own")
    parser.add_argument(
        "--frames",
        type=int,
        default=runner.FRAMES,
        help="at most so many, evenly spaced; default 60",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the draws; default 1")
    parser.add_argument("--dry-run", action="store_true", help="list the trials, with an estimate")


def run(args: argparse.Namespace) -> int:
    how = (args.stressors, args.dials, args.frames, args.seed)
    plan = runner.prepare(args.runs, args.data, args.out, *how)
    for why, names in plan.left_out.items():
        note(f"left out {', '.join(names)}: {why}", args)
    for (name, dial), error in {trial.at: error for trial, error in plan.wrong.items()}.items():
        print(f"pyinfra: {name} {dial} failed: {message_of(error)}", file=sys.stderr)
    failed = len(plan.wrong)
    if args.dry_run:
        _list(plan)
    else:
        failed += _fill(plan, args.out, args.seed)
        files = trials.write_summary(args.out)
        files += stress_plots.draw_all(trials.read(args.out / "stress.csv"), args.out)
        print(*files, sep="\n")
    if failed:
        text = f"{failed} of {len(plan.every)} trials failed; the same command tries them again"
        print(f"pyinfra: {text}", file=sys.stderr)
    return 1 if failed else 0


def _fill(plan: runner.Prepared, out: Path, seed: int) -> int:
    """How many failed, each with a line on stderr. Without a terminal there is no bar."""
    failed = 0
    bar = tqdm(plan.todo, unit="trial", disable=None, file=sys.stderr)
    for trial in bar:
        bar.set_postfix_str(trial.title)
        if error := trials.attempt(trial, plan.base, out, seed):
            tqdm.write(f"pyinfra: {trial.title} failed: {message_of(error)}", file=sys.stderr)
            failed += 1
    return failed


def _list(plan: runner.Prepared) -> None:
    for trial in plan.todo:
        print(trial.title)
    minutes = trials.seconds_of(plan.todo, plan.base) / 60
    done = (
        f"{len(plan.todo)} of {len(plan.every)} trials to do, {len(plan.base.frames)} frames each"
    )
    print(f"{done}, {minutes:.1f} min")
