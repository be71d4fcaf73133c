"""The arrays that describe boxes of one frame, and tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, Rows
from pyinfra.core.boxes import centres_within_reach, pair_bev_overlap, wrapped
from pyinfra.core.vocabulary import OBJECT_CLASSES, PERSON_TYPES
from pyinfra.tracking.motion import STATES, axes

TYPES = tuple(dict.fromkeys(name for names in OBJECT_CLASSES.values() for name in names))
PERSONS = np.array([name in PERSON_TYPES for name in TYPES])
SAME = 0.5  # overlap, relative to the smaller area, above which two boxes are one object
# Standard deviation of a box's centre along and across the heading: the value at distance 0, and
# the increase per metre of distance.
ALONG_M, ALONG_PER_M = 0.25, 0.003
ACROSS_M, ACROSS_PER_M = 0.12, 0.001


@dataclass(frozen=True, eq=False)
class Boxes(Rows):
    """The n boxes of one frame, in the levelled LiDAR frame."""

    values: FloatArray  # (n, 7) x y z dx dy dz heading
    votes: FloatArray  # (n, len(TYPES)) score of each type

    @property
    def scores(self) -> FloatArray:
        """(n,) probability of an object, 0 to 1: the sum over the types, which are exclusive."""
        return np.asarray(np.minimum(self.votes.sum(axis=1), 1))

    @property
    def person(self) -> BoolArray:
        return np.asarray(PERSONS[self.votes.argmax(axis=1)])

    @property
    def noise(self) -> FloatArray:
        """Covariances (n, 2, 2) of the centres, by distance and heading."""
        distance = np.hypot(self.values[:, 0], self.values[:, 1])
        along = ALONG_M + ALONG_PER_M * distance
        return axes(self.values[:, 6], along, ACROSS_M + ACROSS_PER_M * distance)

    def merged(self) -> Boxes:
        """Returns the boxes without those that mostly overlap a box with a higher score.

        A detector of several types returns a box for each type that an object may have. The box
        that stays gets the score of each type.
        """
        boxes = self.select(np.argsort(-self.votes.max(axis=1, initial=0), kind="stable"))
        kept = np.ones(len(boxes), dtype=bool)
        votes = boxes.votes.copy()
        pairs, share = shared(boxes.values)
        for i, j in pairs[share > SAME]:
            if kept[i] and kept[j]:
                kept[j] = False
                votes[i] = np.maximum(votes[i], votes[j])
        return Boxes(boxes.values[kept], votes[kept])


@dataclass(eq=False)
class Tracks(Rows):
    """The n tracks after a frame."""

    ids: IntArray  # (n,) ids of the tracks
    state: FloatArray  # (n, 6) x y vx vy ax ay
    covariance: FloatArray  # (n, 6, 6) covariance of the state
    noise: FloatArray  # (n, 2, 2) covariance of the acceleration since the frame before
    z: FloatArray  # (n,) z of the centre
    size: FloatArray  # (n, 3) dx dy dz
    heading: FloatArray  # (n,) headings, radians
    ahead: FloatArray  # (n,) evidence for the heading minus evidence for the opposite heading
    votes: FloatArray  # (n, len(TYPES)) sum of the boxes' scores of each type
    odds: FloatArray  # (n,) log odds that the track is an object
    confirmed: BoolArray  # (n,) whether the log odds have ever been high enough for a track
    last_s: FloatArray  # (n,) time of the last box
    frames_seen: IntArray  # (n,) number of frames with a box
    frames_missed: IntArray  # (n,) number of frames without a box
    seen: BoolArray  # (n,) whether the last frame has a box
    hidden: BoolArray  # (n,) whether another object hides the track in the last frame

    @classmethod
    def none(cls) -> Self:
        empty = Boxes(np.empty((0, 7)), np.empty((0, len(TYPES))))
        return cls.begin(1, 0, empty, np.empty((0, STATES)), np.empty((0, STATES, STATES)))

    @classmethod
    def begin(
        cls,
        first_id: int,
        time_s: float,
        boxes: Boxes,
        state: FloatArray,
        covariance: FloatArray,
    ) -> Self:
        n = len(boxes)
        return cls(
            ids=np.arange(first_id, first_id + n),
            state=state,
            covariance=covariance,
            noise=np.zeros((n, 2, 2)),
            z=boxes.values[:, 2].copy(),
            size=boxes.values[:, 3:6].copy(),
            heading=wrapped(boxes.values[:, 6]),
            ahead=boxes.scores.copy(),
            votes=boxes.votes.copy(),
            odds=np.zeros(n),
            confirmed=np.zeros(n, dtype=bool),
            last_s=np.full(n, time_s),
            frames_seen=np.ones(n, np.int64),
            frames_missed=np.zeros(n, np.int64),
            seen=np.ones(n, dtype=bool),
            hidden=np.zeros(n, dtype=bool),
        )

    @property
    def types(self) -> IntArray:
        """(n,) index into TYPES of the type with most votes."""
        return np.asarray(self.votes.argmax(axis=1))

    @property
    def person(self) -> BoolArray:
        return np.asarray(PERSONS[self.types])

    def speed(self) -> FloatArray:
        return np.asarray(np.hypot(self.state[:, 2], self.state[:, 3]))

    def boxes(self) -> FloatArray:
        """Returns x y z dx dy dz heading (n, 7)."""
        return np.column_stack([self.state[:, :2], self.z, self.size, self.heading])


def shared(boxes: FloatArray) -> tuple[IntArray, FloatArray]:
    """Returns the pairs (k, 2) of boxes (n, 7) that may touch, first index below the second.

    Also returns the overlap of each pair as share (k,) of the smaller area.
    """
    pairs = np.argwhere(np.triu(centres_within_reach(boxes[:, None], boxes[None]), 1))
    first, second = boxes[pairs[:, 0]], boxes[pairs[:, 1]]
    area = np.minimum(first[:, 3] * first[:, 4], second[:, 3] * second[:, 4])
    return pairs, np.asarray(pair_bev_overlap(first, second) / np.maximum(area, 1e-6))
