"""Measures the AP of four LiDARs and the cost of the simulation under cheaper scene models.

The scene is the highway with preset `datasheet`, in which vehicles have parts of different
materials. The default model has the simulator's defaults and 1,000 of the 5,000 frames. Each other
model differs from the default in one setting. The detector is Background. The command adds the rows
of each model to out/ladder.csv as soon as they are computed. Existing rows are not computed again.
Use another --out for another detector:

    python -m reproduction ladder --work data/ladder
"""

from __future__ import annotations

import argparse
import resource
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from pyinfra.core.files import replacing
from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments.benchmark.frames import split_by_time
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.settings import Settings
from pyinfra.models.inference import detect
from pyinfra.models.training.recipe import read_recipe
from pyinfra.models.training.sources import read_source
from pyinfra.models.training.train import train
from reproduction import ROOT, add_out
from reproduction.report.ladder import SETTINGS

LIDARS = ["ruby_plus", "livox_avia", "pandar_64", "helios_16"]
DEFAULT = {
    "detail": "low",
    "aggregation": "exact",
    "parts": "glass+gap+coat",
    "vegetation": "scene",
    "label_time": "scan",
    "frames": "1000",
}
ALL_FRAMES = 5000
AP = ["ap", "ap_low", "ap_high", "ap_r1000", "ap_r1000_low", "ap_r1000_high"]
PARTS = ("glass", "gap", "coat", "tyres", "reflectors")


def models(
    severities: Sequence[str], frames: str, wanted: Sequence[str] | None
) -> Iterator[dict[str, str]]:
    """Yields the default model, then each model that differs from it in one setting.

    Parameters
    ----------
    severities : names of the settings that vary
    frames : number of frames of the default model
    wanted : values that the settings may take; None for all values
    """
    default = DEFAULT | {"frames": frames}
    yield default
    for severity in severities:
        values = [v for v in SETTINGS[severity] if severity != "frames" or int(v) < int(frames)]
        others = [v for v in values if v != default[severity] and (wanted is None or v in wanted)]
        yield from (default | {severity: value} for value in others)


def parts_of(value: str) -> dict[str, bool]:
    """Returns the scene keys `vehicle_parts.*` of a value like `glass+coat`, `all` or `none`."""
    on = PARTS if value == "all" else value.split("+")
    return {f"vehicle_parts.{part}": part in on for part in PARTS}


def assignments(model: dict[str, str]) -> list[str]:
    """Returns the command-line words that set a model's scene keys with `--set`."""
    settings = {severity: model[severity] for severity in ("detail", "aggregation", "label_time")}
    settings |= {key: str(on).lower() for key, on in parts_of(model["parts"]).items()}
    settings |= {"vegetation": "[]"} if model["vegetation"] == "none" else {}
    return [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]


def simulated(model: dict[str, str], preset: str, names: Sequence[str], folder: Path) -> float:
    """Simulates a model; returns the CPU milliseconds per frame for all LiDARs together."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    frames = int(model["frames"])
    lidars = [lidar_file(name) for name in names]
    words = ["--frames", f"0:{ALL_FRAMES}:{ALL_FRAMES // frames}", "--threads", "1"]
    scene = scene_file("highway")
    words += ["--preset", preset, *assignments(model)]
    infrasim("run", scene, "--lidar", *lidars, *words, "--out", folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    split_by_time(folder, Parts())
    return 1000 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / frames


def row(folder: Path, detector: str) -> dict[str, object]:
    """Trains a detector and evaluates it on the test frames of one LiDAR."""
    run = folder.parent / f"{folder.parent.name}_{folder.name}_{detector}"
    recipe = read_recipe(ROOT / "configs" / "detectors" / f"{detector}.yaml", "quick")
    train(recipe, [read_source(folder, "quick")], run, quiet=True)
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    detect.detect(detect.load_detector(run), files, run / "predictions")
    evaluation = evaluate(folder, run / "predictions", Settings(ground_truths=("captured",)))
    ap_row = evaluation.ap.iloc[0]
    replicates = evaluation.replicates[evaluation.replicates.measure == "ap_r1000"].iloc[0]
    frames = kitti.frames(folder)
    points = int(read_vehicles(folder, frames).points.sum())
    return {
        "lidar": folder.name,
        **ap_row[AP].astype(float).round(4),
        "objects": int(ap_row.objects),
        "vehicle_points_per_frame": round(points / len(frames), 2),
        **replicates.drop(["lidar", "frames", "version"]).to_dict(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--work", type=Path, required=True, help="working folder for frames, about 2 GB"
    )
    add_out(parser, "ladder.csv")
    parser.add_argument(
        "--preset", default="datasheet", help="preset of the LiDARs (default: %(default)s)"
    )
    parser.add_argument(
        "--detector",
        default="background",
        help="name of a file in configs/detectors (default: %(default)s)",
    )
    parser.add_argument(
        "--lidars",
        nargs="+",
        default=LIDARS,
        help="names of the LiDARs (default: the four of the study)",
    )
    parser.add_argument(
        "--settings",
        nargs="+",
        choices=SETTINGS,
        default=list(SETTINGS),
        help="settings to vary (default: all)",
    )
    parser.add_argument(
        "--frames",
        default="1000",
        help="number of frames of the default model, a divisor of 5,000 (default: %(default)s)",
    )
    parser.add_argument(
        "--values", nargs="+", help="values of the settings to measure (default: all)"
    )
    args = parser.parse_args()
    provenance = {
        "preset": args.preset,
        "detector": args.detector,
        "seed": 1,
        "version": __version__,
    }
    provenance |= {"command": command(args), "machine": machine()}
    table = pd.read_csv(args.out, dtype=str) if args.out.is_file() else pd.DataFrame()
    for model in models(args.settings, args.frames, args.values):
        if len(table) and (table[list(model)] == pd.Series(model)).all(axis=1).any():
            continue
        name = "_".join([args.preset, *model.values()]).replace(":", "-")
        folder = args.work / name
        cost = {"ms_per_frame_set": round(simulated(model, args.preset, args.lidars, folder), 3)}
        rows = [{**model, **row(folder / n, args.detector), **cost} for n in args.lidars]
        table = pd.concat([table, pd.DataFrame(rows).assign(**provenance)], ignore_index=True)
        with replacing(args.out) as beside:
            table.to_csv(beside, index=False)
        print(name, *(f"{cells['lidar']} {cells['ap_r1000']}" for cells in rows), flush=True)
        shutil.rmtree(folder)


def command(args: argparse.Namespace) -> str:
    given = f"--preset {args.preset} --detector {args.detector} --frames {args.frames}"
    given += f" --lidars {' '.join(args.lidars)} --settings {' '.join(args.settings)}"
    values = f" --values {' '.join(args.values)}" if args.values else ""
    return f"python -m reproduction ladder {given}{values}"
