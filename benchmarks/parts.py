"""What the parts of vehicles do to their points: by distance, and by height on the body.

Cars of the highway that nothing hides, preset `datasheet`, one LiDAR; all parts, none, and each
one alone. `upper` is from six tenths of the height up, where windows are, `low` below 0.2 m.
Writes results/parts.csv and prints it:
    .venv/bin/python benchmarks/parts.py
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import pandas as pd

from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.runs import infrasim
from pyinfra.formats import kitti

ROOT = Path(__file__).resolve().parent.parent
PARTS = ("glass", "tyres", "gap", "coat", "reflectors")
MODELS = {
    "all": PARTS,
    "none": (),
    **{part: (part,) for part in PARTS},
}
BINS_M = [10, 30, 50, 70, 90, 120]
LOW_M, UPPER = 0.2, 0.6  # above the road; share of the height


def cars(folder: Path, frame: int) -> pd.DataFrame:
    """A row for each car in view: its distance and its points, in all, above and below."""
    objects = pd.read_csv(kitti.frame_file(folder, "objects", frame))
    points = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
    owner = kitti.read_fields(kitti.frame_file(folder, "fields", frame))["object_id"]
    seen = objects[(objects["class"] == "Car") & (objects.visibility > 0.9)]
    rows = []
    for car in seen.itertuples():
        height = points[owner == car.id, 2] - (car.z - car.dz / 2)
        rows.append(
            (car.distance, len(height), (height > UPPER * car.dz).sum(), (height < LOW_M).sum())
        )
    return pd.DataFrame(rows, columns=["distance", "points", "upper", "low"])


def table(model: str, folder: Path) -> pd.DataFrame:
    found = pd.concat([cars(folder, frame) for frame in frame_numbers(folder)])
    bins = pd.cut(found.distance, BINS_M, right=False, labels=BINS_M[:-1])
    means = found.groupby(bins, observed=True)[["points", "upper", "low"]].mean().round(2)
    means["cars"] = found.groupby(bins, observed=True).size()
    return means.rename_axis("from_m").reset_index().assign(model=model)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lidar", default="ruby_plus")
    parser.add_argument("--frames", default="0:1000:10", help="A:B:STEP")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "parts.csv")
    args = parser.parse_args()
    tables = []
    with tempfile.TemporaryDirectory() as work:
        for model, parts in MODELS.items():
            out = Path(work) / model
            sets = [
                w for p in PARTS for w in ("--set", f"vehicle_parts.{p}={str(p in parts).lower()}")
            ]
            words = ["--lidar", lidar_file(args.lidar), "--frames", args.frames, "--fields"]
            infrasim("run", scene_file("highway"), *words, *sets, "--out", out)
            tables.append(table(model, out / args.lidar))
    rows = pd.concat(tables).assign(lidar=args.lidar, version=__version__, machine=machine())
    rows.to_csv(args.out, index=False)
    print(rows.to_string(index=False))


if __name__ == "__main__":
    main()
