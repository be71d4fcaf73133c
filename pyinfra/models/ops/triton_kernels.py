"""Farthest point sampling and search in balls on a GPU, in Triton.

Each function has an equivalent in PyTorch in clouds.py; tests compare both. PyTorch's CUDA builds
for Linux bring Triton, which compiles the kernels at their first use.
"""

import os

import numpy as np
import torch
from torch import Tensor

try:
    import triton
    import triton.language as tl
except ImportError:  # PyTorch for CPUs and some systems have no Triton
    triton = None


def usable(tensor: Tensor) -> bool:
    """Returns whether the kernels run on the device of a tensor."""
    return enabled and (tensor.device.type == "cuda" or INTERPRETED)


enabled = triton is not None  # if False, the PyTorch functions are used
# Products and sums are rounded one by one, so that the kernels and PyTorch choose the same points.
ROUNDING = {"enable_fp_fusion": False}
INTERPRETED = os.environ.get("TRITON_INTERPRET") == "1"  # Triton's own variable, for tests on a CPU

if triton is not None:

    @triton.jit  # type: ignore[untyped-decorator]
    def _farthest(  # type: ignore[no-untyped-def]  # pragma: no cover
        x, y, z, starts, counts, aparts, chosen, most, LANES: tl.constexpr
    ):
        # One program handles one cloud. `aparts` has the distance of each point to the
        # nearest chosen point.
        cloud = tl.program_id(0)
        start = tl.load(starts + cloud)
        count = tl.load(counts + cloud).to(tl.int32)
        lanes = tl.arange(0, LANES)
        last = 0
        steps = tl.where(count > 0, most, 0)
        for k in range(0, steps):
            tl.store(chosen + cloud * most + k, start + last)
            at_x = tl.load(x + start + last)
            at_y = tl.load(y + start + last)
            at_z = tl.load(z + start + last)
            # Each lane keeps its farthest point, so that lanes are compared once per chosen point.
            farthest = tl.full((LANES,), -1.0, tl.float32)
            farthest_row = tl.zeros((LANES,), tl.int32)
            for first in range(0, count, LANES):
                row = first + lanes
                inside = row < count
                dx = tl.load(x + start + row, mask=inside, other=0.0) - at_x
                dy = tl.load(y + start + row, mask=inside, other=0.0) - at_y
                dz = tl.load(z + start + row, mask=inside, other=0.0) - at_z
                apart = tl.load(aparts + start + row, mask=inside, other=0.0)
                apart = tl.minimum(apart, dx * dx + dy * dy + dz * dz)
                tl.store(aparts + start + row, apart, mask=inside)
                farther = inside & (apart > farthest)
                farthest = tl.where(farther, apart, farthest)
                farthest_row = tl.where(farther, row, farthest_row)
            ties = farthest == tl.max(farthest, axis=0)
            last = tl.min(tl.where(ties, farthest_row, 2147483647), axis=0)

    @triton.jit  # type: ignore[untyped-decorator]
    def _first_near(  # type: ignore[no-untyped-def]  # pragma: no cover
        x,
        y,
        z,
        centres,
        begins,
        ends,
        rows,
        limit,
        number,
        most,
        MIDDLES: tl.constexpr,
        LANES: tl.constexpr,
    ):
        # One program handles MIDDLES centres, and stops when all of them have `most` points.
        middle = tl.program_id(0) * MIDDLES + tl.arange(0, MIDDLES)
        exists = middle < number
        at_x = tl.load(centres + middle * 3, mask=exists, other=0.0)[:, None]
        at_y = tl.load(centres + middle * 3 + 1, mask=exists, other=0.0)[:, None]
        at_z = tl.load(centres + middle * 3 + 2, mask=exists, other=0.0)[:, None]
        # A missing centre counts as complete, so that the program can stop.
        begin = tl.load(begins + middle, mask=exists, other=9223372036854775807)
        end = tl.load(ends + middle, mask=exists, other=0)
        held = tl.where(exists, 0, most)
        first = tl.min(begin, axis=0)
        stop = tl.max(end, axis=0)
        while (first < stop) & (tl.min(held, axis=0) < most):
            row = first + tl.arange(0, LANES)
            inside = row < stop
            dx = tl.load(x + row, mask=inside, other=0.0)[None, :] - at_x
            dy = tl.load(y + row, mask=inside, other=0.0)[None, :] - at_y
            dz = tl.load(z + row, mask=inside, other=0.0)[None, :] - at_z
            near = dx * dx + dy * dy + dz * dz < limit
            near = near & (row[None, :] >= begin[:, None]) & (row[None, :] < end[:, None])
            hit = near.to(tl.int32)
            nth = held[:, None] + tl.cumsum(hit, axis=1) - 1
            place = middle[:, None].to(tl.int64) * most + nth
            value = tl.broadcast_to(row[None, :], (MIDDLES, LANES))
            tl.store(rows + place, value, mask=near & (nth < most))
            held += tl.sum(hit, axis=1)
            first += LANES


def farthest(xyz: Tensor, counts: Tensor, most: int) -> Tensor:
    """Returns the same rows (clouds, most) as `clouds._farthest_of_all`.

    xyz: (n, 3) float32. counts: (clouds,) int64.
    """
    starts = counts.cumsum(0) - counts
    rows = torch.arange(most, device=xyz.device) + starts[:, None]
    if len(counts) == 0 or most == 0 or len(xyz) == 0:
        return rows
    columns, apart = xyz.t().contiguous(), torch.full_like(xyz[:, 0], torch.inf)
    # A cloud with few points keeps all of them, so its program has nothing to do.
    large = torch.where(counts > most, counts, 0)
    chosen = torch.empty_like(rows)
    lanes = 512 if len(counts) > 64 else 4096
    _farthest[(len(counts),)](
        *columns.unbind(0),
        starts,
        large,
        apart,
        chosen,
        most,
        LANES=lanes,
        num_warps=lanes // 256,
        **ROUNDING,
    )
    return torch.where(counts[:, None] > most, chosen, rows)


def first_near(
    xyz: Tensor, counts: Tensor, centres: Tensor, cloud: Tensor, radius: float, most: int
) -> Tensor:
    """Returns the first `most` rows of xyz near each centre: (m, most), -1 for none.

    xyz: (n, 3) float32. counts: (clouds,) int64. centres: (m, 3). cloud: (m,) cloud of each centre,
    ascending.
    """
    rows = torch.full((len(centres), most), -1, dtype=torch.int64, device=xyz.device)
    if len(centres) == 0 or len(xyz) == 0:
        return rows
    end = counts.cumsum(0)
    begins, ends = (end - counts)[cloud], end[cloud]
    middles = 16
    _first_near[(triton.cdiv(len(centres), middles),)](
        *xyz.t().contiguous().unbind(0),
        centres.contiguous(),
        begins,
        ends,
        rows,
        float(np.float32(radius) ** 2),
        len(centres),
        most,
        MIDDLES=middles,
        LANES=128,
        **ROUNDING,
    )
    return rows
