"""95 % intervals of figures over frames that are correlated in time.

Neighbouring frames show the same vehicles, so intervals use the circular block bootstrap (Politis
and Romano 1992). A bootstrap replicate consists of runs of one block length that begin at random
times. The time is circular: the first frame follows the last one. The standard deviation of a
figure over the replicates is its standard error. The interval is Student's t interval, with the
number of blocks as the number of samples. The block length is the mean time that a vehicle stays
in view (`block_seconds`), because errors are correlated over that time.
reproduction/commands/coverage.py measures how often these intervals include the true value.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from pyinfra.core.arrays import AnyArray, FloatArray, IntArray
from pyinfra.core.errors import Error

SLOT_S = 1.0  # unit of time that is resampled as a whole
BLOCK_STEP_S = 5.0  # block lengths are multiples of this time, so that all LiDARs have equal ones
LEAST_BLOCK_S = 20.0  # minimum block length; false positives can last longer than vehicles
# Block length for vehicles without ids, whose time in the region is unknown. It suits a motorway.
UNKNOWN_BLOCK_S = 20.0
REPLICATES = 1000
SEED = 1
MIN_BLOCKS = 4.0  # minimum number of blocks for an interval
FEW_BLOCKS = f"vehicles are in fewer than {MIN_BLOCKS:g} blocks of time"
NO_INTERVAL = f"(no interval: {FEW_BLOCKS})"
LEVEL = 0.95
LEAST_DEFINED = 0.5  # minimum share of replicates in which a figure must be defined


@dataclass(frozen=True, eq=False)
class Estimate:
    """A figure or an array of figures with 95 % intervals; unknown intervals have NaN ends."""

    value: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class Blocks:
    """The time slot of each frame, and how often each bootstrap replicate contains each slot."""

    frames: IntArray  # (f,) frame numbers, ascending
    slot: IntArray  # (f,) time slot of each frame, 0 to n - 1
    replicates: IntArray  # (d, n) how often a replicate contains a slot; d = 0 for too few blocks
    length: int  # number of slots in a block
    block_s: float

    @property
    def count(self) -> float:
        """The number of blocks in the time of all frames; it need not be whole."""
        return int(self.replicates.shape[1]) / self.length

    def sums(self, frame: IntArray, values: AnyArray) -> FloatArray:
        """Sums values (n, ...) of frames (n,) within each slot: (slots, ...) float64."""
        out = np.zeros((self.replicates.shape[1], *values.shape[1:]))
        np.add.at(out, self.slot[np.searchsorted(self.frames, frame)], values)
        return out

    def estimate(
        self,
        sums: FloatArray,
        statistic: Callable[[FloatArray], FloatArray],
        *,
        within: tuple[float, float] = (-math.inf, math.inf),
    ) -> Estimate:
        """Returns a statistic of sums with its interval.

        sums: (slots, ...), the result of the method `sums`. statistic: maps the sums (m, ...) of m
        replicates to values (m, ...), NaN where undefined. within: range to which the interval is
        clipped. Replicates with an undefined value are left out.
        """
        value = statistic(sums.sum(axis=0)[None])[0]
        low, high = interval(
            value, statistic(np.tensordot(self.replicates, sums, axes=1)), self.count
        )
        return Estimate(value, np.maximum(low, within[0]), np.minimum(high, within[1]))


def time_blocks(
    frames: IntArray,
    period_s: float,
    *,
    block_s: float,
    replicates: int = REPLICATES,
    seed: int = SEED,
) -> Blocks:
    """Returns the time slots that contain frames, and bootstrap replicates of these slots.

    frames: (f,) frame numbers. There are no replicates if the slots make fewer than MIN_BLOCKS
    blocks. Raises Error if the frame numbers are not ascending.
    """
    back = np.flatnonzero(np.diff(frames) <= 0)
    if len(back):
        before, number = frames[back[0] : back[0] + 2]
        raise Error(f"frames: expected ascending numbers, got {number} after {before}")
    # A frame that starts on the border of two slots belongs to the later slot.
    numbers = np.floor(frames * period_s / SLOT_S + 1e-9)
    _, first, slot = np.unique(numbers, return_index=True, return_inverse=True)
    count = len(first)
    # The median is needed, because the slots of frames that are 2.5 s apart differ by 2 or 3.
    apart_s = period_s * float(np.median(np.diff(frames[first]))) if count > 1 else SLOT_S
    length = max(1, round(block_s / max(SLOT_S, apart_s)))
    enough = count >= MIN_BLOCKS * length
    taken = _runs(count, length, replicates if enough else 0, np.random.default_rng(seed))
    return Blocks(frames, slot.astype(np.int64), taken, length, block_s)


def _runs(count: int, length: int, replicates: int, random: np.random.Generator) -> IntArray:
    """Returns how often each replicate contains each slot: (replicates, count).

    A replicate consists of runs of `length` slots that begin at random slots. The last run is cut,
    so that the replicate has `count` slots.
    """
    runs = -(-count // length)
    starts = random.integers(0, count, size=(replicates, runs))
    slots = (starts[:, :, None] + np.arange(length)).reshape(replicates, runs * length)
    slots = slots[:, :count] % count
    flat = slots + count * np.arange(replicates)[:, None]
    return np.bincount(flat.ravel(), minlength=replicates * count).reshape(replicates, count)


def block_seconds(frame: IntArray, ids: IntArray, apart_s: float) -> float:
    """Returns the block length in seconds: the mean stay of a vehicle, rounded up.

    The mean is over all rows, so a vehicle that stays longer has a higher weight. The length is a
    multiple of BLOCK_STEP_S, and at least LEAST_BLOCK_S. If a vehicle is detected either in all of
    its frames or in none, errors are correlated for as long as the vehicle stays.

    frame, ids: (n,) frame and id of each vehicle that any LiDAR can detect. Rows with the id -1
    (unknown) are left out; the length is UNKNOWN_BLOCK_S if no id is known. apart_s: time between
    two frames, in seconds.
    """
    if len(ids) and ids.max() < 0:
        return UNKNOWN_BLOCK_S
    stay = np.unique(ids[ids >= 0], return_counts=True)[1].astype(np.float64)
    seconds = apart_s * float((stay**2).sum() / stay.sum()) if len(stay) else 0.0
    return max(LEAST_BLOCK_S, BLOCK_STEP_S * math.ceil(seconds / BLOCK_STEP_S - 1e-9))


def interval(
    value: FloatArray, replicates: FloatArray, blocks: float
) -> tuple[FloatArray, FloatArray]:
    """Returns the ends of the 95 % intervals of figures (...) from their replicates (d, ...).

    blocks: the number of blocks n. The variance of the replicates is corrected by n / (n - 1). The
    ends are NaN if there are no replicates, or if fewer than half of the replicates are defined.
    """
    value = np.asarray(value, dtype=np.float64)
    defined = ~np.isnan(replicates)
    count = defined.sum(axis=0)
    undefined = (count < max(2, LEAST_DEFINED * len(replicates))) | np.isnan(value)
    if len(replicates) == 0 or blocks <= 1:
        return np.full_like(value, np.nan), np.full_like(value, np.nan)
    divisor = np.maximum(count, 2)
    mean = np.where(defined, replicates, 0.0).sum(axis=0) / divisor
    variance = np.where(defined, replicates - mean, 0.0) ** 2
    error = np.sqrt(variance.sum(axis=0) / (divisor - 1))
    half = error * student(blocks) * math.sqrt(blocks / (blocks - 1))
    return np.where(undefined, np.nan, value - half), np.where(undefined, np.nan, value + half)


def student(samples: float, level: float = LEVEL) -> float:
    """Returns half the width of Student's t interval, in standard errors.

    samples: number of independent samples. level: confidence level, 0 to 1.
    """
    return float(special.stdtrit(samples - 1, (1 + level) / 2))


def ranks_of_median(samples: int, level: float = LEVEL) -> tuple[int, int]:
    """Returns the ranks of the ends of the interval of a median, from order statistics.

    They are quantiles of the binomial distribution of the samples below the median.
    """
    ranks = []
    for probability in ((1 - level) / 2, (1 + level) / 2):
        rank = math.ceil(special.bdtrik(probability, samples, 0.5))
        below = max(rank - 1, 0)
        ranks.append(below if special.bdtr(below, samples, 0.5) >= probability else rank)
    return ranks[0], ranks[1]


def ratio(above: AnyArray, below: AnyArray) -> FloatArray:
    """Returns above / below for arrays of equal shapes; NaN where below is 0."""
    out = np.full(np.broadcast_shapes(above.shape, below.shape), np.nan)
    return np.asarray(np.divide(above, below, out=out, where=below != 0))
