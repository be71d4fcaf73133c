"""Tests with several traffic seeds under which stress detectors fail.

The scene is the highway with preset `datasheet`. For each seed and LiDAR, Background and the
pretrained detector are trained on the first part of the frames. These two, and the pretrained
detector without further training, are tested on the last part under growing stress. The command
adds the rows of each detector to out/stress_seeds.csv as soon as they are computed. Existing rows
are not computed again, and several processes can share the work.

    python -m reproduction stress --work data/stress
"""

import itertools
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from pyinfra.core.files import held
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.experiments.stress.runner import stress
from pyinfra.formats.csv_table import read_csv
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.measures import train_detector
from reproduction.simulate import simulate

SCENE, PRESET, FRAMES = "highway", "datasheet", "0:5000:11"
TEST_FRAMES = 30
LIDARS = ("ruby_plus", "livox_avia")
TRAINED = {"background": "background", "fine-tuned": "generalist"}  # detector file by setup
SETUPS = (*TRAINED, "pretrained")
# Other LiDARs, scenes and presets are tested by `reproduction unseen`.
STRESSORS = (
    *("drop_out", "rain", "fog", "range_noise", "height_error", "roll_error", "pitch_error"),
    *("yaw_error", "lost_lines", "blocked_sector", "density", "speed", "tilt", "cut_angle"),
    *("phase", "vehicle_class"),
)
KEY = ["lidar", "setup", "seed", "stressor", "severity"]
MEASURES = "unit frames objects ap_r1000 background_per_frame position_error_m".split()


@dataclass(frozen=True)
class Experiment:
    """One detector with one LiDAR and one traffic seed, under all stressors."""

    lidar: str
    setup: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.lidar}_{self.setup}_{self.seed}"

    def is_done(self, out: Path) -> bool:
        return store.has(store.read(out, ["setup"]), asdict(self))


def simulated(seed: int, work: Path) -> Path:
    """Simulates the frames of a traffic seed for all LiDARs; returns the data set's folder."""
    folder = work / "data" / f"{SCENE}_{seed}"
    with held(folder.with_name(f"{folder.name}.lock"), wait=True):
        options = {"preset": PRESET, "seed": seed, "frames": FRAMES, "threads": 1}
        return simulate(SCENE, LIDARS, folder, parts=Parts(), **options)


def model_of(experiment: Experiment, data: Path, work: Path) -> Path:
    """Trains the detector of an experiment on a LiDAR's folder; returns its folder or its name."""
    name = TRAINED.get(experiment.setup)
    if name is None:
        return Path("generalist")
    run = work / "runs" / experiment.name
    train_detector(name, data, run, experiment.seed)
    return run


def fill(experiment: Experiment, work: Path, out: Path) -> None:
    """Adds the rows of one experiment, unless another process is computing them."""

    def run() -> None:
        data = simulated(experiment.seed, work) / experiment.lidar
        model = model_of(experiment, data, work)
        trials = work / "trials" / experiment.name
        seed, frames = experiment.seed, TEST_FRAMES
        stress(model, data, work=trials, stressors=STRESSORS, frames=frames, seed=seed)
        table = read_csv(trials / "stress.csv")
        table = table.assign(
            setup=experiment.setup,
            seed=seed,
            **provenance(f"stress --seeds {seed}"),
        )
        store.put(
            out, table[[*KEY, *MEASURES, "version", "frames_version", "machine", "command"]], KEY
        )
        print(experiment.name, *table.ap_r1000.round(1)[:1], flush=True)
        shutil.rmtree(trials)

    store.fill(work / "locks" / experiment.name, lambda: experiment.is_done(out), run)


@command
def main(
    *,
    work: Work,
    out: Out = Path("stress_seeds.csv"),
    seeds: Sequence[int] = (1, 2, 3),
    setups: Annotated[Sequence[str], {"choices": SETUPS}] = SETUPS,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 2 GB
    seeds : traffic seeds; a seed also seeds the training (default: 1 2 3)
    setups : detectors and their trainings (default: all)
    """
    for seed, setup, lidar in itertools.product(seeds, setups, LIDARS):
        fill(Experiment(lidar, setup, seed), work, out)
