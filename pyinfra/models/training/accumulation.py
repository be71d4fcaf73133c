"""Stacks frames of a fixed sensor into one cloud.

Stacking is useful if the scan pattern of the sensor does not repeat.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error

LabelAt = Literal["newest", "middle"]
MOST_FRAMES = 100


@dataclass(frozen=True)
class Accumulation:
    """How many frames are stacked into one cloud, and which of them has the labels."""

    frames: int = 1  # number of consecutive frames
    label_at: LabelAt = "newest"

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= MOST_FRAMES:
            raise Error(f"accumulate: expected 1 to {MOST_FRAMES}, got {self.frames}")
        if self.frames == 1 and self.label_at != "newest":
            raise Error(f"label_at: expected 'newest' for a single frame, got '{self.label_at}'")

    def around(self, frame: int) -> range:
        """Returns the numbers of the frames that are stacked for a labelled frame."""
        after = self.frames // 2 if self.label_at == "middle" else 0
        return range(frame + after - self.frames + 1, frame + after + 1)

    def stacks(self, labelled: Sequence[int], there: Collection[int]) -> tuple[list[int], ...]:
        """Returns the existing frames of each labelled frame's stack, ascending.

        there: numbers of existing frames. The labelled frame is always in its stack. Raises Error
        if every stack has only one frame.
        """
        existing = {*there, *labelled}
        groups = tuple([k for k in self.around(frame) if k in existing] for frame in labelled)
        if self.frames > 1 and groups and max(map(len, groups)) == 1:
            raise Error(
                "accumulate: expected a folder with consecutive frames, got a folder without two "
                f"frames whose numbers differ by less than {self.frames}"
            )
        return groups

    def clouds(
        self,
        read: Callable[[int], Points],
        labelled: Sequence[int],
        there: Collection[int],
        period_s: float,
    ) -> tuple[Callable[[], Points], ...]:
        """Returns for each labelled frame a function that makes its cloud.

        If frames are not stacked, a cloud is returned unchanged. Raises Error as `stacks` does.
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
    """Concatenates clouds (k, 4) and adds the age of each cloud as a fifth column: (n, 5) float32.

    The age in seconds is 0 for the labelled frame, positive for earlier and negative for later
    frames.
    """
    columns = [np.full((len(c), 1), age) for c, age in zip(clouds, ages_s, strict=True)]
    return np.concatenate(
        [np.concatenate(list(clouds)), np.concatenate(columns)], axis=1, dtype=np.float32
    )
