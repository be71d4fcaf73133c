"""Rulebooks and tables of sparse convolutions: which voxels each output voxel reads."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pyinfra.models.ops.kernels import kernels, on_cpu

Triple = tuple[int, int, int]  # numbers along z, y, x


@dataclass(frozen=True, eq=False)
class Rulebook:
    """Pairs of input rows and output rows for each offset of the kernel.

    Within one offset a row occurs at most once as input and at most once as output.
    """

    inputs: Tensor  # (p,) int64 input row of each pair, grouped by offset
    outputs: Tensor  # (p,) int64 output row of each pair
    counts: list[int]  # number of pairs of each offset; offsets are ordered with z slowest
    centre: int | None  # offset that pairs each row with itself; its pairs are not listed
    source: Tensor  # (n, 4) int64, coordinates of the input
    target: Tensor  # (m, 4) int64, coordinates of the output
    target_shape: Triple

    def inverse(self) -> Rulebook:
        """Returns the rulebook with input and output exchanged."""
        return replace(
            self,
            inputs=self.outputs,
            outputs=self.inputs,
            source=self.target,
            target=self.source,
        )


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of the input by offset of the kernel and output row, for Triton (triton_layers.py)."""

    inputs: Tensor  # (offsets, m) int32 rows of the input, -1 for none; offsets as in Rulebook
    # (offsets, n) int32 rows of the output; if None, they are `inputs` with the offsets reversed
    outputs: Tensor | None
    source: Tensor  # (n, 4) int64, coordinates of the input
    target: Tensor  # (m, 4) int64, coordinates of the output
    target_shape: Triple


def submanifold_rulebook(coordinates: Tensor, shape: Triple, kernel: Triple) -> Rulebook:
    """Returns the pairs of voxels (n, 4) that are neighbours within the kernel.

    The sizes of the kernel must be odd.
    """
    if kernels is None or not on_cpu(coordinates):
        return _rulebook_of(submanifold_table(coordinates, shape, kernel))
    centre = math.prod(kernel) // 2
    keys, steps = _keys_and_steps(coordinates, shape, kernel)
    order = torch.arange(len(keys))
    if (keys[1:] < keys[:-1]).any():
        keys, order = keys.sort()
    neighbours, here, counts = kernels.shifted_pairs(keys.numpy(), steps[:centre].tolist())
    # The opposite offset has the same pairs with input and output exchanged.
    low = order[torch.from_numpy(neighbours)].split_with_sizes(counts)
    high = order[torch.from_numpy(here)].split_with_sizes(counts)
    none = order[:0]
    inputs, outputs = [*low, none, *high[::-1]], [*high, none, *low[::-1]]
    counts = [len(rows) for rows in inputs]
    rows = torch.cat(inputs), torch.cat(outputs)
    return Rulebook(*rows, counts, centre, coordinates, coordinates, shape)


def strided_rulebook(
    coordinates: Tensor, shape: Triple, kernel: Triple, stride: Triple, padding: Triple
) -> Rulebook:
    """Returns the pairs of voxels (n, 4) and the output voxels that the kernel reaches."""
    if kernels is None or not on_cpu(coordinates):
        return _rulebook_of(strided_table(coordinates, shape, kernel, stride, padding))
    target_shape = _convolved_shape(shape, kernel, stride, padding)
    (inputs, outputs, counts), keys = kernels.reached_voxels(
        coordinates.contiguous().numpy(), shape, kernel, stride, padding, target_shape
    )
    rows = torch.from_numpy(inputs), torch.from_numpy(outputs)
    target = _coordinates(torch.from_numpy(keys), target_shape)
    return Rulebook(*rows, counts, None, coordinates, target, target_shape)


def submanifold_table(coordinates: Tensor, shape: Triple, kernel: Triple) -> Table:
    """Returns the neighbours of voxels (n, 4) within the kernel, whose sizes must be odd."""
    keys, steps = _keys_and_steps(coordinates, shape, kernel)
    ascending, order = keys.sort()
    wanted = keys + steps[:, None]  # keys of the neighbours (offsets, n)
    at = torch.searchsorted(ascending, wanted).clamp(max=max(0, len(keys) - 1))
    inputs = torch.where(ascending[at] == wanted, order[at], -1).int()
    return Table(inputs, None, coordinates, coordinates, shape)


def strided_table(
    coordinates: Tensor, shape: Triple, kernel: Triple, stride: Triple, padding: Triple
) -> Table:
    """Returns the pairs of voxels (n, 4) and the output voxels that the kernel reaches."""
    target_shape = _convolved_shape(shape, kernel, stride, padding)
    keys = coordinates[None, :, 0]  # keys (offsets, n) of output cells, and whether they exist
    exists = torch.ones_like(keys, dtype=torch.bool)
    for axis, size in enumerate(target_shape):
        moved = coordinates[:, 1 + axis] + padding[axis]
        offset = torch.arange(kernel[axis], device=moved.device)[:, None]
        # outputs (offsets of the axis, n)
        at = (moved - offset).div(stride[axis], rounding_mode="floor")
        met = (at * stride[axis] == moved - offset) & (at >= 0) & (at < size)
        keys = (keys[:, None] * size + at).flatten(0, 1)
        exists = (exists[:, None] & met).flatten(0, 1)
    offset, row = exists.nonzero().unbind(1)
    reached, output = torch.unique(keys[offset, row], return_inverse=True)
    offsets = math.prod(kernel)
    inputs = torch.full((offsets, len(reached)), -1, dtype=torch.int32, device=row.device)
    outputs = torch.full((offsets, len(coordinates)), -1, dtype=torch.int32, device=row.device)
    inputs[offset, output], outputs[offset, row] = row.int(), output.int()
    target = _coordinates(reached, target_shape)
    return Table(inputs, outputs, coordinates, target, target_shape)


def _rulebook_of(table: Table) -> Rulebook:
    """Returns the pairs of a table, ordered by offset and then by input row."""
    outputs, centre = table.outputs, None
    if outputs is None:
        outputs, centre = table.inputs.flip(0), len(table.inputs) // 2
        outputs[centre] = -1
    inputs = [(of_offset >= 0).nonzero().squeeze(1) for of_offset in outputs]
    pairs = zip(outputs, inputs, strict=True)
    paired = torch.cat([of_offset[rows] for of_offset, rows in pairs]).long()
    counts = [len(rows) for rows in inputs]
    geometry = table.source, table.target, table.target_shape
    return Rulebook(torch.cat(inputs), paired, counts, centre, *geometry)


def _keys_and_steps(coordinates: Tensor, shape: Triple, kernel: Triple) -> tuple[Tensor, Tensor]:
    """Returns the keys (n,) of voxels, and the steps (offsets,) to the keys of their neighbours.

    The grid is padded by half the kernel, so that the neighbours of all voxels have keys.
    """
    pad_z, pad_y, pad_x = (size // 2 for size in kernel)
    padded = shape[0] + 2 * pad_z, shape[1] + 2 * pad_y, shape[2] + 2 * pad_x
    batch, z, y, x = coordinates.unbind(1)
    keys = _keys(batch, z + pad_z, y + pad_y, x + pad_x, padded)
    at_z, at_y, at_x = (torch.arange(n, device=keys.device) - n // 2 for n in kernel)
    steps = (at_z[:, None, None] * padded[1] + at_y[:, None]) * padded[2] + at_x
    return keys, steps.flatten()


def _keys(batch: Tensor, z: Tensor, y: Tensor, x: Tensor, shape: Triple) -> Tensor:
    return ((batch * shape[0] + z) * shape[1] + y) * shape[2] + x


def _coordinates(keys: Tensor, shape: Triple) -> Tensor:
    """Returns the coordinates (n, 4) of keys (n,), the inverse of `_keys`."""
    parts = []
    for size in reversed(shape):
        parts.append(keys % size)
        keys = keys.div(size, rounding_mode="floor")
    return torch.stack([keys, *reversed(parts)], 1)


def _convolved_shape(shape: Triple, kernel: Triple, stride: Triple, padding: Triple) -> Triple:
    sizes = [
        (n + 2 * p - k) // s + 1 for n, k, s, p in zip(shape, kernel, stride, padding, strict=True)
    ]
    return sizes[0], sizes[1], sizes[2]
