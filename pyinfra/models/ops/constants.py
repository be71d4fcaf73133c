"""Creates small tensors directly on the device that uses them.

Copying numbers to a GPU makes the CPU wait until the GPU has finished its earlier work. Therefore
constants are copied once, and numbers of a batch are written by the GPU itself.
"""

from collections.abc import Sequence
from functools import lru_cache

import torch
from torch import Tensor


def constant(values: Sequence[float], like: Tensor, dtype: torch.dtype | None = None) -> Tensor:
    """Returns `values` as a tensor (n,) on the device of `like`, to be read only.

    dtype: by default that of `like`.
    """
    if torch.compiler.is_compiling():  # an exported program has its own constants
        return torch.tensor(values, dtype=dtype or like.dtype, device=like.device)
    return _kept(tuple(values), dtype or like.dtype, like.device)


@lru_cache(maxsize=1024)
@torch.inference_mode(False)
def _kept(values: tuple[float, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    return torch.tensor(values, dtype=dtype, device=device)


def numbers(values: Sequence[int], device: torch.device) -> Tensor:
    """Returns a few integers that differ from batch to batch as a tensor (n,) int64."""
    parts = [torch.full((1,), value, device=device) for value in values]
    return torch.cat([torch.zeros(0, dtype=torch.int64, device=device), *parts])


def owners(counts: Sequence[int], device: torch.device) -> Tensor:
    """Returns the number i, counts[i] times for each i: (sum(counts),) int64."""
    parts = [torch.full((count,), i, device=device) for i, count in enumerate(counts)]
    return torch.cat([torch.zeros(0, dtype=torch.int64, device=device), *parts])
