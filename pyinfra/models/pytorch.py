"""Checks that PyTorch is installed. Training needs it, and so do all networks but one."""

from importlib.util import find_spec

from pyinfra.core.errors import missing


def need_pytorch() -> None:
    """Raises MissingPackage if PyTorch is not installed."""
    if find_spec("torch") is None:
        raise missing("torch", "train")
