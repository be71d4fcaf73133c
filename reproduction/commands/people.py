"""Measures points per frame on pedestrians and cyclists by distance, for each LiDAR.

The LiDAR is 6 m above a straight level road and has preset `datasheet`. A pedestrian and a cyclist
move away from it side by side, up to 500 m. No other object is in the scene. Each frame has a new
pedestrian and a new cyclist with another reflectance and another heading. A distance bin therefore
has 25 frames with different scan phases, positions, headings and reflectances. The number of points
is the median over these frames. The command writes out/people.csv:

    python -m reproduction people
"""

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.dataset import simulation
from pyinfra.dataset.lidars import catalogue_files
from reproduction import provenance
from reproduction.arguments import Out, command

SIZES = {"Pedestrian": (0.73, 0.67, 1.77), "Cyclist": (1.67, 0.70, 1.67)}  # as in core/classes.h
SIDE_M = {"Pedestrian": 1.5, "Cyclist": -1.5}  # lateral offset from the line straight ahead
WEAVE_M = 0.3  # lateral amplitude, so that scan columns hit at different positions
FROM_M, TO_M, BIN_M = 10.0, 500.0, 10.0
STEP_M = 0.4  # movement per frame
TURN_RAD = 2.399963 / 5  # turn per frame; five frames turn by the golden angle, so headings vary
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
    """Returns the columns x to speed of trajectories.csv for a class at an instant."""
    dx, dy, dz = SIZES[name]
    x = FROM_M + STEP_M * instant
    y = SIDE_M[name] + WEAVE_M * np.sin(0.7 * instant)
    heading = (TURN_RAD * instant + np.pi) % (2 * np.pi) - np.pi
    return f"{x:.4f},{y:.4f},{dz / 2},{heading:.6f},{dx},{dy},{dz},{10 * STEP_M}"


def number(name: str, frame: int) -> int:
    """Returns the id of the object of a class in a frame; each object exists in one frame only."""
    return 2 * frame + list(SIZES).index(name)


def trajectories() -> Iterator[str]:
    yield "t,id,class,x,y,z,heading,dx,dy,dz,speed"
    for k in range(FRAMES + 1):
        for frame in (k - 1, k):  # frame that ends, and frame that begins, at instant k
            if 0 <= frame < FRAMES:
                for name in SIZES:
                    yield f"{k / 10},{number(name, frame)},{name},{state(name, k)}"


def write_scene(folder: Path) -> Path:
    (folder / "people.csv").write_text("\n".join(trajectories()) + "\n")
    file = folder / "people.yaml"
    file.write_text(SCENE.format(duration_s=FRAMES / 10))
    return file


def points(world: simulation.World, lidar: simulation.Lidar) -> pd.DataFrame:
    """Returns a row for each frame and class; an object out of range has 0 points."""
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
        lidar = simulation.load_lidar(file)
        table = by_distance(points(world, lidar))
        table.insert(0, "lidar", file.stem)
        print(file.stem, flush=True)
        yield table[table.groupby("class").points.transform(lambda p: p[::-1].cummax()[::-1]) > 0]


@command
def main(*, out: Out = Path("people.csv")) -> None:
    files = catalogue_files()
    with tempfile.TemporaryDirectory() as work:
        table = pd.concat(measured(write_scene(Path(work)), files))
    table = table.assign(preset="datasheet", seed=1, **provenance("people"))
    table.to_csv(out, index=False, float_format="%.4g")
