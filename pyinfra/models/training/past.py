"""The occupancy of the past of a fixed sensor, as two more columns of each point.

A fixed sensor sees its background again and again. Time is divided into PAST_FRAMES slots per
`past_s` seconds, and the first frame of each slot is remembered as the set of its voxels with a
point. A point of a later frame gets two columns:

- past_share: the share of the remembered frames whose points are also in the point's voxel
- past_known: the number of remembered frames, divided by PAST_FRAMES

Only slots before that of the frame are used, at most PAST_FRAMES of them. Both columns are 0 if
there is no such slot. A vehicle that stands has the past_share of the background, if it stands for
as long as the memory lasts. Networks learn this from the queues of their training sites.

Points are in the levelled LiDAR frame. The columns are computed before z is measured from the road.
"""

from bisect import bisect_left
from collections.abc import Callable, Collection, Sequence
from functools import cached_property, partial

import numpy as np

from pyinfra.core.arrays import Int32Array, Points

PAST_FRAMES = 20  # number of remembered frames
VOXEL_M = 0.4
CELLS = 576  # voxels along x and y, around the sensor; points farther away have no past
LEVELS = 64  # voxels along z; farther apart, two voxels share a number
COLUMNS = 2
Cloud = Callable[[], Points]


def voxels_of(points: Points) -> Int32Array:
    """Returns the number of each point's voxel: (n,) int32, -1 if the point has no past.

    points: (n, 3 or more). Points that are not finite have no past.
    """
    with np.errstate(invalid="ignore"):
        cell = np.floor(points[:, :3] / np.float32(VOXEL_M))
        inside = (np.abs(cell[:, :2] + 0.5) < CELLS / 2).all(axis=1) & np.isfinite(cell[:, 2])
    x, y, z = np.where(inside[:, None], cell, 0).astype(np.int32).T
    number = (z % LEVELS * CELLS + y + CELLS // 2) * CELLS + x + CELLS // 2
    return np.where(inside, number, np.int32(-1))


def occupied(points: Points) -> Int32Array:
    """Returns the ascending numbers of the voxels with a point: (m,) int32."""
    numbers = np.unique(voxels_of(points))
    return numbers[numbers >= 0]


def slot_frames(past_s: float, period_s: float) -> int:
    """Returns the number of frames in a time slot."""
    return max(1, round(past_s / PAST_FRAMES / period_s))


class Memory:
    """Adds the columns of the past to clouds. The array of counts is used again for each cloud."""

    def __init__(self) -> None:
        self.counts = np.zeros(LEVELS * CELLS * CELLS, np.uint8)

    def added(self, points: Points, past: Sequence[Int32Array]) -> Points:
        """Returns the points with the columns past_share and past_known: (n, columns + 2) float32.

        past: the voxels of each remembered frame, at most PAST_FRAMES.
        """
        for numbers in past:
            self.counts[numbers] += 1
        voxels = voxels_of(points)
        columns = np.empty((len(points), COLUMNS), np.float32)
        columns[:, 0] = np.where(voxels >= 0, self.counts[voxels], 0) / max(1, len(past))
        columns[:, 1] = len(past) / PAST_FRAMES
        for numbers in past:
            self.counts[numbers] = 0
        return np.concatenate([points, columns], axis=1, dtype=np.float32)


class PastFrames:
    """The past of frames that are read by number.

    there: numbers of existing frames. Frames that are read for the past are read once, and their
    voxels are kept.
    """

    def __init__(
        self,
        read: Callable[[int], Points],
        there: Collection[int],
        period_s: float,
        past_s: float,
    ) -> None:
        self.read, self.step = read, slot_frames(past_s, period_s)
        firsts: dict[int, int] = {}
        for frame in sorted(there):
            firsts.setdefault(frame // self.step, frame)
        self.slots, self.firsts = list(firsts), list(firsts.values())
        self._occupied: dict[int, Int32Array] = {}

    def before(self, frame: int) -> list[int]:
        """Returns the numbers of the remembered frames of a frame, ascending."""
        slot = frame // self.step
        first, end = (bisect_left(self.slots, s) for s in (slot - PAST_FRAMES, slot))
        return self.firsts[first:end]

    def added(self, points: Points, frame: int) -> Points:
        """Returns the points of a frame with the columns of its past."""
        return self._memory.added(points, [self._voxels(k) for k in self.before(frame)])

    @cached_property
    def _memory(self) -> Memory:
        return Memory()

    def _voxels(self, frame: int) -> Int32Array:
        if frame not in self._occupied:
            oldest = frame - (PAST_FRAMES + 1) * self.step
            if len(self._occupied) > MOST_KEPT:  # a long recording, whose frames are in order
                self._occupied = {k: v for k, v in self._occupied.items() if k >= oldest}
            self._occupied[frame] = occupied(self.read(frame))
        return self._occupied[frame]


def frames_with_past(
    frames: Sequence[int], there: Collection[int], period_s: float, past_s: float
) -> int:
    """Returns how many of the frames have a past of one frame or more."""
    if past_s == 0 or not there:
        return 0
    past = PastFrames(_unread, there, period_s, past_s)
    return sum(len(past.before(frame)) > 0 for frame in frames)


def _unread(frame: int) -> Points:
    raise AssertionError(f"frame {frame} is read")


MOST_KEPT = 1000  # frames whose voxels are kept, some 100 kB each


def with_past(
    clouds: Sequence[Cloud],
    read: Callable[[int], Points],
    frames: Sequence[int],
    there: Collection[int],
    period_s: float,
    past_s: float,
) -> tuple[Cloud, ...]:
    """Returns functions that make the clouds of frames with the columns of their past.

    clouds: functions that make the cloud of each of `frames`. there: numbers of existing frames.
    If past_s is 0, the clouds are returned unchanged.
    """
    if past_s == 0:
        return tuple(clouds)
    past = PastFrames(read, there, period_s, past_s)
    pairs = zip(clouds, frames, strict=True)
    return tuple(partial(_with_past, past, cloud, frame) for cloud, frame in pairs)


def _with_past(past: PastFrames, cloud: Cloud, frame: int) -> Points:
    return past.added(cloud(), frame)
