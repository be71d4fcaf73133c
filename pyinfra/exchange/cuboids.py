"""Reads the cuboids of OpenLABEL files with one frame, or with all frames of a recording.

The ten numbers of a cuboid are x y z, quaternion x y z w, and length width height, in the frame of
the cloud.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.exchange.json_boxes import checked_box, number, read_json
from pyinfra.exchange.recording import Boxes

VISIBILITY = {"NOT_OCCLUDED": 0.9, "PARTIALLY_OCCLUDED": 0.6, "MOSTLY_OCCLUDED": 0.2}
KEYS = {"name", "type", "cuboid"}  # keys of an object that are not reported as unread


def read_cuboids(file: Path, ids: dict[str, int]) -> Boxes:
    """Reads the cuboids of the single frame of a file.

    `ids` maps object keys to numbers. New objects are added to it. Objects without a valid cuboid
    are left out, and listed in `Boxes.left_out`.

    Raises FormatError unless the file has exactly one frame.
    """
    frames, types = _frames_and_types(file)
    if len(frames) > 1:
        raise FormatError(f"{file}: expected one frame in a label file, got {len(frames)} frames")
    return _boxes(file, next(iter(frames.values()), {}), types, ids)


def read_sequence(file: Path, clouds: Sequence[str]) -> dict[str, Boxes]:
    """Reads the boxes of each cloud from a file with all frames of a recording.

    `clouds` are the names of the clouds. A frame names its cloud by the `uri` of a stream, else by
    its key. Clouds that are not in the file are not in the result. Raises FormatError for a frame
    without a cloud, and for a file without a frame.
    """
    frames, types = _frames_and_types(file)
    if not frames:
        raise FormatError(f"{file}: openlabel.frames: expected one or more frames, got none")
    numbers: dict[int, list[str]] = {}
    for cloud in clouds:
        if cloud.isdecimal():
            numbers.setdefault(int(cloud), []).append(cloud)
    ids: dict[str, int] = {}
    out = {}
    for key, frame in frames.items():
        names = [PurePath(uri).stem for uri in _uris(frame)] + [key]
        name = next((name for name in names if name in clouds), None)
        if name is None and key.isdecimal() and (fitting := numbers.get(int(key))):
            if len(fitting) > 1:
                raise FormatError(
                    f"{file}: frame {key}: expected a number that fits one cloud, got a number "
                    f"that fits {' and '.join(fitting)}; name the cloud in the `uri` of a stream"
                )
            name = fitting[0]
        if name is None:
            raise FormatError(
                f"{file}: frame {key}: expected a point cloud named {names[0]}, got none"
            )
        out[name] = _boxes(file, frame, types, ids)
    return out


def _uris(frame: dict[str, Any]) -> Iterator[str]:
    properties = frame.get("frame_properties")
    streams = properties.get("streams") if isinstance(properties, dict) else None
    for stream in streams.values() if isinstance(streams, dict) else ():
        if isinstance(stream, dict) and "uri" in stream:
            yield str(stream["uri"])


def _frames_and_types(file: Path) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Returns the frames by key, and the types of objects that are stated once for all frames."""
    content = read_json(file)
    try:
        top = content["openlabel"]
        frames = {key: dict(frame) for key, frame in top["frames"].items()}
        listed = top.get("objects") or {}
        types = {key: str(item["type"]) for key, item in listed.items() if "type" in item}
    except (AttributeError, KeyError, TypeError, ValueError):
        raise FormatError(f"{file}: expected openlabel.frames with objects, got none") from None
    return frames, types


def _boxes(file: Path, frame: dict[str, Any], types: dict[str, str], ids: dict[str, int]) -> Boxes:
    names, rows, track_ids, visibility = [], [], [], []
    left_out: list[str] = []
    unread: set[str] = set()
    for key, data in _objects(file, frame):
        cuboid = data.get("cuboid")
        cuboid = cuboid[0] if isinstance(cuboid, list) and cuboid else cuboid
        cuboid = cuboid if isinstance(cuboid, dict) else {}
        unread |= set(data) - KEYS
        try:
            rows.append(_box(f"{file}: object {key}", cuboid.get("val")))
        except FormatError as error:
            left_out.append(str(error))
            continue
        names.append(str(data.get("type") or types.get(key) or "unknown"))
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


def _objects(file: Path, frame: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields key and object_data of each object of a frame."""
    try:
        object_data = [(k, item["object_data"]) for k, item in frame.get("objects", {}).items()]
    except (AttributeError, KeyError, TypeError):
        raise FormatError(f"{file}: expected openlabel.frames with objects, got none") from None
    for key, data in object_data:
        if not isinstance(data, dict):
            raise FormatError(f"{file}: object {key}: expected object_data, got none")
        yield key, data


def _visibility(cuboid: dict[str, Any]) -> float:
    """Returns the visible share from the number `visibility`, else from `occlusion_level`."""
    attributes = cuboid.get("attributes")
    attributes = attributes if isinstance(attributes, dict) else {}
    for kind, name in (("num", "visibility"), ("text", "occlusion_level")):
        entries = attributes.get(kind)
        for entry in entries if isinstance(entries, list) else []:
            if isinstance(entry, dict) and entry.get("name") == name:
                value = entry.get("val")
                if kind == "text":
                    return VISIBILITY.get(str(value), 1.0)
                if isinstance(value, int | float) and 0 <= value <= 1:
                    return float(value)
    return 1.0
