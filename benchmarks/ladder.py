"""What cheaper models of a scene do to its conclusions: AP of four LiDARs against the cost.


Detector Background, highway, preset `paper`; one dial at a time away from the default, which is
detail low, aggregation exact and 1,000 of 5,000 frames. Writes results/ladder.csv:
    .venv/bin/python benchmarks/ladder.py --work data/ladder
"""

from __future__ import annotations

import argparse
import resource
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from pyinfra import __version__, kitti, machine
from pyinfra.benchmark.frames import split_by_time
from pyinfra.benchmark.matrix import Parts
from pyinfra.data.frame_tables import read_vehicles
from pyinfra.data.frames import frame_numbers
from pyinfra.evaluation.evaluate import evaluate
from pyinfra.evaluation.judge import Settings
from pyinfra.simulator.catalogue import lidar_file, scene_file
from pyinfra.simulator.runs import infrasim
from pyinfra.training import detect
from pyinfra.training.recipe import read_recipe
from pyinfra.training.sources import read_source
from pyinfra.training.train import train

ROOT = Path(__file__).resolve().parent.parent
LIDARS = ["ruby_plus", "livox_avia", "pandar_64", "helios_16"]
DEFAULT = {"detail": "low", "aggregation": "exact", "frames": "1000"}
DIALS = {
    "detail": ("box", "low", "mid", "fine"),
    "aggregation": ("instant", "slices:100", "exact"),
    "frames": ("50", "100", "200", "500", "1000"),
}
ALL_FRAMES = 5000


def models() -> Iterator[dict[str, str]]:
    """The default, and each dial's other values."""
    yield DEFAULT
    for dial, values in DIALS.items():
        yield from (DEFAULT | {dial: value} for value in values if value != DEFAULT[dial])


def simulated(model: dict[str, str], folder: Path) -> float:
    """Runs the model's world into the folder; returns CPU milliseconds a frame set."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    frames = int(model["frames"])
    sets = [
        word for dial in ("detail", "aggregation") for word in ("--set", f"{dial}={model[dial]}")
    ]
    lidars = [lidar_file(name) for name in LIDARS]
    words = ["--frames", f"0:{ALL_FRAMES}:{ALL_FRAMES // frames}", "--threads", "1", *sets]
    scene = scene_file("highway")
    infrasim("run", scene, "--lidar", *lidars, "--preset", "paper", *words, "--out", folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    split_by_time(folder, Parts())
    return 1000 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / frames


def row(folder: Path) -> dict[str, object]:
    """What Background finds in the test frames of one LiDAR."""
    run = folder.parent / f"{folder.parent.name}_{folder.name}"
    recipe = read_recipe(ROOT / "configs" / "detectors" / "background.yaml", "quick")
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
    args = parser.parse_args()
    rows = []
    for model in models():
        folder = args.work / "_".join(model.values()).replace(":", "-")
        cost = simulated(model, folder)
        for lidar in LIDARS:
            rows.append({**model, **row(folder / lidar), "ms_per_frame_set": round(cost, 3)})
            print(rows[-1], flush=True)
    provenance = {"command": "benchmarks/ladder.py", "seed": 1, "version": __version__}
    table = pd.DataFrame(rows).assign(**provenance, machine=machine())
    table.to_csv(args.out, index=False)


if __name__ == "__main__":
    main()
