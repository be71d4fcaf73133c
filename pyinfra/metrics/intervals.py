"""Intervals of figures over time: neighbouring frames show the same vehicles.

Circular block bootstrap (Politis and Romano 1992): a draw is made of runs of time, one block long,
that begin anywhere; the last frame is followed by the first. The spread of a figure over the draws
is its standard error, and the interval Student's, with as many samples as the time holds blocks.
A block is as long as errors last, by the world's own vehicles (`block_seconds`); how often such
intervals hold the truth: reproduction/commands/coverage.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from pyinfra.core.arrays import AnyArray, FloatArray, IntArray
from pyinfra.core.errors import Error

SLOT_S = 1.0  # of time, drawn whole
BLOCK_STEP_S = 5.0  # lengths of blocks are multiples of it, so that LiDARs of a world agree
LEAST_BLOCK_S = 20.0  # ghosts come in bouts, which do not end with a vehicle's stay
DRAWS = 1000
SEED = 1
MIN_BLOCKS = 4.0  # of a block's length; what is shorter gives no interval
FEW_BLOCKS = f"vehicles are in fewer than {MIN_BLOCKS:g} blocks of time"
NO_INTERVAL = f"(no interval: {FEW_BLOCKS})"
LEVEL = 0.95
LEAST_DEFINED = 0.5  # of the draws


@dataclass(frozen=True, eq=False)
class Estimate:
    """A figure or an array of them, with the ends of their 95 % intervals; NaN is none."""

    value: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which slot of time each frame is in, and how often each draw takes each slot."""

    frames: IntArray  # (f,) ascending
    slot: IntArray  # (f,) 0 to n - 1, the slot of each frame
    draws: IntArray  # (d, n) counts; (0, n) if the time holds too few blocks for an interval
    length: int  # slots of a block
    block_s: float

    @property
    def count(self) -> float:
        """How many blocks the time holds."""
        return int(self.draws.shape[1]) / self.length

    def sums(self, frame: IntArray, values: AnyArray) -> FloatArray:
        """Sums of values (n, ...) by the slot of their frame (n,): (slots, ...) float64."""
        out = np.zeros((self.draws.shape[1], *values.shape[1:]))
        np.add.at(out, self.slot[np.searchsorted(self.frames, frame)], values)
        return out

    def estimate(
        self,
        sums: FloatArray,
        statistic: Callable[[FloatArray], FloatArray],
        *,
        within: tuple[float, float] = (-math.inf, math.inf),
    ) -> Estimate:
        """A statistic of sums with its interval.

        sums: (slots, ...) as from `sums`; statistic: takes sums (m, ...) of m samples to (m, ...),
        NaN where it has no value; within: what it can be. Draws without a value are left out.
        """
        value = statistic(sums.sum(axis=0)[None])[0]
        low, high = interval(value, statistic(np.tensordot(self.draws, sums, axes=1)), self.count)
        return Estimate(value, np.maximum(low, within[0]), np.minimum(high, within[1]))


def time_blocks(
    frames: IntArray,
    period_s: float,
    *,
    block_s: float,
    draws: int = DRAWS,
    seed: int = SEED,
) -> Blocks:
    """Slots of time that hold a frame or more, and seeded draws of runs of them.

    Of less than MIN_BLOCKS blocks there are no draws. Raises Error if the frames do not
    ascend.
    """
    if np.any(np.diff(frames) <= 0):
        raise Error("frames: found a frame that is not after the one before it")
    # A frame that starts on the border of a slot belongs to the later one.
    numbers = np.floor(frames * period_s / SLOT_S + 1e-9)
    _, first, slot = np.unique(numbers, return_index=True, return_inverse=True)
    count = len(first)
    # Of frames 2.5 s apart, slots are 2 and 3 apart in turn.
    apart_s = period_s * float(np.median(np.diff(frames[first]))) if count > 1 else SLOT_S
    length = max(1, round(block_s / max(SLOT_S, apart_s)))
    enough = count >= MIN_BLOCKS * length
    random = np.random.default_rng(seed)
    taken = _runs(count, length, draws if enough else 0, random)
    return Blocks(frames, slot.astype(np.int64), taken, length, block_s)


def _runs(count: int, length: int, draws: int, random: np.random.Generator) -> IntArray:
    """How often each of `count` slots is in runs of `length`, cut at `count`: (draws, count)."""
    runs = -(-count // length)
    starts = random.integers(0, count, size=(draws, runs))
    slots = (starts[:, :, None] + np.arange(length)).reshape(draws, runs * length)
    slots = slots[:, :count] % count
    cell = slots + count * np.arange(draws)[:, None]
    return np.bincount(cell.ravel(), minlength=draws * count).reshape(draws, count)


def block_seconds(frame: IntArray, ids: IntArray, apart_s: float) -> float:
    """How long errors last at most: as long as the vehicle that a look meets is there.

    frame, ids: (n,) the frame and the id of every vehicle that is there to be found, whichever
    LiDAR finds it; apart_s: from one frame to the next. Whole steps of BLOCK_STEP_S, LEAST_BLOCK_S
    or more. If a vehicle were found in all of its frames or in none, its stay would be the whole
    correlation of the frames.
    """
    stay = np.unique(ids, return_counts=True)[1].astype(np.float64)
    seconds = apart_s * float((stay**2).sum() / stay.sum()) if len(stay) else 0.0
    return max(LEAST_BLOCK_S, BLOCK_STEP_S * math.ceil(seconds / BLOCK_STEP_S - 1e-9))


def interval(value: FloatArray, drawn: FloatArray, blocks: float) -> tuple[FloatArray, FloatArray]:
    """Ends of the 95 % interval of figures (...) from their draws (d, ...).

    blocks: how many the time holds; draws see n - 1 of the variance of n. NaN without draws, or if
    fewer than half of them are defined.
    """
    value = np.asarray(value, dtype=np.float64)
    known = ~np.isnan(drawn)
    count = known.sum(axis=0)
    none = (count < max(2, LEAST_DEFINED * len(drawn))) | np.isnan(value)
    if len(drawn) == 0 or blocks <= 1:
        return np.full_like(value, np.nan), np.full_like(value, np.nan)
    divisor = np.maximum(count, 2)
    mean = np.where(known, drawn, 0.0).sum(axis=0) / divisor
    variance = np.where(known, drawn - mean, 0.0) ** 2
    error = np.sqrt(variance.sum(axis=0) / (divisor - 1))
    half = error * student(blocks) * math.sqrt(blocks / (blocks - 1))
    return np.where(none, np.nan, value - half), np.where(none, np.nan, value + half)


def student(samples: float) -> float:
    """Half the width of a 95 % interval, in standard errors that rest on so many samples."""
    return float(stats.t.ppf((1 + LEVEL) / 2, samples - 1))


def ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """above / below of any equal shapes; NaN where below is 0."""
    out: FloatArray = np.full(np.broadcast_shapes(above.shape, below.shape), np.nan)
    np.divide(above, below, out=out, where=below != 0)
    return out
