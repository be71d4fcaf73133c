"""Number of threads of a detector."""

from __future__ import annotations

import os

from pyinfra.core.errors import Error

MOST_THREADS = 4  # default on machines with more cores: a frame is too small for many


def checked_threads(threads: int | None) -> int:
    """Returns the number of threads, by default one per available core, at most MOST_THREADS.

    Raises Error for less than one.
    """
    if threads is None:
        return min(MOST_THREADS, len(os.sched_getaffinity(0)))
    if threads < 1:
        raise Error(f"threads: expected 1 or more, got {threads}")
    return threads
