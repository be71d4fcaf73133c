"""Estimates the length unit and the highest intensity of a recording's clouds."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import Floats
from pyinfra.core.errors import Error
from pyinfra.exchange.recording import Options

INTENSITIES_MAX = (1.0, 255.0, 4095.0, 65535.0)
BRIGHT_SHARE = 0.999  # quantile of the intensities that decides their scale
FARTHEST_MEDIAN_M = 400.0  # largest plausible median range of a roadside sensor, metres
NEAREST_MEDIAN_MM = 2000.0


def unit_of(source: Path, clouds: Sequence[Floats], options: Options) -> float:
    """Returns the length unit of the source in metres."""
    if options.unit_m != 1 or sum(map(len, clouds)) == 0:
        return options.unit_m
    slant = np.linalg.norm(np.concatenate([cloud[:, :3] for cloud in clouds]), axis=1)
    middle = float(np.median(slant))
    if middle <= FARTHEST_MEDIAN_M:
        return 1.0
    if middle >= NEAREST_MEDIAN_MM:
        return 1e-3
    raise Error(
        f"{source}: expected a median range of up to {FARTHEST_MEDIAN_M:g} for metres, or of at "
        f"least {NEAREST_MEDIAN_MM:g} for millimetres, got {middle:.0f}; `unit_m` sets the unit"
    )


def brightest_of(clouds: Sequence[Floats]) -> float:
    """Returns the intensity that only a few points exceed, or 0.

    If all intensities are whole numbers, and one is above 1, the result is at least 2, even if
    almost all points are dark. The intensities then do not count as shares of 1.
    """
    values = np.concatenate([np.empty(0), *(c[np.isfinite(c[:, 3]), 3] for c in clouds)])
    if len(values) == 0:
        return 0.0
    highest = float(values.max())
    bright = float(np.quantile(values, BRIGHT_SHARE, method="higher"))
    is_whole = highest > 1 and bool((np.abs(values - np.round(values)) < 1e-3).all())
    return max(bright, 2.0) if is_whole else bright


def usual_intensity_max(brightest: float) -> float:
    """Returns the smallest of INTENSITIES_MAX that is at least `brightest`.

    Returns 1 if `brightest` is above 65535.
    """
    brightest *= 1 - 1e-6  # tolerates rounding, because the value was divided and multiplied again
    return next((top for top in INTENSITIES_MAX if brightest <= top), 1.0)
