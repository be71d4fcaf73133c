"""Measures the CPU load of other processes during a timing."""

import math
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

_TIMES = Path("/proc/stat")
_IDLE = (3, 4)  # columns of idle time in /proc/stat: idle, iowait
_COLUMNS = 8  # columns that are added up; they include the guest time, which later columns repeat


@dataclass
class OtherLoad:
    """The mean number of cores that other processes used during a block; NaN if unknown."""

    cores: float = math.nan

    @property
    def text(self) -> str:
        return load_text([self.cores])


@contextmanager
def other_load() -> Iterator[OtherLoad]:
    """Measures the load by other processes during a block. The result is set at the block's end."""
    load = OtherLoad()
    started, busy, process_s = time.perf_counter(), _busy_seconds(), time.process_time()
    yield load
    wall = time.perf_counter() - started
    others = (_busy_seconds() - busy) - (time.process_time() - process_s)
    if not math.isnan(others):  # the load is clipped, because the CPU clock is coarse
        load.cores = min(max(0.0, others / wall), float(os.cpu_count() or math.inf))


def _busy_seconds() -> float:
    """Returns the CPU seconds of all processes since boot; NaN on a system without /proc/stat."""
    try:
        words = _TIMES.read_text(encoding="ascii").split("\n", 1)[0].split()[1 : 1 + _COLUMNS]
        ticks = [int(word) for at, word in enumerate(words) if at not in _IDLE]
        return sum(ticks) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError):
        return math.nan


def load_text(cores: Sequence[float]) -> str:
    """Returns a text that describes the loads during timings."""
    if any(map(math.isnan, cores)) or not cores:
        return "the load of the machine was not recorded"
    low, high = (f"{end(cores):.1f}" for end in (min, max))
    span = low if low == high else f"{low} to {high}"
    return f"other processes used {span} cores"
