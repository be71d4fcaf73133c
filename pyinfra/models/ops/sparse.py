"""Sparse 3-D convolution as in SECOND (Yan et al., Sensors 2018), by gather, product and scatter.

A rulebook lists for every offset of the kernel which input voxel contributes to which output voxel.
Layers with the same geometry have the same key and share one rulebook. Where Triton is usable, a
table takes the place of the rulebook, and one kernel gathers and multiplies. `benchmarks/ops.py`
compares this code with spconv, whose CPU version has no gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor, nn

from pyinfra.models.ops import triton_layers
from pyinfra.models.ops.rulebooks import (
    Rulebook,
    Table,
    Triple,
    strided_rulebook,
    strided_table,
    submanifold_rulebook,
    submanifold_table,
)
from pyinfra.models.ops.triton_layers import usable


@dataclass(frozen=True, eq=False)
class SparseTensor:
    """Features of the occupied voxels in a batch of grids. The features of other voxels are 0."""

    features: Tensor  # (n, c) features of the occupied voxels
    coordinates: Tensor  # (n, 4) int64: batch, z, y, x; no two rows are equal
    shape: Triple  # number of voxels along z, y, x
    batch_size: int
    # rulebooks and tables of all levels, by key
    rulebooks: dict[str, Rulebook | Table] = field(default_factory=dict)

    def with_features(self, features: Tensor) -> SparseTensor:
        """Returns the same voxels with other features (n, c), for any c."""
        return replace(self, features=features)

    def to_dense(self) -> Tensor:
        """Returns the dense bird's-eye grid, with each height as C channels: (B, C * D, H, W)."""
        depth, height, width = self.shape
        channels = self.features.shape[1]
        dense = self.features.new_zeros(self.batch_size, depth, height, width, channels)
        dense = dense.index_put(tuple(self.coordinates.unbind(1)), self.features)
        dense = dense.permute(0, 4, 1, 2, 3)  # shape (B, C, D, H, W)
        return dense.reshape(self.batch_size, channels * depth, height, width)


class _Layer(nn.Module):
    def __init__(
        self,
        channels_in: int,
        channels_out: int,
        key: str,
        kernel: Triple = (3, 3, 3),
        bias: bool = False,
    ) -> None:
        super().__init__()
        self.key, self.kernel = key, kernel
        # The weights are initialised as in a dense convolution of PyTorch.
        bound = 1 / math.sqrt(channels_in * math.prod(self.kernel))
        weight = torch.empty(math.prod(self.kernel), channels_in, channels_out)
        self.weight = nn.Parameter(weight.uniform_(-bound, bound))
        shift = torch.empty(channels_out).uniform_(-bound, bound)
        self.bias = nn.Parameter(shift) if bias else None

    def forward(self, x: SparseTensor) -> SparseTensor:
        """Maps features (n, c_in) to (m, c_out)."""
        if self.key not in x.rulebooks:
            x.rulebooks[self.key] = self.pairs(x)
        rulebook = x.rulebooks[self.key]
        features = convolve(x.features, self.weight, rulebook, self.bias)
        return replace(
            x, features=features, coordinates=rulebook.target, shape=rulebook.target_shape
        )

    def pairs(self, x: SparseTensor) -> Rulebook | Table:
        """Returns which voxels each output voxel reads."""
        raise NotImplementedError


class SubmanifoldConv3d(_Layer):
    """Convolution whose output has the same voxels as its input.

    key: name that layers with the same voxels and kernel share. The sizes of the kernel must be
    odd.
    """

    def pairs(self, x: SparseTensor) -> Rulebook | Table:
        make = submanifold_table if usable(x.features) else submanifold_rulebook
        return make(x.coordinates, x.shape, self.kernel)


class SparseConv3d(_Layer):
    """Convolution, usually with a stride, whose output has all voxels that the kernel reaches.

    Output voxels are sorted by batch, z, y, x.
    """

    def __init__(
        self,
        channels_in: int,
        channels_out: int,
        key: str,
        kernel: Triple = (3, 3, 3),
        stride: Triple = (2, 2, 2),
        padding: Triple = (1, 1, 1),
        bias: bool = False,
    ) -> None:
        super().__init__(channels_in, channels_out, key, kernel, bias)
        self.stride, self.padding = stride, padding

    def pairs(self, x: SparseTensor) -> Rulebook | Table:
        make = strided_table if usable(x.features) else strided_rulebook
        return make(x.coordinates, x.shape, self.kernel, self.stride, self.padding)


def convolve(
    features: Tensor, weight: Tensor, rulebook: Rulebook | Table, bias: Tensor | None = None
) -> Tensor:
    """Convolves features (n, c_in) to (m, c_out) with weight (offsets, c_in, c_out).

    The result is reproducible on every device.
    """
    kind = features.device.type
    if torch.is_autocast_enabled(kind):
        features = features.to(torch.get_autocast_dtype(kind))
    function = _TableConvolution if isinstance(rulebook, Table) else _Convolution
    result: Tensor = function.apply(features, weight.to(features.dtype), rulebook)  # type: ignore[no-untyped-call]
    return result if bias is None else result + bias


class _Convolution(torch.autograd.Function):
    # There is one matrix product for each offset of the kernel. Rows are unique within an offset.
    # Therefore sums have a fixed order, and no two threads write to the same row.
    @staticmethod
    def forward(ctx: Any, features: Tensor, weight: Tensor, rulebook: Rulebook) -> Tensor:
        ctx.save_for_backward(features, weight)
        ctx.rulebook = rulebook
        return _scatter(features, weight, rulebook)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        features, weight = ctx.saved_tensors
        rulebook, gradient = ctx.rulebook, gradients[0].contiguous()
        to_features = to_weight = None
        if ctx.needs_input_grad[0]:
            to_features = _scatter(gradient, weight.transpose(1, 2), rulebook.inverse())
        if ctx.needs_input_grad[1]:
            to_weight = torch.zeros_like(weight)
            if rulebook.centre is not None:
                torch.mm(features.t(), gradient, out=to_weight[rulebook.centre])
            for k, inputs, outputs in _offsets(rulebook):
                torch.mm(features[inputs].t(), gradient[outputs], out=to_weight[k])
        return to_features, to_weight, None


class _TableConvolution(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, weight: Tensor, table: Table) -> Tensor:
        ctx.save_for_backward(features, weight)
        ctx.table = table
        return triton_layers.convolve(features, weight, table.inputs)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        features, weight = ctx.saved_tensors
        table, gradient = ctx.table, gradients[0].contiguous()
        to_features = to_weight = None
        if ctx.needs_input_grad[0]:
            turned = weight.transpose(1, 2)
            if table.outputs is None:
                to_features = triton_layers.convolve(gradient, turned.flip(0), table.inputs)
            else:
                to_features = triton_layers.convolve(gradient, turned, table.outputs)
        if ctx.needs_input_grad[1]:
            to_weight = triton_layers.gradient_of_weights(features, gradient, table.inputs)
        return to_features, to_weight, None


def _scatter(features: Tensor, weight: Tensor, rulebook: Rulebook) -> Tensor:
    if rulebook.centre is None:
        result = features.new_zeros(len(rulebook.target), weight.shape[2])
    else:
        result = features @ weight[rulebook.centre]
    for k, inputs, outputs in _offsets(rulebook):
        sums = torch.addmm(
            result.index_select(0, outputs), features.index_select(0, inputs), weight[k]
        )
        result.index_copy_(0, outputs, sums)
    return result


def _offsets(rulebook: Rulebook) -> list[tuple[int, Tensor, Tensor]]:
    """Returns offset, input rows and output rows of the offsets that have pairs."""
    inputs = rulebook.inputs.split_with_sizes(rulebook.counts)
    outputs = rulebook.outputs.split_with_sizes(rulebook.counts)
    return [(k, inputs[k], outputs[k]) for k, n in enumerate(rulebook.counts) if n]
