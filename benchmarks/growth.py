"""Measures how the CPU time and the memory of `infrasim run` grow with the size of a scene.

Each row is one case. It has the CPU time per frame without the start of `infrasim`, the CPU time
of the start, and the peak memory. The program writes out/growth.csv; docs/results/speed.md has the
table. To replace the committed table, name it with `--out`:

    .venv/bin/python benchmarks/growth.py [--out results/growth.csv]

`--against` adds the rows of another checkout, such as an earlier version, in which the binary has
been built.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import process
import yaml

from pyinfra.core.version import __version__, machine
from pyinfra.dataset import simulation
from reproduction import ROOT, add_out

BINARY = Path("build/dev/cpp/infrasim")
LIDAR = "ruby_plus"  # LiDAR with 128 lines
FEW, MANY = 10, 110  # numbers of frames; the difference of their times excludes the start-up
CARS = {"Car": 0.74, "Van": 0.1, "Truck": 0.06, "Bus": 0.03, "Motorcycle": 0.07}
SPACE_M = 5.5  # mean length of a parking space
SECONDS = 40  # duration of a scene, unless the case has another one


@dataclass(frozen=True)
class Case:
    """A size of one quantity, such as the road length. All other fields have their defaults."""

    quantity: str
    size: int
    road_km: float = 1
    per_km_lane: float = 15
    parked: int = 0
    mounts: int = 1
    minutes: float = SECONDS / 60
    frames: int = MANY
    step: int = 1  # every step-th frame is computed


def cases() -> Iterator[Case]:
    for frames in (100, 300, 1000):
        yield Case("frames", frames, frames=FEW + frames, minutes=2)
    for km in (1, 10, 50):
        yield Case("road, km", km, road_km=km)
    for density in (5, 20, 40):
        yield Case("vehicles per km and lane", density, per_km_lane=density)
    for parked in (0, 30, 300):
        yield Case("parked cars", parked, parked=parked)
    for mounts in (1, 2, 4, 8):
        yield Case("mounts with clock offsets", mounts, mounts=mounts)
    yield Case("minutes with 300 parked cars and 8 mounts", 10, 1, 15, 300, 8, 10, MANY, 50)


def scene(case: Case) -> dict[str, object]:
    """Returns a scene file's keys: a straight road with mounts and parked cars at its middle."""
    length = 1000 * case.road_km
    # Half the length of a row of parked cars; each side of the road has one row.
    half_row = case.parked / 2 * SPACE_M / 2
    rows = [
        {
            "road": "main",
            "offset_m": side * 9.5,
            "from_m": length / 2 - half_row,
            "to_m": length / 2 + half_row,
            "occupied": 1,
            "class_shares": {"Car": 1},
        }
        for side in (1, -1)
    ]
    return {
        "name": "growth",
        "duration_s": 60 * case.minutes,
        "mounts": {
            f"mount{i}": {
                "x_m": 15 * (i - case.mounts // 2),
                "y_m": 12 * (-1) ** i,
                "z_m": 6,
                "clock_offset_s": 0.005 * i,
            }
            for i in range(case.mounts)
        },
        "roads": [
            {
                "name": "main",
                "start": {"x_m": -length / 2, "y_m": 0, "heading_deg": 0},
                "centreline": [{"line_m": length}],
                "lanes": {"each_way": 2, "width_m": 3.5, "shoulder_m": 0.5, "sidewalk_m": 4},
            }
        ],
        "ground": [
            {
                "elevation_m": -0.05,
                "outline_m": [[-400, -200], [400, -200], [400, 200], [-400, 200]],
            }
        ],
        "traffic": {
            "vehicles_per_km_lane": case.per_km_lane,
            "speed": {"mean_km_h": 50, "std_km_h": 5},
            "class_shares": CARS,
        },
        **({"parked": rows} if case.parked else {}),
    }


def cost(tree: Path, file: Path, frames: int, step: int) -> process.Cost:
    """Returns the cost of simulating `frames` frames of a scene, on one thread, without output."""
    command = [tree / BINARY, "run", file, "--lidar", tree / f"configs/lidars/{LIDAR}.yaml"]
    return process.run([*command, "--frames", f"0:{frames * step}:{step}", "--threads", "1"])


def row(case: Case, tree: Path, which: str) -> dict[str, object]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scene.yaml")
        file.write_text(yaml.safe_dump(scene(case), sort_keys=False))
        few, many = (cost(tree, file, n, case.step) for n in (FEW, case.frames))
    a_frame = (many.cpu_s - few.cpu_s) / (case.frames - FEW)
    return {
        "build": which,
        "quantity": case.quantity,
        "size": case.size,
        "frame_ms": 1000 * a_frame,
        "start_s": few.cpu_s - FEW * a_frame,
        "peak_mb": many.peak_mb,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--against", type=Path, metavar="CHECKOUT", help="also measure another checkout"
    )
    parser.add_argument(
        "--only", metavar="TEXT", default="", help="measure only quantities with TEXT in their name"
    )
    add_out(parser, "growth.csv")
    args = parser.parse_args()
    trees = {"this": ROOT} | ({"other": args.against.resolve()} if args.against else {})
    rows = []
    for case in cases():
        if args.only not in case.quantity:
            continue
        for which, tree in trees.items():
            rows.append(row(case, tree, which))
            print(*rows[-1].values(), flush=True)
            pd.DataFrame(rows).assign(
                lidar=LIDAR,
                preset="datasheet",
                command="benchmarks/growth.py" + (" --against CHECKOUT" if args.against else ""),
                seed=1,
                version=__version__,
                frames_version=simulation.frames_version(),
                machine=machine(),
            ).to_csv(args.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
