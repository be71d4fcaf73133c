"""The requirements of a user on the options of a benchmark."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pyinfra.core.errors import Error
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.windows import REGION_M
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY

FRAME_MS = 1000 * PERIOD_S  # a detector that takes longer per frame is slower than its LiDAR

# No detector is faster than this, so that a smaller number is probably in seconds.
LEAST_LATENCY_MS = 1.0


@dataclass(frozen=True)
class Requirements:
    """Requirements of a user."""

    budget_usd: float = math.inf  # highest price of LiDAR and site
    # Lowest AP of all vehicles, 0 to 100. Road counts as covered where AP is above it.
    min_ap: float = HIGH_QUALITY
    range_m: float = REGION_M  # range within which AP and coverage are computed, to either side
    latency_ms: float = FRAME_MS  # longest median time per frame


def unlike(value: float, limit: float, digits: int) -> str:
    """Returns a number that misses a limit as text, with more digits if it would round to it."""
    text = f"{value:,.{digits}f}"
    is_alike = text == f"{limit:,.{digits}f}" and digits < 4
    return unlike(value, limit, digits + 1) if is_alike else text


def place_of(range_m: float) -> str:
    """Returns in words where vehicles count for a range."""
    return "in the whole region" if range_m >= REGION_M else f"within {range_m:g} m"


def checked_requirements(
    budget_usd: float, min_ap: float, range_m: float, latency_ms: float
) -> Requirements:
    """Returns the requirements. Raises Error for a number out of range."""
    for key, value, least, top in (
        ("budget_usd", budget_usd, 0, math.inf),
        ("min_ap", min_ap, 1, 100),
        ("range_m", range_m, 0, REGION_M),
        ("latency_ms", latency_ms, 0, math.inf),
    ):
        if not least < value <= top:
            upper = f" to {top:g}" if top < math.inf else ""
            text = f"{key}: expected above {least}{upper}, got {value:g}"
            share = key == "min_ap" and 0 < value <= 1
            raise Error(f"{text}; AP is 0 to 100, not a share" if share else text)
    if latency_ms < LEAST_LATENCY_MS:
        raise Error(
            f"latency_ms: expected milliseconds, {LEAST_LATENCY_MS:g} or more, got "
            f"{latency_ms:g}; {latency_ms:g} s are {1000 * latency_ms:g} ms"
        )
    return Requirements(budget_usd, min_ap, range_m, latency_ms)
