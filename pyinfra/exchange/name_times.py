"""Reads the times of frames from the names of their files.

Names hold seconds since 1970 and a fraction, such as 1651673050.454284, 1651673050_454284855 or
1651673050454. Some programs write the fraction without leading zeros, so that 054284855
nanoseconds become 54284855. The names of a recording together show this.
"""

import re
from collections.abc import Sequence

import numpy as np

from pyinfra.core.arrays import FloatArray

# Maps the number of digits of the longest fraction of a second to the unit of all fractions.
UNITS = {0: 1.0, 3: 1e-3, 6: 1e-6, 9: 1e-9}
EARLIEST_S, LATEST_S = 1e8, 1e11  # plausible seconds since 1970
REGULAR = (0.5, 1.5)  # range of regular steps, relative to the median step


def times_in(names: Sequence[str]) -> FloatArray | None:
    """Returns the time (n,) in each name in seconds since 1970, or None if a name has no time.

    A name must begin with a time; a prefix without digits is allowed before it. A frame number with
    many zeros before it, such as 0000000007 in KITTI's raw data, is no time.
    """
    parts = [_parts(name) for name in names]
    if not parts or None in parts:
        return None
    found = [part for part in parts if part is not None]
    whole = np.array([int(seconds) for seconds, _, _ in found], dtype=np.float64)
    if not ((whole > EARLIEST_S) & (whole < LATEST_S)).all():
        return None
    lengths = {len(digits) for _, _, digits in found}
    unit = UNITS.get(max(lengths))
    counted = None if unit is None else whole + [int(d or 0) * unit for _, _, d in found]
    if any(separator == "." for _, separator, _ in found):
        decimal = whole + [float(f"0.{digits or 0}") for _, _, digits in found]
        varies = len(lengths) > 1 and counted is not None
        return counted if varies and regularity(counted) > regularity(decimal) else decimal
    if counted is None and all(separator == "-" for _, separator, _ in found):
        return whole  # the number after the time has another meaning, such as a sensor number
    return counted


def regularity(times: FloatArray | None) -> float:
    """Returns the share of the steps between sorted times that are close to the median step."""
    steps = np.diff(np.sort(times)) if times is not None else np.empty(0)
    return share_regular(steps) if len(steps) >= 2 else 0.0


def share_regular(steps: FloatArray) -> float:
    """Returns the share of the steps that are close to the median step."""
    usual = float(np.median(steps))
    return float(((steps > REGULAR[0] * usual) & (steps < REGULAR[1] * usual)).mean())


def _parts(name: str) -> tuple[str, str, str] | None:
    """Returns the digits of whole seconds, the separator and the digits of the fraction."""
    match = re.match(r"\D*(\d{10})(?:([._-])(\d+))?(?!\d)", name)
    if match is None:
        match = re.match(r"\D*(\d{10})()(\d{1,9})(?!\d)", name)
    return (match[1], match[2] or "", match[3] or "") if match else None
