"""Where the parts of a frame lie, and what they hold when read."""

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
    [("time_s", "<f4"), ("ring", "<u2"), ("class", "<u2"), ("object_id", "<i4")],
)
SCAN_COLUMNS = "scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box".split(",")
OBJECT_COLUMNS = [
    *"id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility".split(","),
    *SCAN_COLUMNS,
]
PITCH_COLUMN = "pitch"  # the last, of runs whose vehicles lean
LABEL_COLUMNS = "type truncated occluded alpha x1 y1 x2 y2 h w l x y z rotation_y".split()
FARTHEST_M = 10_000.0  # of a coordinate in a LiDAR's frame; the farthest range is 5,000 m


@dataclass(frozen=True, eq=False)
class Objects:
    """The k vehicles in reach of a LiDAR in one frame, hit or not."""

    ids: IntArray  # (k,)
    names: NameArray  # (k,) class
    boxes: FloatArray  # (k, 7) x y z dx dy dz heading, at mid-frame
    speed: FloatArray  # (k,) m/s
    points: IntArray  # (k,) returns from the vehicle
    points_in_box: IntArray  # (k,) those of them that lie in its box
    distance: FloatArray  # (k,) horizontal, sensor to box centre
    visibility: FloatArray  # (k,) [0, 1]; -1 outside the evaluation region
    scan_boxes: FloatArray  # (k, 7) at scan_time_s
    scan_time_s: FloatArray  # (k,) mean time of its returns, since the start of the frame
    points_in_scan_box: IntArray  # (k,)
    pitch: FloatArray | None = None  # (k,) of the vehicle itself, positive nose down; None: level

    def __len__(self) -> int:
        return len(self.ids)

    def label_boxes(self, label_time: LabelTime) -> FloatArray:
        """(k, 7) as the labels have them."""
        return self.scan_boxes if label_time == "scan" else self.boxes


@dataclass(frozen=True, eq=False)
class Labels:
    """The k boxes of a label or prediction file."""

    names: NameArray  # (k,) class
    boxes: FloatArray  # (k, 7) x y z dx dy dz heading
    scores: FloatArray | None  # (k,); None for labels
    image: FloatArray | None = None  # (k, 7) truncated occluded alpha x1 y1 x2 y2, as in the file

    def __len__(self) -> int:
        return len(self.names)


def frame_file(lidar_folder: Path, part: Part, frame: int) -> Path:
    """Where a part of a frame lies, whether it exists or not."""
    return lidar_folder / "training" / part / f"{frame:06d}{SUFFIXES[part]}"


def frames(lidar_folder: Path) -> list[int]:
    """The frames of a LiDAR, ascending; a frame exists if and only if its .bin does.

    Raises FileNotFoundError if the folder has no training/velodyne.
    """
    names = (path.name for path in (lidar_folder / "training/velodyne").iterdir())
    return sorted(int(name[:-4]) for name in names if re.fullmatch(r"[0-9]{6,}\.bin", name))


def extent(frames: Sequence[int]) -> str:
    """What is allowed of ascending frames, in words."""
    return f"{frames[0]} to {frames[-1]}" if frames else "none, as the folder has no frame"
