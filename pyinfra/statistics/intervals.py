"""Percentile bootstrap over blocks of time: neighbouring frames show the same vehicles."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pyinfra.arrays import AnyArray, FloatArray, IntArray

BLOCK_S = 5.0
DRAWS = 1000
SEED = 1
MIN_BLOCKS = 10


@dataclass(frozen=True, eq=False)
class Estimate:
    """A figure or an array of them, with the ends of their 95 % intervals; NaN is none."""

    value: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which block each frame is in, and how often each draw takes each block."""

    frames: IntArray  # (f,) ascending
    block: IntArray  # (f,) 0 to b - 1, the block of each frame
    draws: FloatArray  # (d, b) counts; (0, b) if there are too few blocks for an interval

    def sums(self, frame: IntArray, values: AnyArray) -> FloatArray:
        """Sums of values (n, ...) by the block of their frame (n,): (b, ...) float64."""
        out = np.zeros((self.draws.shape[1], *values.shape[1:]))
        np.add.at(out, self.block[np.searchsorted(self.frames, frame)], values)
        return out

    def estimate(self, sums: FloatArray, statistic: Callable[[FloatArray], FloatArray]) -> Estimate:
        """A statistic of sums with its interval.

        sums: (b, ...) as from `sums`; statistic: takes sums (m, ...) of m samples to (m, ...),
        NaN where it has no value. Draws without a value are left out of the interval.
        """
        value = statistic(sums.sum(axis=0)[None])[0]
        if len(self.draws) == 0:
            return Estimate(value, np.full_like(value, np.nan), np.full_like(value, np.nan))
        drawn = statistic(np.tensordot(self.draws, sums, axes=1))
        low, high = _percentiles(drawn)
        none = np.isnan(value)
        return Estimate(value, np.where(none, np.nan, low), np.where(none, np.nan, high))


def time_blocks(
    frames: IntArray,
    period_s: float,
    *,
    block_s: float = BLOCK_S,
    draws: int = DRAWS,
    seed: int = SEED,
) -> Blocks:
    """Blocks of block_s seconds that hold a frame or more, and seeded draws of them.

    With fewer than MIN_BLOCKS blocks there are no draws: an interval of so few is too narrow.
    Raises ValueError if the frames do not ascend.
    """
    if np.any(np.diff(frames) <= 0):
        raise ValueError("frames: found a frame that is not after the one before it")
    # A frame that starts on the border of a block belongs to the later one.
    numbers = np.floor(frames * period_s / block_s + 1e-9)
    found, block = np.unique(numbers, return_inverse=True)
    count = len(found)
    random = np.random.default_rng(seed)
    enough = count >= MIN_BLOCKS
    counts = random.multinomial(count, np.full(count, 1 / count), draws if enough else 0)
    return Blocks(frames, block.astype(np.int64), counts.astype(np.float64))


def ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """above / below of any equal shapes; NaN where below is 0."""
    out: FloatArray = np.full(np.broadcast_shapes(above.shape, below.shape), np.nan)
    np.divide(above, below, out=out, where=below != 0)
    return out


def _percentiles(drawn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """2.5 and 97.5 % of (d, ...) without its NaN; NaN where nothing is left."""
    shape = drawn.shape[1:]
    columns = drawn.reshape(len(drawn), -1).T
    low, high = np.full(len(columns), np.nan), np.full(len(columns), np.nan)
    for i, column in enumerate(columns):
        known = column[~np.isnan(column)]
        if len(known) > 0:
            low[i], high[i] = np.percentile(known, [2.5, 97.5])
    return low.reshape(shape), high.reshape(shape)
