"""How much of the machine other processes use, while something here is timed."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

_TIMES = Path("/proc/stat")
_IDLE = (3, 4)  # columns of /proc/stat: idle, iowait
_COLUMNS = 8  # the next ones, guests, are in the first already


@dataclass
class OtherLoad:
    """Cores that other processes used, on average over a block; NaN where it is not known."""

    cores: float = math.nan

    @property
    def text(self) -> str:
        return load_text([self.cores])


@contextmanager
def other_load() -> Iterator[OtherLoad]:
    """Measures the load of a block that runs in this process; known when the block has ended."""
    load = OtherLoad()
    started, busy, process_s = time.perf_counter(), _busy_seconds(), time.process_time()
    yield load
    wall = time.perf_counter() - started
    others = (_busy_seconds() - busy) - (time.process_time() - process_s)
    if not math.isnan(others):  # the clock of a short block is coarse
        load.cores = min(max(0.0, others / wall), float(os.cpu_count() or math.inf))


def _busy_seconds() -> float:
    """CPU seconds of all processes since the machine started; NaN on a system that keeps none."""
    try:
        words = _TIMES.read_text(encoding="ascii").split("\n", 1)[0].split()[1 : 1 + _COLUMNS]
        ticks = [int(word) for at, word in enumerate(words) if at not in _IDLE]
        return sum(ticks) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError):
        return math.nan


def load_text(cores: Sequence[float]) -> str:
    """In words under which loads something was timed."""
    if any(map(math.isnan, cores)) or not cores:
        return "the load of the machine was not recorded"
    low, high = (f"{end(cores):.1f}" for end in (min, max))
    span = low if low == high else f"{low} to {high}"
    return f"other processes used {span} cores"
