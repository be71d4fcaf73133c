"""Sparse convolution, attention in sets and maxima on a GPU, in Triton, with gradients.

Each function has an equivalent in PyTorch (sparse.py, dsvt.py and pointnet.py); tests compare both.
The kernels gather rows while they multiply, so that no gathered array is written. No two programs
write to the same row, so the results are reproducible.
"""

from typing import Any

import torch
from torch import Tensor

from pyinfra.models.ops import triton_kernels

try:
    import triton
    import triton.language as tl
except ImportError:  # no Triton, as in triton_kernels.py
    triton = None

enabled = True  # if False, the PyTorch functions are used
ROWS = 64  # number of rows that one program computes
SPLITS = 32  # number of programs that share the sum over rows of a gradient of weights
LARGEST_SET, LARGEST_HEAD = 64, 64  # maximum set size and head width of the attention kernels

if triton is not None:

    @triton.jit  # type: ignore[untyped-decorator]
    def _convolve(  # type: ignore[no-untyped-def]  # pragma: no cover
        features,
        weight,
        table,
        out,
        number,
        OFFSETS: tl.constexpr,
        C_IN: tl.constexpr,
        C_OUT: tl.constexpr,
        PADDED_IN: tl.constexpr,
        PADDED_OUT: tl.constexpr,
        ROWS: tl.constexpr,
        PRECISION: tl.constexpr,
    ):
        # One program computes ROWS outputs. An offset that no output of the program uses is
        # skipped.
        row = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
        exists = row < number
        c_in = tl.arange(0, PADDED_IN)
        c_out = tl.arange(0, PADDED_OUT)
        whole = (c_in < C_IN)[:, None] & (c_out < C_OUT)[None, :]
        sums = tl.zeros((ROWS, PADDED_OUT), tl.float32)
        for k in range(0, OFFSETS):
            at = tl.load(table + k * number + row, mask=exists, other=-1)
            if tl.max(at, axis=0) >= 0:
                there = (at >= 0)[:, None] & (c_in < C_IN)[None, :]
                place = at.to(tl.int64)[:, None] * C_IN + c_in[None, :]
                x = tl.load(features + place, mask=there, other=0.0)
                place = (k * C_IN + c_in)[:, None] * C_OUT + c_out[None, :]
                w = tl.load(weight + place, mask=whole, other=0.0)
                sums += tl.dot(x, w, input_precision=PRECISION)
        place = row.to(tl.int64)[:, None] * C_OUT + c_out[None, :]
        inside = exists[:, None] & (c_out < C_OUT)[None, :]
        tl.store(out + place, sums.to(out.dtype.element_ty), mask=inside)

    @triton.jit  # type: ignore[untyped-decorator]
    def _weights(  # type: ignore[no-untyped-def]  # pragma: no cover
        features,
        gradient,
        table,
        parts,
        number,
        OFFSETS: tl.constexpr,
        C_IN: tl.constexpr,
        C_OUT: tl.constexpr,
        PADDED_IN: tl.constexpr,
        PADDED_OUT: tl.constexpr,
        ROWS: tl.constexpr,
        SPLITS: tl.constexpr,
        PRECISION: tl.constexpr,
    ):
        # One program computes the part of the gradient from one offset and one share of the rows.
        k = tl.program_id(0)
        split = tl.program_id(1)
        c_in = tl.arange(0, PADDED_IN)
        c_out = tl.arange(0, PADDED_OUT)
        sums = tl.zeros((PADDED_IN, PADDED_OUT), tl.float32)
        for first in range(split * ROWS, number, SPLITS * ROWS):
            row = first + tl.arange(0, ROWS)
            at = tl.load(table + k * number + row, mask=row < number, other=-1)
            if tl.max(at, axis=0) >= 0:
                there = (at >= 0)[:, None]
                place = at.to(tl.int64)[:, None] * C_IN + c_in[None, :]
                x = tl.load(features + place, mask=there & (c_in < C_IN)[None, :], other=0.0)
                place = row.to(tl.int64)[:, None] * C_OUT + c_out[None, :]
                g = tl.load(gradient + place, mask=there & (c_out < C_OUT)[None, :], other=0.0)
                sums += tl.dot(tl.trans(x), g, input_precision=PRECISION)
        place = ((split * OFFSETS + k) * C_IN + c_in)[:, None] * C_OUT + c_out[None, :]
        tl.store(parts + place, sums, mask=(c_in < C_IN)[:, None] & (c_out < C_OUT)[None, :])

    @triton.jit  # type: ignore[untyped-decorator]
    def _attention(  # type: ignore[no-untyped-def]  # pragma: no cover
        projected,
        voxel,
        repeats,
        out,
        scale,
        SIZE: tl.constexpr,
        PADDED_SIZE: tl.constexpr,
        WIDTH: tl.constexpr,
        HEAD: tl.constexpr,
        PADDED_HEAD: tl.constexpr,
        PRECISION: tl.constexpr,
    ):
        # One program computes one head of one set.
        slot = tl.arange(0, PADDED_SIZE)
        c = tl.arange(0, PADDED_HEAD)
        first = tl.program_id(0).to(tl.int64) * SIZE
        repeated = tl.load(repeats + first + slot, mask=slot < SIZE, other=1)
        once = repeated == 0
        row = tl.load(voxel + first + slot, mask=once, other=0)
        mask = once[:, None] & (c < HEAD)[None, :]
        place = row[:, None] * (3 * WIDTH) + tl.program_id(1) * HEAD + c[None, :]
        q = tl.load(projected + place, mask=mask, other=0.0)
        k = tl.load(projected + place + WIDTH, mask=mask, other=0.0)
        v = tl.load(projected + place + 2 * WIDTH, mask=mask, other=0.0)
        scores = tl.dot(q, tl.trans(k), input_precision=PRECISION) * scale
        scores = tl.where(once[None, :], scores, -float("inf"))
        weights = tl.exp(scores - tl.max(scores, axis=1)[:, None])
        weights = weights / tl.sum(weights, axis=1)[:, None]
        result = tl.dot(weights.to(v.dtype), v, input_precision=PRECISION)
        place = row[:, None] * WIDTH + tl.program_id(1) * HEAD + c[None, :]
        tl.store(out + place, result.to(out.dtype.element_ty), mask=mask)

    @triton.jit  # type: ignore[untyped-decorator]
    def _attention_backward(  # type: ignore[no-untyped-def]  # pragma: no cover
        projected,
        voxel,
        repeats,
        gradient,
        out,
        scale,
        SIZE: tl.constexpr,
        PADDED_SIZE: tl.constexpr,
        WIDTH: tl.constexpr,
        HEAD: tl.constexpr,
        PADDED_HEAD: tl.constexpr,
        PRECISION: tl.constexpr,
    ):
        # The attention weights are computed again, which is faster than reading them.
        slot = tl.arange(0, PADDED_SIZE)
        c = tl.arange(0, PADDED_HEAD)
        first = tl.program_id(0).to(tl.int64) * SIZE
        repeated = tl.load(repeats + first + slot, mask=slot < SIZE, other=1)
        once = repeated == 0
        row = tl.load(voxel + first + slot, mask=once, other=0)
        mask = once[:, None] & (c < HEAD)[None, :]
        place = row[:, None] * (3 * WIDTH) + tl.program_id(1) * HEAD + c[None, :]
        q = tl.load(projected + place, mask=mask, other=0.0)
        k = tl.load(projected + place + WIDTH, mask=mask, other=0.0)
        v = tl.load(projected + place + 2 * WIDTH, mask=mask, other=0.0)
        at = row[:, None] * WIDTH + tl.program_id(1) * HEAD + c[None, :]
        g = tl.load(gradient + at, mask=mask, other=0.0)
        scores = tl.dot(q, tl.trans(k), input_precision=PRECISION) * scale
        scores = tl.where(once[None, :], scores, -float("inf"))
        weights = tl.exp(scores - tl.max(scores, axis=1)[:, None])
        weights = weights / tl.sum(weights, axis=1)[:, None]
        to_v = tl.dot(tl.trans(weights).to(g.dtype), g, input_precision=PRECISION)
        to_weights = tl.dot(g, tl.trans(v), input_precision=PRECISION)
        mean = tl.sum(weights * to_weights, axis=1)
        to_scores = (weights * (to_weights - mean[:, None]) * scale).to(q.dtype)
        to_q = tl.dot(to_scores, k, input_precision=PRECISION)
        to_k = tl.dot(tl.trans(to_scores), q, input_precision=PRECISION)
        tl.store(out + place, to_q.to(out.dtype.element_ty), mask=mask)
        tl.store(out + place + WIDTH, to_k.to(out.dtype.element_ty), mask=mask)
        tl.store(out + place + 2 * WIDTH, to_v.to(out.dtype.element_ty), mask=mask)

    @triton.jit  # type: ignore[untyped-decorator]
    def _most(  # type: ignore[no-untyped-def]  # pragma: no cover
        x,
        starts,
        out,
        rows,
        number,
        C: tl.constexpr,
        PADDED: tl.constexpr,
        GROUPS: tl.constexpr,
    ):
        # One program computes the maxima of GROUPS groups of adjacent rows.
        group = tl.program_id(0) * GROUPS + tl.arange(0, GROUPS)
        c = tl.arange(0, PADDED)
        start = tl.load(starts + group, mask=group < number, other=0)
        end = tl.load(starts + group + 1, mask=group < number, other=0)
        best = tl.zeros((GROUPS, PADDED), tl.float32)
        best_row = tl.full((GROUPS, PADDED), -1, tl.int64)
        for j in range(0, tl.max(end - start, axis=0)):
            row = start + j
            mask = (row < end)[:, None] & (c < C)[None, :]
            value = tl.load(x + row[:, None] * C + c[None, :], mask=mask, other=0.0)
            higher = value.to(tl.float32) > best
            best = tl.where(higher, value.to(tl.float32), best)
            best_row = tl.where(higher, row[:, None], best_row)
        place = group.to(tl.int64)[:, None] * C + c[None, :]
        mask = (group < number)[:, None] & (c < C)[None, :]
        tl.store(out + place, best.to(out.dtype.element_ty), mask=mask)
        tl.store(rows + place, best_row, mask=mask)


def usable(tensor: Tensor) -> bool:
    """Returns whether the kernels support the device and type of a tensor (not float64)."""
    return enabled and tensor.dtype != torch.float64 and triton_kernels.usable(tensor)


def convolve(features: Tensor, weight: Tensor, table: Tensor) -> Tensor:
    """Returns sums (m, c_out) over offsets k of features[table[k]] @ weight[k].

    features: (n, c_in). weight: (offsets, c_in, c_out). table: (offsets, m) int32 rows of features,
    -1 for none.
    """
    offsets, c_in, c_out = weight.shape
    number = table.shape[1]
    out = features.new_empty(number, c_out)
    if number:
        _convolve[(triton.cdiv(number, ROWS),)](
            features.contiguous(),
            weight.contiguous(),
            table,
            out,
            number,
            OFFSETS=offsets,
            C_IN=c_in,
            C_OUT=c_out,
            PADDED_IN=_padded(c_in),
            PADDED_OUT=_padded(c_out),
            ROWS=ROWS,
            PRECISION=_precision(),
        )
    return out


def gradient_of_weights(features: Tensor, gradient: Tensor, table: Tensor) -> Tensor:
    """Returns the gradient (offsets, c_in, c_out) of the weights of `convolve`.

    gradient: (m, c_out) of the sums.
    """
    offsets, c_in, c_out = len(table), features.shape[1], gradient.shape[1]
    parts = torch.empty(SPLITS, offsets, c_in, c_out, device=features.device)
    _weights[(offsets, SPLITS)](
        features.contiguous(),
        gradient.contiguous(),
        table,
        parts,
        table.shape[1],
        OFFSETS=offsets,
        C_IN=c_in,
        C_OUT=c_out,
        PADDED_IN=_padded(c_in),
        PADDED_OUT=_padded(c_out),
        ROWS=ROWS,
        SPLITS=SPLITS,
        PRECISION=_precision(),
    )
    return parts.sum(dim=0).to(features.dtype)


def set_attention(projected: Tensor, voxel: Tensor, repeats: Tensor, heads: int) -> Tensor:
    """Returns the attention (n, width) of voxels to the voxels of their set.

    projected: (n, 3 * width) queries, keys and values. voxel, repeats: (s, size), as in `Sets`.
    """
    result: Tensor = _SetAttention.apply(projected, voxel, repeats, heads)  # type: ignore[no-untyped-call]
    return result


class _SetAttention(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, projected: Tensor, voxel: Tensor, repeats: Tensor, heads: int) -> Tensor:
        projected, hidden = projected.contiguous(), repeats.to(torch.int8)
        ctx.save_for_backward(projected, voxel, hidden)
        ctx.heads = heads
        out = projected.new_empty(len(projected), projected.shape[1] // 3)
        _attention[(len(voxel), heads)](projected, voxel, hidden, out, **_sizes(out, voxel, heads))
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        projected, voxel, hidden = ctx.saved_tensors
        gradient, out = gradients[0].contiguous(), torch.empty_like(projected)
        _attention_backward[(len(voxel), ctx.heads)](
            projected, voxel, hidden, gradient, out, **_sizes(gradient, voxel, ctx.heads)
        )
        return out, None, None, None


def most_of_groups(x: Tensor, owners: Tensor, groups: int) -> Tensor:
    """Returns the maximum of each feature over the rows of a group: (groups, c).

    x: (n, c), not negative. owners: (n,) int64 group of each row, ascending. A group without rows
    has zeros.
    """
    result: Tensor = _MostOfGroups.apply(x, owners, groups)  # type: ignore[no-untyped-call]
    return result


class _MostOfGroups(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, owners: Tensor, groups: int) -> Tensor:
        channels = x.shape[1]
        starts = torch.searchsorted(owners, torch.arange(groups + 1, device=x.device))
        out = x.new_empty(groups, channels)
        rows = torch.empty(groups, channels, dtype=torch.int64, device=x.device)
        if groups:
            _most[(triton.cdiv(groups, 16),)](
                x.contiguous(), starts, out, rows, groups, channels, _padded(channels), 16
            )
        ctx.save_for_backward(rows)
        ctx.number = len(x)
        return out

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        rows, gradient = ctx.saved_tensors[0], gradients[0]
        # The added last row receives the gradients of zeros that belong to no row of x.
        result = gradient.new_zeros(ctx.number + 1, gradient.shape[1])
        result.scatter_(0, torch.where(rows < 0, ctx.number, rows), gradient)
        return result[: ctx.number], None, None


def _sizes(attended: Tensor, voxel: Tensor, heads: int) -> dict[str, Any]:
    width, size = attended.shape[1], voxel.shape[1]
    head = width // heads
    return {
        "scale": head**-0.5,
        "SIZE": size,
        "PADDED_SIZE": _padded(size),
        "WIDTH": width,
        "HEAD": head,
        "PADDED_HEAD": _padded(head),
        "PRECISION": _precision(),
    }


def _padded(channels: int) -> int:
    """Returns the next power of two; products have at least 16 rows and columns."""
    return max(16, int(triton.next_power_of_2(channels)))


def _precision() -> str:
    """Returns the precision of float32 products: the one that is set for PyTorch's products."""
    return "ieee" if torch.get_float32_matmul_precision() == "highest" else "tf32"
