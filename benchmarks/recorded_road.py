"""A recording on a crest: AP with the road's shape that its import finds, and with a plane.

Simulated frames go through an import as a stranger's clouds would, without labels and without a
map. The generalist looks at them with what was found of the road, with its plane alone, and with
the map's heights; its boxes are judged by the labels that the import never saw. Rows of
results/recorded_road.csv.
    .venv/bin/python benchmarks/recorded_road.py --work data/recorded_road
"""

from __future__ import annotations

import argparse
import itertools
import shutil
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.ground import Ground, ground_of, level_ground
from pyinfra.dataset.runs import infrasim
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.experiments import store
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import judged
from pyinfra.metrics.evaluation_tables import fine_ap, fine_columns
from pyinfra.metrics.match_results import Settings
from pyinfra.models.inference import detect

ROOT = Path(__file__).resolve().parent.parent
SCENES: dict[str, tuple[str, ...]] = {  # by name: the scene's, and what is set in it
    "crest": ("crest",),
    "crest, pole 40 m down": ("crest", "mounts.pole.x_m=40"),
    "highway": ("highway",),
}
LIDARS = ("ruby_plus", "livox_avia", "helios_16")
SEEDS = (1, 2)
FRAMES = "0:1000:20"
SETTINGS = Settings(ground_truths=("captured",))
KEY = ["scene", "seed", "lidar", "road"]


def simulated(scene: str, seed: int, work: Path) -> Path:
    """The data set's folder."""
    name, *keys = SCENES[scene]
    out = work / f"{name_of(scene)}_{seed}"
    words = ["--preset", "datasheet", "--seed", str(seed), "--frames", FRAMES, "--out", str(out)]
    words += [word for key in keys for word in ("--set", key)]
    infrasim("run", scene_file(name), "--lidar", *map(lidar_file, LIDARS), *words)
    return out


def name_of(scene: str) -> str:
    """Of its files."""
    return scene.replace(", ", "_").replace(" ", "_")


def imported(folder: Path, work: Path) -> Path:
    """The frames of a LiDAR's folder as a recording of which nothing is known."""
    shutil.rmtree(work, ignore_errors=True)
    (work / "clouds").mkdir(parents=True)
    for k in frame_numbers(folder, "all"):
        shutil.copy(kitti.frame_file(folder, "velodyne", k), work / f"clouds/{k:06d}.bin")
    about = LidarFacts("pole", "recorded")
    import_recording(work / "clouds", "bin", work / "in/pole", about, Options())
    return work / "in/pole"


def rows(folder: Path, work: Path) -> Iterator[dict[str, object]]:
    recorded = imported(folder, work)
    found, known = ground_of(recorded), ground_of(folder)
    shaped = int(kitti.read_road_shape(recorded) is not None)
    plane = level_ground(-kitti.read_lidar(recorded).T_world_levelled.z)
    yield {"road": "found", "shaped": shaped, **ap(folder, recorded, found, work / "found")}
    yield {"road": "plane", "shaped": shaped, **ap(folder, recorded, plane, work / "plane")}
    yield {"road": "map", "shaped": shaped, **ap(folder, folder, known, work / "map")}


def ap(truth: Path, clouds: Path, ground: Ground | None, out: Path) -> dict[str, float]:
    """Of the generalist with a ground in the clouds of a folder, by the labels of another."""
    network = detect.load_detector(Path("generalist"), ground=ground)
    numbers = frame_numbers(truth, "all")
    files = [kitti.frame_file(clouds, "velodyne", k) for k in frame_numbers(clouds, "all")]
    boxes, _ = detect.detect(network, files, None)
    out.mkdir()
    for k, own in zip(numbers, boxes, strict=True):
        detect.write(out, kitti.frame_file(truth, "velodyne", k), own)
    (judgement,) = judged(truth, out, SETTINGS, frames=numbers)
    figures = fine_columns(judgement, fine_ap(judgement))
    rounded = {name: round(float(value), 3) for name, value in figures.items()}
    return {**rounded, "objects": judgement.objects}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of frames")
    parser.add_argument("--out", type=Path, default=ROOT / "results/recorded_road.csv")
    args = parser.parse_args()
    about = {"version": __version__, "machine": machine(), "command": "benchmarks/recorded_road.py"}
    for scene, seed in itertools.product(SCENES, SEEDS):
        data = simulated(scene, seed, args.work)
        for lidar in LIDARS:
            key = {"scene": scene, "seed": seed, "lidar": lidar}
            if store.has(store.read(args.out, KEY), {**key, "road": "map"}):
                continue
            for row in rows(data / lidar, args.work / f"{name_of(scene)}_{seed}_{lidar}"):
                store.put(args.out, pd.DataFrame([{**key, **row, **about}]), KEY)
                print(*key.values(), *list(row.values())[:3], flush=True)


if __name__ == "__main__":
    main()
