"""`pyinfra stress RUN... --data DATA/LIDAR --out DIR`: where detectors fail, and what fails first.

The rules stand in docs/conventions.md, "Stress", and were written before the first run.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tqdm import tqdm

from pyinfra.cli import message_of
from pyinfra.stress import cells, worlds
from pyinfra.stress.catalogue import STRESSORS, chosen
from pyinfra.stress.results import write


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Turns dials on clouds, worlds and training from none to breaking; rows go to stress.csv. "
        "A row that is there is not computed again, and several processes share the work. "
        "Stressors that cannot act on the data are left out with a note; cells that fail are "
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
    parser.add_argument("--dry-run", action="store_true", help="list the cells, with an estimate")


def run(args: argparse.Namespace) -> int:
    if args.frames < 1:
        raise ValueError(f"--frames: found {args.frames}, allowed 1 or more")
    stressors = chosen(args.stressors, args.dials)
    base = worlds.read_base(args.data, args.frames)
    runs = [cells.read_run(folder, base) for folder in args.runs]
    every = cells.plan(runs, cells.able(stressors, base), base)
    for why, names in cells.left_out(stressors, base).items():
        print(f"pyinfra: note: left out {', '.join(names)}: {why}", file=sys.stderr)
    todo = list(cells.missing(every, base, args.out, args.seed))
    wrong = cells.wrong_worlds(todo, base)
    for (name, dial), error in wrong.items():
        print(f"pyinfra: {name} {dial} failed: {message_of(error)}", file=sys.stderr)
    failed = [cell for cell in todo if cell.at in wrong]
    todo = [cell for cell in todo if cell.at not in wrong]
    if args.dry_run:
        _list(todo, base, len(every))
    else:
        failed += _fill(todo, base, args.out, args.seed)
        print(*write(args.out), sep="\n")
    if failed:
        text = f"{len(failed)} of {len(every)} cells failed; the same command tries them again"
        print(f"pyinfra: {text}", file=sys.stderr)
    return 1 if failed else 0


def _fill(todo: list[cells.Cell], base: worlds.Base, out: Path, seed: int) -> list[cells.Cell]:
    """Those that failed, each with a line on stderr. Without a terminal there is no bar."""
    failed = []
    bar = tqdm(todo, unit="cell", disable=None, file=sys.stderr)
    for cell in bar:
        bar.set_postfix_str(cell.title)
        if error := cells.attempt(cell, base, out, seed):
            tqdm.write(f"pyinfra: {cell.title} failed: {message_of(error)}", file=sys.stderr)
            failed.append(cell)
    return failed


def _list(todo: list[cells.Cell], base: worlds.Base, of: int) -> None:
    for cell in todo:
        print(cell.title)
    minutes = cells.seconds_of(todo, base) / 60
    print(f"{len(todo)} of {of} cells to do, {len(base.frames)} frames each, {minutes:.1f} min")
