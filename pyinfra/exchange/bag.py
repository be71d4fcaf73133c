"""Reads ROS bags without ROS: .bag of ROS 1, and .mcap and .db3 of ROS 2.

A recording is one topic of clouds, sensor_msgs/PointCloud2 or Livox's CustomMsg. Boxes come from a
topic with MarkerArray, Detection3DArray or BoundingBoxArray. The pose of the sensor comes from tf.
"""

import contextlib
import itertools
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import IntArray, Records
from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange import ros_messages as ros
from pyinfra.exchange.data_set import levelled
from pyinfra.exchange.nuscenes_tables import angles_of
from pyinfra.exchange.point_fields import PointFields
from pyinfra.exchange.record_clouds import FIRST, points_of, readable
from pyinfra.exchange.recording import NO_BOXES, Options, RecordedFrame, Recording
from pyinfra.formats.kitti import WorldPose

SUFFIXES = (".bag", ".mcap", ".db3")
METADATA = "metadata.yaml"
BOXES = (ros.MARKERS, ros.DETECTIONS, ros.JSK_BOXES)
ROOTS = ("world", "map", "site", "earth", "odom")  # frames in which the sensor does not move
NEAR_S = 0.15  # maximum time between a cloud and the message with its boxes
LEAST_TILT_RAD = 1e-4
# Message types with raw packets, which only the driver of the LiDAR can decode.
PACKETS = ("VelodyneScan", "PandarScan", "UdpFrame", "PacketMsg", "RslidarScan", "RslidarPacket")


@dataclass
class Contents:
    """Topics, clouds and boxes that one pass over a bag collects."""

    topics: dict[str, tuple[str, int]]  # type and number of messages of each topic
    times_ns: list[int] = field(default_factory=list)  # time at which each cloud was recorded
    stamps_ns: list[int] = field(default_factory=list)  # stamp in the header of each cloud
    # Header stamp (0 if not set), recording time, and boxes of each message with boxes.
    boxes: list[tuple[int, int, list[ros.Entry]]] = field(default_factory=list)
    box_topic: str = ""
    frames: ros.Frames = field(default_factory=dict)


def read(source: Path, options: Options) -> Recording:
    """Opens a bag: a file, or a folder of files of one bag.

    `options.channel` selects a topic, if several topics have clouds. Raises Error for a bag without
    clouds, or without a selected topic. Reading a frame raises FormatError.
    """
    return Bag(source, options).recording()


class Bag:
    """A bag and its selected topic of clouds. Reading clouds in order is fastest."""

    def __init__(self, source: Path, options: Options) -> None:
        self.source, self.options = source, options
        self.paths = bag_paths(source)
        store = get_typestore(Stores.ROS2_HUMBLE)
        with _errors(source):
            self._reader: Any = AnyReader(self.paths, default_typestore=store)
            self._reader.open()
            weakref.finalize(self, _close, self._reader)
            self.is_ros2 = self._reader.is2
            self.topic, self.kind, self.contents = _scan(source, self._reader, options.channel)
        self._messages: Iterator[bytes] = iter(())
        self._next = -1

    def recording(self) -> Recording:
        contents = self.contents
        stamps, times = np.array(contents.stamps_ns), np.array(contents.times_ns)
        # Some drivers do not set the stamp, or always write the same stamp. A simulation begins at
        # stamp 0.
        stamped = bool(stamps.max() > 0 and len(np.unique(stamps)) > len(stamps) / 2)
        clock_ns = stamps if stamped else times
        notes = [] if stamped else ["stamps of clouds are not set: times of the bag are used"]
        pose, tilt = self._pose(notes)
        of_cloud = self._boxes_by_cloud(clock_ns, notes)
        T_levelled_sensor = Rotation.from_euler("ZYX", [0, *(tilt or (0.0, 0.0))]).as_matrix()
        levelling = ros.Transform(np.zeros(3), T_levelled_sensor)
        boxes_in = {box.frame_id for *_, boxes in contents.boxes for box in boxes}
        location = f"{self.source}: {contents.box_topic}"
        found = ros.transforms_to(location, self._frame_id(), sorted(boxes_in), contents.frames)
        notes += [f"boxes in `{name}` are transformed by tf" for name, T in found.items() if T]
        to_levelled = {name: levelling.after(T or ros.IDENTITY) for name, T in found.items()}

        def frame(i: int) -> RecordedFrame:
            location = f"{self.source}: {self.topic}: cloud {i}"
            records = self.records(i)
            points = points_of(location, records, self.options, self.fields.offset)
            cloud = RecordedFrame(points, NO_BOXES, self.fields.read(location, records))
            cloud = levelled(cloud, T_levelled_sensor) if tilt else cloud
            if i not in of_cloud:
                return cloud
            boxes = ros.boxes_of(f"{location}: boxes", of_cloud[i], to_levelled)
            return replace(cloud, boxes=boxes)

        digest = f"{self.source.name}:{contents.box_topic}:{len(times)}"
        return Recording(
            tuple(f"{i:06d}" for i in range(len(times))),
            frame,
            labelled=bool(contents.boxes),
            pose=pose,
            tilt=tilt,
            tracks_sha256=digest if contents.boxes else "",
            times=lambda: clock_ns / 1e9,
            notes=lambda: [*notes, *self._field_notes()],
            slots=tuple(range(len(times))),
            reads=_files(self.source),
            unread_parts=self._unread_parts,
        )

    def _unread_parts(self) -> list[str]:
        """Returns texts that list the topics and the point fields that are not read."""
        topics = [
            f"{name} ({kind.rpartition('/')[2]}, {count})"
            for name, (kind, count) in self.contents.topics.items()
            if self._unread(name, kind) and count > 0
        ]
        return [f"topic {topic}" for topic in topics] + self.fields.unread()

    def records(self, i: int) -> Records:
        """Reads cloud `i` of the selected topic. Raises FormatError."""
        with _errors(self.source):
            if self._next != i:
                self._messages, self._next = self._from(i), i
            raw = next(self._messages)
            self._next += 1
            location = f"{self.source}: {self.topic}: cloud {i}"
            if self.kind in ros.LIVOX:
                return ros.livox_records(location, raw, is_ros2=self.is_ros2)
            return ros.cloud_records(location, _message(self._reader, raw, self.kind))

    def _from(self, i: int) -> Iterator[bytes]:
        times = self.contents.times_ns
        chosen = [c for c in self._reader.connections if c.topic == self.topic]
        messages = self._reader.messages(chosen, start=times[i])
        skip = i - times.index(times[i])  # number of earlier clouds with the same time
        return (raw for _, _, raw in itertools.islice(messages, skip, None))

    @cached_property
    def fields(self) -> PointFields:
        first = range(min(FIRST, len(self.contents.times_ns)))
        return PointFields(readable(self.records, first))

    def _field_notes(self) -> list[str]:
        notes = self.fields.cloud_notes()
        others = [
            name for name, (kind, _) in self.contents.topics.items() if self._unread(name, kind)
        ]
        if others:
            notes.append(f"topics that are not read: {', '.join(sorted(others)[:8])}")
        return notes

    def _unread(self, name: str, kind: str) -> bool:
        return name not in (self.topic, self.contents.box_topic) and kind not in ros.TRANSFORMS

    def _pose(self, notes: list[str]) -> tuple[WorldPose | None, tuple[float, float] | None]:
        """Returns the pose of the sensor from tf, and its tilt if the recording has boxes."""
        frame_id = self._frame_id()
        above = ros.frames_above(self.contents.frames, frame_id)
        root, transform = list(above.items())[-1]
        if len(above) == 1 or root not in ROOTS or root in self.contents.frames:
            return None, None
        yaw, pitch, roll = angles_of(transform.turn)
        x, y, z = transform.shift
        notes.append(
            f"tf gives the pose of `{frame_id}` in `{root}`: ({x:.2f}, {y:.2f}, {z:.2f}) m"
        )
        tilted = max(abs(pitch), abs(roll)) > LEAST_TILT_RAD
        return WorldPose(x, y, z, yaw), (pitch, roll) if tilted and self.contents.boxes else None

    def _frame_id(self) -> str:
        raw = next(self._from(0), b"")
        length = int.from_bytes(raw[12:16], "little")
        return raw[16 : 16 + length].rstrip(b"\0").decode("utf-8", "replace").lstrip("/")

    def _boxes_by_cloud(self, clock_ns: IntArray, notes: list[str]) -> dict[int, list[ros.Entry]]:
        """Pairs each message of boxes with the latest cloud that is not newer than it.

        clock_ns: (n,) stamp of each cloud, or its time in the bag if stamps are not set.
        """
        contents, out, lost, unstamped = self.contents, {}, 0, 0
        clocks = (np.array(contents.times_ns), clock_ns)
        orders = [np.argsort(clock, kind="stable") for clock in clocks]
        seconds = [clock[order] / 1e9 for clock, order in zip(clocks, orders, strict=True)]
        for stamp, time, boxes in contents.boxes:
            has_stamp = stamp > 0
            if not has_stamp and not boxes:  # an unstamped message without boxes deletes markers
                continue
            unstamped += not has_stamp
            now, earlier = (stamp if has_stamp else time) / 1e9, seconds[has_stamp]
            at = int(np.searchsorted(earlier, now + 1e-6, side="right")) - 1
            if at < 0 or now - earlier[at] > NEAR_S:
                lost += 1
            else:
                out[int(orders[has_stamp][at])] = boxes
        if contents.boxes:
            text = f"boxes are those of the topic {contents.box_topic}"
            if unstamped:
                text += f"; {unstamped} messages without a stamp are paired by the times of the bag"
            if lost:
                text += f"; {lost} messages match no cloud in time and are left out"
            if len(out) < len(clock_ns):
                bare = len(clock_ns) - len(out)
                text += f"; {bare} of {len(clock_ns)} clouds have no message with boxes"
            notes.append(text)
        return out


def _files(source: Path) -> tuple[Path, ...]:
    """Returns the files of a bag: those with the endings of bags, and metadata.yaml."""
    names = (METADATA, *(f"*{suffix}" for suffix in SUFFIXES))
    return (source,) if source.is_file() else tuple(p for n in names for p in source.glob(n))


def bag_paths(source: Path) -> list[Path]:
    """Returns the paths for rosbags: files, or the folder of a ROS 2 bag with its metadata.yaml."""
    if source.is_file() or (source / METADATA).is_file():
        return [source]
    files = sorted(p for p in source.iterdir() if p.suffix.lower() in SUFFIXES)
    kinds = {path.suffix.lower() for path in files}
    if len(kinds) != 1:
        got = ", ".join(path.name for path in files[:4]) or "none"
        raise Error(f"{source}: expected the files of one bag, got {got}")
    return files


def _scan(source: Path, reader: Any, channel: str | None) -> tuple[str, str, Contents]:
    topics = {name: (str(info.msgtype), int(info.msgcount)) for name, info in reader.topics.items()}
    clouds = {
        name: kind
        for name, (kind, count) in topics.items()
        if kind in (ros.CLOUD, *ros.LIVOX) and count > 0
    }
    topic = _chosen(source, clouds, topics, channel)
    contents = Contents(topics)
    boxes = [name for name, (kind, count) in topics.items() if kind in BOXES and count > 0]
    beside = [name for name in boxes if name.rpartition("/")[0] == topic.rpartition("/")[0]]
    if len(boxes) == 1 or len(beside) == 1:
        contents.box_topic = (beside if len(beside) == 1 else boxes)[0]
    wanted = [
        c
        for c in reader.connections
        if c.topic in (topic, contents.box_topic) or c.msgtype in ros.TRANSFORMS
    ]
    for connection, time_ns, raw in reader.messages(wanted):
        if connection.topic == topic:
            contents.times_ns.append(int(time_ns))
            contents.stamps_ns.append(ros.header_stamp_ns(raw, is_ros2=reader.is2))
        elif connection.topic == contents.box_topic:
            message = _message(reader, raw, connection.msgtype)
            entries = ros.box_entries(message, connection.msgtype)
            contents.boxes.append((_stamp_of(message), int(time_ns), entries))
        else:
            for child, parent, transform in ros.transforms(
                _message(reader, raw, connection.msgtype)
            ):
                contents.frames.setdefault(child, (parent, transform))
    numbered = ros.with_ids([entries for *_, entries in contents.boxes])
    contents.boxes = [
        (stamp, time, entries)
        for (stamp, time, _), entries in zip(contents.boxes, numbered, strict=True)
    ]
    if not contents.times_ns:
        raise FormatError(
            f"{source}: {topic}: expected point clouds, got none; the bag may be truncated"
        )
    return topic, clouds[topic], contents


def _chosen(
    source: Path,
    clouds: dict[str, str],
    topics: dict[str, tuple[str, int]],
    channel: str | None,
) -> str:
    if channel in clouds:
        return str(channel)
    listed = ", ".join(f"{name} ({kind}, {count})" for name, (kind, count) in topics.items())
    if not clouds:
        packets = [n for n, (kind, _) in topics.items() if kind.rpartition("/")[2] in PACKETS]
        advice = (
            f": {packets[0]} has packets, so play the bag with the sensor's driver and record its "
            "topic of PointCloud2"
            if packets
            else ""
        )
        raise Error(
            f"{source}: expected a topic of sensor_msgs/PointCloud2 or of Livox's CustomMsg, got "
            f"{listed or 'no topic'}{advice}"
        )
    if channel is not None or len(clouds) > 1:
        names = ", ".join(f"{name} ({topics[name][1]} clouds)" for name in clouds)
        got = f", got {channel}" if channel else ""
        raise Error(f"{source}: expected one of the topics {names}{got}; `channel` selects a topic")
    return next(iter(clouds))


def _stamp_of(message: Any) -> int:
    """Returns the first stamp of a message or of its objects that is set, in ns; else 0."""
    objects = (getattr(message, name, ()) for name in ("markers", "detections", "boxes"))
    for part in (message, *itertools.chain(*objects)):
        stamp = getattr(getattr(part, "header", None), "stamp", None)
        if stamp is not None and (time_ns := int(stamp.sec) * 10**9 + int(stamp.nanosec)):
            return time_ns
    return 0


def _message(reader: Any, raw: bytes, kind: str) -> Any:
    """Deserialises a message. Types that the bag does not define are read as in ROS 2 Humble."""
    if kind in reader.typestore.fielddefs:
        return reader.deserialize(raw, kind)
    store = get_typestore(Stores.ROS2_HUMBLE)
    return store.deserialize_cdr(raw, kind) if reader.is2 else store.deserialize_ros1(raw, kind)


def _close(reader: Any) -> None:
    """Closes a bag. SQLite cannot close some damaged files while a query is unfinished."""
    with contextlib.suppress(Exception):
        reader.close()


@contextlib.contextmanager
def _errors(source: Path) -> Iterator[None]:
    """Converts all errors of rosbags, which has many types for damaged files, to FormatError."""
    try:
        yield
    except (Error, OSError):
        raise
    except Exception as error:
        name = type(error).__name__
        raise FormatError(
            f"{source}: cannot be read as a bag: {str(error)[:200] or name}; for a bag that was "
            "not closed, run `rosbag reindex` or `ros2 bag reindex`, or convert it with "
            "`mcap recover`"
        ) from None
