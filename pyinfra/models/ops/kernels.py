"""The compiled extension, or None if it is not installed. PyTorch code is then used instead."""

from __future__ import annotations

from types import ModuleType

kernels: ModuleType | None
try:
    from pyinfra import _core as kernels
except ImportError:
    kernels = None
