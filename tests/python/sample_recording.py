"""Writes the sample recording of the package: clouds of a simulated LiDAR, as a driver would.

python tests/python/sample_recording.py out/sample
"""

import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import pyinfra as pi
from pyinfra.core.arrays import Points, Records
from pyinfra.formats.pcd_file import write_pcd

FRAMES = range(100, 200, 5)  # 20 clouds over 10 s
ACROSS_M = 19.0  # maximum distance of points from the road's axis, as after a region filter
TILT_DEG = (4.0, -1.5)  # pitch and roll of the sensor
FIRST = datetime(2026, 5, 4, 8, 30, tzinfo=UTC)  # time of frame 0
FIELDS = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "u1")]


def main(out: Path) -> None:
    """Simulates 20 clouds of a LiDAR on the highway, in the frame of a tilted sensor, and writes
    them as .pcd files without labels.
    """
    frames = pi.simulate("highway", "helios_16", FRAMES)
    out.mkdir(parents=True, exist_ok=True)
    for frame in frames:
        seconds = FIRST.timestamp() + frame.number * frames.period_s
        write_pcd(out / f"{seconds:.6f}.pcd", records_of(frame.points))
    size = sum(file.stat().st_size for file in out.glob("*.pcd"))
    print(f"{out}: {len(frames)} clouds, {size / 1e6:.2f} MB")


def records_of(points: Points) -> Records:
    """Returns the points (n, 4) near the road in the frame of the tilted sensor."""
    near = points[np.abs(points[:, 1]) <= ACROSS_M]
    T_levelled_sensor = Rotation.from_euler("ZYX", [0, *TILT_DEG], degrees=True).as_matrix()
    out = np.empty(len(near), FIELDS)
    for name, column in zip("xyz", (near[:, :3] @ T_levelled_sensor).T, strict=True):
        out[name] = column
    out["intensity"] = np.rint(255 * near[:, 3])
    return out


if __name__ == "__main__":
    main(Path(sys.argv[1]))
