"""`pyinfra stress RUN... --data DATA/LIDAR --out DIR`: where detectors fail, and what fails first.

The rules stand in docs/conventions.md, "Stress", and were written before the first run.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from pyinfra.atomic import held, replacing
from pyinfra.cli import message_of
from pyinfra.stress import cells, figures, summary, worlds
from pyinfra.stress.catalogue import NONE, STRESSORS, Dial, Stressor


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
    every = cells.plan(runs, able(stressors, base), base)
    todo = list(cells.missing(every, base, args.out, args.seed))
    todo, failed = sound(todo, base)
    if args.dry_run:
        _list(todo, base, len(every))
    else:
        failed += measure(todo, base, args.out, args.seed)
        for file in write(args.out):
            print(file)
    if failed:
        text = f"{len(failed)} of {len(every)} cells failed; the same command tries them again"
        print(f"pyinfra: {text}", file=sys.stderr)
    return 1 if failed else 0


def sound(todo: list[cells.Cell], base: worlds.Base) -> tuple[list[cells.Cell], list[cells.Cell]]:
    """The cells whose worlds can be simulated, and the others, with a line on stderr for each."""
    wrong = cells.wrong_worlds(todo, base)
    for (name, dial), error in wrong.items():
        print(f"pyinfra: {name} {dial} failed: {message_of(error)}", file=sys.stderr)
    return [c for c in todo if c.at not in wrong], [c for c in todo if c.at in wrong]


def able(
    stressors: dict[Stressor, tuple[Dial, ...]], base: worlds.Base
) -> dict[Stressor, tuple[Dial, ...]]:
    """Those that can act on a base, with a note on stderr of the others.

    Raises ValueError if none can.
    """
    reasons = cells.left_out(stressors, base)
    left_out = {name for names in reasons.values() for name in names}
    if len(left_out) == len(stressors):
        raise ValueError("; ".join(reasons))
    for why, names in reasons.items():
        print(f"pyinfra: note: left out {', '.join(names)}: {why}", file=sys.stderr)
    return {s: dials for s, dials in stressors.items() if s.name not in left_out}


def measure(todo: list[cells.Cell], base: worlds.Base, out: Path, seed: int) -> list[cells.Cell]:
    """Fills cells; returns those that failed, each with a line on stderr.

    Raises what a cell without stress raises: nothing compares without it.
    """
    out.mkdir(parents=True, exist_ok=True)
    failed = []
    # Without a terminal there is no bar.
    bar = tqdm(todo, unit="cell", disable=None, file=sys.stderr)
    for cell in bar:
        name = f"{cell.run.name} {cell.stressor.name} {cell.dial}"
        bar.set_postfix_str(name)
        try:
            cells.fill(cell, base, out, seed)
        except (OSError, ValueError, RuntimeError) as error:
            if cell.stressor is NONE:
                raise
            tqdm.write(f"pyinfra: {name} failed: {message_of(error)}", file=sys.stderr)
            failed.append(cell)
    return failed


def chosen(names: list[str], words: list[str] | None) -> dict[Stressor, tuple[Dial, ...]]:
    """The stressors by their names, with the dials that stress. Raises ValueError."""
    unknown = [name for name in names if name not in STRESSORS]
    if unknown:
        raise ValueError(f"--stressors: found '{unknown[0]}', allowed {', '.join(STRESSORS)}")
    found = [STRESSORS[name] for name in dict.fromkeys(names)]
    if words is None:
        return {stressor: stressor.dials[1:] for stressor in found}
    if len(found) != 1 or found[0].acts_on == "training":
        raise ValueError("--dials: found it without one stressor of clouds or worlds, allowed one")
    return {found[0]: found[0].parse(words)}


def write(out: Path) -> list[Path]:
    """Summary, ranking and figures of the rows that are there; returns the files."""
    table = cells.read(out / "stress.csv")
    tables: dict[str, pd.DataFrame] = {
        "stress_summary": summary.summary(table),
        "stress_ranking": summary.ranking(table),
    }
    files = [out / "stress.csv"]
    with held(out / "locks" / "summary", wait=True):
        for name, rows in tables.items():
            files.append(out / f"{name}.csv")
            with replacing(files[-1]) as beside:
                rows.to_csv(beside, index=False, float_format="%.4g")
        return files + figures.draw_all(table, out)


def _list(todo: list[cells.Cell], base: worlds.Base, of: int) -> None:
    for cell in todo:
        print(cell.run.name, cell.stressor.name, cell.dial)
    minutes = cells.seconds_of(todo, base) / 60
    print(f"{len(todo)} of {of} cells to do, {len(base.frames)} frames each, {minutes:.1f} min")
