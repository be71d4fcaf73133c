"""`configs/benchmarks/*.yaml`: which cells a benchmark has."""

from __future__ import annotations

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
from pyinfra.core.vocabulary import Preset, Tier
from pyinfra.dataset import split
from pyinfra.dataset.catalogue import configs
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.experiments.value import Costs
from pyinfra.scenes.maps.site_folder import MAP, SCENE

# Of the 5,000 frames of 500 s.
FRAMES: dict[Tier, str] = {"smoke": "0:5000:20", "quick": "0:5000:5", "full": "0:5000"}
MOST_FRAMES = 360_000  # of a scene: 36,000 s
MOST_CELLS = 100_000  # of a benchmark, of 20 s at least
# Names are folders and words of tables, which a shell or a spreadsheet must not take for more.
NAME = re.compile(r"\w[^/\\,\"\x00-\x1f\x7f]{0,99}")


def name_of(path: Path) -> str:
    """That of the file; of a site that of its folder (sites/corner/site.yaml)."""
    is_site = path.name == SCENE and (path.parent / MAP).exists()
    return path.absolute().parent.name if is_site else path.stem


def config_file(kind: str, benchmark: Path, word: str) -> Path:
    """`ruby_plus` of configs/lidars, or `own.yaml` beside the benchmark's file.

    Raises Error with what is allowed.
    """
    folder = configs() / kind
    path = benchmark.parent / word if word.endswith(".yaml") else folder / f"{word}.yaml"
    if not NAME.fullmatch(name_of(path)):
        raise Error(
            f"found '{word}', allowed a name of up to 100 letters that begins with a letter, a "
            "digit or _"
        )
    if not path.is_file():
        names = ", ".join(sorted(p.stem for p in folder.glob("*.yaml")))
        raise Error(f"found '{word}', allowed a file or {names}")
    return path


def scene_of(word: str) -> Path:
    """A scene that a user names. Raises Error."""
    try:
        return config_file("scenes", Path.cwd() / "plan", word)
    except ValueError as error:
        raise Error(f"scene: {error}") from None


def files_of(kind: str) -> Any:
    return checked(partial(config_file, kind), once=True)


@dataclass(frozen=True)
class Combinations:
    """All combinations of what it lists; names of configs/, or files beside the benchmark's."""

    scenes: tuple[str, ...] = files_of("scenes")  # of configs/scenes
    lidars: tuple[str, ...] = files_of("lidars")  # of configs/lidars
    presets: tuple[Preset, ...] = ruled(once=True)  # of the LiDARs
    detectors: tuple[str, ...] = files_of("detectors")  # of configs/detectors
    seeds: tuple[int, ...] = ruled((1,), 0, 1e9, once=True)  # of the training, not of the world

    @property
    def cells(self) -> int:
        return math.prod(len(values) for values in vars(self).values())


@dataclass(frozen=True)
class Parts:
    """What is learnt from and what is tested on."""

    train_until_s: float = ruled(split.TRAIN_UNTIL_S, 0, 1e6)  # frames that start before it train
    val_from_s: float = ruled(split.VAL_FROM_S, 0, 1e6)  # and from here on they test


@dataclass(frozen=True)
class Benchmark:
    """A union of blocks, in their order."""

    matrix: tuple[Combinations, ...]  # combinations to measure
    frames: str = ""  # A:B[:STEP] in place of the tier's
    split: Parts = field(default_factory=Parts)
    costs: Costs = field(default_factory=Costs)

    def __post_init__(self) -> None:
        cells = sum(block.cells for block in self.matrix)
        if not 1 <= cells <= MOST_CELLS:
            raise Error(f"matrix: found {cells or 'no'} cells, allowed 1 to {MOST_CELLS}")


@dataclass(frozen=True)
class Cell:
    """One row of the results; its fields are the row's key."""

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
        return " ".join(str(value) for value in asdict(self).values())

    @property
    def world(self) -> str:
        """The data set it needs."""
        return f"{self.scene}_{self.preset}"


@dataclass(frozen=True)
class Plan:
    """The cells of a benchmark on one tier, and the files their names stand for."""

    cells: tuple[Cell, ...]
    frames: str
    files: dict[tuple[str, str], Path]  # by kind and name
    costs: Costs
    parts: Parts

    def worlds(self) -> dict[str, list[Cell]]:
        """The cells by the data set they need."""
        groups: dict[str, list[Cell]] = {}
        for cell in self.cells:
            groups.setdefault(cell.world, []).append(cell)
        return groups


def read_plan(file: Path, tier: Tier, scene: str = "") -> Plan:
    """The cells of a file; scene: a file or a name in place of all of its scenes.

    Raises ConfigError with file, key, what was found and what is allowed, and Error for the
    scene.
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
                    f"{file}: {kind}: found '{name}' of two files, {path} and "
                    f"{files[kind, name]}, allowed one of a name"
                )
        return [name_of(path) for path in paths]

    def cells() -> Iterator[Cell]:
        for block in benchmark.matrix:
            # Detectors before LiDARs: the first rows say most.
            for scene, preset, detector, lidar, seed in itertools.product(
                known("scenes", block.scenes),
                block.presets,
                known("detectors", block.detectors),
                known("lidars", block.lidars),
                block.seeds,
            ):
                yield Cell(scene, lidar, preset, detector, tier, seed)

    unique_cells = tuple(dict.fromkeys(cells()))
    frames = benchmark.frames or FRAMES[tier]
    check_parts(file, frames, benchmark.split)
    return Plan(unique_cells, frames, files, benchmark.costs, benchmark.split)


def check_parts(file: Path, frames: str, parts: Parts) -> None:
    """Raises ConfigError if there is nothing to learn from, or nothing to test on."""
    try:
        split.by_time(range_of(frames), PERIOD_S, parts.train_until_s, parts.val_from_s)
    except ValueError as error:
        raise ConfigError(f"{file}: frames, split: {error}") from None


def range_of(frames: str) -> range:
    """A:B[:STEP]. Raises ConfigError if it is no range."""
    match = re.fullmatch(r"([0-9]{1,9}):([0-9]{1,9})(?::([0-9]{1,9}))?", frames)
    if match is None:
        raise ConfigError(f"frames: found '{frames}', allowed A:B[:STEP]")
    first, end, step = (int(word or 1) for word in match.groups())
    numbers = range(first, end, step) if step else range(0)
    if not numbers or end > MOST_FRAMES:
        raise ConfigError(
            f"frames: found '{frames}', allowed a range with frames, up to {MOST_FRAMES}"
        )
    return numbers
