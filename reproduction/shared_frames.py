"""Frames in a working folder, which several experiments and processes use."""

import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pyinfra.core.files import held


def _lock(work: Path, frames: str) -> Path:
    return work / "locks" / f"frames_{frames}"


@contextmanager
def in_use(work: Path, frames: str) -> Iterator[None]:
    """Context manager in which no process removes frames. frames: the name of the frames."""
    with held(_lock(work, frames), wait=True, shared=True):
        yield


def remove(work: Path, frames: str, paths: Iterable[Path]) -> None:
    """Removes folders of frames, unless another process uses the frames."""
    with held(_lock(work, frames), wait=False) as unused:
        for path in paths if unused else ():
            if path.is_dir():
                shutil.rmtree(path)
