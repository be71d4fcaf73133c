"""Figures with intervals, and what can be said of two of them."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Measured:
    """A figure with the ends of its 95 % interval; NaN without one."""

    value: float
    low: float
    high: float

    def less(self, other: Measured) -> Measured:
        """The difference, as if the two were independent."""
        value = self.value - other.value
        down = math.hypot(self.value - self.low, other.high - other.value)
        up = math.hypot(self.high - self.value, other.value - other.low)
        return Measured(value, value - down, value + up)

    def times(self, factor: float) -> Measured:
        return Measured(self.value * factor, self.low * factor, self.high * factor)

    def over(self, other: Measured) -> Measured:
        """The ratio of two positive figures, as if the two were independent."""
        logs = [
            Measured(*(math.log(max(v, 1e-9)) for v in (f.value, f.low, f.high)))
            for f in (self, other)
        ]
        found = logs[0].less(logs[1])
        high = math.exp(found.high) if other.low > 0 else math.inf
        return Measured(math.exp(found.value), math.exp(found.low), high)
