"""Reads the JSON files of the labelling tools labelCloud and SUSTechPOINTS.

Follows the source of labelCloud (`labelCloud/io/labels/centroid.py` and `vertices.py`) and
`doc/data-format.md` of SUSTechPOINTS. Positions are box centres in the frame of the cloud.

- labelCloud: `objects` with `name`, and `centroid` (x y z), `dimensions` (length width height) and
  `rotations` (x y z), or with the eight corners `vertices`. `rotations` are radians in the format
  `centroid_rel`, and degrees in `centroid_abs`; the file does not state which.
- SUSTechPOINTS: a list of objects with `obj_type`, `obj_id` and `psr`: `position`, `scale`,
  `rotation` (Euler angles XYZ, radians).
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.exchange.json_boxes import (
    boxes_of,
    checked_box,
    checked_objects,
    group,
    number,
    read_json,
)
from pyinfra.exchange.recording import Boxes
from pyinfra.formats.text_table import MOST_RADIANS

SUSTECH_KEYS = {"obj_type", "obj_id", "psr"}
CLOUD_KEYS = {"name", "centroid", "dimensions", "rotations", "vertices"}
SIZES = ("length", "width", "height")


def read_sustech(file: Path, ids: dict[str, int]) -> Boxes:
    """Reads a file of SUSTechPOINTS. New tracks are added to `ids`, which maps names to numbers."""
    objects = checked_objects(file, read_json(file))
    return boxes_of(file, objects, _sustech_box, ("obj_type", "obj_id"), SUSTECH_KEYS, ids)[0]


def read_label_cloud(file: Path, *, degrees: bool) -> Boxes:
    """Reads a file of labelCloud. `degrees` is the unit of `rotations`."""
    content = read_json(file)
    objects = checked_objects(file, content.get("objects") if isinstance(content, dict) else None)

    def box(location: str, entry: Mapping[str, Any]) -> FloatArray:
        if "vertices" in entry:
            return _box_of_corners(location, entry["vertices"])
        xyz = group(location, entry, "centroid", "xyz")
        sizes = group(location, entry, "dimensions", SIZES)
        (yaw,) = group(location, entry, "rotations", "z")
        return checked_box(
            location, np.array([*xyz, *sizes, math.radians(yaw) if degrees else yaw])
        )

    return boxes_of(file, objects, box, ("name", ""), CLOUD_KEYS, None)[0]


def has_degrees(files: Sequence[Path]) -> bool:
    """Returns whether a rotation in files of labelCloud is too large for radians."""
    for file in files:
        content = read_json(file)
        for entry in content.get("objects", ()) if isinstance(content, dict) else ():
            turn = entry.get("rotations") if isinstance(entry, dict) else None
            for value in turn.values() if isinstance(turn, dict) else ():
                if isinstance(value, int | float) and abs(value) > MOST_RADIANS:
                    return True
    return False


def _sustech_box(location: str, entry: Mapping[str, Any]) -> FloatArray:
    box = entry.get("psr")
    box = box if isinstance(box, dict) else {}
    parts = [group(f"{location}: psr", box, key, "xyz") for key in ("position", "scale")]
    turn = group(f"{location}: psr", box, "rotation", "xyz")
    ahead = Rotation.from_euler("XYZ", turn).as_matrix()[:, 0]
    heading = float(np.arctan2(ahead[1], ahead[0]))
    return checked_box(location, np.array([*parts[0], *parts[1], heading]))


def _box_of_corners(location: str, raw: object) -> FloatArray:
    """Returns the box of eight corners. Corner 3 is ahead of corner 0, 1 left of 0, 4 above 0."""
    rows = raw if isinstance(raw, list) else []
    values = [
        number(f"{location}: vertices", v) for row in rows if isinstance(row, list) for v in row
    ]
    if len(values) != 24:
        raise FormatError(
            f"{location}: vertices: expected 8 corners of x, y, z, got {len(values)} numbers"
        )
    corners = np.array(values).reshape(8, 3)
    sides = corners[[3, 1, 4]] - corners[0]
    heading = math.atan2(sides[0, 1], sides[0, 0])
    return checked_box(
        location, np.array([*corners.mean(axis=0), *np.linalg.norm(sides, axis=1), heading])
    )
