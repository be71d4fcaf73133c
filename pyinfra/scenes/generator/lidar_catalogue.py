"""Random choice of LiDARs and presets from the catalogue, for training on generated sites."""

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
    """Relative frequency of each preset among the presets of a LiDAR. 0 excludes a preset.

    Real sensors are closest to `datasheet`. The study uses the other presets.
    """

    datasheet: float = ruled(0.6, 0, 1)
    equal: float = ruled(0.2, 0, 1)
    paper: float = ruled(0.2, 0, 1)


@dataclass(frozen=True)
class Sensors:
    """LiDAR files, and the relative frequency of each preset."""

    files: tuple[Path, ...]
    presets: Mapping[str, float] = field(default_factory=lambda: asdict(PresetShares()))

    def draw(self, random: np.random.Generator, count: int) -> list[simulation.Lidar]:
        """Returns `count` random LiDARs from different files, without phase lock."""
        chosen = random.permutation(len(self.files))[:count]
        return [self._lidar(self.files[i], random.random()) for i in chosen]

    def _lidar(self, file: Path, u: float) -> simulation.Lidar:
        weights = {name: self.presets.get(name, 0.0) for name in _presets(file)}
        ends = np.cumsum(list(weights.values())) / sum(weights.values())
        name = list(weights)[int(np.searchsorted(ends, u, side="right"))]
        return _loaded(file, name)


def sensors(
    *, without: Collection[str] = (), presets: Mapping[str, float] | None = None
) -> Sensors:
    """Returns the catalogue LiDARs that can be simulated, without the excluded LiDARs.

    `without` contains the names of excluded LiDARs. `presets` maps presets to weights; a weight of
    0 excludes a preset. Raises Error for an unknown name, and if no LiDAR is left.
    """
    files = catalogue_files()
    names = [file.stem for file in files]
    for name in without:
        if name not in names:
            raise Error(f"without: expected names of LiDARs ({', '.join(names)}), got '{name}'")
    weights = presets or Sensors(()).presets
    kept = [file for file in files if file.stem not in without and _can_be_cast(file, weights)]
    if not kept:
        raise Error("without: expected one or more remaining LiDARs with these presets, got none")
    return Sensors(tuple(kept), weights)


def only(names: Collection[str], presets: Mapping[str, float] | None = None) -> Sensors:
    """Returns the catalogue LiDARs with the given names. Raises Error like `sensors`."""
    others = [file.stem for file in catalogue_files() if file.stem not in names]
    unknown = set(names) - {file.stem for file in catalogue_files()}
    return sensors(without=[*others, *sorted(unknown)], presets=presets)


def _can_be_cast(file: Path, presets: Mapping[str, float]) -> bool:
    """Returns whether a LiDAR has any of the presets, and can be loaded with each of them.

    Loading fails, for example, if a table of the LiDAR is missing.
    """
    allowed = [name for name in _presets(file) if presets.get(name, 0) > 0]
    try:
        return bool([_loaded(file, name) for name in allowed])
    except (ValueError, OSError):
        return False


_presets = cache(presets_of)  # cached, because each choice of a LiDAR calls it


@cache
def _loaded(file: Path, preset: str) -> simulation.Lidar:
    return simulation.load_lidar(file, preset).with_free_motors()


def names_of(lidars: Sequence[Path]) -> str:
    return " ".join(sorted(file.stem for file in lidars))
