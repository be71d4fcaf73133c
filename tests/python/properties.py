"""Runs property-based tests of readers. The examples are always the same, except in `make fuzz`."""

import os
import time
from collections.abc import Callable

from hypothesis import HealthCheck, settings

SECONDS = float(os.environ.get("FUZZ_SECONDS", "0"))
EXAMPLES = 200 if SECONDS else 40
LIMIT_S = 300 + 2 * SECONDS  # limit for one test


def tried(examples: Callable[..., None], most: int = EXAMPLES) -> None:
    """Runs a property under @given, for FUZZ_SECONDS if this variable is set."""
    run = settings(
        max_examples=most,
        deadline=None,
        derandomize=not SECONDS,
        database=None,
        suppress_health_check=list(HealthCheck),
    )(examples)
    end = time.monotonic() + SECONDS
    run()
    while time.monotonic() < end:
        run()
