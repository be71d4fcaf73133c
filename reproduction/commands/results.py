"""Makes the files of results/ that are out of date: `make results`.

A file is made by one or more parts: commands that can run separately. A file is up to date if
results/steps.csv has the keys of all its parts. A key has the words of the command, the
`frames_version` of the simulator, the version of the command (`engine.VERSIONS`), the digest of the
pretrained detector if the command uses it, and the files that the command reads.

A stopped run resumes. In another clone it resumes if results/parts/ was committed. Independent
parts run side by side, in processes of this machine or of a Dask cluster. Commands that
measure times run alone after them.

examples: python -m reproduction results --list; python -m reproduction results claims.csv --jobs 2
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.experiments.pool import Backend, Pool
from reproduction import ROOT, engine
from reproduction.arguments import command
from reproduction.steps import STEPS
from reproduction.toys import TOYS

NAMED = 5  # maximum number of changed files in a message


@command
def main(
    files: Sequence[str] = (),
    *,
    list: bool = False,
    jobs: int = 1,
    backend: Backend = "local",
    address: str = "",
    dirty: bool = False,
    primary: bool = False,
    toy: bool = False,
    work: Path = ROOT / "out/steps",
) -> int:
    """
    Parameters
    ----------
    files : files of results/ (default: all)
    list : print the steps and run nothing
    jobs : number of parts that run at the same time (default: 1)
    backend : run parts on this machine or in a cluster (default: %(default)s)
    address : address of the cluster
    dirty : run although the code differs from the commit
    primary : leave out rows of secondary claims
    toy : run the steps at toy size, into --work/toy
    work : folder for parts, frames and trainings (default: out/steps)
    """
    steps = engine.toys(STEPS, TOYS) if toy else STEPS
    if primary:
        steps = [
            replace(step, commands=tuple(c for c in step.commands if not c.secondary))
            for step in steps
            if not all(command.secondary for command in step.commands)
        ]
    folder = work.resolve() / ("toy" if toy else "")
    places = engine.Places(folder / "results" if toy else ROOT / "results", folder)
    left, stale = show(steps, files, places)
    if list or not stale:
        return 0
    if not dirty and (changed := engine.changed_code()):
        named = ", ".join(changed[:NAMED]) + (" ..." if len(changed) > NAMED else "")
        raise Error(
            f"expected committed code, got uncommitted changes in {named}; commit them, or use "
            "--dirty"
        )
    failed = engine.run(steps, files, places, Pool(backend, jobs, address))
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
    """Returns the CPU hours of the last run of the same command, or the estimate in `steps`."""
    same = record[record.command == part.words]
    return float(same.cpu_s.iloc[-1]) / 3600 if len(same) else part.cpu_h
