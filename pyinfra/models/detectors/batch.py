"""The input of networks: points and boxes of several frames, and the area that is used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from pyinfra.core.errors import Error
from pyinfra.models.detectors.detection_area import Area
from pyinfra.models.detectors.sample import Sample


@dataclass(frozen=True, eq=False)
class Windows:
    """The part of each frame's canvas that is used for training (windows.py)."""

    most_m2: float
    centres: Tensor  # (B, 2) x y


@dataclass(frozen=True, eq=False)
class CanvasPart:
    """The part of the canvas that a batch uses, and the boxes in this part."""

    sides: tuple[int, int]  # rows, columns
    first: Tensor | None  # (B, 2) row, column of the part's first cell; None: the whole canvas
    boxes: tuple[Tensor, ...]  # (k, 7) boxes of each frame in the part, shifted with the part
    classes: tuple[Tensor, ...]  # (k,) class numbers of these boxes


@dataclass(frozen=True, eq=False)
class Batch:
    """Several frames, with their points concatenated."""

    points: Tensor  # (n, 4) float32; (n, 5) for a network that uses ages
    frame: Tensor  # (n,) int64, frame of each point, ascending
    boxes: tuple[Tensor, ...]  # (k, 7) float32 for each frame
    windows: Windows | None = None  # None: the whole canvas is used
    classes: tuple[Tensor, ...] = ()  # (k,) int64 class numbers of the boxes of each frame
    balance: float = 0.0  # weighting of frames in the loss: see `Learning.balance`

    @property
    def size(self) -> int:
        return len(self.boxes)

    def to(self, device: torch.device) -> Batch:
        return replace(
            self,
            points=self.points.to(device),
            frame=self.frame.to(device),
            boxes=tuple(b.to(device) for b in self.boxes),
            classes=tuple(c.to(device) for c in self.classes),
        )


def make_batch(samples: Sequence[Sample], area: Area, columns: int = 4) -> Batch:
    """Makes a batch of the points inside the area and the boxes whose centres are inside.

    columns: number of columns of the points to use. Raises Error for a cloud with fewer columns.
    """
    for sample in samples:
        if sample.points.shape[1] < columns:
            raise Error(
                f"points: expected {columns} columns, got {sample.points.shape[1]}: the network "
                "uses the age of points in stacked frames"
            )
    clouds = [area.crop(sample.points)[:, :columns] for sample in samples]
    counts = torch.tensor([len(cloud) for cloud in clouds])
    inside = [area.holds(sample.boxes[:, :3]) for sample in samples]
    pairs = list(zip(samples, inside, strict=True))
    return Batch(
        points=torch.from_numpy(np.concatenate(clouds).astype(np.float32)),
        frame=torch.repeat_interleave(torch.arange(len(clouds)), counts),
        boxes=tuple(torch.from_numpy(s.boxes[mask].astype(np.float32)) for s, mask in pairs),
        classes=tuple(torch.from_numpy(s.numbers[mask]) for s, mask in pairs),
    )
