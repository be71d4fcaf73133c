"""Exclusive use of GPUs: no two experiments use the same GPU at the same time."""

import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pyinfra.core.files import held

POLL_S = 1.0


@contextmanager
def exclusive_gpu(device: str, folder: Path) -> Iterator[str]:
    """Yields the device to use: for `cuda` a free GPU of this machine, else `device` itself.

    Waits until a GPU is free. folder: folder of the lock files. All processes that share the GPUs
    must use the same folder.
    """
    names = visible() if device == "cuda" else []
    if not names:
        yield device
        return
    while True:
        for i, name in enumerate(names):
            with held(folder / f"gpu_{platform.node()}_{name}.lock", wait=False) as ours:
                if ours:
                    yield f"cuda:{i}"
                    return
        time.sleep(POLL_S)


def visible() -> list[str]:
    """Returns the names of the GPUs that this process may use, in PyTorch's order."""
    import torch

    count = torch.cuda.device_count()
    listed = os.environ.get("CUDA_VISIBLE_DEVICES", "")
    return listed.split(",")[:count] if listed else [str(i) for i in range(count)]
