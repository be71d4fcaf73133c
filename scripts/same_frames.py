"""Compares frames from the Python bindings with frames from the binary.

scripts/wheels.sh runs this script on a wheel:

    python same_frames.py CONFIGS DATA

DATA is a data set of the highway that the binary has written with the default preset.
"""

import sys
from pathlib import Path

from pyinfra.dataset import simulation


def main() -> int:
    configs, data = map(Path, sys.argv[1:])
    names = sorted(folder.parent.name for folder in data.glob("*/training"))
    lidars = [simulation.load_lidar(configs / f"lidars/{name}.yaml") for name in names]
    count = len(list((data / names[0] / "training/velodyne").glob("*.bin")))
    for number, frames in simulation.simulate(
        configs / "scenes/highway.yaml", lidars, range(count)
    ):
        for name, frame in zip(names, frames, strict=True):
            file = data / name / f"training/velodyne/{number:06d}.bin"
            if simulation.points(frame).tobytes() != file.read_bytes():
                raise SystemExit(f"{file}: the bindings give other points than the binary")
    print(f"{count} frames of {len(names)} LiDARs: the bindings and the binary give the same bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
