"""The LiDARs that streams are cast with: those that come with the package, under every preset."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from pyinfra.core.config import ruled
from pyinfra.core.errors import Error
from pyinfra.dataset import simulation
from pyinfra.dataset.lidars import catalogue_files, presets_of


@dataclass(frozen=True)
class PresetShares:
    """How often each preset is drawn, of those that a LiDAR has; 0: never.

    Real sensors are as `datasheet`; the study's figures are of the others.
    """

    datasheet: float = ruled(0.6, 0, 1)
    equal: float = ruled(0.2, 0, 1)
    paper: float = ruled(0.2, 0, 1)


@dataclass(frozen=True)
class Sensors:
    """LiDAR files, and how often each preset is drawn."""

    files: tuple[Path, ...]
    presets: Mapping[str, float] = field(default_factory=lambda: asdict(PresetShares()))

    def draw(self, random: np.random.Generator, count: int) -> list[simulation.Lidar]:
        """So many LiDARs, no file twice; motors start anywhere."""
        chosen = random.permutation(len(self.files))[:count]
        return [self._lidar(self.files[i], random.random()) for i in chosen]

    def _lidar(self, file: Path, u: float) -> simulation.Lidar:
        there = {name: self.presets.get(name, 0.0) for name in _presets(file)}
        ends = np.cumsum(list(there.values())) / sum(there.values())
        name = list(there)[int(np.searchsorted(ends, u, side="right"))]
        return _loaded(file, name)


def sensors(
    *, without: Collection[str] = (), presets: Mapping[str, float] | None = None
) -> Sensors:
    """Those of the catalogue that can be cast, but for some names, and only some presets.

    Raises Error for a name that is none, and if none is left.
    """
    files = catalogue_files()
    names = [file.stem for file in files]
    for name in without:
        if name not in names:
            raise Error(f"without: found '{name}', allowed {', '.join(names)}")
    weights = presets or Sensors(()).presets
    kept = [file for file in files if file.stem not in without and _can_be_cast(file, weights)]
    if not kept:
        raise Error("without: found no LiDAR left, allowed one or more")
    return Sensors(tuple(kept), weights)


def only(names: Collection[str], presets: Mapping[str, float] | None = None) -> Sensors:
    """Those of the catalogue with these names. Raises Error as `sensors` does."""
    others = [file.stem for file in catalogue_files() if file.stem not in names]
    unknown = set(names) - {file.stem for file in catalogue_files()}
    return sensors(without=[*others, *sorted(unknown)], presets=presets)


def _can_be_cast(file: Path, presets: Mapping[str, float]) -> bool:
    """False without a preset of those, and of a table that is not beside the file."""
    there = [name for name in _presets(file) if presets.get(name, 0) > 0]
    try:
        return bool([_loaded(file, name) for name in there])
    except (ValueError, OSError):
        return False


_presets = cache(presets_of)  # streams ask for each frame


@cache
def _loaded(file: Path, preset: str) -> simulation.Lidar:
    return simulation.load_lidar(file, preset).with_free_motors()


def names_of(lidars: Sequence[Path]) -> str:
    return " ".join(sorted(file.stem for file in lidars))
