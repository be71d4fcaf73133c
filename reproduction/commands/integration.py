"""Tests whether clouds of several frames give a higher AP than clouds of one frame.

The integration time is the time of the frames that are stacked into one cloud. For each traffic
seed s, speed, LiDAR and integration time, PointPillars is trained from scratch on stacked
frames of traffic seed 1000 + s, and tested on stacked frames of traffic seed s. The age of each
point is an input. The labelled frames are the same for each integration time. Rows are added to the
output as they are made; existing rows are kept, and several processes can share the work.

    python -m reproduction integration --work data/integration --out results/integration.csv
"""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import pandas as pd

from pyinfra.core.files import held
from pyinfra.dataset import split
from pyinfra.dataset.data_set import read_data_set
from pyinfra.experiments import store
from pyinfra.models.training.accumulation import Accumulation
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.commands.experiments import TRAIN_SEEDS_FROM
from reproduction.measures import rows_of_test, train_detector
from reproduction.simulate import simulate

SCENE, PRESET = "highway", "datasheet"
LIDARS = ("livox_avia", "helios_16", "ruby_plus")
SPEEDS_KM_H = (62, 20)  # mean speeds of the vehicles; 62 is that of the scene
STACKS = (Accumulation(1), Accumulation(5, "newest"), Accumulation(5, "middle"))
DETECTOR = "pointpillars"
# Range of the labelled frames, and steps between training frames and between test frames.
FIRST, END, TRAIN_STEP, TEST_STEP = 10, 4990, 11, 47
KEY = ["speed_km_h", "lidar", "accumulate", "label_at", "seed", "subset"]
MEASURES = ["frames", "objects", "ap_r1000", "ap_r1000_near", "ap_r1000_far", "train_cpu_s"]


@dataclass(frozen=True)
class Experiment:
    """One LiDAR and one way to stack frames, at one speed and with one traffic seed."""

    speed_km_h: int
    lidar: str
    accumulate: int
    label_at: str
    seed: int

    @property
    def name(self) -> str:
        return "_".join(map(str, asdict(self).values()))

    def is_done(self, out: Path) -> bool:
        return store.has(store.read(out, ["label_at", "subset"]), asdict(self))


def simulated(speed_km_h: int, seed: int, step: int, work: Path) -> Path:
    """Simulates every labelled frame and its neighbours; returns the data set's folder.

    The labelled frames are training frames in ImageSets.
    """
    folder = work / "data" / f"{speed_km_h}_{seed}"
    labelled = range(FIRST, END, step)
    neighbours = sorted({k - FIRST for stack in STACKS for k in stack.around(FIRST)})
    with held(folder.with_name(f"{folder.name}.lock"), wait=True):
        for k in neighbours:
            simulate(
                SCENE, LIDARS, folder, preset=PRESET, seed=seed, threads=1,
                frames=f"{FIRST + k}:{END + k}:{step}",
                set=[f"traffic.speed.mean_km_h={speed_km_h}"],
            )  # fmt: skip
        split.write(read_data_set(folder), split.Split(tuple(labelled), ()))
    return folder


def fill(experiment: Experiment, stack: Accumulation, work: Path, out: Path) -> None:
    """Adds the rows of one experiment, unless another process is computing them."""

    def run() -> None:
        speed, seed = experiment.speed_km_h, experiment.seed
        train, test = (
            simulated(speed, number, step, work) / experiment.lidar
            for number, step in ((TRAIN_SEEDS_FROM + seed, TRAIN_STEP), (seed, TEST_STEP))
        )
        folder = work / "runs" / experiment.name
        model, seconds = train_detector(DETECTOR, train, folder, seed, accumulation=stack)
        predictions = work / "predictions" / experiment.name
        rows = rows_of_test(model, test, predictions, "train")
        table = pd.DataFrame(rows).assign(**asdict(experiment), train_cpu_s=round(seconds, 1))
        words = f"integration --seeds {seed} --speeds {speed} --lidars {experiment.lidar}"
        store.put(out, table[[*KEY, *MEASURES]].assign(**provenance(words)), KEY)
        print(experiment.name, *table.ap_r1000.round(1), flush=True)

    store.fill(work / "locks" / experiment.name, lambda: experiment.is_done(out), run)


@command
def main(
    *,
    work: Work,
    out: Out = Path("integration.csv"),
    seeds: Sequence[int] = (1, 2, 3),
    speeds: Annotated[Sequence[int], {"metavar": "KM_H"}] = SPEEDS_KM_H,
    lidars: Annotated[Sequence[str], {"choices": LIDARS}] = LIDARS,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 10 GB
    seeds : traffic seeds; a seed also seeds the training (default: 1 2 3)
    """
    experiments = itertools.product(speeds, lidars, STACKS, seeds)
    for speed, lidar, stack, seed in experiments:
        experiment = Experiment(speed, lidar, stack.frames, stack.label_at, seed)
        fill(experiment, stack, work, out)
