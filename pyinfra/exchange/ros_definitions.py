"""Definitions and parts of the ROS 2 messages that are written (Humble and later)."""

from collections.abc import Sequence
from typing import Any

from pyinfra.core.arrays import FloatArray
from pyinfra.exchange.series import nanoseconds, quaternion

Message = dict[str, Any]

CUBE, DELETE_ALL = 1, 3  # values of Marker.type and Marker.action

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
_POSE = """
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
"""
DEFINITIONS = {
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
{_HEADER}{_VECTORS}{_POSE}
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
    "vision_msgs/msg/Detection3DArray": f"""
std_msgs/Header header
vision_msgs/Detection3D[] detections
{_HEADER}{_VECTORS}{_POSE}
================================================================================
MSG: vision_msgs/Detection3D
std_msgs/Header header
vision_msgs/ObjectHypothesisWithPose[] results
vision_msgs/BoundingBox3D bbox
string id
================================================================================
MSG: vision_msgs/ObjectHypothesisWithPose
vision_msgs/ObjectHypothesis hypothesis
geometry_msgs/PoseWithCovariance pose
================================================================================
MSG: vision_msgs/ObjectHypothesis
string class_id
float64 score
================================================================================
MSG: vision_msgs/BoundingBox3D
geometry_msgs/Pose center
geometry_msgs/Vector3 size
================================================================================
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
""",
}


def header(time_s: float, frame_id: str) -> Message:
    """Returns a std_msgs/Header."""
    sec, nanosec = divmod(nanoseconds(time_s), 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id}


def xyz(values: Sequence[float]) -> Message:
    """Returns a geometry_msgs/Point or Vector3."""
    return dict(zip("xyz", values, strict=True))


def turned_about_z(heading: float) -> Message:
    """Returns the geometry_msgs/Quaternion of a rotation about z."""
    return dict(zip("xyzw", quaternion(heading), strict=True))


def pose(box: FloatArray) -> Message:
    """Returns a geometry_msgs/Pose of the centre of a box (7,)."""
    return {"position": xyz(box[:3].tolist()), "orientation": turned_about_z(float(box[6]))}


def cube(stamp: Message, namespace: str, number: int, box: FloatArray, colour: Message) -> Message:
    """Returns a visualization_msgs/Marker of a box (7,)."""
    return {
        "header": stamp,
        "ns": namespace,
        "id": number,
        "type": CUBE,
        "pose": pose(box),
        "scale": xyz(box[3:6].tolist()),
        "color": colour,
        "text": f"{namespace} {number}",
    }


def marker_array(stamp: Message, markers: Sequence[Message]) -> Message:
    """Returns a visualization_msgs/MarkerArray that replaces all former markers of its topic."""
    return {"markers": [{"header": stamp, "action": DELETE_ALL}, *markers]}
