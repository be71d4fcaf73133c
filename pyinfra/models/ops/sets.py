"""Divides a sparse grid into windows, and the voxels of each window into sets of equal size.

The module follows section 3.2 of DSVT, Wang et al., CVPR 2023. A window with more voxels gets more
sets. Each voxel is in one set, and attention costs the same for each set.
"""

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

MOST_WINDOWS = 1 << 16  # larger than the number of windows along a side of any canvas


@dataclass(frozen=True, eq=False)
class VoxelWindows:
    """The positions of n voxels in square windows of `side` cells."""

    window: Tensor  # (n,) int64, number of the window; no two frames share a number
    row: Tensor  # (n,) int64, row of each voxel in its window
    column: Tensor
    side: int

    @property
    def by_row(self) -> Tensor:
        """(n,) index of each voxel's cell in its window, row by row."""
        return self.row * self.side + self.column

    @property
    def by_column(self) -> Tensor:
        return self.column * self.side + self.row


@dataclass(frozen=True, eq=False)
class Sets:
    """The assignment of n voxels to s sets."""

    voxel: Tensor  # (s, size) int64; smaller sets repeat some of their voxels in adjacent slots
    repeats: Tensor  # (s, size) bool: whether the slot has the same voxel as the previous slot

    @cached_property
    def slot(self) -> Tensor:
        """(n,) int64: for each voxel, the first of the s * size slots that has it."""
        once = (~self.repeats).flatten().nonzero()[:, 0]  # slots (n,)
        return torch.empty_like(once).index_put((self.voxel.flatten()[once],), once)


def windows_of(frame: Tensor, row: Tensor, column: Tensor, side: int, shift: int) -> VoxelWindows:
    """Returns the windows of voxels (n,). The grid starts `shift` cells inside a window."""
    row, column = row + shift, column + shift
    down, across = row // side, column // side
    # MOST_WINDOWS replaces the largest row and column, which would have to be read from a GPU.
    window = (frame * MOST_WINDOWS + down) * MOST_WINDOWS + across
    return VoxelWindows(window, row % side, column % side, side)


def partition(windows: VoxelWindows, position: Tensor, size: int) -> Sets:
    """Divides the voxels of each window into sets, in ascending order of `position` (n,).

    By equation 3 of the paper, n voxels are divided into s = ceil(n / size) sets. Slot i has the
    voxel floor(i n / (s size)). No voxel is in two sets, because s - 1 < n / size.
    """
    order = torch.argsort(windows.window * windows.side**2 + position)
    _, count = torch.unique_consecutive(windows.window[order], return_counts=True)
    first = count.cumsum(0) - count
    sets = (count + size - 1) // size
    number = torch.arange(len(count), device=order.device)
    set_window = torch.repeat_interleave(number, sets)  # window of each set (s,)
    nth = torch.arange(len(set_window), device=order.device) - (sets.cumsum(0) - sets)[set_window]
    slots = nth[:, None] * size + torch.arange(size, device=order.device)
    chosen = slots * count[set_window, None] // (sets[set_window, None] * size)  # voxels (s, size)
    voxel = order[first[set_window, None] + chosen]
    repeats = torch.zeros_like(voxel, dtype=torch.bool)
    repeats[:, 1:] = chosen[:, 1:] == chosen[:, :-1]
    return Sets(voxel, repeats)
