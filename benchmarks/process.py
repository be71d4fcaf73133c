"""Measures the time and memory of a command, which a small launcher process starts.

Linux includes the memory of the starting process in a command's peak memory. A benchmark that uses
hundreds of megabytes must therefore not start the command itself.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

LAUNCHER = """
import json, resource, subprocess, sys, time
start = time.perf_counter()
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
wall_s = time.perf_counter() - start
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([code, wall_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""


@dataclass(frozen=True)
class Cost:
    wall_s: float
    cpu_s: float
    peak_mb: float  # at least 10 MB, which is the memory of the launcher


def run(command: Sequence[object], **how: object) -> Cost:
    """Runs a command and returns its cost.

    Raises RuntimeError if the command fails.

    Parameters
    ----------
    how : keyword arguments of subprocess.run
    """
    words = [sys.executable, "-S", "-c", LAUNCHER, *map(str, command)]
    done = subprocess.run(words, check=True, capture_output=True, text=True, **how)  # type: ignore[call-overload]
    code, *cost = json.loads(done.stdout)
    if code != 0:
        raise RuntimeError(f"{' '.join(map(str, command))}: exit status {code}: {done.stderr}")
    return Cost(*cost)
