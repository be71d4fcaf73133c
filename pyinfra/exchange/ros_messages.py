"""Reads ROS messages of points, boxes and transforms into arrays.

Names and types are those of the public interface definitions of ROS 1 and ROS 2, of vision_msgs,
jsk_recognition_msgs, and of Livox's drivers.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import FloatArray, Records
from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange.json_boxes import checked_box
from pyinfra.exchange.recording import Boxes
from pyinfra.exchange.series import NEW_IDS
from pyinfra.formats.track_names import names_in_frame

CLOUD = "sensor_msgs/msg/PointCloud2"
LIVOX = tuple(
    f"{package}/msg/CustomMsg"
    for package in ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces")
)
MARKERS = "visualization_msgs/msg/MarkerArray"
DETECTIONS = "vision_msgs/msg/Detection3DArray"
JSK_BOXES = "jsk_recognition_msgs/msg/BoundingBoxArray"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
# Types of sensor_msgs/PointField, by their number.
DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
LIVOX_FIELDS = [
    ("offset_time", "<u4"),
    *((axis, "<f4") for axis in "xyz"),
    *((name, "u1") for name in ("reflectivity", "tag", "line")),
]
_CUBE, _ADD = 1, 0  # values of Marker.type and Marker.action


class Entry(NamedTuple):
    """A box of a message."""

    frame_id: str  # empty if the message does not state the frame
    name: str
    track: str  # name of the track in the message
    pose: Any
    size: Any
    id: int = -1  # number of the track, which `with_ids` sets


def header_stamp_ns(raw: bytes, *, is_ros2: bool) -> int:
    """Returns the stamp of a message that begins with a std_msgs/Header, without its other fields.

    ROS 2 has 4 bytes of encapsulation, and ROS 1 has a sequence number, before the stamp.
    """
    if len(raw) < 12:
        return 0
    order = "<" if not is_ros2 or raw[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}II", raw, 4)
    return int(seconds) * 10**9 + int(nanoseconds)


def cloud_records(location: str, message: Any) -> Records:
    """Returns the points (n,) of a sensor_msgs/PointCloud2 with all fields of one value.

    Raises FormatError that begins with `location` if the message's sizes are inconsistent.
    """
    order = ">" if message.is_bigendian else "<"
    names, formats, offsets = [], [], []
    for field in message.fields:
        kind = DATATYPES.get(int(field.datatype))
        is_padding = int(field.count) > 1
        if kind is None or not field.name or field.name in names or is_padding:
            continue
        names.append(field.name)
        formats.append(order + kind)
        offsets.append(int(field.offset))
    step, width, height = int(message.point_step), int(message.width), int(message.height)
    ends = [o + np.dtype(f).itemsize for o, f in zip(offsets, formats, strict=True)]
    if not names or max(ends) > step or step > 10_000:
        raise FormatError(
            f"{location}: expected fields within the point_step of {step} bytes, got fields up to "
            f"byte {max(ends, default=0)}"
        )
    data = bytes(message.data)
    row = int(message.row_step) if height > 1 else width * step
    size = row * (height - 1) + width * step if width and height else 0
    if row < width * step or len(data) < size:
        raise FormatError(
            f"{location}: expected {size} bytes of points ({width} x {height}), got {len(data)}"
        )
    record = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})
    return np.ndarray((height, width), record, data, strides=(row, step)).ravel()


def livox_records(location: str, raw: bytes, *, is_ros2: bool) -> Records:
    """Returns the points (n,) of a Livox CustomMsg.

    The bytes are read here, because a general reader makes an object of each point. Raises
    FormatError that begins with `location`.
    """
    try:
        (length,) = struct.unpack_from("<I", raw, 12)
        at = 16 + length
        if is_ros2:
            at += -(at - 4) % 8  # padding: the timebase is aligned to 8 bytes, counted from byte 4
        at += 8 + 4 + 4  # sizes of timebase, of point_num, and of lidar_id and rsvd
        (count,) = struct.unpack_from("<I", raw, at)
    except struct.error:
        raise FormatError(f"{location}: expected a whole CustomMsg, got {len(raw)} bytes") from None
    at += 4
    step = 20 if is_ros2 else 19  # CDR aligns each point to 4 bytes
    size = max(step * (count - 1) + 19, 0)
    if len(raw) - at < size or size > len(raw):
        raise FormatError(f"{location}: expected {size} bytes of points, got {len(raw) - at}")
    return np.ndarray(count, np.dtype(LIVOX_FIELDS), raw, at, strides=(step,)).copy()


@dataclass(frozen=True, eq=False)
class Transform:
    """The transform of a child frame to its parent frame."""

    shift: FloatArray  # translation (3,), metres
    turn: FloatArray  # rotation matrix (3, 3)

    def after(self, inner: Transform) -> Transform:
        """Returns the transform that applies `inner` and then this transform."""
        return Transform(self.shift + self.turn @ inner.shift, self.turn @ inner.turn)

    def inverse(self) -> Transform:
        return Transform(-self.turn.T @ self.shift, self.turn.T)


IDENTITY = Transform(np.zeros(3), np.eye(3))
Frames = dict[str, tuple[str, Transform]]  # parent of each child frame, and the transform to it


def transforms(message: Any) -> Iterator[tuple[str, str, Transform]]:
    """Yields child, parent and the transform of each valid entry of a TFMessage."""
    for entry in message.transforms:
        q, t = entry.transform.rotation, entry.transform.translation
        turn = np.array([q.x, q.y, q.z, q.w], dtype=np.float64)
        shift = np.array([t.x, t.y, t.z], dtype=np.float64)
        if np.isfinite(shift).all() and 0.9 < np.linalg.norm(turn) < 1.1:
            child, parent = entry.child_frame_id.lstrip("/"), entry.header.frame_id.lstrip("/")
            yield child, parent, Transform(shift, Rotation.from_quat(turn).as_matrix())


def frames_above(frames: Frames, frame_id: str) -> dict[str, Transform]:
    """Returns the transforms of a frame to itself and to the frames above it, the highest last."""
    name, out = frame_id, {frame_id: IDENTITY}
    while name in frames and frames[name][0] not in out:
        inner = out[name]
        name, step = frames[name]
        out[name] = step.after(inner)
    return out


def transforms_to(
    location: str, cloud: str, names: Iterable[str], frames: Frames
) -> dict[str, Transform | None]:
    """Returns the transform of each frame of boxes to that of the cloud; None for the same frame.

    Boxes without a frame are in that of the cloud, and so are all boxes if the cloud has no frame.
    Raises Error that begins with `location` for a frame that tf does not connect with the cloud's.
    """
    above_cloud = frames_above(frames, cloud)
    out: dict[str, Transform | None] = {}
    for name in names:
        if not name or not cloud or name == cloud:
            out[name] = None
            continue
        above = frames_above(frames, name)
        common = next((each for each in above if each in above_cloud), None)
        if common is None:
            raise Error(
                f"{location}: expected boxes in the frame '{cloud}' or in a frame that tf connects "
                f"with '{cloud}', got the frame '{name}'"
            )
        out[name] = above_cloud[common].inverse().after(above[common])
    return out


def box_entries(message: Any, kind: str) -> list[Entry]:
    """Returns the boxes of a message of type MARKERS, DETECTIONS or JSK_BOXES."""
    return list({MARKERS: _markers, DETECTIONS: _detections, JSK_BOXES: _jsk}[kind](message))


def with_ids(messages: Sequence[Sequence[Entry]]) -> list[list[Entry]]:
    """Returns the boxes of all messages of a topic with the numbers of their tracks.

    A track keeps the number that its name is or ends with, if no earlier track has it; other tracks
    get new numbers. A box without a track, or with that of another box of its message, gets a
    number of its own. Numbers do not depend on the cloud that a message belongs to, so that all
    LiDARs of a bag share them.
    """
    new = itertools.count(NEW_IDS)  # above all numbers of tracks, which have at most nine digits
    ids: dict[str, int] = {}
    taken: set[int] = set()
    out = []
    for k, entries in enumerate(messages):
        places = [f"message {k}, box {i}" for i in range(len(entries))]
        names = names_in_frame([entry.track for entry in entries], places)
        for name in names:
            if name not in ids:
                word = name.rpartition("/")[2]
                number = int(word) if word.isdecimal() and len(word) < 10 else None
                ids[name] = next(new) if number is None or number in taken else number
                taken.add(ids[name])
        out.append([e._replace(id=ids[name]) for e, name in zip(entries, names, strict=True)])
    return out


def boxes_of(location: str, entries: Sequence[Entry], to_cloud: Mapping[str, Transform]) -> Boxes:
    """Returns the boxes of a message in the frame of the cloud.

    `to_cloud` has the transform of each frame. Invalid boxes are left out.
    """
    rows, names, ids, left_out = [], [], [], []
    for i, (frame_id, name, _, pose, size, number) in enumerate(entries):
        p, q = pose.position, pose.orientation
        turn = np.array([q.x, q.y, q.z, q.w], dtype=np.float64)
        if not turn.any():  # some programs do not set the orientation
            turn[3] = 1.0
        T = to_cloud[frame_id]
        centre = T.turn @ np.array([p.x, p.y, p.z], dtype=np.float64) + T.shift
        values = np.array([*centre, size.x, size.y, size.z, 0], dtype=np.float64)
        try:
            if not 0.9 < np.linalg.norm(turn) < 1.1:
                raise FormatError(
                    f"{location}: box {i}: expected a quaternion of length 1, got {turn}"
                )
            ahead = T.turn @ Rotation.from_quat(turn).as_matrix()[:, 0]
            values[6] = np.arctan2(ahead[1], ahead[0])
            rows.append(checked_box(f"{location}: box {i}", values))
        except FormatError as error:
            left_out.append(str(error))
            continue
        names.append(name or "unknown")
        ids.append(number)
    return Boxes(
        np.array(names, dtype=np.str_),
        np.array(rows, dtype=np.float64).reshape(-1, 7),
        np.array(ids, dtype=np.int64),
        left_out=tuple(left_out),
    )


def _markers(message: Any) -> Iterator[Entry]:
    """Yields the cubes. As in RViz, a marker is identified by its namespace and its number."""
    for marker in message.markers:
        if int(marker.type) == _CUBE and int(marker.action) == _ADD:
            name = str(marker.ns)
            track = f"{name}/{int(marker.id)}"
            yield Entry(_frame_of(marker), name, track, marker.pose, marker.scale)


def _detections(message: Any) -> Iterator[Entry]:
    for detection in message.detections:
        best, most = "", -1.0
        for result in detection.results:
            # Since vision_msgs 4, the class and score are in the field `hypothesis`.
            inner = getattr(result, "hypothesis", result)
            score = float(getattr(inner, "score", 0.0))
            if score > most:
                best, most = str(getattr(inner, "class_id", getattr(inner, "id", ""))), score
        track = str(getattr(detection, "id", "") or getattr(detection, "tracking_id", ""))
        frame_id = _frame_of(detection) or _frame_of(message)
        yield Entry(frame_id, best, track, detection.bbox.center, detection.bbox.size)


def _jsk(message: Any) -> Iterator[Entry]:
    for box in message.boxes:
        frame_id = _frame_of(box) or _frame_of(message)
        yield Entry(frame_id, f"label_{int(box.label)}", "", box.pose, box.dimensions)


def _frame_of(message: Any) -> str:
    """Returns the frame in the header of a message; empty if it is not set."""
    header = getattr(message, "header", None)
    return str(getattr(header, "frame_id", "")).lstrip("/")
