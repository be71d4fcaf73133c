"""Tracks of moving boxes at a site, in the world frame. Instants are 0.1 s apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray

STEP_S = 0.1
X, Y, Z, HEADING, PITCH, SPEED = range(6)


@dataclass(frozen=True)
class ObjectClass:
    """Mean and standard deviation of length, width, height in metres, and SUMO's class name."""

    mean_m: tuple[float, float, float]
    std_m: tuple[float, float, float]
    sumo_class: str


# A test checks that the sizes equal those in core/classes.h.
CLASSES = {
    "Car": ObjectClass((4.53, 1.95, 1.57), (0.71, 0.16, 0.17), "passenger"),
    "Van": ObjectClass((5.30, 2.05, 2.25), (0.85, 0.21, 0.25), "delivery"),
    "Truck": ObjectClass((6.97, 2.70, 2.96), (1.30, 0.21, 0.71), "truck"),
    "Bus": ObjectClass((10.5, 2.94, 3.47), (0.52, 0.10, 0.17), "bus"),
    "Motorcycle": ObjectClass((2.10, 0.82, 1.57), (0.10, 0.04, 0.08), "motorcycle"),
    "Pedestrian": ObjectClass((0.73, 0.67, 1.77), (0.04, 0.03, 0.09), "pedestrian"),
    "Cyclist": ObjectClass((1.67, 0.70, 1.67), (0.08, 0.03, 0.08), "bicycle"),
}


@dataclass(frozen=True)
class FrontPath:
    """The path of the middle of an object's front bumper, at road height.

    `first` is the instant of the first row. `points` (n, 3) are x y z in metres, and `heading` (n,)
    is in radians.
    """

    name: str
    object_class: str
    size_m: FloatArray  # (3,) length, width, height
    first: int
    points: FloatArray
    heading: FloatArray


@dataclass(frozen=True)
class Track:
    """A moving box in the world frame, metres, radians and m/s.

    `states` (n, 6) are x y z of the box centre, heading, pitch and speed. `first` is the instant of
    the first state.
    """

    name: str
    object_class: str
    size_m: FloatArray  # (3,) length, width, height
    first: int
    states: FloatArray

    def between(self, start: int, end: int) -> Track | None:
        """Returns the part of the track from instant `start` to `end`, both included.

        Instants of the part count from `start`. Returns None if the track has no such part.
        """
        low, high = max(self.first, start), min(self.first + len(self.states) - 1, end)
        if high < low:
            return None
        states = self.states[low - self.first : high - self.first + 1]
        return Track(self.name, self.object_class, self.size_m, low - start, states)

    def near(self, feet: FloatArray, reach_m: float) -> list[Track]:
        """Returns the pieces within a distance of any of the feet (k, 2) as separate tracks."""
        away = np.linalg.norm(self.states[:, None, :2] - feet, axis=2).min(1)
        inside = np.concatenate([[False], away <= reach_m, [False]])
        edges = np.flatnonzero(np.diff(inside.astype(int))).reshape(-1, 2)
        return [
            replace(self, first=self.first + a, states=self.states[a:b]) for a, b in edges.tolist()
        ]


@dataclass(frozen=True)
class TrackTable:
    """The rows of all tracks, sorted by instant, then by track."""

    instant: IntArray  # (n,) instant of each row, in steps of 0.1 s
    track: IntArray  # (n,) index of the track
    boxes: FloatArray  # (n, 7) x y z dx dy dz heading
    states: FloatArray  # (n, 6) rows of `Track.states`


def from_zero(tracks: list[Track]) -> list[Track]:
    """Shifts the instants so that the first track starts at 0."""
    start = min((t.first for t in tracks), default=0)
    return [replace(t, first=t.first - start) for t in tracks]


def lasts_s(tracks: list[Track]) -> float:
    """Returns the time of the last instant in seconds."""
    return round(max((t.first + len(t.states) - 1 for t in tracks), default=0) * STEP_S, 1)


def table(tracks: list[Track]) -> TrackTable:
    """Returns the rows of all tracks in the order of trajectories.csv."""
    if not tracks:
        none = np.zeros(0, np.int64)
        return TrackTable(none, none, np.zeros((0, 7)), np.zeros((0, 6)))
    instant = np.concatenate([t.first + np.arange(len(t.states)) for t in tracks])
    track = np.repeat(np.arange(len(tracks)), [len(t.states) for t in tracks])
    states = np.concatenate([t.states for t in tracks])
    sizes = np.stack([t.size_m for t in tracks])[track]
    order = np.lexsort((track, instant))
    boxes = np.concatenate([states[:, :3], sizes, states[:, HEADING, None]], axis=1)
    return TrackTable(instant[order], track[order], boxes[order], states[order])
