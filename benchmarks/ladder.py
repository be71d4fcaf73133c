"""What cheaper models of a scene do to its conclusions: AP of four LiDARs against the cost.

Highway, preset `datasheet`, where vehicles have parts; one dial at a time away from the default,
which is that of the simulator and 1,000 of 5,000 frames. Writes results/ladder.csv, of Background;
another detector's table needs an --out of its own:
    .venv/bin/python benchmarks/ladder.py --work data/ladder
"""

from __future__ import annotations

import argparse
import resource
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from pyinfra import __version__, kitti, machine
from pyinfra.benchmark.frames import split_by_time
from pyinfra.benchmark.matrix import Parts
from pyinfra.data.frame_tables import read_vehicles
from pyinfra.data.frames import frame_numbers
from pyinfra.evaluation.evaluate import evaluate
from pyinfra.evaluation.judge import Settings
from pyinfra.report.sections.ladder import DIALS
from pyinfra.simulator.catalogue import lidar_file, scene_file
from pyinfra.simulator.runs import infrasim
from pyinfra.training import detect
from pyinfra.training.recipe import read_recipe
from pyinfra.training.sources import read_source
from pyinfra.training.train import train

ROOT = Path(__file__).resolve().parent.parent
LIDARS = ["ruby_plus", "livox_avia", "pandar_64", "helios_16"]
DEFAULT = {
    "detail": "low",
    "aggregation": "exact",
    "parts": "glass+gap+coat",
    "label_time": "scan",
    "frames": "1000",
}
ALL_FRAMES = 5000
PARTS = ("glass", "gap", "coat", "tyres", "reflectors")


def models(dials: Sequence[str], frames: str) -> Iterator[dict[str, str]]:
    """The default, and each dial's other values; frames: of the default."""
    default = DEFAULT | {"frames": frames}
    yield default
    for dial in dials:
        values = [v for v in DIALS[dial] if dial != "frames" or int(v) < int(frames)]
        yield from (default | {dial: value} for value in values if value != default[dial])


def parts_of(value: str) -> dict[str, bool]:
    """Which `vehicle_parts` a value of the dial turns on: `glass+coat`, `all` or `none`."""
    on = PARTS if value == "all" else value.split("+")
    return {f"vehicle_parts.{part}": part in on for part in PARTS}


def assignments(model: dict[str, str]) -> list[str]:
    """The keys of the scene that a model sets, as `--set` has them."""
    own = {dial: model[dial] for dial in ("detail", "aggregation", "label_time")}
    own |= {key: str(on).lower() for key, on in parts_of(model["parts"]).items()}
    return [word for key, value in own.items() for word in ("--set", f"{key}={value}")]


def simulated(model: dict[str, str], preset: str, folder: Path) -> float:
    """Runs the model's world into the folder; returns CPU milliseconds a frame set."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    frames = int(model["frames"])
    lidars = [lidar_file(name) for name in LIDARS]
    words = ["--frames", f"0:{ALL_FRAMES}:{ALL_FRAMES // frames}", "--threads", "1"]
    scene = scene_file("highway")
    words += ["--preset", preset, *assignments(model)]
    infrasim("run", scene, "--lidar", *lidars, *words, "--out", folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    split_by_time(folder, Parts())
    return 1000 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / frames


def row(folder: Path, detector: str) -> dict[str, object]:
    """What a detector finds in the test frames of one LiDAR."""
    run = folder.parent / f"{folder.parent.name}_{folder.name}_{detector}"
    recipe = read_recipe(ROOT / "configs" / "detectors" / f"{detector}.yaml", "quick")
    train(recipe, [read_source(folder, "quick")], run, quiet=True)
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    detect.detect(detect.load_detector(run), files, run / "predictions")
    found = evaluate(folder, run / "predictions", Settings(ground_truths=("captured",))).ap.iloc[0]
    frames = kitti.frames(folder)
    points = int(read_vehicles(folder, frames).points.sum())
    return {
        "lidar": folder.name,
        "ap": round(float(found.ap), 4),
        "ap_low": round(found.ap_low, 4),
        "ap_high": round(found.ap_high, 4),
        "objects": int(found.objects),
        "vehicle_points_per_frame": round(points / len(frames), 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of frames; about 2 GB")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "ladder.csv")
    parser.add_argument("--preset", default="datasheet")
    parser.add_argument("--detector", default="background", help="file of configs/detectors")
    parser.add_argument("--dials", nargs="+", choices=DIALS, default=list(DIALS))
    parser.add_argument("--frames", default="1000", help="of the default; a divisor of 5,000")
    args = parser.parse_args()
    rows = []
    for model in models(args.dials, args.frames):
        name = "_".join([args.preset, *model.values()]).replace(":", "-")
        folder = args.work / name
        cost = {"ms_per_frame_set": round(simulated(model, args.preset, folder), 3)}
        for lidar in LIDARS:
            rows.append({**model, **row(folder / lidar, args.detector), **cost})
            print(rows[-1], flush=True)
    given = f"--preset {args.preset} --detector {args.detector} --frames {args.frames}"
    command = f"benchmarks/ladder.py {given} --dials {' '.join(args.dials)}"
    about = {"preset": args.preset, "detector": args.detector, "command": command}
    provenance = {**about, "seed": 1, "version": __version__}
    table = pd.DataFrame(rows).assign(**provenance, machine=machine())
    table.to_csv(args.out, index=False)


if __name__ == "__main__":
    main()
