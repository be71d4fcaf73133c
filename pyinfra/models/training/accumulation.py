"""Frames of one fixed sensor stacked into one cloud: more time where a pattern does not repeat."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import numpy as np

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error

LabelAt = Literal["newest", "middle"]
MOST_FRAMES = 100


@dataclass(frozen=True)
class Accumulation:
    """How many frames are one cloud, and of which of them the labels are."""

    frames: int = 1  # one after another
    label_at: LabelAt = "newest"

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= MOST_FRAMES:
            raise Error(f"accumulate: found {self.frames}, allowed 1 to {MOST_FRAMES}")
        if self.label_at not in get_args(LabelAt):
            allowed = ", ".join(get_args(LabelAt))
            raise Error(f"label_at: found '{self.label_at}', allowed {allowed}")
        if self.frames == 1 and self.label_at != "newest":
            raise Error(f"label_at: found {self.label_at} of one frame, allowed newest")

    def around(self, frame: int) -> range:
        """The numbers of the frames in the cloud of a labelled one."""
        after = self.frames // 2 if self.label_at == "middle" else 0
        return range(frame + after - self.frames + 1, frame + after + 1)

    def stacks(self, labelled: Sequence[int], there: Collection[int]) -> tuple[list[int], ...]:
        """Those that are there, ascending, for each labelled frame; it is one of them.

        Raises Error if frames lie so far apart that none has a neighbour.
        """
        known = {*there, *labelled}
        groups = tuple([k for k in self.around(frame) if k in known] for frame in labelled)
        if self.frames > 1 and groups and max(map(len, groups)) == 1:
            raise Error(
                f"accumulate: found no two frames within {self.frames} numbers, allowed a folder "
                "with frames one after another"
            )
        return groups

    def clouds(
        self,
        read: Callable[[int], Points],
        labelled: Sequence[int],
        there: Collection[int],
        period_s: float,
    ) -> tuple[Callable[[], Points], ...]:
        """The cloud of each labelled frame, made when it is asked for: as read if it is one frame.

        Raises Error as `stacks`.
        """
        if self.frames == 1:
            return tuple(partial(read, frame) for frame in labelled)
        pairs = zip(labelled, self.stacks(labelled, there), strict=True)
        return tuple(partial(_read_stack, read, frame, stack, period_s) for frame, stack in pairs)


def _read_stack(
    read: Callable[[int], Points], labelled: int, stack: Sequence[int], period_s: float
) -> Points:
    return stacked([read(k) for k in stack], [(labelled - k) * period_s for k in stack])


def stacked(clouds: Sequence[Points], ages_s: Sequence[float]) -> Points:
    """(n, 5) float32: clouds (k, 4) under one another, each with its age as the fifth column.

    An age is 0 of the labelled frame, positive of what was seen before and negative after it.
    """
    columns = [np.full((len(c), 1), age) for c, age in zip(clouds, ages_s, strict=True)]
    return np.concatenate(
        [np.concatenate(list(clouds)), np.concatenate(columns)], axis=1, dtype=np.float32
    )
