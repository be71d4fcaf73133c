"""`configs/detectors/*.yaml`: which detector, how wide, and how it learns, for each tier."""

from __future__ import annotations

import dataclasses
import importlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pyinfra.config import read_config, ruled
from pyinfra.detectors.catalogue import DETECTORS
from pyinfra.training.samples import Augmentation
from pyinfra.training.sources import TIERS, Tier

# Of the layers; in which cell a point lies, searches, losses and boxes always have 32 bits.
Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class Learning:
    """One-cycle AdamW over all steps of the budget."""

    steps: int = ruled(1000, 1, 10_000_000)  # batches until the end
    batch: int = ruled(4, 1, 1024)  # frames in a batch
    rate: float = ruled(0.003, 1e-7, 1)  # the highest learning rate
    weight_decay: float = ruled(0.01, 0, 1)  # of AdamW
    clip: float = ruled(10.0, 1e-6, 1e6)  # of the gradients' norm
    window_m2: float = ruled(0.0, 0, 1e9)  # m2 of a frame that are learnt from at a time; 0: all
    # The last ones of each LiDAR are not learnt from: they choose best.safetensors. None by
    # default, because the published figures are of networks that learnt from all frames.
    validate_frames: int = ruled(0, 0, 100_000)


@dataclass(frozen=True)
class Recipe:
    """What one tier of a file says."""

    detector: str
    network: Any  # the detector's own Config
    learning: Learning
    augmentation: Augmentation


def read_recipe(file: Path, tier: Tier) -> Recipe:
    """Raises ConfigError with file, line and key, and FileNotFoundError."""
    named: list[tuple[str, Any, Any]] = [
        ("detector", Literal[*DETECTORS], field()),
        ("tiers", Any, None),
    ]
    name: str = read_config(file, dataclasses.make_dataclass("Name", named)).detector
    config = importlib.import_module(DETECTORS[name].module).Config
    kind = dataclasses.make_dataclass(
        "TierConfig",
        [
            ("network", config, field(default_factory=config)),
            ("learning", Learning, field(default_factory=Learning)),
            ("augmentation", Augmentation, field(default_factory=Augmentation)),
        ],
        frozen=True,
    )
    tiers = dataclasses.make_dataclass("Tiers", [(t, kind) for t in TIERS], frozen=True)
    whole = dataclasses.make_dataclass("File", [("detector", str), ("tiers", tiers)], frozen=True)
    chosen = getattr(read_config(file, whole).tiers, tier)
    return Recipe(name, chosen.network, chosen.learning, chosen.augmentation)
