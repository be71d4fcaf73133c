"""Runs the steps that make the files of results/: `make results`.

A step is one command, or several, and makes one or more files. A command may be split into parts,
which are independent. The key of a part is a digest of its words, of the number of the simulator's
frames, of the command's entry in `VERSIONS`, of the pretrained detector if the command uses it,
and of the files that the command reads. A file is up to date if `steps.csv` has the keys of all its
parts. The rows of a finished part stay in the working folder, so that a stopped run resumes. Until
the file is complete, results/parts/ has a copy of them, to be committed.

The parts run through joblib: in local processes, or in a Dask cluster with a common disk.
"""

import fcntl
import hashlib
import itertools
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from graphlib import TopologicalSorter
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.files import write
from pyinfra.core.version import __version__, machine
from pyinfra.dataset.simulation import frames_version
from pyinfra.experiments import pool
from reproduction import ROOT

RECORD = "steps.csv"  # file that records the steps that were run, and their times
CODE = ("bindings", "benchmarks", "configs", "cpp", "pyinfra", "reproduction")
MODEL = ROOT / "pyinfra/models/generalist.safetensors"
TOY_CPU_H = 0.01  # assumed CPU time of a step at a toy size
# Versions of the results of commands and scripts; 1 for those not listed. Raise the version of a
# command with every change that alters its results.
VERSIONS = {"plan_coverage": 3, "plans": 2, "verdicts": 2}


@dataclass(frozen=True)
class Command:
    """A command, and how it is split into parts.

    words: words after `python -m reproduction`, or a script of benchmarks/ and its words. A name in
    braces is the path of a file of results/ that the command reads.
    cpu_h: expected CPU hours of all parts together; `source` tells how they were found
    work: name of the command whose working folder is used; empty if there is none
    model: whether the command uses the pretrained detector
    out: name of the file to give as --out; "." for the folder
    alone: whether the command measures times, so that nothing else may run
    split: options and their values; each combination is a part
    secondary: whether no primary claim, and no claim about planning, needs the rows
    """

    words: str
    cpu_h: float
    source: str
    work: str = ""
    model: bool = False
    out: str = ""
    alone: bool = False
    split: tuple[tuple[str, tuple[str, ...]], ...] = ()
    secondary: bool = False


@dataclass(frozen=True)
class Step:
    """Files of results/, and the commands whose rows they have."""

    files: tuple[str, ...]
    commands: tuple[Command, ...]

    @property
    def name(self) -> str:
        return self.files[0].removesuffix(".csv")

    @property
    def reads(self) -> set[str]:
        words = [word for command in self.commands for word in shlex.split(command.words)]
        return {word[1:-1] for word in words if word.startswith("{")}


@dataclass(frozen=True)
class Places:
    """Folders: `results` for the finished files, `work` for parts, frames and trainings."""

    results: Path
    work: Path

    def input(self, name: str, made: Container[str]) -> Path:
        """Returns the path of a file that a command reads. made: the files that steps make."""
        file = (self.results if name in made else ROOT / "results") / name
        return file.relative_to(ROOT) if file.is_relative_to(ROOT) else file


@dataclass(frozen=True)
class Part:
    """A command with one value of each split option; the rows of its files are in `folder`.

    words: all words of the command but --work and --out; kept: folder of results/ for a copy of the
    rows until the file is complete; arguments: the command line
    """

    words: str
    key: str
    cpu_h: float
    folder: Path
    kept: Path
    arguments: tuple[str, ...]
    alone: bool

    @property
    def done(self) -> Path:
        return self.folder / "done.json"

    @property
    def took(self) -> dict[str, object]:
        taken: dict[str, object] = json.loads(self.done.read_text())
        return {"command": self.words, "key": self.key, **taken}


def toys(steps: Sequence[Step], words: Mapping[str, str]) -> list[Step]:
    """Returns the steps that have a toy size, with the words of that size.

    words: words of a step's first command at the toy size, by the first file of the step. Other
    commands of the step are left out.
    """
    return [
        replace(
            step,
            commands=(
                replace(step.commands[0], words=words[step.files[0]], split=(), cpu_h=TOY_CPU_H),
            ),
        )
        for step in steps
        if step.files[0] in words
    ]


def digest(*values: object) -> str:
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()[:16]


@cache
def _of_file(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def parts_of(step: Step, steps: Sequence[Step], places: Places) -> list[Part]:
    """Returns the parts of a step, with their keys."""
    makers = {file: other for other in steps for file in other.files}
    inputs = [
        [part.key for part in parts_of(makers[name], steps, places)]
        if name in makers
        else _of_file(ROOT / "results" / name)
        for name in sorted(step.reads)
    ]
    parts = []
    for command in step.commands:
        name, *words = shlex.split(command.words)
        given = [str(places.input(w[1:-1], makers)) if w.startswith("{") else w for w in words]
        program = [name] if name.endswith(".py") else ["-m", "reproduction", name]
        model = _of_file(MODEL) if command.model else ""
        choices = list(zip(typed(command), _choices(command), strict=True))
        for told, choice in choices:
            key = digest(told, frames_version(), VERSIONS.get(name, 1), model, inputs)
            folder, kept = (
                top / "parts" / step.name / key for top in (places.work, places.results)
            )
            more = ["--work", str(_work(command, places))] if command.work else []
            more += ["--out", str(folder / command.out)]
            line = (*program, *given, *choice, *more)
            cpu_h = command.cpu_h / len(choices)
            parts.append(Part(told, key, cpu_h, folder, kept, line, command.alone))
    return parts


def _work(command: Command, places: Places) -> Path:
    """Returns the working folder for the present frames_version, version and initial weights."""
    made = digest(frames_version(), VERSIONS.get(command.work, 1), _of_file(MODEL))
    return places.work / command.work / made


def typed(command: Command) -> list[str]:
    """Returns the words of each part of a command, as they are recorded."""
    words = [f"results/{w[1:-1]}" if w.startswith("{") else w for w in shlex.split(command.words)]
    return [shlex.join([*words, *choice]) for choice in _choices(command)]


def _choices(command: Command) -> Iterator[list[str]]:
    options = [[(name, *shlex.split(v)) for v in values] for name, values in command.split]
    for choice in itertools.product(*options):
        yield [word for words in choice for word in words]


def run_part(part: Part) -> None:
    """Runs a part unless it is done.

    The command inherits the lock: if this process is killed, the next one waits for the command to
    end. A failed command is no error here, so that the other parts run; its log remains.
    """
    part.folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(part.folder / "lock", os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if part.done.is_file():
            return
        with (part.folder / "log.txt").open("wb") as log:
            started = time.monotonic()
            command = [sys.executable, *part.arguments]
            process = subprocess.Popen(
                command, cwd=ROOT, stdout=log, stderr=log, stdin=subprocess.DEVNULL, pass_fds=[lock]
            )
            _, status, used = os.wait4(process.pid, 0)  # `used` includes all child processes
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode == 0:
            cpu_s = round(used.ru_utime + used.ru_stime, 3)
            wall_s = round(time.monotonic() - started, 1)
            taken = {"cpu_s": cpu_s, "wall_s": wall_s, "version": __version__, "machine": machine()}
            write(part.done, json.dumps(taken))
            copy_rows(part.folder, part.kept)
    finally:
        os.close(lock)


def copy_rows(source: Path, target: Path) -> None:
    """Copies the files of a finished part; done.json, which marks it as finished, comes last."""
    target.mkdir(parents=True, exist_ok=True)
    for file in [*source.glob("*.csv"), source / "done.json"]:
        write(target / file.name, file.read_bytes())


def restore(part: Part) -> None:
    """Copies the rows of a part from results/ to the working folder, if they are missing there."""
    if not part.done.is_file() and (part.kept / part.done.name).is_file():
        copy_rows(part.kept, part.folder)


def recorded(places: Places) -> pd.DataFrame:
    """Returns the table of the parts that were run; empty if there is no file."""
    file = places.results / RECORD
    columns = ["step", "command", "key", "cpu_s", "wall_s", "version", "machine"]
    return pd.read_csv(file) if file.is_file() else pd.DataFrame(columns=columns)


def is_current(step: Step, parts: Sequence[Part], places: Places) -> bool:
    record = recorded(places)
    keys = set(record.key[record.step == step.name])
    return keys == {p.key for p in parts} and all(
        (places.results / f).is_file() for f in step.files
    )


def assemble(step: Step, parts: Sequence[Part], places: Places) -> None:
    """Writes the files of a step from the rows of its parts, and records their times."""
    places.results.mkdir(parents=True, exist_ok=True)
    read = partial(pd.read_csv, dtype=str, keep_default_na=False)
    for file in step.files:
        tables = [read(part.folder / file) for part in parts]
        whole = pd.concat(tables, ignore_index=True).fillna("").to_csv(index=False)
        first = (parts[0].folder / file).read_text("utf-8")
        write(places.results / file, first if len(parts) == 1 else whole)
    record = recorded(places)
    rows = pd.DataFrame([part.took for part in parts]).assign(step=step.name)
    others = record[record.step != step.name]
    table = pd.concat([others, rows[list(record)]] if len(others) else [rows[list(record)]])
    write(places.results / RECORD, table.sort_values("step", kind="stable").to_csv(index=False))
    if (kept := parts[0].kept.parent).is_dir():
        shutil.rmtree(kept)
        with suppress(OSError):  # the folder still has parts of other steps
            kept.parent.rmdir()


def levels(steps: Sequence[Step], wanted: Sequence[str]) -> Iterator[list[Step]]:
    """Yields lists of steps. A step reads only files that steps of earlier lists make.

    wanted: files of results/; all steps if empty. Steps that make the files they read come first.
    Raises Error for a file that no step makes.
    """
    makers = {file: step for step in steps for file in step.files}
    if unknown := [name for name in wanted if name not in makers]:
        raise Error(f"files: expected one or more of {' '.join(sorted(makers))}; got {unknown[0]}")
    chosen: dict[Step, set[Step]] = {}
    queue = [makers[name] for name in wanted] or list(steps)
    while queue:
        step = queue.pop()
        chosen[step] = {makers[name] for name in step.reads if name in makers}
        queue += [other for other in chosen[step] if other not in chosen]
    order = TopologicalSorter(chosen)
    order.prepare()
    while order.is_active():
        ready = order.get_ready()
        yield sorted(ready, key=steps.index)
        order.done(*ready)


def run(
    steps: Sequence[Step], wanted: Sequence[str], places: Places, workers: pool.Pool
) -> list[Part]:
    """Makes the files that are out of date; returns the parts that failed.

    Independent parts run side by side. A step whose input failed does not run.
    """
    failed: list[Part] = []
    for level in levels(steps, wanted):
        parts = {step: parts_of(step, steps, places) for step in level}
        stale = [step for step in level if not is_current(step, parts[step], places)]
        stale = [step for step in stale if not _lacks_input(step, steps, places)]
        for part in itertools.chain.from_iterable(parts[step] for step in stale):
            restore(part)
        left = [part for step in stale for part in parts[step] if not part.done.is_file()]
        together = [part for part in left if not part.alone]
        if together:
            pool.call_all(run_part, together, workers)
        for part in left:
            run_part(part)  # runs parts that measure times, after all other parts
        failed += [part for part in left if not part.done.is_file()]
        for step in stale:
            if all(part.done.is_file() for part in parts[step]):
                assemble(step, parts[step], places)
    return failed


def _lacks_input(step: Step, steps: Sequence[Step], places: Places) -> bool:
    """Returns True if a step that makes an input of the step is not up to date."""
    makers = {other for other in steps if step.reads & set(other.files)}
    return not all(is_current(o, parts_of(o, steps, places), places) for o in makers)


def changed_code() -> list[str]:
    """Returns the files of the code that differ from the commit."""
    words = ["git", "status", "--porcelain", "--untracked-files=all", "--", *CODE]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    return [line[3:] for line in done.stdout.splitlines()]
