"""Makes the files of results/ that are out of date: `make results`.

A file is up to date if results/steps.csv has the keys of all its parts. A key has the words of the
command, the number of the simulator's frames, the version of the command (`engine.VERSIONS`), the
digest of the pretrained detector if the command uses it, and the files that the command reads.

    python -m reproduction results --list
    python -m reproduction results claims.csv people.csv --jobs 2

A stopped run resumes. In another clone it resumes if results/parts/ was committed. Independent
parts run side by side, in processes of this machine or of a Dask cluster. Commands that
measure times run alone after them.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.experiments.pool import Backend, Pool
from reproduction import ROOT, engine
from reproduction.steps import STEPS
from reproduction.toys import TOYS

NAMED = 5  # maximum number of changed files in a message


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", help="files of results/ (default: all)")
    parser.add_argument("--list", action="store_true", help="print the steps and run nothing")
    parser.add_argument("--jobs", type=int, default=1, help="parts side by side (default: 1)")
    parser.add_argument(
        "--backend", choices=get_args(Backend), default="local", help="or a cluster"
    )
    parser.add_argument("--address", default="", help="address of the cluster")
    parser.add_argument(
        "--dirty", action="store_true", help="run although the code differs from the commit"
    )
    parser.add_argument("--primary", action="store_true", help="leave out rows of secondary claims")
    parser.add_argument(
        "--toy", action="store_true", help="run the steps at toy size, into --work/toy"
    )
    parser.add_argument(
        "--work",
        type=Path,
        default=ROOT / "out/steps",
        help="folder for parts, frames and trainings (default: out/steps)",
    )
    args = parser.parse_args()
    steps = engine.toys(STEPS, TOYS) if args.toy else STEPS
    if args.primary:
        steps = [
            replace(step, commands=tuple(c for c in step.commands if not c.secondary))
            for step in steps
            if not all(command.secondary for command in step.commands)
        ]
    work = args.work.resolve() / ("toy" if args.toy else "")
    places = engine.Places(work / "results" if args.toy else ROOT / "results", work)
    left, stale = show(steps, args.files, places)
    if args.list or not stale:
        return 0
    if not args.dirty and (changed := engine.changed_code()):
        named = ", ".join(changed[:NAMED]) + (" ..." if len(changed) > NAMED else "")
        raise Error(
            f"expected committed code, got uncommitted changes in {named}; commit them, or use "
            "--dirty"
        )
    failed = engine.run(steps, args.files, places, Pool(args.backend, args.jobs, args.address))
    for part in failed:
        print(f"failed: {part.words}\n  log: {part.folder / 'log.txt'}")
    took = sum(float(str(part.took["cpu_s"])) for part in left if part.done.is_file())
    print(f"took {took / 3600:.2g} CPU hours")
    return 1 if failed else 0


def show(
    steps: Sequence[engine.Step], files: Sequence[str], places: engine.Places
) -> tuple[list[engine.Part], bool]:
    """Prints the state of the steps.

    Returns the parts that have to run, and whether a file is out of date. If all parts are done,
    only the files have to be written.
    """
    left, stale = list[engine.Part](), False
    record = engine.recorded(places)
    for level in engine.levels(steps, files):
        for step in level:
            parts = engine.parts_of(step, steps, places)
            for part in parts:
                engine.restore(part)
            current = engine.is_current(step, parts, places)
            rest = [part for part in parts if not current and not part.done.is_file()]
            hours = sum(expected_h(part, record) for part in rest)
            state = "up to date" if current else f"{len(rest)} of {len(parts)} parts to run"
            print(f"{', '.join(step.files):<60} {state:<24} {hours:6.2f} CPU h")
            left += rest
            stale |= not current
    hours = sum(expected_h(part, record) for part in left)
    print(f"{len(left)} parts will take about {hours:.2f} CPU hours")
    return left, stale


def expected_h(part: engine.Part, record: pd.DataFrame) -> float:
    """Returns the CPU hours that the same words took last, or those of the step's list."""
    same = record[record.command == part.words]
    return float(same.cpu_s.iloc[-1]) / 3600 if len(same) else part.cpu_h
