"""The requirements of a user on the options of a benchmark."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.windows import REGION_M
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY

FRAME_MS = 1000 * PERIOD_S  # assumed frame period of a LiDAR whose table has none


def frame_ms(lidars: pd.DataFrame, lidar: str, preset: str) -> float:
    """Returns the frame period of a LiDAR from the table `lidars`, in ms."""
    if lidars.empty:
        return FRAME_MS
    rows = lidars[(lidars.lidar == lidar) & (lidars.preset == preset)].period_s.dropna()
    return 1000 * float(rows.iloc[0]) if len(rows) else FRAME_MS


# No detector takes less than 1 ms per frame, so a lower limit is probably in seconds.
LEAST_LATENCY_MS = 1.0


@dataclass(frozen=True)
class Requirements:
    """Requirements of a user."""

    budget_usd: float = math.inf  # maximum price of the LiDAR and the site together
    # Minimum AP of all vehicles, 0 to 100. A road is covered where AP exceeds min_ap.
    min_ap: float = HIGH_QUALITY
    range_m: float = REGION_M  # distance to either side within which AP and coverage are computed
    # Maximum median time per frame. None stands for the frame period of the LiDAR, because a
    # slower detector cannot process all frames.
    latency_ms: float | None = None

    def limit_ms(self, frame_ms: float) -> float:
        """Returns the maximum median time per frame, in ms, for a LiDAR with this frame period."""
        return frame_ms if self.latency_ms is None else self.latency_ms

    def limits_text(self, frames_ms: Iterable[float]) -> str:
        """Returns the maximum median times per frame as text, for LiDARs with these periods."""
        limits = sorted({self.limit_ms(frame_ms) for frame_ms in frames_ms})
        return " or ".join(f"{limit:g}" for limit in limits) + " ms"


def unlike(value: float, limit: float, digits: int) -> str:
    """Returns `value` as text, with more decimal places if it would look equal to `limit`."""
    text = f"{value:,.{digits}f}"
    is_alike = text == f"{limit:,.{digits}f}" and digits < 4
    return unlike(value, limit, digits + 1) if is_alike else text


def place_of(range_m: float) -> str:
    """Returns the place of the vehicles within a range in words, such as `within 50 m`."""
    return "in the whole region" if range_m >= REGION_M else f"within {range_m:g} m"


def checked_requirements(
    budget_usd: float, min_ap: float, range_m: float, latency_ms: float | None
) -> Requirements:
    """Returns the requirements. Raises Error for a number out of range."""
    for key, value, least, top in (
        ("budget_usd", budget_usd, 0, math.inf),
        ("min_ap", min_ap, 1, 100),
        ("range_m", range_m, 0, REGION_M),
        ("latency_ms", math.inf if latency_ms is None else latency_ms, 0, math.inf),
    ):
        if not least < value <= top:
            upper = f" and at most {top:g}" if top < math.inf else ""
            text = f"{key}: expected above {least}{upper}, got {value:g}"
            share = key == "min_ap" and 0 < value <= 1
            raise Error(f"{text}; AP is 0 to 100, not a share" if share else text)
    if latency_ms is not None and latency_ms < LEAST_LATENCY_MS:
        raise Error(
            f"latency_ms: expected milliseconds, {LEAST_LATENCY_MS:g} or more, got "
            f"{latency_ms:g}; {latency_ms:g} s are {1000 * latency_ms:g} ms"
        )
    return Requirements(budget_usd, min_ap, range_m, latency_ms)
