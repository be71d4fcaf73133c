"""Progress bar and throughput of an import or export."""

import time
from collections.abc import Iterator
from pathlib import Path

from pyinfra.core.progress import track


class Shown(list[int]):
    """Frame numbers whose iteration shows the progress on stderr."""

    def __iter__(self) -> Iterator[int]:
        return track(self[:], "frame")


def summary(frames: int, folder: Path, since: float) -> str:
    """Returns a text such as `100 frames, 12.3 MB in 1.5 s: 67 frames/s, 8 MB/s`.

    `since` is the value of time.perf_counter() at the start.
    """
    seconds = max(time.perf_counter() - since, 1e-9)
    megabytes = size_of(folder) / 1e6
    return (
        f"{frames} frames, {megabytes:.1f} MB in {seconds:.1f} s: "
        f"{frames / seconds:.0f} frames/s, {megabytes / seconds:.0f} MB/s"
    )


def size_of(folder: Path) -> int:
    """Returns the total size of all files in a folder in bytes."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
