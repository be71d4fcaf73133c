"""The input of networks: points and boxes of several frames, and the area that is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from pyinfra.models.detectors.detection_area import Area
from pyinfra.models.detectors.sample import Sample, with_columns
from pyinfra.models.ops.constants import owners


@dataclass(frozen=True)
class Windows:
    """The part of each frame's canvas that is used for training (windows.py).

    The centres are not tensors, because the CPU computes the sizes of the windows.
    """

    most_m2: float
    centres: tuple[tuple[float, float], ...]  # x y of the centre of each frame's window


@dataclass(frozen=True, eq=False)
class CanvasPart:
    """The part of the canvas that a batch uses, and the boxes in this part."""

    sides: tuple[int, int]  # numbers of rows and columns
    first: Tensor | None  # (B, 2) row, column of the part's first cell; None for the whole canvas
    boxes: tuple[Tensor, ...]  # (k, 7) boxes of each frame in the part, shifted with the part
    classes: tuple[Tensor, ...]  # (k,) class numbers of these boxes


@dataclass(frozen=True, eq=False)
class Batch:
    """Several frames, with their points concatenated."""

    points: Tensor  # (n, 4) float32 points, or (n, 5) with the age of each point
    counts: tuple[int, ...]  # number of points in each frame
    boxes: tuple[Tensor, ...]  # boxes (k, 7) float32 of each frame
    windows: Windows | None = None  # windows of the frames; None if the whole canvas is used
    classes: tuple[Tensor, ...] = ()  # (k,) int64 class numbers of the boxes of each frame
    balance: float = 0.0  # weighting of frames in the loss: see `Learning.balance`

    @property
    def size(self) -> int:
        return len(self.boxes)

    @cached_property
    def frame(self) -> Tensor:
        """(n,) int64, frame of each point, ascending."""
        if len(self.counts) == 1:  # so that an exported program accepts any number of points
            return torch.zeros_like(self.points[:, 0], dtype=torch.int64)
        return owners(self.counts, self.points.device)

    def clouds(self) -> tuple[Tensor, ...]:
        """Returns the points (n, 4 or 5) of each frame."""
        return self.points.split_with_sizes(list(self.counts))

    def to(self, device: torch.device) -> Batch:
        """Returns the batch on a device; does not wait for the copy if the batch is pinned."""
        return self._mapped(lambda tensor: tensor.to(device, non_blocking=True))

    def pin_memory(self) -> Batch:
        """Returns the batch in memory from which a GPU copies while the CPU goes on."""
        return self._mapped(torch.Tensor.pin_memory)

    def __reduce__(self) -> tuple[object, ...]:
        # Between processes each tensor takes a file handle, so the frames' boxes are concatenated.
        sizes, class_sizes = [len(b) for b in self.boxes], [len(c) for c in self.classes]
        parts = self.points, self.counts, *self._joined(), sizes, class_sizes
        return _rejoined, (*parts, self.windows, self.balance)

    def _joined(self) -> tuple[Tensor, Tensor]:
        """Returns the boxes (k, 7) and class numbers (k,) of all frames."""
        boxes = torch.cat([*self.boxes, self.points.new_zeros(0, 7)])
        none = torch.zeros(0, dtype=torch.int64, device=self.points.device)
        return boxes, torch.cat([*self.classes, none])

    def _mapped(self, change: Callable[[Tensor], Tensor]) -> Batch:
        sizes, class_sizes = [len(b) for b in self.boxes], [len(c) for c in self.classes]
        boxes, classes = map(change, self._joined())
        parts = change(self.points), self.counts, boxes, classes, sizes, class_sizes
        return _rejoined(*parts, self.windows, self.balance)


def _rejoined(
    points: Tensor,
    counts: tuple[int, ...],
    boxes: Tensor,
    classes: Tensor,
    sizes: list[int],
    class_sizes: list[int],
    windows: Windows | None,
    balance: float,
) -> Batch:
    """Returns a batch. boxes, classes: those of all frames. sizes: their number in each frame."""
    of_frames = boxes.split_with_sizes(sizes), classes.split_with_sizes(class_sizes)
    return Batch(points, counts, of_frames[0], windows, of_frames[1], balance)


def make_batch(samples: Sequence[Sample], area: Area, columns: int = 4) -> Batch:
    """Makes a batch of the points inside the area and the boxes whose centres are inside.

    columns: number of columns of the points to use. Raises Error for a cloud with fewer columns.
    """
    clouds = [with_columns(area.crop(sample.points), columns) for sample in samples]
    inside = [area.holds(sample.boxes[:, :3]) for sample in samples]
    pairs = list(zip(samples, inside, strict=True))
    return Batch(
        points=torch.from_numpy(np.concatenate(clouds).astype(np.float32)),
        counts=tuple(len(cloud) for cloud in clouds),
        boxes=tuple(torch.from_numpy(s.boxes[mask].astype(np.float32)) for s, mask in pairs),
        classes=tuple(torch.from_numpy(s.numbers[mask]) for s, mask in pairs),
    )
