"""What a hill does: to a network that knows one height of the road, and to boxes that do not lean.

A road of 700 m rises at a grade in its middle, where the pole stands; an own map, SUMO's traffic.
The generalist looks at the same frames three times: with the height of the local road, with one
height, that under the pole, and with the plane that an import finds in the clouds. `iou_3d`: of
boxes that turn with the vehicle but do not lean, with those that do. Rows of results/hill.csv.
    .venv/bin/python benchmarks/hill.py --work out/hill
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.cli.main import main as command_line
from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.ground import Ground, level_ground
from pyinfra.dataset.runs import infrasim
from pyinfra.exchange.pose_estimation import road_of
from pyinfra.experiments import store
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import judged
from pyinfra.metrics.evaluation_tables import fine_ap, fine_columns
from pyinfra.metrics.match_results import Settings
from pyinfra.models.inference import detect
from pyinfra.models.training.sources import spread
from pyinfra.scenes.maps.sumo import sumo_folder

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests/python"))
GRADES_PERCENT = (0, 3, 6, 12)
LIDARS = ("ruby_plus", "helios_16")
SECONDS, FRAMES = 130, "0:1300:10"
SETTINGS = Settings(ground_truths=("captured",))
SEEDS = (1, 2)  # of the traffic
KEY = ["grade_percent", "seed", "lidar", "height"]
LOOKED_AT = 30  # frames, for the plane
STEP = 7  # every so many boxes
DRAWS = 20_000  # of points in a box, for its overlap


def site_of(percent: int, seed: int, work: Path) -> Path:
    """The folder of a site of the grade, with its traffic."""
    import site_maps

    work.mkdir(parents=True, exist_ok=True)
    site = work / f"hill_{percent}_{seed}"
    words = ["--vehicles-per-hour", "600", "--seconds", str(SECONDS), "--seed", str(seed)]
    commands = [["import", str(site_maps.hill(work, sumo_folder(), percent / 100))]]
    commands[0] += ["--out", str(site)]
    for command in (*commands, ["traffic", str(site), *words]):
        if command_line(["site", *command]):
            raise RuntimeError(f"pyinfra site {command[0]}: failed")
    return site


def frames_of(site: Path, data: Path) -> None:
    words = ["--preset", "datasheet", "--frames", FRAMES, "--out", str(data)]
    infrasim("run", site / "site.yaml", "--lidar", *map(lidar_file, LIDARS), *words)


def rows(folder: Path, work: Path) -> Iterator[dict[str, object]]:
    """AP of the generalist with the local height, that under the sensor alone, and a plane."""
    local, region = detect.place_of(folder)
    assert local is not None
    numbers = frame_numbers(folder, "all")
    files = [kitti.frame_file(folder, "velodyne", k) for k in numbers]
    lean = leaning(folder, numbers)
    plane = plane_of([kitti.read_points(files[i]) for i in spread(range(len(files)), LOOKED_AT)])
    grounds = {"local": local, "one": level_ground(-local.sensor_m), "plane": plane}
    for name, ground in grounds.items():
        network = detect.load_detector(Path("generalist"), ground=ground, region=region)
        detect.detect(network, files, work / name)
        (judgement,) = judged(folder, work / name, SETTINGS, frames=numbers)
        ap = fine_columns(judgement, fine_ap(judgement))
        row = {**ap, "objects": judgement.objects, **lean}
        yield {"height": name, **{key: round(float(value), 3) for key, value in row.items()}}


def plane_of(clouds: Sequence[Points]) -> Ground:
    """The road of clouds as an import finds it. Raises ValueError if there is none."""
    road = road_of(clouds)
    if road is None:
        raise ValueError("found no road in the clouds, allowed one")
    x, y, z = road.normal
    return Ground((-x / z, -y / z, -road.height_m / z))


def leaning(folder: Path, numbers: Sequence[int]) -> dict[str, float]:
    """How much boxes that do not lean share with those that do, of all vehicles in reach."""
    found = [kitti.read_objects(kitti.frame_file(folder, "objects", k)) for k in numbers]
    leaning = [
        (o.boxes[i], o.pitch[i]) for o in found if o.pitch is not None for i in range(len(o))
    ]
    ious = np.array([iou_3d(box[3:6], pitch) for box, pitch in leaning[::STEP]] or [1.0])
    return {"iou_3d": ious.mean(), "share_above_0.7": (ious > 0.7).mean(), "boxes": len(leaning)}


def iou_3d(size: FloatArray, pitch: float) -> float:
    """Of a box and the same one turned about its transverse axis."""
    random = np.random.default_rng(1)
    own = (random.random((DRAWS, 3)) - 0.5) * size
    cos, sin = np.cos(pitch), np.sin(pitch)
    turned = np.stack([cos * own[:, 0] + sin * own[:, 2], cos * own[:, 2] - sin * own[:, 0]])
    shared = (np.abs(turned) <= size[[0, 2], None] / 2).all(0).mean()
    return float(shared / (2 - shared))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of sites and frames")
    parser.add_argument("--out", type=Path, default=ROOT / "results/hill.csv")
    args = parser.parse_args()
    about = {"version": __version__, "machine": machine(), "command": "benchmarks/hill.py"}
    for percent, seed in itertools.product(GRADES_PERCENT, SEEDS):
        key = {"grade_percent": percent, "seed": seed}
        table = store.read(args.out, KEY)
        if all(store.has(table, {**key, "lidar": x, "height": "plane"}) for x in LIDARS):
            continue
        site, data = site_of(percent, seed, args.work), args.work / f"data_{percent}_{seed}"
        frames_of(site, data)
        for lidar in LIDARS:
            for row in rows(data / lidar, args.work / f"found_{percent}_{seed}_{lidar}"):
                found = {**key, "lidar": lidar, **row, **about}
                store.put(args.out, pd.DataFrame([found]), KEY)
                print(found, flush=True)


if __name__ == "__main__":
    main()
