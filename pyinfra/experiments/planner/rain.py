"""What the options of a plan find in rain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pyinfra.experiments.planner.site import PlanSite, other_traffic
from pyinfra.metrics.comparison import Interval

RAIN_MM_PER_H = 25.0  # heavy rain
FRAMES = 24
WITH_WEATHER = "datasheet"  # the preset whose LiDARs detect by received power


def in_rain(site: PlanSite, frames: int) -> PlanSite:
    """Returns the site with other traffic and heavy rain.

    The rain takes points from the LiDARs. The detectability of an object with the same points is
    that of dry air.
    """
    wet = {"weather.rain_mm_per_h": RAIN_MM_PER_H}
    return other_traffic(site, min(frames, FRAMES), wet)


def rain_lines(recalls: Sequence[Interval]) -> Iterator[str]:
    """Yields what the first option finds in rain, and which other one finds more."""
    first, best = recalls[0].value, int(np.argmax([one.value for one in recalls]))
    text = f"In rain of {RAIN_MM_PER_H:g} mm/h the first option finds {100 * first:.0f} of 100"
    more = recalls[best].value
    if round(100 * more) > round(100 * first):
        text += f"; option {best + 1} finds most then, {100 * more:.0f}"
    yield f"{text}."
