"""Writes an MCAP file of ROS 2 messages without ROS, for Foxglove, RViz and PlotJuggler.

The file NAME.mcap has the topics
    /NAME/points  sensor_msgs/PointCloud2            all available point fields
    /NAME/boxes   visualization_msgs/MarkerArray     deletes earlier markers, adds a cube per object
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

from mcap.records import Schema
from mcap_ros2.writer import Writer

from pyinfra.core.files import replacing
from pyinfra.exchange.ros_definitions import (
    DEFINITIONS,
    Message,
    cube,
    header,
    marker_array,
    turned_about_z,
    xyz,
)
from pyinfra.exchange.series import (
    FrameSeries,
    StoredFrame,
    nanoseconds,
    point_records,
    read_frames,
    read_series,
)

WORLD = "world"
TYPES = (
    "sensor_msgs/msg/PointCloud2", "visualization_msgs/msg/MarkerArray", "tf2_msgs/msg/TFMessage"
)  # fmt: skip
COLOUR = {"r": 1.0, "g": 0.6, "b": 0.1, "a": 0.4}

# Type numbers of sensor_msgs/PointField.
_DATATYPES = {"<f4": 7, "|u1": 2, "<u2": 4, "<i4": 5}
# Maps the names of point fields in exported files to names in kitti.FIELDS.
_FIELDS = {
    "time": "time_s",
    "ring": "ring",
    "class_id": "class",
    "echo": "echo",
    "object_id": "object_id",
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
        schemas = {name: writer.register_msgdef(name, DEFINITIONS[name]) for name in TYPES}
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
    records = point_records(frame.points, frame.fields, _FIELDS)
    step = records.dtype.itemsize
    return {
        "header": header(frame.start_s, frame_id),
        "height": 1,
        "width": len(records),
        "fields": [
            {"name": name, "offset": offset, "datatype": _DATATYPES[kind.str], "count": 1}
            for name, (kind, offset, *_) in (records.dtype.fields or {}).items()
        ],
        "is_bigendian": False,
        "point_step": step,
        "row_step": step * len(records),
        "data": records.tobytes(),
        "is_dense": True,
    }


def markers(frame_id: str, frame: StoredFrame) -> Message:
    """Returns a visualization_msgs/MarkerArray. The namespace is the class of the object."""
    objects, stamp = frame.objects, header(frame.middle_s, frame_id)
    named = zip(objects.names, objects.ids, objects.boxes, strict=True)
    return marker_array(stamp, [cube(stamp, str(n), int(i), box, COLOUR) for n, i, box in named])


def transforms(series: FrameSeries, frame: StoredFrame) -> Message:
    """Returns a tf2_msgs/TFMessage with the sensor's pose at the stamps of cloud and boxes."""
    pose = series.T_world_lidar
    transform = {
        "translation": xyz((pose.x, pose.y, pose.z)),
        "rotation": turned_about_z(pose.yaw),
    }
    return {
        "transforms": [
            {
                "header": header(time_s, WORLD),
                "child_frame_id": series.lidar,
                "transform": transform,
            }
            for time_s in (frame.start_s, frame.middle_s)
        ]
    }
