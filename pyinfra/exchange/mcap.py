"""Writes an MCAP file of ROS 2 messages without ROS, for Foxglove, RViz and PlotJuggler.

The file NAME.mcap has the topics
    /NAME/points  sensor_msgs/PointCloud2            all available point fields
    /NAME/boxes   visualization_msgs/MarkerArray     a marker that deletes all, one cube per object
    /tf           tf2_msgs/TFMessage                 world to the levelled LiDAR frame, `NAME`
A cloud is stamped with the start of its frame. The field `time` counts from this stamp. Boxes are
stamped with the middle of the frame. With label time `scan`, this is only approximate, because
each object has a different scan time. All messages are logged at the end of the frame, when a
real sensor would send them.

The pose is written in every frame for both stamps, so that a player can start at any frame. The
topic `/tf_static` cannot be used, because its messages are only kept with a quality of service that
file players do not set by default. Names and types of the fields are those of the ROS 2 interfaces
(Humble and later).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap_ros2.writer import Writer

from pyinfra.core.arrays import Records
from pyinfra.core.files import replacing
from pyinfra.exchange.series import (
    FrameSeries,
    StoredFrame,
    nanoseconds,
    quaternion,
    read_frames,
    read_series,
)

Message = dict[str, Any]

WORLD = "world"
COLOUR = {"r": 1.0, "g": 0.6, "b": 0.1, "a": 0.4}
_CUBE, _DELETE_ALL = 1, 3  # Marker.type, Marker.action

# Type numbers of sensor_msgs/PointField.
_DATATYPES = {"<f4": 7, "|u1": 2, "<u2": 4, "<i4": 5}
# Maps kitti.FIELDS to the names that other tools use.
_FIELDS = {
    "time_s": "time",
    "ring": "ring",
    "class": "class_id",
    "echo": "echo",
    "object_id": "object_id",
}

_HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
_VECTORS = """
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
_DEFINITIONS = {
    "sensor_msgs/msg/PointCloud2": f"""
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
{_HEADER}
================================================================================
MSG: sensor_msgs/PointField
string name
uint32 offset
uint8 datatype
uint32 count
""",
    "visualization_msgs/msg/MarkerArray": f"""
visualization_msgs/Marker[] markers
================================================================================
MSG: visualization_msgs/Marker
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials
{_HEADER}{_VECTORS}
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: std_msgs/ColorRGBA
float32 r
float32 g
float32 b
float32 a
================================================================================
MSG: sensor_msgs/CompressedImage
std_msgs/Header header
string format
uint8[] data
================================================================================
MSG: visualization_msgs/UVCoordinate
float32 u
float32 v
================================================================================
MSG: visualization_msgs/MeshFile
string filename
uint8[] data
""",
    "tf2_msgs/msg/TFMessage": f"""
geometry_msgs/TransformStamped[] transforms
================================================================================
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
{_HEADER}{_VECTORS}
================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""",
}


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes NAME.mcap to the folder `out`, with one frame in memory at a time.

    Raises FileNotFoundError for an incomplete frame, and FormatError. If an error occurs, no file
    is written.
    """
    series = read_series(lidar_folder)
    file = out / f"{series.lidar}.mcap"
    with replacing(file) as beside, beside.open("wb") as stream, Writer(stream) as writer:
        writer.add_metadata("infrasim", series.provenance)
        schemas = {name: writer.register_msgdef(name, text) for name, text in _DEFINITIONS.items()}
        for frame in read_frames(series, frames):
            _write_frame(writer, schemas, series, frame)


def _write_frame(
    writer: Writer, schemas: dict[str, Schema], series: FrameSeries, frame: StoredFrame
) -> None:
    name = series.lidar
    messages = (
        ("/tf", "tf2_msgs/msg/TFMessage", transforms(series, frame)),
        (f"/{name}/points", "sensor_msgs/msg/PointCloud2", cloud(name, frame)),
        (f"/{name}/boxes", "visualization_msgs/msg/MarkerArray", markers(name, frame)),
    )
    logged = nanoseconds(frame.start_s + series.period_s)
    for topic, schema, message in messages:
        writer.write_message(topic, schemas[schema], message, logged, sequence=frame.number)


def cloud(frame_id: str, frame: StoredFrame) -> Message:
    """Returns a sensor_msgs/PointCloud2 with all available fields of the points."""
    records = _records(frame)
    step = records.dtype.itemsize
    return {
        "header": _header(frame.start_s, frame_id),
        "height": 1,
        "width": len(records),
        "fields": _point_fields(records.dtype),
        "is_bigendian": False,
        "point_step": step,
        "row_step": step * len(records),
        "data": records.tobytes(),
        "is_dense": True,
    }


def markers(frame_id: str, frame: StoredFrame) -> Message:
    """Returns a visualization_msgs/MarkerArray. The namespace is the class of the object."""
    objects, header = frame.objects, _header(frame.middle_s, frame_id)
    clear = {"header": header, "action": _DELETE_ALL}
    cubes = [
        {
            "header": header,
            "ns": str(name),
            "id": int(number),
            "type": _CUBE,
            "pose": {
                "position": _xyz(box[:3]),
                "orientation": _xyzw(quaternion(box[6])),
            },
            "scale": _xyz(box[3:6]),
            "color": COLOUR,
            "text": f"{name} {number}",
        }
        for name, number, box in zip(objects.names, objects.ids, objects.boxes, strict=True)
    ]
    return {"markers": [clear, *cubes]}


def transforms(series: FrameSeries, frame: StoredFrame) -> Message:
    """Returns a tf2_msgs/TFMessage with the sensor's pose at the stamps of cloud and boxes."""
    pose = series.T_world_lidar
    transform = {
        "translation": _xyz((pose.x, pose.y, pose.z)),
        "rotation": _xyzw(quaternion(pose.yaw)),
    }
    return {
        "transforms": [
            {
                "header": _header(time_s, WORLD),
                "child_frame_id": series.lidar,
                "transform": transform,
            }
            for time_s in (frame.start_s, frame.middle_s)
        ]
    }


def _records(frame: StoredFrame) -> Records:
    """Returns packed records (n,) with all available fields of the points."""
    columns = {name: frame.points[:, i] for i, name in enumerate(("x", "y", "z", "intensity"))}
    if frame.fields is not None:
        columns |= {name: frame.fields[key] for key, name in _FIELDS.items()}
    types = [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()]
    records = np.empty(len(frame.points), dtype=types)
    for name, column in columns.items():
        records[name] = column
    return records


def _point_fields(dtype: np.dtype[Any]) -> list[Message]:
    assert dtype.fields is not None
    return [
        {"name": name, "offset": offset, "datatype": _DATATYPES[kind.str], "count": 1}
        for name, (kind, offset, *_) in dtype.fields.items()
    ]


def _header(time_s: float, frame_id: str) -> Message:
    sec, nanosec = divmod(nanoseconds(time_s), 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id}


def _xyz(values: Sequence[float]) -> Message:
    return dict(zip("xyz", values, strict=True))


def _xyzw(values: Sequence[float]) -> Message:
    return dict(zip("xyzw", values, strict=True))
