"""Reads `configs/benchmarks/*.yaml`, the experiments of a benchmark."""

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from pyinfra.core.config import checked, read_config, ruled
from pyinfra.core.errors import ConfigError, Error
from pyinfra.core.names import suggestion
from pyinfra.core.vocabulary import Preset, Tier
from pyinfra.dataset import split
from pyinfra.dataset.catalogue import configs, shipped
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.experiments.result_tables import DETECTOR_WORDS
from pyinfra.experiments.value import Costs
from pyinfra.scenes.maps.site_folder import MAP, SCENE

# Frames that are simulated in each tier, out of the 5,000 frames of 500 s.
FRAMES: dict[Tier, str] = {"smoke": "0:5000:20", "quick": "0:5000:5", "full": "0:5000"}
MOST_FRAMES = 360_000  # maximum number of frames of a scene; at 10 Hz they last 36,000 s
MOST_EXPERIMENTS = 100_000  # maximum number of experiments of a benchmark; each takes 20 s or more
# Names are used for folders and in tables, so they must be safe in a shell and in a spreadsheet.
NAME = re.compile(r"\w[^/\\,\"\x00-\x1f\x7f]{0,99}")


def name_of(path: Path) -> str:
    """Returns the name of a scene's or LiDAR's file without its suffix.

    For a site it is the name of the folder, such as `corner` for sites/corner/site.yaml.
    """
    is_site = path.name == SCENE and (path.parent / MAP).exists()
    return path.absolute().parent.name if is_site else path.stem


def config_file(kind: str, benchmark: Path, word: str) -> Path:
    """Returns the file that a benchmark names: `ruby_plus` in configs/, or a path `own.yaml`.

    A word that ends in .yaml is a path relative to the benchmark's file. Raises Error if the file
    or the name does not exist; the message suggests similar names.
    """
    is_path = word.endswith(".yaml")
    path = benchmark.parent / word if is_path else configs() / kind / f"{word}.yaml"
    if not NAME.fullmatch(name_of(path)):
        raise Error(
            "expected a name of up to 100 letters that begins with a letter, a digit or _, got "
            f"'{word}'"
        )
    if not path.is_file():
        near = suggestion(word, shipped(kind))
        raise Error(f"expected a .yaml file or one of the package's {kind}, got '{word}'{near}")
    return path


def scene_of(word: str) -> Path:
    """Returns the file of a scene, given its name or a path. Raises Error if there is no file."""
    try:
        return config_file("scenes", Path.cwd() / "plan", word)
    except ValueError as error:
        raise Error(f"scene: {error}") from None


def files_of(kind: str) -> Any:
    return checked(partial(config_file, kind), once=True)


@dataclass(frozen=True)
class Combinations:
    """All combinations of the listed values.

    A scene, LiDAR or detector is a name in configs/, or a file relative to the benchmark's file.
    """

    scenes: tuple[str, ...] = files_of("scenes")  # names in configs/scenes, or paths of files
    lidars: tuple[str, ...] = files_of("lidars")  # names in configs/lidars, or paths of files
    presets: tuple[Preset, ...] = ruled(once=True)  # presets of the LiDARs
    detectors: tuple[str, ...] = files_of("detectors")  # names in configs/detectors, or paths
    seeds: tuple[int, ...] = ruled((1,), 0, 1e9, once=True)  # seeds of training, not of traffic

    @property
    def experiments(self) -> int:
        return math.prod(len(values) for values in vars(self).values())


@dataclass(frozen=True)
class Parts:
    """How frames are divided into training and test frames."""

    # frames that start before this time are training frames
    train_until_s: float = ruled(split.TRAIN_UNTIL_S, 0, 1e6)
    # frames that start at this time or later are test frames
    val_from_s: float = ruled(split.VAL_FROM_S, 0, 1e6)


@dataclass(frozen=True)
class Benchmark:
    """A benchmark. The experiments are all combinations of each element of `matrix`, in order."""

    matrix: tuple[Combinations, ...]  # combinations to measure
    frames: str = ""  # frame numbers A:B[:STEP], B excluded; default: the frames of the tier
    split: Parts = field(default_factory=Parts)
    costs: Costs = field(default_factory=Costs)

    def __post_init__(self) -> None:
        experiments = sum(block.experiments for block in self.matrix)
        if not 1 <= experiments <= MOST_EXPERIMENTS:
            raise Error(
                f"matrix: expected 1 to {MOST_EXPERIMENTS} experiments, got {experiments or 'none'}"
            )


@dataclass(frozen=True)
class Experiment:
    """An experiment, which becomes one row of the results. Its fields are the key of the row."""

    scene: str
    lidar: str
    preset: str
    detector: str
    tier: Tier
    seed: int

    @property
    def name(self) -> str:
        return "_".join(str(value) for value in asdict(self).values())

    @property
    def title(self) -> str:
        """The fields in words, for messages."""
        values = asdict(self) | {"detector": DETECTOR_WORDS.get(self.detector, self.detector)}
        return " ".join(map(str, values.values()))

    @property
    def data_set(self) -> str:
        """The name of the data set that the experiment needs."""
        return f"{self.scene}_{self.preset}"


@dataclass(frozen=True)
class Plan:
    """The experiments of a benchmark in one tier, and the files that they name."""

    experiments: tuple[Experiment, ...]
    frames: str
    files: dict[tuple[str, str], Path]  # files by kind and name
    costs: Costs
    parts: Parts
    traffic_offset: int = 0  # number added to the traffic seed of each scene

    def data_sets(self) -> dict[str, list[Experiment]]:
        """Returns the experiments, grouped by the data set that they need."""
        groups: dict[str, list[Experiment]] = {}
        for experiment in self.experiments:
            groups.setdefault(experiment.data_set, []).append(experiment)
        return groups


def read_plan(file: Path, tier: Tier, scene: str = "") -> Plan:
    """Reads the experiments of a benchmark's file.

    scene: file or name of a scene that replaces the scenes of the file. Raises ConfigError, which
    names the file and the key, and Error if the scene does not exist.
    """
    benchmark = read_config(file, Benchmark)
    files: dict[tuple[str, str], Path] = {}

    def known(kind: str, words: tuple[str, ...]) -> list[str]:
        is_scene = scene and kind == "scenes"
        paths = [scene_of(scene)] if is_scene else [config_file(kind, file, word) for word in words]
        for path in paths:
            name = name_of(path)
            if files.setdefault((kind, name), path) != path:
                raise ConfigError(
                    f"{file}: {kind}: expected one file for each name, got two files with "
                    f"the name '{name}': {path} and {files[kind, name]}"
                )
        return [name_of(path) for path in paths]

    def experiments() -> Iterator[Experiment]:
        for block in benchmark.matrix:
            # LiDARs vary faster than detectors, so that the first rows compare LiDARs.
            for scene, preset, detector, lidar, seed in itertools.product(
                known("scenes", block.scenes),
                block.presets,
                known("detectors", block.detectors),
                known("lidars", block.lidars),
                block.seeds,
            ):
                yield Experiment(scene, lidar, preset, detector, tier, seed)

    unique_experiments = tuple(dict.fromkeys(experiments()))
    by_name: dict[str, Experiment] = {}
    for experiment in unique_experiments:
        if (other := by_name.setdefault(experiment.name, experiment)) is not experiment:
            raise ConfigError(
                f"{file}: matrix: expected a different folder for each experiment, got "
                f"{experiment.name} for '{other.title}' and '{experiment.title}'; rename a scene "
                "or a LiDAR"
            )
    frames = benchmark.frames or FRAMES[tier]
    for period_s in {_period_s(files["lidars", e.lidar], e.preset) for e in unique_experiments}:
        check_parts(file, frames, benchmark.split, period_s)
    return Plan(unique_experiments, frames, files, benchmark.costs, benchmark.split)


def _period_s(lidar: Path, preset: str) -> float:
    """Returns the frame period of a LiDAR, or PERIOD_S if the LiDAR's file has errors.

    The simulation reports the errors.
    """
    try:
        from pyinfra.dataset import simulation

        return simulation.load_lidar(lidar, preset).period_s
    except (ImportError, Error):
        return PERIOD_S


def check_parts(file: Path, frames: str, parts: Parts, period_s: float = PERIOD_S) -> None:
    """Raises ConfigError if the split leaves no frame for training, or no frame for testing."""
    ends, where = (parts.train_until_s, parts.val_from_s), f"{file}: frames, split"
    try:
        split.by_time(range_of(frames), period_s, *ends, where=where)
    except Error as error:
        raise ConfigError(str(error)) from None


def range_of(frames: str) -> range:
    """Returns the frame numbers of the text A:B[:STEP]. Raises ConfigError for any other text."""
    match = re.fullmatch(r"([0-9]{1,9}):([0-9]{1,9})(?::([0-9]{1,9}))?", frames)
    if match is None:
        raise ConfigError(f"frames: expected A:B[:STEP], got '{frames}'")
    first, end, step = (int(word or 1) for word in match.groups())
    numbers = range(first, end, step) if step else range(0)
    if not numbers or end > MOST_FRAMES:
        raise ConfigError(
            f"frames: expected A:B[:STEP] with A below B, STEP above 0 and B up to {MOST_FRAMES}, "
            f"got '{frames}'"
        )
    return numbers
