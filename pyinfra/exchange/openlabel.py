"""Writes boxes as cuboids in one JSON file of ASAM OpenLABEL 1.0.0, and the clouds.

    NAME.json            labels, valid against the standard's JSON schema
    points/NNNNNN.bin    float32 x y z intensity, as in KITTI
- OpenLABEL frames count from 0 without gaps, because intervals refer to them. `frame_stream` of a
  stream is the frame number of this package.
- Times are seconds since the start of the run. The time of a frame is its middle, and the time of a
  cloud is the start of its frame. Times are strings, because more readers accept strings than
  fractional numbers.
- A cuboid is x y z, quaternion x y z w, length width height, in the LiDAR's coordinate system. This
  system has a pose in the coordinate system `world` of the scene.
- Attributes are `points_in_box` of the objects, and speed (m/s) and visibility if known.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from pyinfra.core.files import replacing
from pyinfra.exchange.series import (
    FrameSeries,
    StoredFrame,
    copy_cloud,
    quaternion,
    read_frames,
    read_series,
)
from pyinfra.formats.kitti import Objects

Json = dict[str, Any]
Item = tuple[str, Json]

WORLD = "world"
CUBOID = "shape"  # name of the single cuboid of each object
FORMAT = "KITTI: float32 little-endian x y z intensity, metres, intensity 0 to 1"


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes NAME.json and the clouds to the folder `out`.

    The function keeps only one frame and the frame intervals of all objects in memory. Raises
    FileNotFoundError for an incomplete frame, and FormatError. `frames` must not be empty.
    """
    series, presence = read_series(lidar_folder), Presence()
    (out / "points").mkdir()
    parts: dict[str, Json | Iterable[Item]] = {
        "metadata": _metadata(series),
        "coordinate_systems": _coordinate_systems(series),
        "streams": {series.lidar: {"type": "lidar", "uri": "points", "description": FORMAT}},
        "frames": _frames(series, frames, presence, out),
        # `objects` must follow the frames, because iterating over the frames fills `presence`.
        "objects": presence.objects(series.lidar),
    }
    write_document(out / f"{series.lidar}.json", parts, len(frames))


def write_document(file: Path, parts: Mapping[str, Json | Iterable[Item]], frames: int) -> None:
    """Writes an OpenLABEL file: the parts in their order, with one item of a part per line."""
    with replacing(file) as beside, beside.open("w", encoding="utf-8") as stream:
        stream.write('{"openlabel": {\n')
        for name, part in parts.items():
            stream.write(f'"{name}": ')
            _write_items(stream, part.items() if isinstance(part, dict) else part)
            stream.write(",\n")
        stream.write(f'"frame_intervals": {json.dumps([_interval(0, frames - 1)])}\n}}}}\n')


class Presence:
    """The intervals of frames, both ends included, in which each object is present."""

    def __init__(self) -> None:
        self.names: dict[int, str] = {}
        self.intervals: dict[int, list[list[int]]] = {}

    def add(self, index: int, objects: Iterable[tuple[int, str]]) -> None:
        """Adds the ids and classes of the objects of a frame."""
        for number, name in objects:
            self.names.setdefault(number, name)
            intervals = self.intervals.setdefault(number, [])
            if intervals and intervals[-1][1] == index - 1:
                intervals[-1][1] = index
            else:
                intervals.append([index, index])

    def objects(self, coordinate_system: str) -> Iterator[Item]:
        for number, name in self.names.items():
            intervals = [_interval(*ends) for ends in self.intervals[number]]
            shape = {"type": "cuboid", "frame_intervals": intervals}
            yield (
                str(number),
                {
                    "name": f"{name} {number}",
                    "type": name,
                    "coordinate_system": coordinate_system,
                    "frame_intervals": intervals,
                    "object_data_pointers": {CUBOID: shape},
                },
            )


def _frames(
    series: FrameSeries, numbers: Sequence[int], presence: Presence, out: Path
) -> Iterator[Item]:
    for index, frame in enumerate(read_frames(series, numbers)):
        cloud = f"points/{frame.number:06d}.bin"
        copy_cloud(series, frame.number, out / cloud)
        ids, names = frame.objects.ids.tolist(), frame.objects.names.tolist()
        presence.add(index, zip(ids, names, strict=True))
        yield (
            str(index),
            {
                "frame_properties": _frame_properties(series, frame, cloud),
                "objects": dict(_cuboids(series.lidar, frame.objects)),
            },
        )


def _frame_properties(series: FrameSeries, frame: StoredFrame, cloud: str) -> Json:
    sync = {"frame_stream": frame.number, "timestamp": f"{frame.start_s:.9f}"}
    stream = {"uri": cloud, "stream_properties": {"sync": sync}}
    return {"timestamp": f"{frame.middle_s:.9f}", "streams": {series.lidar: stream}}


def _cuboids(coordinate_system: str, o: Objects) -> Iterator[Item]:
    """Yields the id and object_data of each object of a frame."""
    for i, number in enumerate(o.ids.tolist()):
        box = o.boxes[i].tolist()
        numbers = {"points_in_box": int(o.points_in_box[i])}
        if not np.isnan(o.speed[i]):
            numbers["speed"] = o.speed[i]
        if o.visibility[i] >= 0:
            numbers["visibility"] = o.visibility[i]
        yield str(number), cuboid(coordinate_system, box, numbers)


def cuboid(coordinate_system: str, box: Sequence[float], numbers: Mapping[str, float]) -> Json:
    """Returns the data of an object: a box x y z dx dy dz heading, with attributes."""
    shape = {
        "name": CUBOID,
        "val": [*box[:3], *quaternion(box[6]), *box[3:6]],
        "coordinate_system": coordinate_system,
        "attributes": {"num": [{"name": name, "val": val} for name, val in numbers.items()]},
    }
    return {"object_data": {"cuboid": [shape]}}


def _metadata(series: FrameSeries) -> Json:
    return {
        "schema_version": "1.0.0",
        "name": f"{series.scene}, {series.lidar}",
        "annotator": f"infrasim {series.provenance.get('version', '')}".strip(),
        "comment": ", ".join(f"{key} {value}" for key, value in series.provenance.items()),
    }


def _coordinate_systems(series: FrameSeries) -> Json:
    """Returns the coordinate systems. A system's pose maps its points to the parent's system."""
    pose = series.T_world_lidar
    return {
        WORLD: {"type": "scene_cs", "parent": "", "children": [series.lidar]},
        series.lidar: {
            "type": "sensor_cs",
            "parent": WORLD,
            "children": [],
            "pose_wrt_parent": {
                "quaternion": list(quaternion(pose.yaw)),
                "translation": [pose.x, pose.y, pose.z],
            },
        },
    }


def _interval(start: int, end: int) -> Json:
    return {"frame_start": start, "frame_end": end}


def _write_items(stream: TextIO, items: Iterable[tuple[str, Any]]) -> None:
    """Writes a JSON object with one item per line."""
    before = "{\n"
    for key, value in items:
        stream.write(f"{before}{json.dumps(key)}: {json.dumps(value, allow_nan=False)}")
        before = ",\n"
    stream.write("{}" if before == "{\n" else "\n}")
