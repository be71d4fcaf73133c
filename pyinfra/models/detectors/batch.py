"""The input of networks: points and boxes of several frames, and the area that is used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, IntArray, Points
from pyinfra.core.errors import Error


@dataclass(frozen=True)
class Area:
    """The part of the levelled LiDAR frame that a detector uses, in metres."""

    low: tuple[float, float, float]  # x y z
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise Error(f"area: expected low below high, got {self.low} to {self.high}")

    @property
    def size(self) -> tuple[float, float, float]:
        x, y, z = (b - a for a, b in zip(self.low, self.high, strict=True))
        return x, y, z

    def holds(self, xyz: Floats) -> BoolArray:
        """Returns which points xyz (n, 3) are finite and inside: (n,) bool. `high` is excluded."""
        low, high = np.array(self.low, xyz.dtype), np.array(self.high, xyz.dtype)
        inside = np.ones(len(xyz), dtype=np.bool_)
        for axis in range(3):  # column by column, which is five times as fast as all(axis=1)
            inside &= (xyz[:, axis] >= low[axis]) & (xyz[:, axis] < high[axis])
        return inside

    def crop(self, points: Points) -> Points:
        """Returns the points (n, 4 or more) that are inside and have finite intensities."""
        keep = self.holds(points[:, :3]) & np.isfinite(points[:, 3])
        return points[keep]

    def grown(self, step: float) -> Area:
        """Returns the area enlarged around its middle, so that x and y are multiples of `step`."""
        low, high = list(self.low), list(self.high)
        for axis in (0, 1):
            size = high[axis] - low[axis]
            more = (np.ceil(size / step - 1e-6) * step - size) / 2
            low[axis], high[axis] = float(low[axis] - more), float(high[axis] + more)
        return Area((low[0], low[1], low[2]), (high[0], high[1], high[2]))


@dataclass(frozen=True, eq=False)
class Sample:
    """One training frame."""

    points: Points  # (n, 4); for stacked frames (n, 5) with ages
    boxes: FloatArray  # (k, 7) boxes of the objects with a point of this LiDAR
    classes: IntArray | None = None  # (k,) class numbers of the boxes; None: all 0
    height_m: float = field(default=0.0, kw_only=True)  # height of the sensor above z = 0

    @property
    def numbers(self) -> IntArray:
        """(k,) class numbers of the boxes."""
        return np.zeros(len(self.boxes), np.int64) if self.classes is None else self.classes


@dataclass(frozen=True, eq=False)
class Windows:
    """The part of each frame's canvas that is used for training (windows.py)."""

    most_m2: float
    centres: Tensor  # (B, 2) x y


@dataclass(frozen=True, eq=False)
class CanvasPart:
    """The part of the canvas that is filled, shifted to the first cell of the canvas."""

    sides: tuple[int, int]  # rows, columns
    first: Tensor | None  # (B, 2) row, column of the part's first cell; None for the whole canvas
    boxes: tuple[Tensor, ...]  # (k, 7) boxes of each frame in the part, shifted as the part is
    classes: tuple[Tensor, ...]  # (k,) class numbers of these boxes


@dataclass(frozen=True, eq=False)
class Batch:
    """Several frames, with their points concatenated."""

    points: Tensor  # (n, 4) float32; (n, 5) for a network that uses ages
    frame: Tensor  # (n,) int64, frame of each point, ascending
    boxes: tuple[Tensor, ...]  # (k, 7) float32 for each frame
    windows: Windows | None = None  # None: the whole area
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
