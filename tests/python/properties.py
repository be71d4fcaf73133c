"""How property-based tests of readers are run: always the same here, others in `make fuzz`."""

import os
import time
from collections.abc import Callable

from hypothesis import HealthCheck, settings

SECONDS = float(os.environ.get("FUZZ_SECONDS", "0"))
EXAMPLES = 200 if SECONDS else 40
LIMIT_S = 300 + 2 * SECONDS  # of a test


def tried(examples: Callable[..., None], most: int = EXAMPLES) -> None:
    """A property under @given, also for FUZZ_SECONDS."""
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
