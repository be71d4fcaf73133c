"""Reads the cuboids of an OpenLABEL file with a single frame.

The ten numbers of a cuboid are x y z, quaternion x y z w, and length width height, in the frame of
the cloud.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.exchange.json_boxes import checked_box, number, read_json
from pyinfra.exchange.recording import Boxes

VISIBILITY = {"NOT_OCCLUDED": 0.9, "PARTIALLY_OCCLUDED": 0.6, "MOSTLY_OCCLUDED": 0.2}
KEYS = {"name", "type", "cuboid"}  # of an object, which are read or repeat its key


def read_cuboids(file: Path, ids: dict[str, int]) -> Boxes:
    """Reads the cuboids of the single frame of a file.

    `ids` maps object keys to numbers. New objects are added to it. Objects without a valid cuboid
    are left out, and listed in `Boxes.left_out`.

    Raises FormatError if the file has no single frame of objects.
    """
    names, rows, track_ids, visibility = [], [], [], []
    left_out: list[str] = []
    unread: set[str] = set()
    for key, data in _objects(file):
        cuboid = data.get("cuboid")
        cuboid = cuboid[0] if isinstance(cuboid, list) and cuboid else cuboid
        cuboid = cuboid if isinstance(cuboid, dict) else {}
        unread |= set(data) - KEYS
        try:
            rows.append(_box(f"{file}: object {key}", cuboid.get("val")))
        except FormatError as error:
            left_out.append(str(error))
            continue
        names.append(str(data.get("type") or "unknown"))
        track_ids.append(ids.setdefault(key, len(ids)))
        visibility.append(_visibility(cuboid))
    boxes = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return Boxes(
        np.array(names, dtype=np.str_),
        boxes,
        np.array(track_ids, dtype=np.int64),
        np.array(visibility, dtype=np.float64),
        tuple(left_out),
        frozenset(unread),
    )


def _box(location: str, values: object) -> FloatArray:
    if not isinstance(values, list) or len(values) != 10:
        raise FormatError(f"{location}: expected a cuboid of ten numbers, got none")
    x, y, z, *turn, length, width, height = (number(location, value) for value in values)
    if not 0.9 <= np.linalg.norm(turn) <= 1.1:
        raise FormatError(f"{location}: expected a quaternion of length 1, got {turn}")
    ahead = Rotation.from_quat(turn).as_matrix()[:, 0]
    heading = float(np.arctan2(ahead[1], ahead[0]))
    return checked_box(location, np.array([x, y, z, length, width, height, heading]))


def _objects(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields key and object_data of each object of the single frame."""
    content = read_json(file)
    try:
        frames = list(content["openlabel"]["frames"].values())
        objects = [item for frame in frames for item in frame.get("objects", {}).items()]
        object_data = [(key, item["object_data"]) for key, item in objects]
    except (AttributeError, KeyError, TypeError):
        raise FormatError(f"{file}: expected openlabel.frames with objects, got none") from None
    if len(frames) > 1:
        raise FormatError(f"{file}: expected one frame in a label file, got {len(frames)} frames")
    for key, data in object_data:
        if not isinstance(data, dict):
            raise FormatError(f"{file}: object {key}: expected object_data, got none")
        yield key, data


def _visibility(cuboid: dict[str, Any]) -> float:
    attributes = cuboid.get("attributes")
    texts = attributes.get("text", []) if isinstance(attributes, dict) else []
    for attribute in texts if isinstance(texts, list) else []:
        if isinstance(attribute, dict) and attribute.get("name") == "occlusion_level":
            return VISIBILITY.get(str(attribute.get("val")), 1.0)
    return 1.0
