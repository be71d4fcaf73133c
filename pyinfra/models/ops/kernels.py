"""The compiled extension, or None where it is not built; then torch does its work."""

from __future__ import annotations

from types import ModuleType

kernels: ModuleType | None
try:
    from pyinfra import _core as kernels
except ImportError:
    kernels = None
