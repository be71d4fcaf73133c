"""Measures detectors with each LiDAR, in replicates with separate training and test traffic.

Replicate r trains a detector for each LiDAR on frames of traffic seed 1000 + r, with training seed
r. It tests the detector on all frames of traffic seeds 2 r - 1 and 2 r. Intervals over replicates
therefore include the variation of traffic, noise and training. docs/verdict_rules.md defines the
rules of the study.

With --cut-angles, the same trained detector is also tested on frames of spinning LiDARs whose cut
angle is turned left by each given angle (degrees). With --training-cut-angles, it is trained on
such frames; by default it is trained at the LiDAR's own cut angle.

With --law-exponents, training and test frames use this exponent of the range law: the range is
proportional to this power of the reflectance. The catalogue has 0.25 for LiDARs of which only one
range is published, and 0.5 is the largest exponent that was fitted to published ranges.

Rows are added to the output as they are made; existing rows are kept. Several processes can share
the work.

    python -m reproduction experiments --work data/experiments --out results/experiments.csv
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import pandas as pd

from pyinfra.core.files import held, write
from pyinfra.core.vocabulary import SUBSETS, LabelTime, Preset, Tier
from pyinfra.dataset import split
from pyinfra.dataset.data_set import read_data_set
from pyinfra.experiments import store
from pyinfra.experiments.stress import lidar as lidar_keys
from reproduction import provenance, shared_frames
from reproduction.arguments import Out, Work, command
from reproduction.measures import rows_of_test, train_detector
from reproduction.simulate import simulate

# The steps 11 and 47 share no factor with 200, the number of frames after which the Avia's pattern
# repeats.
TRAIN_FRAMES, TEST_FRAMES = "0:5000:11", "0:5000:47"
TRAIN_SEEDS_FROM = 1000
TESTS = 2  # number of test seeds of a replicate
LAW_EXPONENTS = (0.25, 0.5)  # minimum and maximum exponent of the range law; the catalogue has 0.25
SPINNING = ("ruby_plus", "pandar_64", "helios_16")
LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
BUNDLES = {"crossroad": "bundle_5_livox_avia"}  # the LiDAR that replaces the single Avia in a scene


@dataclass(frozen=True)
class DetectorSetup:
    """A detector and its training."""

    training: str  # value of the column `training`
    detector: str  # name of a file in configs/detectors
    tier: Tier | None  # None for the pretrained detector without training
    budget: float = 1.0  # multiple of the tier's training steps


SETUPS = {
    "fine-tuned": DetectorSetup("fine-tuned", "generalist", "quick"),
    "background": DetectorSetup("background", "background", "quick"),
    "pretrained": DetectorSetup("pretrained", "generalist", None),
    **{
        name: DetectorSetup("from scratch", name, "quick", 2.0)
        for name in (
            "pointpillars",
            "centerpoint-pillar",
            "pv-rcnn",
            "dsvt",
            "pointrcnn",
            "pointrcnn-remedied",
        )
    },
}
MAIN = ("fine-tuned", "background", "pretrained")
KEY = (
    "scene preset lidar detector training replicate seed subset label_time training_cut_angle_deg "
    "cut_angle_deg law_exponent"
).split()
TEXT = ["training", "label_time", "subset"]  # columns of the key that hold text in each row


@dataclass(frozen=True)
class Replicate:
    """The traffic of one replicate in one scene, preset and label time, for all LiDARs."""

    scene: str
    preset: Preset
    label_time: LabelTime
    replicate: int
    law_exponent: float = LAW_EXPONENTS[0]

    @property
    def name(self) -> str:
        name = f"{self.scene}_{self.preset}_{self.label_time}_{self.replicate}"
        return name if self.at_catalogue_law else f"law_{self.law_exponent}_{name}"

    @property
    def at_catalogue_law(self) -> bool:
        return self.law_exponent == LAW_EXPONENTS[0]

    @property
    def test_seeds(self) -> list[int]:
        return [TESTS * (self.replicate - 1) + i for i in range(1, TESTS + 1)]

    @property
    def lidars(self) -> list[str]:
        return self.named(LIDARS)

    def named(self, lidars: Sequence[str]) -> list[str]:
        """Returns `lidars`, in which the scene's bundle of Avias, if any, replaces the Avia."""
        bundle = BUNDLES.get(self.scene)
        return [bundle if bundle and name == "livox_avia" else name for name in lidars]


def simulated(
    replicate: Replicate, seed: int, frames: str, work: Path, cut_angle_deg: int = 0
) -> Path:
    """Simulates frames of one traffic seed for all LiDARs; returns the data set's folder.

    cut_angle_deg: angle by which the cut angles of spinning LiDARs are turned left. LiDARs that do
    not spin are left out if it is not 0.
    """
    folder = work / "data" / f"{replicate.name}_{seed}"
    lidars: Sequence[str | Path] = replicate.lidars
    if cut_angle_deg:
        unturned = [simulated(replicate, seed, frames, work) / name for name in replicate.lidars]
        folder = folder.with_name(f"{folder.name}_cut_{cut_angle_deg}")
        lidars = turned(unturned, cut_angle_deg, folder.with_name(f"{folder.name}_lidars"))
    exponent = None if replicate.at_catalogue_law else replicate.law_exponent
    with held(folder.with_name(f"{folder.name}.lock"), wait=True):
        return simulate(
            replicate.scene, lidars, folder, preset=replicate.preset, seed=seed, frames=frames,
            label_time=replicate.label_time, threads=1, law_exponent=exponent,
        )  # fmt: skip


def turned(lidars: Sequence[Path], degrees: int, folder: Path) -> list[Path]:
    """Writes a LiDAR file with a shifted cut angle for each spinning LiDAR; returns the paths.

    lidars: the folders of the LiDARs in a data set
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for lidar in lidars:
        if lidar_keys.spins(lidar_keys.read(lidar / lidar_keys.FILE)):
            file = folder / f"{lidar.name}.yaml"
            write(file, lidar_keys.text(lidar / lidar_keys.FILE, [degrees]))
            files.append(file)
    return files


def model_of(trained: Trained, work: Path) -> tuple[Path, float]:
    """Returns the model of a trained detector, and the CPU seconds of its training."""
    using, replicate, lidar = SETUPS[trained.setup], trained.replicate, trained.lidar
    if using.tier is None:
        return Path(using.detector), 0.0
    run = work / "runs" / trained.name
    angle, seed = trained.training_cut_angle_deg, TRAIN_SEEDS_FROM + replicate.replicate
    data = simulated(replicate, seed, TRAIN_FRAMES, work, angle)
    test = simulated(replicate, replicate.test_seeds[0], TEST_FRAMES, work, angle)
    split.write(read_data_set(data), split.by_seed(read_data_set(data), read_data_set(test))[0])
    how = (replicate.replicate, using.tier, using.budget)
    return run, train_detector(using.detector, data / lidar, run, *how)[1]


def at_own_cut_angle(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows of a table of experiments in which no cut angle is turned."""
    return table[(table.cut_angle_deg == 0) & (table.training_cut_angle_deg == 0)]


def at_catalogue_law(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows of a table of experiments or claims with the catalogue's range law."""
    return table[table.law_exponent == LAW_EXPONENTS[0]]


@dataclass(frozen=True)
class Trained:
    """One detector, trained for one LiDAR in one replicate, and the cut angles of its tests."""

    setup: str
    replicate: Replicate
    lidar: str
    cut_angles_deg: tuple[int, ...] = (0,)
    training_cut_angle_deg: int = 0

    @property
    def name(self) -> str:
        angle = self.training_cut_angle_deg
        return f"{self.replicate.name}_{self.lidar}_{self.setup}" + f"_cut_{angle}" * bool(angle)

    @property
    def key(self) -> dict[str, object]:
        """The columns of the table that all tests of this detector share."""
        using = SETUPS[self.setup]
        return {
            **asdict(self.replicate),
            "lidar": self.lidar,
            "detector": using.detector,
            "training": using.training,
            "training_cut_angle_deg": self.training_cut_angle_deg,
        }

    @property
    def tests(self) -> list[tuple[int, int]]:
        """Test seed and cut angle of each test."""
        angles = self.cut_angles_deg if self.lidar in SPINNING else (0,)
        return list(itertools.product(self.replicate.test_seeds, angles))

    def is_done(self, out: Path) -> bool:
        """Returns whether the table `out` has all rows of the tests."""
        wanted = [
            {**self.key, "seed": seed, "cut_angle_deg": angle, "subset": subset}
            for (seed, angle), subset in itertools.product(self.tests, SUBSETS)
        ]
        return all(store.has_each(store.read(out, KEY), wanted))


def fill(trained: Trained, work: Path, out: Path) -> None:
    """Adds the rows of one trained detector, unless another process is computing them."""
    replicate = trained.replicate

    def run() -> None:
        model, seconds = model_of(trained, work)
        rows: list[dict[str, object]] = []
        for seed, angle in trained.tests:
            data = simulated(replicate, seed, TEST_FRAMES, work, angle)
            predictions = work / "predictions" / f"{trained.name}_{seed}_{angle}"
            tested = rows_of_test(model, data / trained.lidar, predictions)
            rows += [{**trained.key, "seed": seed, "cut_angle_deg": angle, **row} for row in tested]
        words = f"experiments --scenes {replicate.scene} --presets {replicate.preset}"
        words += f" --setups {trained.setup} --label-times {replicate.label_time}"
        words += f" --replicates {replicate.replicate}"
        if trained.cut_angles_deg != (0,):
            words += f" --cut-angles {' '.join(map(str, trained.cut_angles_deg))}"
        if trained.training_cut_angle_deg:
            words += f" --training-cut-angles {trained.training_cut_angle_deg}"
        if not replicate.at_catalogue_law:
            words += f" --law-exponents {replicate.law_exponent}"
        columns = {"train_cpu_s": round(seconds, 1), **provenance(words)}
        table = pd.DataFrame(rows).assign(**columns)
        store.put(out, table[[*KEY, *(name for name in table if name not in KEY)]], KEY)
        first = table[table.subset == "captured"].ap_r1000
        print(trained.name, *first.round(1), flush=True)

    with shared_frames.in_use(work, replicate.name):
        store.fill(work / "locks" / trained.name, lambda: trained.is_done(out), run)


@command
def main(
    *,
    work: Work,
    out: Out = Path("experiments.csv"),
    scenes: Sequence[str] = ("highway", "crossroad", "curve"),
    presets: Sequence[Preset] = ("paper", "datasheet"),
    setups: Annotated[Sequence[str], {"choices": SETUPS}] = MAIN,
    label_times: Sequence[LabelTime] = ("scan",),
    cut_angles: Annotated[Sequence[int], {"metavar": "DEGREES"}] = (0,),
    training_cut_angles: Annotated[Sequence[int], {"metavar": "DEGREES"}] = (0,),
    law_exponents: Annotated[Sequence[float], {"choices": LAW_EXPONENTS}] = (LAW_EXPONENTS[0],),
    lidars: Annotated[Sequence[str], {"choices": LIDARS}] = LIDARS,
    replicates: int = 3,
    only: Annotated[Sequence[int] | None, {"metavar": "N"}] = None,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 3 GB
    cut_angles : angles by which the cut angles of spinning LiDARs are turned left in the tests
    training_cut_angles : as --cut-angles, for the training frames
    law_exponents : exponents of the range law, for LiDARs of which only one range is published
        (default: that of the catalogue)
    lidars : LiDARs to measure; the frames always have all of them
    replicates : number of replicates (default: %(default)s)
    only : numbers of the replicates to measure (default: 1 to --replicates)
    """
    numbers = only or range(1, replicates + 1)
    for scene, label_time, number, preset, exponent in itertools.product(
        scenes, label_times, numbers, presets, law_exponents
    ):
        replicate = Replicate(scene, preset, label_time, number, exponent)
        detectors = [
            Trained(setup, replicate, lidar, tuple(cut_angles), angle)
            for lidar, setup, angle in itertools.product(
                replicate.named(lidars), setups, training_cut_angles
            )
            if lidar in SPINNING or angle == 0
        ]
        for trained in detectors:
            fill(trained, work, out)
        if not all(trained.is_done(out) for trained in detectors):
            continue  # another process still uses the frames
        made = (work / "data").glob(f"{replicate.name}_*")
        shared_frames.remove(work, replicate.name, made)
