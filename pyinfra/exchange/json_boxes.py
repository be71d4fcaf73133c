"""Reads boxes in the JSON format of DAIR-V2X and RCooper.

There is one file per cloud, with a list of objects. An object has `type`, `3d_dimensions` (h w l),
`3d_location` (x y z of the box centre in the cloud's frame) and `rotation` (rad, from x towards y).
`occluded_state` and `track_id` are optional.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.exchange.recording import Boxes, digest_of
from pyinfra.formats.kitti.layout import FARTHEST_M
from pyinfra.formats.track_names import names_in_frame

# Visible share for each `occluded_state`: not, partly and mostly occluded.
VISIBILITY = {0: 0.9, 1: 0.6, 2: 0.2}
BOX_KEYS = (("3d_location", "xyz"), ("3d_dimensions", "lwh"))
# Keys of an object that are read.
KNOWN = {"type", "3d_dimensions", "3d_location", "rotation", "occluded_state", "track_id"}
LEAST_M, MOST_M = 0.001, 1000.0


class UnitError(FormatError):
    """Raised for a value in another unit, which is then probably the unit of all objects."""


def read_json(file: Path) -> Any:
    """Reads a JSON file. Raises FormatError if it is not valid JSON."""
    try:
        return json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:  # the file is not JSON or not UTF-8, for example
        raise FormatError(f"{file}: cannot be read as JSON: {error}") from None


def shown(content: object) -> str:
    """Describes the JSON value of a file in a few words."""
    if isinstance(content, dict):
        return f"the keys {', '.join(map(str, content))[:200]}" if content else "no keys"
    return "a list with unexpected entries" if isinstance(content, list) else f"{content!r:.40}"


def read_objects(file: Path, ids: dict[str, int] | None = None) -> Boxes:
    """Reads the objects of a file.

    `ids` maps track names to numbers, and new tracks are added to it. An object without a track,
    or with the track of another object of the file, gets an id of its own. If `ids` is None, boxes
    get no ids. Objects without a valid box are left out, and listed in `Boxes.left_out` with the
    key.

    Raises FormatError if the file is no list of objects, and for a rotation in degrees.
    """
    objects = checked_objects(file, read_json(file))
    boxes, kept = boxes_of(file, objects, _box, ("type", "track_id"), KNOWN, ids)
    visibility = [VISIBILITY.get(_state(objects[i]), 1.0) for i in kept]
    return replace(boxes, visibility=np.array(visibility, dtype=np.float64))


def checked_objects(file: Path, objects: object) -> list[dict[str, Any]]:
    """Returns the objects unchanged. Raises FormatError if they are no list of objects."""
    if not isinstance(objects, list) or not all(isinstance(entry, dict) for entry in objects):
        raise FormatError(f"{file}: expected a list of objects, got {shown(objects)}")
    return objects


def boxes_of(
    file: Path,
    objects: Sequence[Mapping[str, Any]],
    box_of: Callable[[str, Mapping[str, Any]], FloatArray],
    keys: tuple[str, str],
    known: Set[str],
    ids: dict[str, int] | None,
) -> tuple[Boxes, list[int]]:
    """Reads the boxes of objects. Returns them, and the positions of the objects with a valid box.

    box_of: returns a box; gets the location of an object, for messages, and the object.

    `keys` are the keys of the class and of the track, and `known` are all keys that are read. `ids`
    is that of `read_objects`. Raises UnitError. Objects for which `box_of` raises another
    FormatError are left out.
    """
    rows, kept, left_out = [], [], []
    for i, entry in enumerate(objects):
        try:
            rows.append(box_of(f"{file}: object {i}", entry))
            kept.append(i)
        except UnitError:
            raise
        except FormatError as error:
            left_out.append(str(error))
    chosen = [objects[i] for i in kept]
    names = [str(entry.get(keys[0], "unknown")) or "unknown" for entry in chosen]
    tracks = None
    if ids is not None:
        words = [entry.get(keys[1]) for entry in chosen]
        named = names_in_frame(words, [f"{file}: object {i}" for i in kept])
        tracks = np.array([ids.setdefault(name, len(ids)) for name in named], dtype=np.int64)
    values = np.array(rows, dtype=np.float64).reshape(-1, 7)
    unread = frozenset().union(*objects) - known
    boxes = Boxes(np.array(names, dtype=np.str_), values, tracks, None, tuple(left_out), unread)
    return boxes, kept


def track_digest(files: Sequence[Path], key: str = "track_id") -> str:
    """Returns a digest of label files whose objects have tracks; empty if no object has one."""
    tracked = any(f'"{key}"'.encode() in file.read_bytes() for file in files)
    return digest_of(files) if tracked else ""


def checked_box(location: str, values: FloatArray) -> FloatArray:
    """Checks a box (7,) and returns it. Raises FormatError that begins with `location`."""
    xyz, sizes = values[:3], values[3:6]
    finite = np.isfinite(values).all() and np.abs(xyz).max() <= FARTHEST_M
    if not finite or sizes.min() <= LEAST_M or sizes.max() > MOST_M:
        allowed = f"sizes above {LEAST_M:g} m, up to {MOST_M:g} m, and a centre within 10 km"
        raise FormatError(
            f"{location}: expected {allowed}, got length, width, height {sizes} and centre {xyz}"
        )
    if abs(values[6]) > 2 * math.pi + 0.01:
        raise UnitError(f"{location}: rotation: expected -2 pi to 2 pi rad, got {values[6]:g}")
    return values


def _box(location: str, entry: Mapping[str, Any]) -> FloatArray:
    numbers = [value for key, letters in BOX_KEYS for value in group(location, entry, key, letters)]
    numbers.append(number(f"{location}: rotation", entry.get("rotation")))
    return checked_box(location, np.array(numbers))


def group(location: str, entry: Mapping[str, Any], key: str, parts: Sequence[str]) -> list[float]:
    """Returns the numbers of a key such as `3d_location`, in the order of `parts`."""
    if key not in entry:
        raise FormatError(f"{location}: expected the key '{key}', got none")
    inside = entry[key] if isinstance(entry[key], dict) else {}
    return [number(f"{location}: {key}.{part}", inside.get(part)) for part in parts]


def number(location: str | Path, raw: object) -> float:
    """Converts a number or text to float. Raises FormatError that begins with `location`."""
    try:
        value = float(raw)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{location}: expected a finite number, got {str(raw)[:40]!r}")
    return value


def _state(entry: Mapping[str, Any]) -> int:
    try:
        return int(entry.get("occluded_state", -1))
    except (TypeError, ValueError):
        return -1
