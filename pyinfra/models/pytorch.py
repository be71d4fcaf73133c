"""Whether PyTorch is installed: it trains networks, and runs all but one of them."""

from importlib.util import find_spec

from pyinfra.core.errors import missing


def need_pytorch() -> None:
    """Raises MissingPackage if PyTorch is not installed."""
    if find_spec("torch") is None:
        raise missing("torch", "train")
