"""Rulebooks and tables of sparse convolutions: which voxels each output voxel reads."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pyinfra.models.ops.constants import constant
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
    source_shape: Triple
    target_shape: Triple

    def inverse(self) -> Rulebook:
        """Returns the rulebook with input and output exchanged."""
        return replace(
            self,
            inputs=self.outputs,
            outputs=self.inputs,
            source=self.target,
            target=self.source,
            source_shape=self.target_shape,
            target_shape=self.source_shape,
        )


@dataclass(frozen=True, eq=False)
class Table:
    """The input row of each output row and offset of the kernel, for Triton (triton_layers.py)."""

    inputs: Tensor  # (offsets, m) int32 rows of the input, -1 for none; offsets as in Rulebook
    # (offsets, n) int32 rows of the output; None for `inputs` in reverse order of offsets
    outputs: Tensor | None
    source: Tensor  # (n, 4) int64, coordinates of the input
    target: Tensor  # (m, 4) int64, coordinates of the output
    source_shape: Triple
    target_shape: Triple


def submanifold_rulebook(coordinates: Tensor, shape: Triple, kernel: Triple) -> Rulebook:
    """Returns the pairs of voxels (n, 4) that are neighbours within the kernel.

    Raises ValueError for a kernel of even size.
    """
    if any(size % 2 == 0 for size in kernel):
        raise ValueError(f"kernel: expected odd sizes, got {kernel}")
    pad = kernel[0] // 2, kernel[1] // 2, kernel[2] // 2
    keys, order = _sorted_keys(coordinates, shape, pad)
    sizes = _padded(shape, pad)
    centre = math.prod(kernel) // 2
    steps = [
        ((dz - pad[0]) * sizes[1] + dy - pad[1]) * sizes[2] + dx - pad[2]
        for dz, dy, dx in itertools.product(*map(range, kernel))
    ]
    neighbours, here, counts = _shifted_pairs(keys, steps[:centre])
    # The opposite offset has the same pairs with input and output exchanged.
    low, high = order[neighbours].split_with_sizes(counts), order[here].split_with_sizes(counts)
    none = order[:0]
    inputs, outputs = [*low, none, *high[::-1]], [*high, none, *low[::-1]]
    return Rulebook(
        torch.cat(inputs),
        torch.cat(outputs),
        [len(rows) for rows in inputs],
        centre,
        coordinates,
        coordinates,
        shape,
        shape,
    )


def strided_rulebook(
    coordinates: Tensor, shape: Triple, kernel: Triple, stride: Triple, padding: Triple
) -> Rulebook:
    """Returns the pairs of voxels (n, 4) and the output voxels that the kernel reaches."""
    target_shape = _convolved_shape(shape, kernel, stride, padding)
    _sorted_keys(coordinates, shape, (0, 0, 0))
    inputs, outputs, counts, keys = _reached_voxels(
        coordinates, shape, kernel, stride, padding, target_shape
    )
    target = _coordinates(keys, target_shape)
    return Rulebook(inputs, outputs, counts, None, coordinates, target, shape, target_shape)


def submanifold_table(coordinates: Tensor, shape: Triple, kernel: Triple) -> Table:
    """Returns the neighbours of voxels (n, 4) within the kernel, whose sizes must be odd."""
    pad = kernel[0] // 2, kernel[1] // 2, kernel[2] // 2
    sizes = _padded(shape, pad)
    batch, z, y, x = coordinates.unbind(1)
    keys = _keys(batch, z + pad[0], y + pad[1], x + pad[2], sizes)
    ascending, order = keys.sort()
    at_z, at_y, at_x = (torch.arange(n, device=keys.device) - n // 2 for n in kernel)
    steps = (at_z[:, None, None] * sizes[1] + at_y[:, None]) * sizes[2] + at_x
    wanted = keys + steps.flatten()[:, None]  # keys of the neighbours (offsets, n)
    at = torch.searchsorted(ascending, wanted).clamp(max=max(0, len(keys) - 1))
    inputs = torch.where(ascending[at] == wanted, order[at], -1).int()
    return Table(inputs, None, coordinates, coordinates, shape, shape)


def strided_table(
    coordinates: Tensor, shape: Triple, kernel: Triple, stride: Triple, padding: Triple
) -> Table:
    """Returns the pairs of voxels (n, 4) and the output voxels that the kernel reaches."""
    target_shape = _convolved_shape(shape, kernel, stride, padding)
    keys, exists = coordinates[:, 0], torch.ones_like(coordinates[:, 0], dtype=torch.bool)
    for axis, size in enumerate(target_shape):
        moved = coordinates[:, 1 + axis] + padding[axis]
        offset = torch.arange(kernel[axis], device=moved.device)[:, None]
        # outputs (offsets of the axis, n)
        at = (moved - offset).div(stride[axis], rounding_mode="floor")
        met = (at * stride[axis] == moved - offset) & (at >= 0) & (at < size)
        keys = (keys.view(-1, 1, len(moved)) * size + at).flatten(0, 1)
        exists = (exists.view(-1, 1, len(moved)) & met).flatten(0, 1)
    offset, row = exists.nonzero().unbind(1)
    reached, output = torch.unique(keys[offset, row], return_inverse=True)
    offsets = math.prod(kernel)
    inputs = torch.full((offsets, len(reached)), -1, dtype=torch.int32, device=row.device)
    outputs = torch.full((offsets, len(coordinates)), -1, dtype=torch.int32, device=row.device)
    inputs[offset, output], outputs[offset, row] = row.int(), output.int()
    target = _coordinates(reached, target_shape)
    return Table(inputs, outputs, coordinates, target, shape, target_shape)


def _shifted_pairs(keys: Tensor, steps: list[int]) -> tuple[Tensor, Tensor, list[int]]:
    """Returns the row pairs with keys[first] == keys[second] + step, and their number per step.

    keys: ascending.
    """
    if kernels is not None and on_cpu(keys):
        first, second, counts = kernels.shifted_pairs(keys.numpy(), steps)
        return torch.from_numpy(first), torch.from_numpy(second), counts
    neighbours, here = [keys[:0]], [keys[:0]]
    for step in steps:
        at = torch.searchsorted(keys, keys + step).clamp(max=max(0, len(keys) - 1))
        here.append(torch.nonzero(keys[at] == keys + step).squeeze(1))
        neighbours.append(at[here[-1]])
    return torch.cat(neighbours), torch.cat(here), [len(rows) for rows in neighbours[1:]]


def _reached_voxels(
    coordinates: Tensor,
    shape: Triple,
    kernel: Triple,
    stride: Triple,
    padding: Triple,
    target_shape: Triple,
) -> tuple[Tensor, Tensor, list[int], Tensor]:
    """Returns inputs, outputs and counts of a rulebook, and the ascending keys of the outputs."""
    if kernels is not None and on_cpu(coordinates):
        (inputs, outputs, counts), keys = kernels.reached_voxels(
            coordinates.contiguous().numpy(), shape, kernel, stride, padding, target_shape
        )
        inputs, outputs = torch.from_numpy(inputs), torch.from_numpy(outputs)
        return inputs, outputs, counts, torch.from_numpy(keys)
    # For each axis and offset, compute the output cell of a voxel, and whether it exists.
    arrivals = []
    for axis, size in enumerate(target_shape):
        moved = coordinates[:, 1 + axis] + padding[axis]
        offset = torch.arange(kernel[axis], device=moved.device)[:, None]
        at = (moved - offset).div(stride[axis], rounding_mode="floor")  # (offsets, n)
        met = (at * stride[axis] == moved - offset) & (at >= 0) & (at < size)
        arrivals.append(list(zip(at, met, strict=True)))
    rows, arrived = [], []
    for (z, met_z), (y, met_y), (x, met_x) in itertools.product(*arrivals):
        here = torch.nonzero(met_z & met_y & met_x).squeeze(1)
        rows.append(here)
        arrived.append(_keys(coordinates[here, 0], z[here], y[here], x[here], target_shape))
    keys, outputs = torch.unique(torch.cat(arrived), return_inverse=True)
    return torch.cat(rows), outputs, [len(part) for part in rows], keys


def _sorted_keys(coordinates: Tensor, shape: Triple, pad: Triple) -> tuple[Tensor, Tensor]:
    """Returns the sorted keys (n,) of voxels in a padded grid, and the rows in this order.

    On a CPU, raises ValueError for a voxel outside the grid, and for a duplicate. On a GPU these
    tests would make the CPU wait.
    """
    padded = _padded(shape, pad)
    batch, z, y, x = coordinates.unbind(1)
    keys = _keys(batch, z + pad[0], y + pad[1], x + pad[2], padded)
    if not on_cpu(keys):
        sorted_keys, order = keys.sort()
        return sorted_keys, order
    beyond = coordinates[:, 1:] >= constant(shape, coordinates)
    if (coordinates < 0).any() or beyond.any():
        low, high = coordinates[:, 1:].amin(0).tolist(), coordinates[:, 1:].amax(0).tolist()
        raise ValueError(f"coordinates: expected voxels in the grid {shape}, got {low} to {high}")
    if (keys[1:] > keys[:-1]).all():
        return keys, torch.arange(len(keys), device=keys.device)
    keys, order = keys.sort()
    if (keys[1:] == keys[:-1]).any():
        twice = coordinates[order[1:][keys[1:] == keys[:-1]][0]].tolist()
        raise ValueError(f"coordinates: expected each voxel once, got {twice} twice")
    return keys, order


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
    if min(sizes) < 1:
        raise ValueError(f"shape: expected at least the kernel {kernel}, got {shape}")
    return sizes[0], sizes[1], sizes[2]


def _padded(shape: Triple, pad: Triple) -> Triple:
    return shape[0] + 2 * pad[0], shape[1] + 2 * pad[1], shape[2] + 2 * pad[2]


def triple(size: int | Triple) -> Triple:
    return (size, size, size) if isinstance(size, int) else size
