"""`configs/detectors/*.yaml`: which detector, how wide, and how it learns, for each tier."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from pyinfra.core.config import Part, checked, read_config, ruled
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import TIERS, ObjectClass, Tier
from pyinfra.models.detectors.catalogue import DETECTORS
from pyinfra.models.detectors.classes import classes_of
from pyinfra.models.inference.detect import model_file, shipped
from pyinfra.models.training.samples import Augmentation

# Of the layers; in which cell a point lies, searches, losses and boxes always have 32 bits.
Precision = Literal["float32", "bfloat16"]


def _model(_: Path, word: str) -> None:
    """Raises Error if a network to begin with is named that is not there."""
    try:
        if word:
            model_file(Path(word))
    except FileNotFoundError:
        ours = ", ".join(shipped())
        raise Error(f"found '{word}', allowed a run, a file, or {ours}") from None


@dataclass(frozen=True)
class Learning:
    """One-cycle AdamW over all steps of the budget."""

    steps: int = ruled(1000, 0, 10_000_000)  # batches until the end; 0, with start: as it comes
    start: str = checked(
        _model, ""
    )  # whose weights are the first ones: a run, a file, or a model of the package
    batch: int = ruled(4, 1, 1024)  # frames in a batch
    rate: float = ruled(0.003, 1e-7, 1)  # the highest learning rate
    weight_decay: float = ruled(0.01, 0, 1)  # of AdamW
    clip: float = ruled(10.0, 1e-6, 1e6)  # of the gradients' norm
    window_m2: float = ruled(0.0, 0, 1e9)  # m2 of a frame that are learnt from at a time; 0: all
    # Share of the windows whose class is drawn first, each class of the frame alike.
    rare_windows: float = ruled(0.0, 0, 1)
    # Exponent: a frame of n objects has the weight n ** -balance. 0: each object counts the same.
    balance: float = ruled(0.0, 0, 1)
    # The last ones of each LiDAR are not learnt from: they choose best.safetensors. None by
    # default, because the published figures are of networks that learnt from all frames.
    validate_frames: int = ruled(0, 0, 100_000)

    def __post_init__(self) -> None:
        if not self.steps and not self.start:
            raise Error("steps: found 0 without start, allowed 1 or more")


@dataclass(frozen=True)
class Recipe:
    """What one tier of a file says."""

    detector: str
    network: Any  # the detector's own Config
    learning: Learning
    augmentation: Augmentation

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """That the detector tells apart."""
        return classes_of(self.network)

    def for_budget(self, share: float) -> Recipe:
        """With so much of the steps, the schedule with them."""
        steps = max(min(1, self.learning.steps), round(share * self.learning.steps))
        return replace(self, learning=replace(self.learning, steps=steps))

    def begun_with(self, start: Path) -> Recipe:
        """With the weights of a run, a file, or a model of the package."""
        return replace(self, learning=replace(self.learning, start=str(start)))


@dataclass(frozen=True)
class TierPart:
    """A tier as it stands in a file; the keys of its network are the detector's."""

    network: Part = field(default_factory=Part)
    learning: Learning = field(default_factory=Learning)
    augmentation: Augmentation = field(default_factory=Augmentation)


@dataclass(frozen=True)
class TierParts:
    smoke: TierPart
    quick: TierPart
    full: TierPart


def _known(_: Path, detector: str) -> None:
    if detector not in DETECTORS:
        raise Error(f"found '{detector}', allowed {', '.join(DETECTORS)}")


@dataclass(frozen=True)
class DetectorFile:
    tiers: TierParts
    detector: str = checked(_known)


def read_recipe(file: Path, tier: Tier) -> Recipe:
    """Raises ConfigError with file, line and key, and FileNotFoundError."""
    whole = read_config(file, DetectorFile)
    kind = importlib.import_module(DETECTORS[whole.detector].module).Config
    parts = {name: getattr(whole.tiers, name) for name in TIERS}
    networks = {name: part.network.read(kind) for name, part in parts.items()}
    chosen = parts[tier]
    return Recipe(whole.detector, networks[tier], chosen.learning, chosen.augmentation)
