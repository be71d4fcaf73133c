"""Points per vehicle of an earlier version beside today's, and what each model of returns does.

Vehicles of the highway that are seen, by distance; four LiDARs, three presets. Under `datasheet`
also today's law of detection alone (no parts of vehicles, no plants), then with one more model at a
time. Writes results/before.csv; the earlier version is a checkout with its binary built:
    .venv/bin/python benchmarks/before.py --checkout ../0.2.0
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from pyinfra.core.version import __version__, machine
from pyinfra.dataset.frames import frame_numbers
from pyinfra.formats import kitti

ROOT = Path(__file__).resolve().parent.parent
LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
PRESETS = ("paper", "equal", "datasheet")
BINS_M = [10, 30, 50, 70, 90, 120]
PARTS = ("glass", "gap", "coat")
LEAST_VISIBILITY = 0.2


def models() -> dict[str, list[str]]:
    """What is set, by name: the law alone, and one more at a time."""
    bare = ["vegetation=[]", *(f"vehicle_parts.{part}=false" for part in PARTS)]
    found = {"law": bare}
    for part in PARTS:
        bare = [f"vehicle_parts.{part}=true" if part in word else word for word in bare]
        found[f"and {part}"] = bare
    return found


def simulated(checkout: Path, preset: str, sets: list[str], frames: str, out: Path) -> Path:
    configs = checkout / "configs"
    lidars = [configs / "lidars" / f"{name}.yaml" for name in LIDARS]
    words = [checkout / "build/dev/cpp/infrasim", "run", configs / "scenes/highway.yaml"]
    words += ["--lidar", *lidars, "--preset", preset, "--frames", frames, "--out", out]
    words += [word for key in sets for word in ("--set", key)]
    subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL)
    return out


def points(data: Path) -> pd.DataFrame:
    """Vehicles and their mean points, by LiDAR and distance."""
    tables = []
    for lidar in LIDARS:
        folder = data / lidar
        files = [kitti.frame_file(folder, "objects", k) for k in frame_numbers(folder, "all")]
        tables.append(pd.concat(pd.read_csv(file) for file in files).assign(lidar=lidar))
    found = pd.concat(tables)
    found = found[found.visibility >= LEAST_VISIBILITY]
    found["from_m"] = pd.cut(found.distance, BINS_M, right=False, labels=BINS_M[:-1])
    grouped = found.groupby(["lidar", "from_m"], observed=True).points
    counted = grouped.agg(vehicles="size", points_per_vehicle="mean").round(3)
    return counted.reset_index()


def rows(checkout: Path, frames: str, work: Path) -> Iterator[pd.DataFrame]:
    for preset in PRESETS:
        for name, tree in (("before", checkout), ("today", ROOT)):
            data = simulated(tree, preset, [], frames, work / f"{preset}_{name}")
            yield points(data).assign(preset=preset, model=name)
    for name, sets in models().items():
        data = simulated(ROOT, "datasheet", sets, frames, work / name.replace(" ", "_"))
        yield points(data).assign(preset="datasheet", model=name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checkout", type=Path, required=True, help="of the earlier version")
    # In 25 frames an Avia's slow wedge turns 102.0 times: every 25th sees one phase of it alone.
    parser.add_argument("--frames", default="0:5000:23", help="A:B:STEP")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "before.csv")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        table = pd.concat(rows(args.checkout, args.frames, Path(work)))
    table = table[["preset", "model", "lidar", "from_m", "vehicles", "points_per_vehicle"]]
    about = {"command": f"benchmarks/before.py --frames {args.frames}", "seed": 1}
    table = table.assign(**about, version=__version__, machine=machine())
    table.to_csv(args.out, index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
