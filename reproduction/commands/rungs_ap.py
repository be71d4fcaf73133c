"""Measures what a model of a LiDAR changes in the AP of two detectors.

The model is a rung of `python -m reproduction rungs`. The scene is the highway, preset `datasheet`.
Background is trained again for each seed, and the pretrained detector is used as it is. Both see
the same traffic with and without the model. The command writes out/rungs_ap.csv, a row for each
rung, LiDAR, detector and seed:

    python -m reproduction rungs_ap --work out/rungs_ap
"""

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pandas as pd

from pyinfra.experiments.benchmark.matrix import Parts
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.commands.rungs import FOUR, RUNGS, changed_file
from reproduction.measures import ap_of_captured, detected, train_detector
from reproduction.simulate import simulate

FRAMES = "0:5000:20"
DETECTORS = ("background", "pretrained")


def simulated(rung: str, seed: int, folder: Path) -> None:
    """Writes the frames of all LiDARs of a rung, a change of one LiDAR model (see `rungs`)."""
    with tempfile.TemporaryDirectory() as configs:
        files = [changed_file(name, rung, Path(configs)) for name in FOUR]
        options = {"frames": FRAMES, "preset": "datasheet", "seed": seed}
        simulate("highway", files, folder, parts=Parts(), **options)


def average_precision(folder: Path, detector: str, seed: int) -> float:
    """Returns the AP (R1000) of captured vehicles in the test frames of one LiDAR."""
    run = folder.parent / f"{folder.name}_{detector}"
    model = Path("generalist")
    if detector == "background":
        model, _ = train_detector(detector, folder, run, seed)
    return float(ap_of_captured(folder, detected(model, folder, run)).ap_r1000)


@command
def main(
    *,
    work: Work,
    out: Out = Path("rungs_ap.csv"),
    seeds: Sequence[int] = (1, 2, 3),
    rungs: Annotated[Sequence[str], {"choices": list(RUNGS)}] = ("one ray",),
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 1 GB
    seeds : traffic seeds; a seed also seeds the training (default: 1 2 3)
    rungs : rungs to measure (default: one ray)
    """
    rows: list[dict[str, object]] = []
    for seed in seeds:
        for rung in ["default", *rungs]:
            folder = work / f"{rung.replace(' ', '_')}_{seed}"
            simulated(rung, seed, folder)
            for lidar in FOUR:
                for detector in DETECTORS:
                    ap = average_precision(folder / lidar, detector, seed)
                    keys = {"rung": rung, "lidar": lidar, "detector": detector, "seed": seed}
                    rows.append({**keys, "ap_r1000": ap})
                    print(*keys.values(), f"{ap:.1f}", flush=True)
            shutil.rmtree(folder)
            table = pd.DataFrame(rows).assign(preset="datasheet", **provenance("rungs_ap"))
            table.to_csv(out, index=False, float_format="%.4f")
