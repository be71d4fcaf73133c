"""`pyinfra stress DATA/LIDAR --model RUN... --out DIR`: finds where detectors fail.

The rules are in the section "Stress" of docs/conventions/detectors.md. They were written before the
first stress test.
"""

import argparse
import sys
from pathlib import Path

from tqdm import tqdm

from pyinfra.cli.messages import message_of, note
from pyinfra.cli.parser import argument, usage
from pyinfra.core.progress import in_lines
from pyinfra.experiments.stress import runner, trials
from pyinfra.experiments.stress.stressors import STRESSORS
from pyinfra.viz import stress_plots

add_arguments = usage(
    "Tests detectors under stressors of growing severity. A stressor changes the point clouds, "
    "the simulated scene or LiDAR, or the training. Rows go to stress.csv. Existing rows are "
    "not computed again, and several processes can share the work. Stressors that do not "
    "apply to the data are left out with a note. If a trial fails, its name and error are "
    "printed and the exit status is 1.",
    "example: pyinfra stress data/highway/ruby_plus --model runs/background runs/pillars "
    "--out out/stress --stressors rain tilt",
    argument(
        "data", metavar="DATA", type=Path, help="folder of one LiDAR; its val frames are used"
    ),
    argument(
        "--model",
        dest="runs",
        nargs="+",
        type=Path,
        required=True,
        metavar="RUN",
        help="output folders of `pyinfra train` for this LiDAR. If there are several runs of one "
        "detector, only the first is stressed. The other runs, with fewer training frames or "
        "another seed, are compared with the first",
    ),
    argument("--out", type=Path, required=True, help="folder for tables and figures"),
    argument(
        "--stressors",
        nargs="+",
        metavar="NAME",
        default=list(STRESSORS),
        help=f"names of stressors; default: all, which are {', '.join(STRESSORS)}",
    ),
    argument(
        "--severities",
        nargs="+",
        help="severities to test, in the unit of the stressor; only with one stressor; default: "
        "those defined for the stressor",
    ),
    argument(
        "--max-frames",
        dest="frames",
        type=int,
        default=runner.FRAMES,
        metavar="N",
        help="maximum number of frames, evenly distributed; default: 60",
    ),
    argument("--seed", type=int, default=1, help="seed of the random changes; default: 1"),
    argument(
        "--dry-run", action="store_true", help="only list the trials and estimate their run time"
    ),
)


def run(args: argparse.Namespace) -> int:
    how = (args.stressors, args.severities, args.frames, args.seed)
    plan = runner.prepare(args.runs, args.data, args.out, *how)
    for why, names in plan.left_out.items():
        note(f"left out {', '.join(names)}: {why}", args)
    for (name, severity), error in {trial.at: error for trial, error in plan.wrong.items()}.items():
        print(f"pyinfra: {name} {severity} failed: {message_of(error)}", file=sys.stderr)
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
    """Runs the trials and returns the number of failed trials. A failure prints a line on stderr.

    The progress is shown as a bar if stderr is a terminal, otherwise as lines.
    """
    failed = 0
    bar = tqdm(plan.todo, unit="trial", disable=None, file=sys.stderr)
    for trial in in_lines(bar, "trial"):
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
