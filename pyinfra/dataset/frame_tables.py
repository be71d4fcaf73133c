"""The boxes of many frames in one table: objects or predictions."""

from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, NameArray, Rows


@dataclass(frozen=True, eq=False)
class Vehicles(Rows):
    """The n objects of several frames, in the levelled LiDAR frame."""

    frame: IntArray  # (n,) index into the requested frames, ascending
    ids: IntArray  # (n,) track number of each object; -1 if unknown
    names: NameArray  # (n,) class of each object
    boxes: FloatArray  # (n, 7) boxes at the label time
    mid_frame: FloatArray  # (n, 7) boxes at mid-frame, which the region tests use
    points: IntArray  # (n,) number of this LiDAR's returns from the object; 1 if read from labels
    visibility: FloatArray  # (n,) visible share; -1 outside the region, NaN if read from labels
    speed: FloatArray  # (n,) speed along the heading, m/s; NaN if unknown


@dataclass(frozen=True, eq=False)
class Predictions(Rows):
    """The n predicted boxes of several frames, in the levelled LiDAR frame."""

    frame: IntArray  # (n,) index into the requested frames, ascending
    line: IntArray  # (n,) line number in the prediction file
    names: NameArray  # (n,) class of each box
    boxes: FloatArray  # (n, 7) predicted boxes
    scores: FloatArray  # (n,) scores of the boxes
    angle: FloatArray  # (n,) rotation_y or heading, unchanged from the file


def no_vehicles() -> Vehicles:
    """Returns a table without objects."""
    none = np.empty(0, np.int64)
    return without_points(none, none, np.empty(0, "<U12"), np.empty((0, 7)))


def without_points(frame: IntArray, ids: IntArray, names: NameArray, boxes: FloatArray) -> Vehicles:
    """Returns objects with `boxes` at mid-frame. `points` is 0 and `visibility` is -1 (unknown)."""
    return Vehicles(
        frame=frame,
        ids=ids,
        names=names,
        boxes=boxes,
        mid_frame=boxes,
        points=np.zeros(len(frame), np.int64),
        visibility=np.full(len(frame), -1.0),
        speed=np.full(len(frame), np.nan),
    )
