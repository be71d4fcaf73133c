"""Figures with their bootstrap replicates, and the differences between figures.

All LiDARs and detectors that are evaluated on the same traffic use the same blocks of time. A
difference is taken in each replicate, so that the effect of the traffic on both figures cancels
out. The difference of two figures is not significant if its interval includes 0, or if it has no
interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.present import Presented
from pyinfra.metrics import intervals


@dataclass(frozen=True, repr=False)
class Interval(Presented):
    """A figure and its 95 % interval. Both ends are NaN if the interval is unknown."""

    value: float
    low: float
    high: float

    def facts(self) -> dict[str, object]:
        return dict(vars(self))

    @property
    def is_known(self) -> bool:
        """Whether the interval is known."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def is_significant(self) -> bool:
        """Whether a difference is significant: its interval excludes 0."""
        return self.low > 0 or self.high < 0


UNKNOWN = Interval(math.nan, math.nan, math.nan)


def columns_of(name: str, figure: Interval, factor: float = 1) -> dict[str, float]:
    """Returns the columns of a table for a figure times a factor, with its interval."""
    return {
        name: factor * figure.value,
        f"{name}_low": factor * figure.low,
        f"{name}_high": factor * figure.high,
    }


@dataclass(frozen=True, eq=False)
class Bootstrapped:
    """A figure with its bootstrap replicates."""

    value: float
    replicates: FloatArray  # (d,) value of the figure in each replicate; NaN where undefined
    blocks: float  # number of time blocks in the evaluated frames

    def less(self, other: Bootstrapped) -> Bootstrapped:
        """Returns this figure minus another figure with replicates of the same blocks."""
        return Bootstrapped(
            self.value - other.value, self.replicates - other.replicates, self.blocks
        )

    def measured(self) -> Interval:
        low, high = intervals.interval(np.array(self.value), self.replicates, self.blocks)
        return Interval(self.value, float(low), float(high))


def mean_of(figures: Sequence[Bootstrapped]) -> Bootstrapped:
    """Returns the mean of figures with replicates of the same blocks."""
    value = float(np.mean([one.value for one in figures]))
    return Bootstrapped(value, np.mean([one.replicates for one in figures], 0), figures[0].blocks)


def clipped(figure: Interval, low: float, high: float) -> Interval:
    """Returns a figure whose ends are clipped to a range. Unknown ends stay NaN."""
    ends = np.clip([figure.low, figure.high], low, high).tolist()
    return Interval(figure.value, *ends)


def over_replicates(per_seed: Sequence[float], level: float = intervals.LEVEL) -> Interval:
    """Returns the mean of a figure over seeds, with Student's t interval at confidence `level`.

    The seeds must be independent: each seed has its own traffic and training
    (`replicates.over_seeds` checks the traffic). Both ends are NaN for fewer than two seeds.
    """
    values = np.asarray(per_seed, dtype=np.float64)
    if len(values) < 2:
        return Interval(float(values.mean()) if len(values) else math.nan, math.nan, math.nan)
    error = float(values.std(ddof=1)) / math.sqrt(len(values))
    mean, half = float(values.mean()), error * intervals.student(len(values), level)
    return Interval(mean, mean - half, mean + half)
