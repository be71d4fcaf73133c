"""Checks the number of threads of a detector."""

import os

from pyinfra.core.errors import Error

MOST_THREADS = 4  # maximum default number of threads, because a frame is too small for more


def checked_threads(threads: int | None) -> int:
    """Returns `threads`, or by default one thread per available core, at most MOST_THREADS.

    Raises Error for less than one thread.
    """
    if threads is None:
        return min(MOST_THREADS, len(os.sched_getaffinity(0)))
    if threads < 1:
        raise Error(f"threads: expected 1 or more, got {threads}")
    return threads
