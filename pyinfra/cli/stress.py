"""`pyinfra stress RUN... --data DATA/LIDAR --out DIR`: where detectors fail, and what fails first.

The rules stand in docs/conventions.md, "Stress", and were written before the first run.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tqdm import tqdm

from pyinfra.cli.messages import message_of, note
from pyinfra.core.errors import Error
from pyinfra.experiments.stress import altered_scenes, trials
from pyinfra.experiments.stress.stressors import STRESSORS, chosen
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
        "--frames", type=int, default=60, help="at most so many, evenly spaced; default 60"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the draws; default 1")
    parser.add_argument("--dry-run", action="store_true", help="list the trials, with an estimate")


def run(args: argparse.Namespace) -> int:
    if args.frames < 1:
        raise Error(f"--frames: found {args.frames}, allowed 1 or more")
    stressors = chosen(args.stressors, args.dials)
    base = altered_scenes.read_base(args.data, args.frames)
    runs = [trials.read_run(folder, base) for folder in args.runs]
    every = trials.plan(runs, trials.able(stressors, base), base)
    for why, names in trials.left_out(stressors, base).items():
        note(f"left out {', '.join(names)}: {why}", args)
    todo = list(trials.missing(every, base, args.out, args.seed))
    wrong = trials.wrong_worlds(todo, base)
    for (name, dial), error in wrong.items():
        print(f"pyinfra: {name} {dial} failed: {message_of(error)}", file=sys.stderr)
    failed = [trial for trial in todo if trial.at in wrong]
    todo = [trial for trial in todo if trial.at not in wrong]
    if args.dry_run:
        _list(todo, base, len(every))
    else:
        failed += _fill(todo, base, args.out, args.seed)
        files = trials.write_summary(args.out)
        files += stress_plots.draw_all(trials.read(args.out / "stress.csv"), args.out)
        print(*files, sep="\n")
    if failed:
        text = f"{len(failed)} of {len(every)} trials failed; the same command tries them again"
        print(f"pyinfra: {text}", file=sys.stderr)
    return 1 if failed else 0


def _fill(
    todo: list[trials.Trial], base: altered_scenes.Base, out: Path, seed: int
) -> list[trials.Trial]:
    """Those that failed, each with a line on stderr. Without a terminal there is no bar."""
    failed = []
    bar = tqdm(todo, unit="trial", disable=None, file=sys.stderr)
    for trial in bar:
        bar.set_postfix_str(trial.title)
        if error := trials.attempt(trial, base, out, seed):
            tqdm.write(f"pyinfra: {trial.title} failed: {message_of(error)}", file=sys.stderr)
            failed.append(trial)
    return failed


def _list(todo: list[trials.Trial], base: altered_scenes.Base, of: int) -> None:
    for trial in todo:
        print(trial.title)
    minutes = trials.seconds_of(todo, base) / 60
    print(f"{len(todo)} of {of} trials to do, {len(base.frames)} frames each, {minutes:.1f} min")
