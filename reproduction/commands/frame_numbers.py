"""Compares the points per vehicle of this simulator with those of an earlier checkout.

Both simulate the same traffic with all LiDARs of the catalogue that both have, preset `datasheet`.
Vehicles of the evaluation region count, and both builds count the same vehicles. `--against` names
a checkout of the earlier version in which the binary has been built. The command writes
out/frame_numbers.csv:

    python -m reproduction frame_numbers --against ../before
"""

import subprocess
import tempfile
from pathlib import Path

import pandas as pd

from pyinfra.core.vocabulary import VEHICLE_TYPES
from reproduction import ROOT, provenance
from reproduction.arguments import Out, command

SCENES = ("highway", "crossroad", "curve")
FRAMES = "0:600:15"
BANDS_M = [0, 30, 60, 90, 120]
KEYS = ["scene", "lidar", "frame", "id"]


def catalogue(checkout: Path) -> set[str]:
    """Returns the LiDARs of a checkout that have the preset."""
    files = (checkout / "configs/lidars").glob("*.yaml")
    return {file.stem for file in files if "\n  datasheet:" in file.read_text()}


def objects(checkout: Path, scene: str, lidars: list[str], seed: int) -> pd.DataFrame:
    """Simulates a scene with a checkout; returns its vehicles in the region, a row for each LiDAR,
    frame and vehicle."""
    with tempfile.TemporaryDirectory() as work:
        files = [str(checkout / f"configs/lidars/{name}.yaml") for name in lidars]
        binary = str(checkout / "build/dev/cpp/infrasim")
        command = [binary, "run", f"configs/scenes/{scene}.yaml"]
        command += ["--preset", "datasheet", "--frames", FRAMES, "--seed", str(seed)]
        command += ["--out", work, "--lidar", *files]
        subprocess.run(command, cwd=checkout, check=True, stdout=subprocess.DEVNULL)
        tables = []
        for lidar in lidars:
            for file in sorted(Path(work, lidar, "training/objects").glob("*.csv")):
                table = pd.read_csv(file)
                tables.append(table.assign(scene=scene, lidar=lidar, frame=int(file.stem)))
    rows = pd.concat(tables)
    inside = (rows.visibility >= 0) & rows["class"].isin(VEHICLE_TYPES)
    return rows[inside].set_index(KEYS)[["points", "distance"]]


def compared(before: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Returns the mean points per vehicle of both builds, by scene, LiDAR and distance."""
    both = before.join(now, how="inner", lsuffix="_before", rsuffix="_now")
    from_m = pd.cut(both.distance_now, BANDS_M, right=False, labels=BANDS_M[:-1])
    groups = both.assign(from_m=from_m).groupby(["scene", "lidar", "from_m"], observed=True)
    return groups.agg(
        vehicles=("points_now", "size"),
        points_before=("points_before", "mean"),
        points_now=("points_now", "mean"),
    ).reset_index()


@command
def main(*, against: Path, seeds: int = 2, out: Out = Path("frame_numbers.csv")) -> None:
    """
    Parameters
    ----------
    against : checkout of an earlier version
    seeds : number of traffic seeds; default: 2
    """
    lidars = sorted(catalogue(against.resolve()) & catalogue(ROOT))
    tables = []
    for seed in range(1, seeds + 1):
        for scene in SCENES:
            before = objects(against.resolve(), scene, lidars, seed)
            tables.append(compared(before, objects(ROOT, scene, lidars, seed)).assign(seed=seed))
            print(scene, seed, flush=True)
    command = f"frame_numbers --seeds {seeds} --against CHECKOUT"
    table = pd.concat(tables).assign(preset="datasheet", **provenance(command))
    table.to_csv(out, index=False, float_format="%.5g")
