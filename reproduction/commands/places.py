"""Compares LiDAR positions at a crossing with corner buildings: distance, height, tilt, two poles.

The scene and the commands are taken from docs/several_poles.md. Three traffic seeds are simulated.
The positions are:

- 40 m before the crossing;
- at the corner, 4, 6 and 8 m high;
- at the corner, 8 m high and pitched down by 10 degrees;
- at the corner, 6 m high, with a second pole at the opposite corner.

The detector is the pretrained detector without further training. The command writes out/places.csv.
Its rows are the output of `pyinfra compare` under the ground-truth subsets `present` and `all`:

    python -m reproduction places --work data/places
"""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pandas as pd

from pyinfra.metrics.places import compare_places
from reproduction import ROOT, provenance
from reproduction.arguments import Out, Work, command
from reproduction.simulate import simulate

SEEDS = (1, 2, 3)
FRAMES = "0:5000:47"
LIDARS = ("hesai_xt32", "hesai_ot128")
CORNER = {"pole.x_m": -11.5, "pole.y_m": -11.5}
ACROSS = {"across.x_m": 11.5, "across.y_m": 11.5, "across.z_m": 6}
RUNS = {  # changed keys of the mounts, and the folder of each position, by run
    "back": ({}, {"back": "."}),
    "4m": (CORNER | {"pole.z_m": 4}, {"4m": "."}),
    "8m": (CORNER | {"pole.z_m": 8}, {"8m": "."}),
    "8m_down": (CORNER | {"pole.z_m": 8, "pole.pitch_deg": 10}, {"8m_down": "."}),
    "two": (CORNER | ACROSS, {"6m": "pole", "two": "fused"}),
}
PLACES = ("back", "4m", "6m", "8m", "8m_down", "two")
NAMES = ("place", "minus")  # columns that hold paths


def scene(work: Path) -> Path:
    """Writes the scene of docs/several_poles.md to `work/corner.yaml`; returns the file."""
    page = (ROOT / "docs/several_poles.md").read_text("utf-8")
    match = re.search(r"^```yaml corner.yaml\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    assert match is not None
    (file := work / "corner.yaml").write_text(match[1], "utf-8")
    return file


def pyinfra(*words: object) -> None:
    command = [sys.executable, "-P", "-m", "pyinfra", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def evaluate(lidar: str, run: str, seed: int, work: Path) -> None:
    """Simulates a run and evaluates each of its positions into `work/out/LIDAR/PLACE/SEED`."""
    keys, places = RUNS[run]
    data = simulate(
        scene(work), [lidar], work / "data" / lidar / f"{run}_{seed}", frames=FRAMES, seed=seed,
        set=[f"mounts.{key}={value}" for key, value in keys.items()], fuse=len(places) > 1,
    )  # fmt: skip
    for place, folder in places.items():
        gt, predictions = data / folder / lidar, work / "runs" / lidar / f"{place}_{seed}"
        out = work / "out" / lidar / place / str(seed)
        if not (out / "replicates.csv").is_file():
            if not predictions.is_dir():
                pyinfra("detect", gt, "--model", "generalist", "--out", predictions)
            of = ("--ground-truth", "present", "all", "--no-figures")
            pyinfra("evaluate", gt, predictions, *of, "--out", out)


@command
def main(
    *,
    work: Work,
    out: Out = Path("places.csv"),
    lidars: Annotated[Sequence[str], {"choices": LIDARS}] = LIDARS,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 5 GB
    lidars : names of the LiDARs (default: all)
    """
    tables = []
    for lidar in lidars:
        for run in RUNS:
            for seed in SEEDS:
                evaluate(lidar, run, seed, work)
                print(lidar, run, seed, flush=True)
        for which in ("present", "all"):
            # Under `all`, time blocks differ between positions, so differences are not paired.
            folders = [work / "out" / lidar / place for place in PLACES]
            groups = [folders] if which == "present" else [[folder] for folder in folders]
            for group in groups:
                rows = compare_places(group, which)
                names = {column: rows[column].map(lambda t: Path(t).name) for column in NAMES}
                columns = {"lidar": lidar, "detector": "generalist", "ground_truth": which}
                tables.append(pd.DataFrame(columns, index=rows.index).join(rows.assign(**names)))
    made_by = provenance(f"places --work {work.name}")
    table = pd.concat(tables).assign(seed=" ".join(map(str, SEEDS)), **made_by)
    table.to_csv(out, index=False, float_format="%.5g")
