"""Figures with their draws, and what can be said of two of them.

The draws of blocks are the same for all LiDARs and detectors of a world, so a difference is taken
draw by draw: what the traffic does to both falls out of it. Two figures cannot be told apart where
the interval of their difference holds 0, or there is none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.metrics import intervals


@dataclass(frozen=True)
class Measured:
    """A figure with the ends of its 95 % interval; NaN without one."""

    value: float
    low: float
    high: float

    @property
    def is_known(self) -> bool:
        """Whether it has an interval."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def is_significant(self) -> bool:
        """Of a difference: whether the two can be told apart."""
        return self.low > 0 or self.high < 0


@dataclass(frozen=True, eq=False)
class Bootstrapped:
    """A figure and what it is in each draw of blocks."""

    value: float
    draws: FloatArray  # (d,) nan where it is not defined
    blocks: float  # how many the time holds

    def less(self, other: Bootstrapped) -> Bootstrapped:
        """The difference, of the same world."""
        return Bootstrapped(self.value - other.value, self.draws - other.draws, self.blocks)

    def times(self, factor: float) -> Bootstrapped:
        return Bootstrapped(self.value * factor, self.draws * factor, self.blocks)

    def over(self, other: Bootstrapped) -> Bootstrapped:
        """The ratio, of the same world."""
        both = np.append(self.draws, self.value), np.append(other.draws, other.value)
        *draws, value = intervals.ratio(*both)
        return Bootstrapped(float(value), np.array(draws), self.blocks)

    def measured(self) -> Measured:
        low, high = intervals.interval(np.array(self.value), self.draws, self.blocks)
        return Measured(self.value, float(low), float(high))


def over_seeds(values: Sequence[Bootstrapped]) -> Measured:
    """Of one seed by its blocks of time, of several by Student's t over the seeds."""
    return values[0].measured() if len(values) == 1 else over_worlds([v.value for v in values])


def over_worlds(per_seed: Sequence[float]) -> Measured:
    """The mean of a figure over replicates, each of another world and training: Student's."""
    values = np.asarray(per_seed, dtype=np.float64)
    if len(values) < 2:
        return Measured(float(values.mean()) if len(values) else math.nan, math.nan, math.nan)
    error = float(values.std(ddof=1)) / math.sqrt(len(values))
    mean, half = float(values.mean()), error * intervals.student(len(values))
    return Measured(mean, mean - half, mean + half)
