"""The suggested next command after a command. It is printed only if stdout is a terminal."""

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

from pyinfra.dataset.frames import has_labels, lidars_in
from pyinfra.viz.plan_page.files import is_plan

Words = list[object]
BUDGET_USD = 10_000  # example of a budget, used if the user has not set a budget


def print_next(command: str, args: argparse.Namespace) -> None:
    """Prints the suggested next command if stdout is a terminal.

    Nothing is printed for commands that are not in NEXT, and for commands that print live tracks.
    """
    live = getattr(args, "follow", False) or str(getattr(args, "data", "")) == "-"
    if command in NEXT and sys.stdout.isatty() and not live:
        print(f"next: {next_command(command, args)}")


def next_command(command: str, args: argparse.Namespace) -> str:
    """Returns the suggested command line after `command` has run with `args`."""
    following = NEXT[command]
    if isinstance(following, str):
        return shlex.join(_filled(word, args) for word in following.split())
    return shlex.join(map(str, following(args)))


def _filled(word: str, args: argparse.Namespace) -> str:
    """Fills in a word of a template, such as `{out}`, from a command line; normalises paths."""
    text = word.format_map(vars(args))
    return str(Path(text)) if "/" in word else text


def _lidars(args: argparse.Namespace) -> Words:
    lidar = args.lidars[0] if args.lidars else "ruby_plus"
    run = ["infrasim", "run", "highway", "--lidar", lidar, "--frames", "0:100"]
    return [*run, "--out", "data/highway"]


def _view(args: argparse.Namespace) -> Words:
    folder = _lidar_of(args.data[0])
    if args.pred and len(args.pred) == 1 and has_labels(folder):
        pred = Path(args.pred[0].rpartition("=")[2])
        return ["pyinfra", "evaluate", folder, pred, "--out", args.out.parent / "evaluation"]
    return ["pyinfra", "detect", folder, "--out", args.out.parent / "boxes"]


def _split(args: argparse.Namespace) -> Words:
    name = "centerpoint-pillar"
    return ["pyinfra", "train", name, _lidar_of(args.data), "--out", Path("runs") / name]


def _site(args: argparse.Namespace) -> Words:
    site = args.out if hasattr(args, "out") and not hasattr(args, "site") else args.site
    scene = site / "site.yaml"
    if not (site / "trajectories.csv").is_file():
        return ["pyinfra", "site", "traffic", site]
    if hasattr(args, "out") and hasattr(args, "site"):  # the command was `site draw`
        run = ["infrasim", "run", scene, "--lidar", "ruby_plus", "--frames", "0:100"]
        return [*run, "--out", Path("data") / site.name]
    return ["infrasim", "check", scene, "--lidar", "ruby_plus"]


def _sites(args: argparse.Namespace) -> Words:
    scene = next(iter(sorted(args.out.glob("*.yaml"))))
    return ["infrasim", "check", scene, "--lidar", "ruby_plus"]


def _train(args: argparse.Namespace) -> Words:
    if not args.data:
        return ["pyinfra", "onnx", args.out, "--out", args.out / "model.onnx"]
    detect = ["pyinfra", "detect", args.data[0], "--model", args.out]
    return [*detect, "--out", args.out / "predictions"]


def _detect(args: argparse.Namespace) -> Words:
    data = args.inputs[0]
    if not data.is_dir():
        folder = args.out or Path("boxes")
        return ["pyinfra", "detect", *args.inputs, "--model", args.model, "--out", folder]
    if has_labels(data):
        evaluation = args.out.parent / f"{args.out.name}_evaluation"
        return ["pyinfra", "evaluate", data, args.out, "--out", evaluation]
    return ["pyinfra", "view", data, "--pred", args.out, "--out", args.out / "view.html"]


def _validate(args: argparse.Namespace) -> Words:
    if args.pred is not None and has_labels(args.data):
        evaluation = args.pred.parent / f"{args.pred.name}_evaluation"
        return ["pyinfra", "evaluate", args.data, args.pred, "--out", evaluation]
    pred = ["--pred", args.pred] if args.pred is not None else []
    return ["pyinfra", "view", args.data, *pred, "--out", "view.html"]


def _stress(args: argparse.Namespace) -> Words:
    if args.dry_run:
        return ["pyinfra", "stress", args.data, "--model", *args.runs, "--out", args.out]
    return ["pyinfra", "detect", args.data, "--model", args.runs[0], "--out", args.out / "boxes"]


def _compare(args: argparse.Namespace) -> Words:
    file = args.out or Path(args.places[0]).parent / "places.csv"
    return ["pyinfra", "compare", *args.places, "--ground-truth", "all", "--out", file]


def _benchmark(args: argparse.Namespace) -> Words:
    if args.dry_run:
        scene = ["--scene", args.scene] if args.scene else []
        tier = ["--tier", args.tier]
        return ["pyinfra", "benchmark", args.config, *tier, *scene, "--out", args.out]
    return ["pyinfra", "recommend", args.out, "--tier", args.tier, "--budget", BUDGET_USD]


def _recommend(args: argparse.Namespace) -> Words:
    words = ["pyinfra", "report", args.results, "--tier", args.tier, *_requirements(args)]
    return [*words, "--out", args.results / "report.html"]


def _report(args: argparse.Namespace) -> Words:
    if is_plan(args.results):
        return ["pyinfra", "benchmark", "first_look", "--out", args.results / "benchmark"]
    tier = ["--tier", args.tier] if args.tier else []
    budget = [] if args.budget_usd is not None else ["--budget", BUDGET_USD]
    return ["pyinfra", "recommend", args.results, *tier, *budget, *_requirements(args)]


def _requirements(args: argparse.Namespace) -> Words:
    """Returns the requirements that the user has set, as options of recommend and report."""
    # This import is slow, because the module imports pandas.
    from pyinfra.experiments.requirements import Requirements

    default = Requirements()
    options = {
        "budget_usd": "budget",
        "min_ap": "min-ap",
        "range_m": "range",
        "latency_ms": "latency",
    }
    changed = [n for n in options if getattr(args, n) not in (None, getattr(default, n))]
    return [
        word for name in changed for word in (f"--{options[name]}", number(getattr(args, name)))
    ]


def number(value: float) -> str:
    """Returns a number as text that is read as the same number."""
    return f"{value:.15g}"


def _lidar_of(folder: Path) -> Path:
    """Returns the folder of the first LiDAR of a data set, or the LiDAR's folder itself."""
    return next(iter(lidars_in(folder)), folder)


# Suggested next command of each command: a template with names of arguments, or a function.
NEXT: dict[str, str | Callable[[argparse.Namespace], Words]] = {
    "lidars": _lidars,
    "pictures": "pyinfra view {data[0]} --out {out}/view.html",
    "view": _view,
    "split": _split,
    "site": _site,
    "sites": _sites,
    "train": _train,
    "detect": _detect,
    "track": "pyinfra count {out} {data} --out {out.parent}/counts",
    "count": "pyinfra count {tracks} {site} --interval-s 3600 --out {out}",
    "region": "pyinfra detect {data} --region {out} --out {out.parent}/{out.stem}_boxes",
    "onnx": "pyinfra benchmark first_look --out {out.parent}/first_look",
    "statistics": "pyinfra split {data[0]}",
    "validate": _validate,
    "evaluate": "pyinfra view {gt} --pred {pred} --out {out}/view.html",
    "stress": _stress,
    "compare": _compare,
    "benchmark": _benchmark,
    "plan": "pyinfra benchmark first_look --scene {scene} --out {out}/benchmark",
    "recommend": _recommend,
    "report": _report,
    "import": "pyinfra validate {out}",
    "export": "pyinfra validate {data}",
}
