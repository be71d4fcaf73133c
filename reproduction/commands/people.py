"""Measures points per frame on pedestrians and cyclists by distance, for each LiDAR.

The LiDAR is 6 m above a straight level road, with preset `datasheet`. A pedestrian and a cyclist
move away from it side by side, to 500 m, with nothing in front of them or behind them. Each frame
has new ones with another paint and another heading. So a distance bin has 25 frames with different
scan phases, positions, headings and reflectances. Points are medians over these frames. Writes
out/people.csv and prints the distances up to which the median is 5 points:

    python -m reproduction people
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.version import __version__, machine
from pyinfra.dataset import simulation
from pyinfra.dataset.lidars import catalogue_files, presets_of
from reproduction import add_out

SIZES = {"Pedestrian": (0.73, 0.67, 1.77), "Cyclist": (1.67, 0.70, 1.67)}  # core/classes.h
SIDE_M = {"Pedestrian": 1.5, "Cyclist": -1.5}  # lateral offset from the line straight ahead
WEAVE_M = 0.3  # lateral movement to both sides, so that scan columns hit at varying positions
FROM_M, TO_M, BIN_M = 10.0, 500.0, 10.0
STEP_M = 0.4  # from one frame to the next
TURN_RAD = 2.399963 / 5  # the golden angle in five frames: all headings in each bin
ENOUGH = 5  # points that count as enough
SCENE = """name: people
duration_s: {duration_s}
mounts:
  pole: {{x_m: 0, y_m: 0, z_m: 6}}
roads:
  - name: main
    start: {{x_m: -20, y_m: 0}}
    centreline: [{{line_m: 560}}]
    lanes: {{each_way: 1}}
trajectories: people.csv
"""
FRAMES = round((TO_M - FROM_M) / STEP_M)


def state(name: str, instant: int) -> str:
    """Returns the state of a class at an instant: columns x to speed of trajectories.csv."""
    dx, dy, dz = SIZES[name]
    x = FROM_M + STEP_M * instant
    y = SIDE_M[name] + WEAVE_M * np.sin(0.7 * instant)
    heading = (TURN_RAD * instant + np.pi) % (2 * np.pi) - np.pi
    return f"{x:.4f},{y:.4f},{dz / 2},{heading:.6f},{dx},{dy},{dz},{10 * STEP_M}"


def number(name: str, frame: int) -> int:
    """Returns the id of a class's object that exists in one frame only."""
    return 2 * frame + list(SIZES).index(name)


def trajectories() -> Iterator[str]:
    yield "t,id,class,x,y,z,heading,dx,dy,dz,speed"
    for k in range(FRAMES + 1):
        for frame in (k - 1, k):  # the frame that ends at this instant, and the one that starts
            if 0 <= frame < FRAMES:
                for name in SIZES:
                    yield f"{k / 10},{number(name, frame)},{name},{state(name, k)}"


def write_scene(folder: Path) -> Path:
    (folder / "people.csv").write_text("\n".join(trajectories()) + "\n")
    file = folder / "people.yaml"
    file.write_text(SCENE.format(duration_s=FRAMES / 10))
    return file


def points(world: simulation.World, lidar: simulation.Lidar) -> pd.DataFrame:
    """Returns a row for each frame and class; objects out of range have 0 points."""
    rows = []
    for k, (frame,) in simulation.simulate(world, [lidar], range(FRAMES)):
        counts = dict(
            zip(frame.objects["id"].tolist(), frame.objects["points"].tolist(), strict=True)
        )
        middle = FROM_M + STEP_M * (k + 0.5)
        rows += [(name, middle, counts.get(number(name, k), 0)) for name in SIZES]
    return pd.DataFrame(rows, columns=["class", "distance", "points"])


def by_distance(rows: pd.DataFrame) -> pd.DataFrame:
    from_m = (BIN_M * (rows.distance // BIN_M)).astype(int)
    groups = rows.groupby(["class", from_m.rename("from_m")], sort=False).points
    table = groups.agg(points="median", seen_share=lambda p: (p > 0).mean(), frames="size")
    return table.reset_index()


def measured(scene: Path, files: Iterable[Path]) -> Iterator[pd.DataFrame]:
    world = simulation.load_scene(scene)
    for file in files:
        if "datasheet" not in presets_of(file):
            continue
        lidar = simulation.load_lidar(file)
        table = by_distance(points(world, lidar))
        table.insert(0, "lidar", file.stem)
        print(file.stem, reach(table), flush=True)
        yield table[table.groupby("class").points.transform(lambda p: p[::-1].cummax()[::-1]) > 0]


def reach(table: pd.DataFrame) -> dict[str, float]:
    """Returns the distance (m) up to which the median is ENOUGH, by class."""
    enough = table[table.points >= ENOUGH]
    return {name: (enough[enough["class"] == name].from_m + BIN_M).max() for name in SIZES}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_out(parser, "people.csv")
    args = parser.parse_args()
    # Excluded: users must download its table of rays themselves, and it looks upwards.
    files = [file for file in catalogue_files() if file.stem != "livox_mid_360"]
    with tempfile.TemporaryDirectory() as work:
        table = pd.concat(measured(write_scene(Path(work)), files))
    provenance = {"preset": "datasheet", "seed": 1, "version": __version__, "machine": machine()}
    table = table.assign(**provenance)
    table.to_csv(args.out, index=False, float_format="%.4g")
