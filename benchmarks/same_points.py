"""Compares the points of two builds of the simulator.

scripts/debian13.sh runs this program. It reads two folders with the same data sets. Each build has
written one folder, with --fields. A ray is identified by its ring and time. A ray is the same in
both builds if neither build has a point of the ray, or if both points have the same object and
class and are within 1 mm. The program prints and writes a table. Its exit code is 1 if the builds
differ too much.

    .venv/bin/python benchmarks/same_points.py HERE THERE --out results/debian13.csv
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.data_set import DataSet, read_data_set
from pyinfra.dataset.frames_version import number_at
from pyinfra.formats import kitti

SAME_RAYS_PERCENT = 99.99
TOTALS_PERCENT = 0.01
SAME_POINT_M = 1e-3


def points(folder: Path, frame: int) -> pd.DataFrame:
    """Returns the points of one frame: columns x y z intensity time_s ring class object_id."""
    xyzi = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
    fields = kitti.read_fields(kitti.frame_file(folder, "fields", frame))
    table = pd.DataFrame(xyzi, columns=["x", "y", "z", "intensity"])
    for name in fields.dtype.names or ():
        table[name] = fields[name]
    return table


def distances(both: pd.DataFrame) -> FloatArray:
    """Returns the distance (m) between the two points of each ray, shape (n,)."""
    here, there = (both[[f"{axis}_{i}" for axis in "xyz"]].to_numpy(float) for i in (0, 1))
    return np.asarray(np.linalg.norm(here - there, axis=1), np.float64)


def compare_frame(a: Path, b: Path, frame: int) -> dict[str, float]:
    """Counts the points and the differences of one LiDAR's frame in two folders.

    The result also has the largest distance (mm) between two points of a ray on the same surface.
    """
    here, there = points(a, frame), points(b, frame)
    rays = here.merge(there, on=["ring", "time_s"], suffixes=("_0", "_1"), validate="one_to_one")
    surface = (rays.object_id_0 == rays.object_id_1) & (rays.class_0 == rays.class_1)
    apart = distances(rays)
    return {
        "points": len(here),
        "points_other": len(there),
        "vehicle_points": int((here.object_id >= 0).sum()),
        "vehicle_points_other": int((there.object_id >= 0).sum()),
        "rays_in_one_only": len(here) + len(there) - 2 * len(rays),
        "other_surface": int((~surface).sum()),
        "same_surface_apart": int((surface & (apart > SAME_POINT_M)).sum()),
        "equal_bits": int((apart == 0).sum()),
        "largest_mm": 1e3 * float(apart[surface].max(initial=0)),
    }


def compare(here: DataSet, there: DataSet) -> pd.DataFrame:
    """Returns a row for each LiDAR of two data sets with the same frames."""
    if (here.names, here.frames, here.seed) != (there.names, there.frames, there.seed):
        raise ValueError(
            f"{there.folder}: expected the LiDARs, frames and seed of {here.folder}, got others"
        )
    rays = pd.read_csv(here.folder / "summary.csv", index_col="lidar").rays_per_frame
    rows = []
    for name in here.names:
        folders = here.lidar_folder(name), there.lidar_folder(name)
        frames = pd.DataFrame([compare_frame(*folders, frame) for frame in here.frames])
        sums = frames.sum().drop("largest_mm").astype(int)
        count = round(rays[name] * len(here.frames))
        other = sums.rays_in_one_only + sums.other_surface + sums.same_surface_apart
        rows.append(
            {"preset": here.preset, "lidar": name, "frames": len(frames), "rays": count, **sums}
            | {
                "largest_mm": round(frames.largest_mm.max(), 4),
                "same_rays_percent": 100 * (1 - other / count),
                "same_points_percent": 100 * (1 - other / sums.points),
            }
        )
    return pd.DataFrame(rows)


def totals_apart_percent(table: pd.DataFrame) -> float:
    """Returns the largest relative difference (%) of the total points or vehicle points."""
    return max(
        float((100 * (table[f"{kind}_other"] / table[kind] - 1)).abs().max())
        for kind in ("points", "vehicle_points")
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("here", type=Path, help="data set of this machine")
    parser.add_argument("there", type=Path, help="data set of the other machine")
    parser.add_argument("--out", type=Path, required=True, help="output CSV file")
    args = parser.parse_args()
    names = sorted(file.parent.name for file in args.here.glob("*/dataset.yaml"))
    pairs = [[read_data_set(side / name) for side in (args.here, args.there)] for name in names]
    table = pd.concat([compare(*pair) for pair in pairs], ignore_index=True)
    (number,) = {number_at(data.lidar_folder(data.names[0])) for pair in pairs for data in pair}
    table = table.assign(seed=pairs[0][0].seed, version=pairs[0][0].version, frames_version=number)
    table.to_csv(args.out, index=False, float_format="%.5f")
    same, apart = table.same_rays_percent.min(), totals_apart_percent(table)
    print(table.to_string(index=False))
    print(f"same rays: at least {same:.5f} %; totals differ by at most {apart:.5f} %")
    return int(same < SAME_RAYS_PERCENT or apart > TOTALS_PERCENT)


if __name__ == "__main__":
    raise SystemExit(main())
