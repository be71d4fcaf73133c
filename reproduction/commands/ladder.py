"""Measures the AP of four LiDARs and the cost of the simulation under cheaper scene models.

The scene is the highway with preset `datasheet`, in which vehicles have parts of different
materials. The default model has the simulator's defaults and 500 of the 5,000 frames. Each other
model differs from the default in one setting. Every model is measured with the same traffic seeds.
For each seed, the detector (by default Background) is trained again with other noise. The command
adds the rows of each model and seed to out/ladder.csv as soon as they are computed. Existing rows
are not computed again, and several processes can share the work.

    python -m reproduction ladder --work data/ladder
"""

import itertools
import resource
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import pandas as pd

from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.formats import kitti
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.measures import ap_of_captured, detected, train_detector
from reproduction.simulate import simulate

# The values of each setting from cheap to expensive. The last value is the reference.
SETTINGS = {
    "detail": ("box", "low", "mid", "fine"),
    "aggregation": ("instant", "slices:100", "exact"),
    "parts": ("none", "glass", "gap", "coat", "tyres", "reflectors", "glass+gap+coat", "all"),
    "vegetation": ("none", "scene"),
    "label_time": ("frame", "scan"),
    "frames": ("50", "100", "200", "500", "1000"),
}
LIDARS = ["ruby_plus", "livox_avia", "pandar_64", "helios_16"]
DEFAULT = {
    "detail": "low",
    "aggregation": "exact",
    "parts": "glass+gap+coat",
    "vegetation": "scene",
    "label_time": "scan",
    "frames": "500",
}
ALL_FRAMES = 5000
KEY = [*DEFAULT, "lidar", "detector", "preset", "seed"]
PARTS = ("glass", "gap", "coat", "tyres", "reflectors")


def models(
    settings: Sequence[str], frames: str, wanted: Sequence[str] | None
) -> Iterator[dict[str, str]]:
    """Yields the default model, then each model that differs from it in one setting.

    Parameters
    ----------
    settings : names of the settings that vary
    frames : number of frames of the default model
    wanted : values that the settings may take; None for all values
    """
    default = DEFAULT | {"frames": frames}
    yield default
    for setting in settings:
        values = [v for v in SETTINGS[setting] if setting != "frames" or int(v) < int(frames)]
        others = [v for v in values if v != default[setting] and (wanted is None or v in wanted)]
        yield from (default | {setting: value} for value in others)


def parts_of(value: str) -> dict[str, bool]:
    """Returns the scene keys `vehicle_parts.*` of a value like `glass+coat`, `all` or `none`."""
    on = PARTS if value == "all" else value.split("+")
    return {f"vehicle_parts.{part}": part in on for part in PARTS}


def assignments(model: dict[str, str]) -> list[str]:
    """Returns KEY=VALUE words that set a model's scene keys."""
    settings = {name: model[name] for name in ("detail", "aggregation", "label_time")}
    settings |= {key: str(on).lower() for key, on in parts_of(model["parts"]).items()}
    settings |= {"vegetation": "[]"} if model["vegetation"] == "none" else {}
    return [f"{key}={value}" for key, value in settings.items()]


def simulated(
    model: dict[str, str], preset: str, seed: int, names: Sequence[str], folder: Path
) -> float:
    """Simulates a model; returns the CPU milliseconds per frame for all LiDARs together."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    frames = int(model["frames"])
    simulate(
        "highway", names, folder, parts=Parts(), frames=f"0:{ALL_FRAMES}:{ALL_FRAMES // frames}",
        threads=1, preset=preset, seed=seed, set=assignments(model),
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return 1000 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / frames


def row(folder: Path, detector: str, seed: int) -> dict[str, object]:
    """Trains a detector and evaluates it on the test frames of one LiDAR."""
    run = folder.parent / f"{folder.name}_{detector}"
    train_detector(detector, folder, run, seed)
    ap_row = ap_of_captured(folder, detected(run, folder, run))
    frames = kitti.frames(folder)
    points = int(read_vehicles(folder, frames).points.sum())
    return {
        "ap_r1000": ap_row.ap_r1000,
        "objects": int(ap_row.objects),
        "vehicle_points_per_frame": points / len(frames),
    }


@command
def main(
    *,
    work: Work,
    out: Out = Path("ladder.csv"),
    seeds: Sequence[int] = (1, 2, 3),
    preset: str = "datasheet",
    detector: str = "background",
    lidars: Sequence[str] = LIDARS,
    settings: Annotated[Sequence[str], {"choices": SETTINGS}] = tuple(SETTINGS),
    frames: str = DEFAULT["frames"],
    values: Sequence[str] | None = None,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 2 GB
    seeds : traffic seeds; a seed also seeds the training (default: 1 2 3)
    preset : preset of the LiDARs (default: %(default)s)
    detector : name of a file in configs/detectors (default: %(default)s)
    lidars : names of the LiDARs (default: the four of the study)
    settings : settings to vary (default: all)
    frames : number of frames of the default model, a divisor of 5,000 (default: %(default)s)
    values : values of the settings to measure (default: all)
    """
    for model, seed in itertools.product(models(settings, frames, values), seeds):
        words = f"ladder --preset {preset} --detector {detector} --seeds {seed}"
        words += f" --frames {frames} --lidars {' '.join(lidars)}"
        shared = {**model, "detector": detector, "preset": preset, "seed": seed}
        fill(shared, lidars, words, work, out)


def fill(shared: dict[str, Any], lidars: Sequence[str], words: str, work: Path, out: Path) -> None:
    """Adds the rows of one model and seed, unless another process is computing them.

    shared: columns of all rows; words: the command's name and options, for the column `command`
    """
    name = "_".join(map(str, shared.values())).replace(":", "-")
    folder, detector, seed = work / name, shared["detector"], shared["seed"]

    def is_done() -> bool:
        wanted = [{**shared, "lidar": lidar} for lidar in lidars]
        return all(store.has_each(store.read(out, list(DEFAULT)), wanted))

    def run() -> None:
        ms = simulated(shared, shared["preset"], seed, lidars, folder)
        columns = {"ms_per_frame_set": ms, **provenance(words)}
        rows = pd.DataFrame(
            {**shared, "lidar": lidar, **row(folder / lidar, detector, seed), **columns}
            for lidar in lidars
        )
        store.put(out, rows[[*KEY, *(c for c in rows if c not in KEY)]], KEY)
        print(name, *rows.ap_r1000.round(1), flush=True)
        shutil.rmtree(folder)

    store.fill(work / "locks" / name, is_done, run)
