"""File paths of the parts of a frame, and the data classes that hold their content."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, NameArray
from pyinfra.core.vocabulary import LabelTime

Part = Literal["velodyne", "fields", "objects", "label_2", "calib"]

SUFFIXES: dict[Part, str] = {
    "velodyne": ".bin",
    "fields": ".bin",
    "objects": ".csv",
    "label_2": ".txt",
    "calib": ".txt",
}
FIELDS = np.dtype(
    [("time_s", "<f4"), ("ring", "<u2"), ("class", "u1"), ("echo", "u1"), ("object_id", "<i4")],
)
SCAN_COLUMNS = "scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box".split(",")
OBJECT_COLUMNS = [
    *"id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility".split(","),
    *SCAN_COLUMNS,
]
PITCH_COLUMN = "pitch"  # optional last column of objects, written if vehicles can pitch
LABEL_COLUMNS = "type truncated occluded alpha x1 y1 x2 y2 h w l x y z rotation_y".split()
# Largest coordinate in a LiDAR's frame. The simulator allows LiDARs with a range of up to 5,000 m.
FARTHEST_M = 10_000.0


@dataclass(frozen=True, eq=False)
class Objects:
    """The k objects within range of a LiDAR in one frame, with or without returns."""

    ids: IntArray  # (k,) track number of each object; -1 if unknown
    names: NameArray  # (k,) class of each object
    boxes: FloatArray  # (k, 7) boxes x y z dx dy dz heading, at mid-frame
    speed: FloatArray  # (k,) speed of each object, m/s
    points: IntArray  # (k,) number of returns from the object
    points_in_box: IntArray  # (k,) number of returns from the object that are inside its box
    distance: FloatArray  # (k,) horizontal distance from the sensor to the box centre, metres
    visibility: FloatArray  # (k,) visible share in [0, 1]; -1 outside the evaluation region
    scan_boxes: FloatArray  # (k, 7) boxes at scan_time_s
    scan_time_s: FloatArray  # (k,) mean time of the object's returns, from the start of the frame
    points_in_scan_box: IntArray  # (k,) number of returns from the object in its scan box
    # (k,) pitch in radians, positive with the nose down. None if no vehicle can pitch.
    pitch: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.ids)

    def label_boxes(self, label_time: LabelTime) -> FloatArray:
        """Returns the boxes (k, 7) at the given label time."""
        return self.scan_boxes if label_time == "scan" else self.boxes


@dataclass(frozen=True, eq=False)
class Labels:
    """The k boxes of a label or prediction file."""

    names: NameArray  # (k,) class of each box
    boxes: FloatArray  # (k, 7) boxes x y z dx dy dz heading
    scores: FloatArray | None  # (k,) scores of predictions; None for labels
    # (k, 7) the columns truncated occluded alpha x1 y1 x2 y2 of the file.
    image: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.names)


def frame_file(lidar_folder: Path, part: Part, frame: int) -> Path:
    """Returns the path of a part of a frame. The file need not exist."""
    return lidar_folder / "training" / part / f"{frame:06d}{SUFFIXES[part]}"


def frames(lidar_folder: Path) -> list[int]:
    """Returns the frame numbers of a LiDAR, ascending. A frame exists if its .bin file exists.

    Raises FileNotFoundError if the folder has no training/velodyne.
    """
    names = (path.name for path in (lidar_folder / "training/velodyne").iterdir())
    return sorted(int(name[:-4]) for name in names if re.fullmatch(r"[0-9]{6,}\.bin", name))


def extent(frames: Sequence[int]) -> str:
    """Returns the first and last of ascending frame numbers as text, for messages."""
    return f"{frames[0]} to {frames[-1]}" if frames else "none, as the folder has no frame"
