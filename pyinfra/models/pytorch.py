"""Checks that PyTorch is installed. All trainings of networks need PyTorch.

All networks except centerpoint-pillar also need it for detection.
"""

from importlib.util import find_spec

from pyinfra.core.errors import missing


def need_pytorch() -> None:
    """Raises MissingPackage if PyTorch is not installed."""
    if find_spec("torch") is None:
        raise missing("torch", "train")
