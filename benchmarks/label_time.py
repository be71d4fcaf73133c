"""What a motor's phase does to AP when labels hold at mid-frame, and at the time of the scan.

A detector learns in one world, with the seam where the LiDAR's file has it. In another world of the
same scene it is tested so, with the LiDAR turned on its mount, with other seams, and with the
phases of four power-ups. AP has 1,000 recalls; differences from the LiDAR as learnt are paired,
draw by draw of the same blocks of time. Rows go to results/label_time.csv as they come, and what is
there is not computed again:
    .venv/bin/python benchmarks/label_time.py --work data/label_time
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd
import yaml

from pyinfra.core.files import replacing
from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments.benchmark.frames import split_by_time
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.experiments.stress import altered_scenes
from pyinfra.experiments.stress import lidar as stressed
from pyinfra.formats import kitti
from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.evaluate import judged
from pyinfra.metrics.evaluation_tables import fine_ap
from pyinfra.metrics.ground_truth import Set
from pyinfra.metrics.match_results import Settings
from pyinfra.models.detectors import Detector
from pyinfra.models.inference import detect
from pyinfra.models.training.recipe import read_recipe
from pyinfra.models.training.sources import read_source
from pyinfra.models.training.train import train

ROOT = Path(__file__).resolve().parent.parent
LEARNT_FRAMES, TEST_FRAMES = "0:5000:5", "0:5000:20"
GROUND_TRUTHS: tuple[Set, ...] = ("captured", "all")
SETTINGS = Settings(draws=1000, ground_truths=GROUND_TRUTHS)


@dataclass(frozen=True)
class Motor:
    """How the LiDAR stands, and where its turns begin."""

    dial: str
    value: float
    yaw_deg: float = 0  # of the unit on its mount
    seam_deg: float = 0  # further left than in its file

    @property
    def name(self) -> str:
        return f"{self.dial}_{self.value:g}"


AS_LEARNT = Motor("none", 0)


def motors() -> list[Motor]:
    turned = [Motor("turn", deg, yaw_deg=deg) for deg in (90, 180, 270)]
    seams = [Motor("seam", deg, seam_deg=deg) for deg in range(45, 360, 45)]
    drawn = [altered_scenes.angles_deg(i)[0] for i in range(1, 5)]
    return [*turned, *seams, *(Motor("phase", deg, seam_deg=deg) for deg in drawn)]


@dataclass(frozen=True)
class Trial:
    """One detector that learns once."""

    scene: str
    lidar: str
    preset: str
    label_time: str
    detector: str
    trained_seed: int

    @property
    def frames(self) -> str:
        return f"{self.scene}_{self.lidar}_{self.preset}_{self.label_time}"


def learnt_from(trial: Trial, work: Path) -> Path:
    """The LiDAR's folder of the world that is learnt from, simulated."""
    out = work / trial.frames / "learnt"
    _run(trial, lidar_file(trial.lidar), LEARNT_FRAMES, 1, out)
    split_by_time(out, Parts())
    return out / trial.lidar


def tested_on(trial: Trial, motor: Motor, learnt: Path, work: Path) -> Path:
    """The LiDAR's folder of the other world, simulated."""
    out = work / trial.frames / motor.name
    file = work / trial.frames / f"{motor.name}.yaml"
    file.write_text(turned(learnt / stressed.FILE, motor), "utf-8")
    _run(trial, file, TEST_FRAMES, 2, out)
    return out / trial.lidar


def _run(trial: Trial, lidar: Path, frames: str, seed: int, out: Path) -> None:
    words = ["--preset", trial.preset, "--label-time", trial.label_time, "--frames", frames]
    words += ["--seed", str(seed), "--out", str(out)]
    infrasim("run", scene_file(trial.scene), "--lidar", lidar, *words)


def turned(file: Path, motor: Motor) -> str:
    """The LiDAR of a `lidar.yaml`, on its mount as the motor says."""
    keys = yaml.safe_load(stressed.text(file, (motor.seam_deg,)))
    for unit in keys["bundle"]:
        unit["yaw_deg"] += motor.yaw_deg
    return str(yaml.safe_dump(keys, sort_keys=False))


def trained(trial: Trial, learnt: Path, run: Path) -> Detector:
    recipe = read_recipe(ROOT / f"configs/detectors/{trial.detector}.yaml", "quick")
    train(recipe, [read_source(learnt, "quick")], run, seed=trial.trained_seed, quiet=True)
    return detect.load_detector(run)


def average_precisions(folder: Path, pred: Path) -> dict[Set, Bootstrapped]:
    """Fine AP by ground truth."""
    found = judged(folder, pred, SETTINGS, split="all")
    return dict(zip(GROUND_TRUTHS, map(fine_ap, found), strict=True))


def rows(trial: Trial, work: Path) -> Iterator[dict[str, object]]:
    """Of every motor and ground truth."""
    learnt = learnt_from(trial, work)
    run = work / trial.frames / f"{trial.detector}_{trial.trained_seed}"
    detector: Detector | None = None
    base: dict[Set, Bootstrapped] = {}
    for motor in [AS_LEARNT, *motors()]:
        folder = tested_on(trial, motor, learnt, work)
        files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder, "all")]
        if len(list((run / motor.name).glob("*.txt"))) < len(files):
            detector = detector or trained(trial, learnt, run)
            detect.detect(detector, files, run / motor.name)
        found = average_precisions(folder, run / motor.name)
        base = base or found
        for which in GROUND_TRUTHS:
            yield {
                **asdict(trial),
                "dial": motor.dial,
                "value": motor.value,
                "ground_truth": which,
                **figures("ap", found[which]),
                **figures("change", found[which].less(base[which])),
            }


def figures(name: str, one: Bootstrapped) -> dict[str, float]:
    found = one.measured()
    ends = {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}
    return {key: round(value, 3) for key, value in ends.items()}


def write(table: pd.DataFrame, out: Path) -> None:
    with replacing(out) as beside:
        table.to_csv(beside, index=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of frames; about 25 GB")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "label_time.csv")
    parser.add_argument("--scenes", nargs="+", default=["highway", "curve"])
    parser.add_argument("--lidars", nargs="+", default=["ruby_plus"])
    parser.add_argument("--presets", nargs="+", default=["datasheet"])
    parser.add_argument("--detectors", nargs="+", default=["background", "pointpillars"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1], help="of the trainings")
    args = parser.parse_args()
    table = pd.read_csv(args.out) if args.out.is_file() else pd.DataFrame()
    about = {"command": "benchmarks/label_time.py", "seed": 2}
    about |= {"version": __version__, "machine": machine()}
    times = ("frame", "scan")
    parts = (args.seeds, args.detectors, args.scenes, args.lidars, args.presets, times)
    for seed, detector, scene, lidar, preset, label_time in itertools.product(*parts):
        if detector == "background" and seed != args.seeds[0]:
            continue
        trial = Trial(scene, lidar, preset, label_time, detector, seed)
        key = asdict(trial)
        if len(table) and (table[list(key)] == pd.Series(key)).all(axis=1).any():
            continue
        found = pd.DataFrame(rows(trial, args.work)).assign(**about)
        table = pd.concat([table, found], ignore_index=True)
        write(table, args.out)
        print(found.drop(columns=[*key, *about]).to_string(index=False), flush=True)


if __name__ == "__main__":
    main()
