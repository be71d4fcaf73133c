"""The compiled extension, or None if it is not installed. PyTorch code is then used instead."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

kernels: ModuleType | None
try:
    from pyinfra import _core as kernels
except ImportError:
    kernels = None


def on_cpu(tensor: Tensor) -> bool:
    """Returns whether a tensor is in the memory of the CPU, which may then read its values.

    Reading a value of a tensor on a GPU makes the CPU wait until the GPU has computed it.
    """
    return tensor.device.type == "cpu"
