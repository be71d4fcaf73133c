"""Windows of a sparse grid, and sets of equal size of the voxels in each.

DSVT, Wang et al., CVPR 2023, section 3.2: a window with many voxels gets many sets, so attention
costs the same for each set and every voxel is in one.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, eq=False)
class VoxelWindows:
    """Where n voxels lie in square windows of `side` cells."""

    window: Tensor  # (n,) int64, the same number for the voxels of one window of one frame
    row: Tensor  # (n,) int64, in the window
    column: Tensor
    side: int

    @property
    def by_row(self) -> Tensor:
        """(n,) place of each voxel in its window, row after row."""
        return self.row * self.side + self.column

    @property
    def by_column(self) -> Tensor:
        return self.column * self.side + self.row


@dataclass(frozen=True, eq=False)
class Sets:
    """Which voxels of n are in which of s sets."""

    voxel: Tensor  # (s, size) int64; a set with fewer voxels repeats some, next to each other
    repeats: Tensor  # (s, size) bool: holds the same voxel as the slot before
    slot: Tensor  # (n,) int64: the one of the s * size slots that holds the voxel first


def windows_of(frame: Tensor, row: Tensor, column: Tensor, side: int, shift: int) -> VoxelWindows:
    """The windows of voxels (n,) at cells of a grid that starts `shift` cells inside a window."""
    row, column = row + shift, column + shift
    down, across = row // side, column // side
    rows, columns = (int(v.max()) + 1 if len(v) else 1 for v in (down, across))
    window = (frame * rows + down) * columns + across
    return VoxelWindows(window, row % side, column % side, side)


def partition(windows: VoxelWindows, position: Tensor, size: int) -> Sets:
    """Sets of the voxels of each window in ascending order of their place (n,) in it.

    The paper's equation 3: of n voxels in s = ceil(n / size) sets, slot i holds the voxel
    floor(i n / (s size)). No voxel is in two sets, as s - 1 < n / size.
    """
    order = torch.argsort(windows.window * windows.side**2 + position)
    _, count = torch.unique_consecutive(windows.window[order], return_counts=True)
    first = count.cumsum(0) - count
    sets = (count + size - 1) // size
    number = torch.arange(len(count), device=order.device)
    set_window = torch.repeat_interleave(number, sets)  # (s,) window
    nth = torch.arange(len(set_window), device=order.device) - (sets.cumsum(0) - sets)[set_window]
    slots = nth[:, None] * size + torch.arange(size, device=order.device)
    chosen = slots * count[set_window, None] // (sets[set_window, None] * size)  # (s, size)
    voxel = order[first[set_window, None] + chosen]
    repeats = torch.zeros_like(voxel, dtype=torch.bool)
    repeats[:, 1:] = chosen[:, 1:] == chosen[:, :-1]
    once = (~repeats).flatten().nonzero()[:, 0]  # (n,)
    slot = torch.empty_like(order).index_put((voxel.flatten()[once],), once)
    return Sets(voxel, repeats, slot)
