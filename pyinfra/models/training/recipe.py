"""`configs/detectors/*.yaml`: detector, network size and training settings for each tier."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.config import Part, checked, read_config, ruled
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import TIERS, ObjectClass, Tier
from pyinfra.models.detectors.catalogue import DETECTORS
from pyinfra.models.detectors.classes import classes_of
from pyinfra.models.inference.detect import model_file, shipped
from pyinfra.models.training.samples import Augmentation

# Precision of the layers. The cells of points, searches, losses and boxes always use 32 bits.
Precision = Literal["float32", "bfloat16"]

# Maps points (n, 4), boxes (k, 7) and a random generator to points and boxes.
Hook = Callable[[Points, FloatArray, np.random.Generator], tuple[Points, FloatArray]]


def _model(_: Path, word: str) -> None:
    """Raises Error if the network to start from does not exist."""
    try:
        if word:
            model_file(Path(word))
    except FileNotFoundError:
        ours = ", ".join(shipped())
        raise Error(
            f"expected the folder of a trained detector, a model file or {ours}, got '{word}'"
        ) from None


@dataclass(frozen=True)
class Learning:
    """Settings of the training, which uses AdamW with a one-cycle learning rate."""

    steps: int = ruled(1000, 0, 10_000_000)  # training steps; 0 uses `start` without training
    start: str = checked(
        _model, ""
    )  # network to start from: folder of a trained detector, file, or a pretrained detector's name
    batch: int = ruled(4, 1, 1024)  # number of frames in a batch
    rate: float = ruled(0.003, 1e-7, 1)  # highest learning rate
    weight_decay: float = ruled(0.01, 0, 1)  # weight decay of AdamW
    clip: float = ruled(10.0, 1e-6, 1e6)  # gradients with a larger norm are scaled to this norm
    window_m2: float = ruled(0.0, 0, 1e9)  # area of a frame that a step uses; 0 for the whole area
    # share of the windows that are centred on an object of a random class of the frame; the other
    # windows are centred on a random object of any class
    rare_windows: float = ruled(0.0, 0, 1)
    # exponent of the weight n ** -balance of a frame with n objects; with 0, all objects have the
    # same weight
    balance: float = ruled(0.0, 0, 1)
    # number of last frames of each LiDAR that are left out of the training and select
    # best.safetensors. The default is 0, because the networks of the published figures were trained
    # on all frames.
    validate_frames: int = ruled(0, 0, 100_000)

    def __post_init__(self) -> None:
        if not self.steps and not self.start:
            raise Error("steps: expected 1 or more if `start` is not set, got 0")


@dataclass(frozen=True)
class Recipe:
    """The settings of one tier in a detector's file."""

    detector: str
    network: Any  # the Config of the detector
    learning: Learning
    augmentation: Augmentation
    hook: Hook | None = None  # the user's function for additional augmentation
    loss: Callable[..., Any] | None = None  # the user's function that changes the losses

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """The classes that the detector distinguishes."""
        return classes_of(self.network)

    def for_budget(self, share: float) -> Recipe:
        """Returns the recipe with a share of its steps and a shorter learning rate schedule."""
        steps = max(min(1, self.learning.steps), round(share * self.learning.steps))
        return replace(self, learning=replace(self.learning, steps=steps))

    def begun_with(self, start: Path) -> Recipe:
        """Returns the recipe with another network to start from (see `Learning.start`)."""
        return replace(self, learning=replace(self.learning, start=str(start)))


@dataclass(frozen=True)
class TierPart:
    """A tier as it is in a file; the detector defines the keys of `network`."""

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
        raise Error(f"expected one of {', '.join(DETECTORS)}; got '{detector}'")


@dataclass(frozen=True)
class DetectorFile:
    tiers: TierParts
    detector: str = checked(_known)


def read_recipe(file: Path, tier: Tier) -> Recipe:
    """Reads one tier of a file.

    Raises FileNotFoundError, and ConfigError with file, line and key.
    """
    config = read_config(file, DetectorFile)
    kind = DETECTORS[config.detector].config
    parts = {name: getattr(config.tiers, name) for name in TIERS}
    networks = {name: part.network.read(kind) for name, part in parts.items()}
    chosen = parts[tier]
    return Recipe(config.detector, networks[tier], chosen.learning, chosen.augmentation)
