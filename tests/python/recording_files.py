"""Writes small recordings as the software of sensors does: bags, packets, and files of clouds."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START_S = 1_700_000_000
PERIOD_S = 0.1
XYZ = [(axis, "<f4") for axis in "xyz"]
# Layouts of points in the drivers' PointCloud2: fields, and the unit and start of the time.
DRIVERS: dict[str, tuple[list[tuple[str, str]], int]] = {
    "velodyne": ([*XYZ, ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")], 22),
    "ouster": (
        [
            *(*XYZ, ("_", "<f4"), ("intensity", "<f4"), ("t", "<u4"), ("reflectivity", "<u2")),
            *(("ring", "<u2"), ("ambient", "<u2"), ("range", "<u4")),
        ],
        48,
    ),
    "hesai": ([*XYZ, ("intensity", "<f4"), ("timestamp", "<f8"), ("ring", "<u2")], 32),
    "robosense": ([*XYZ, ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")], 26),
    "livox2": (
        [
            *(*XYZ, ("intensity", "<f4"), ("tag", "|u1"), ("line", "|u1")),
            ("timestamp", "<f8"),
        ],
        26,
    ),
}
LIVOX_DEFINITION = """
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
livox_ros_driver2/CustomPoint[] points
"""
LIVOX_POINT = """
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""
DETECTION = """
std_msgs/Header header
vision_msgs/ObjectHypothesisWithPose[] results
vision_msgs/BoundingBox3D bbox
string id
"""
Storage = Literal["bag", "mcap", "db3"]


def road(k: int, n: int = 600) -> np.ndarray:
    """Points (m, 4) x y z intensity of frame k: a road 6 m below, a wall, and a car that moves."""
    g = np.random.default_rng(1)
    ground = np.column_stack([g.uniform(-35, 35, n), g.uniform(-12, 12, n), np.zeros(n)])
    wall = np.column_stack(
        [g.uniform(-35, 35, n // 5), np.full(n // 5, 14.0), g.uniform(0, 3, n // 5)]
    )
    h = np.random.default_rng(10 + k)
    car = np.column_stack([h.uniform(-2, 2, 80), np.full(80, -0.9), h.uniform(0.25, 1.5, 80)])
    xyz = np.vstack([ground, wall, car + np.array([-20 + 2.0 * k, 5.0, 0])]) - [0, 0, 6.0]
    xyz[:, 2] += h.normal(0, 0.01, len(xyz))
    return np.column_stack([xyz, np.round(h.uniform(0.05, 0.9, len(xyz)), 3)]).astype(np.float32)


def driver_records(k: int, driver: str) -> np.ndarray:
    """Records of frame k in the layout of a driver, with padding up to its size of a point."""
    fields, step = DRIVERS[driver]
    cloud = road(k)
    offsets, at = [], 0
    for _, kind in fields:
        offsets.append(at)
        at += np.dtype(kind).itemsize
    dtype = np.dtype(
        {
            "names": [name for name, _ in fields],
            "formats": [kind for _, kind in fields],
            "offsets": offsets,
            "itemsize": max(step, at),
        }
    )
    out = np.zeros(len(cloud), dtype=dtype)
    since = np.linspace(0, 0.0999, len(cloud))
    absolute = START_S + PERIOD_S * k + since
    values: dict[str, Any] = {axis: cloud[:, i] for i, axis in enumerate("xyz")}
    values |= {
        "intensity": cloud[:, 3] * 255,
        "reflectivity": cloud[:, 3] * 255,
        "ring": np.arange(len(cloud)) % 32,
    }
    values |= {"time": since - 0.1, "t": since * 1e9, "line": np.arange(len(cloud)) % 4}
    values["timestamp"] = absolute * 1e9 if driver == "livox2" else absolute
    for name in dtype.names or ():
        if name in values:
            out[name] = values[name]
    return out


def store_of(storage: Storage) -> Any:
    store = get_typestore(Stores.ROS1_NOETIC if storage == "bag" else Stores.ROS2_HUMBLE)
    types = get_types_from_msg(LIVOX_DEFINITION, "livox_ros_driver2/msg/CustomMsg")
    types |= get_types_from_msg(LIVOX_POINT, "livox_ros_driver2/msg/CustomPoint")
    types |= get_types_from_msg(DETECTION, "vision_msgs/msg/Detection3D")
    types |= get_types_from_msg(
        "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
        "vision_msgs/msg/Detection3DArray",
    )
    types |= get_types_from_msg(
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
        "vision_msgs/msg/ObjectHypothesisWithPose",
    )
    types |= get_types_from_msg(
        "string class_id\nfloat64 score\n", "vision_msgs/msg/ObjectHypothesis"
    )
    types |= get_types_from_msg(
        "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
        "vision_msgs/msg/BoundingBox3D",
    )
    store.register(types)
    return store


class BagWriter:
    """Writes messages to a bag of ROS 1 or ROS 2."""

    def __init__(self, path: Path, storage: Storage) -> None:
        self.storage, self.store = storage, store_of(storage)
        plugin = {"mcap": StoragePlugin.MCAP, "db3": StoragePlugin.SQLITE3}
        self.writer: Any = (
            Writer1(path)
            if storage == "bag"
            else Writer2(path, version=9, storage_plugin=plugin[storage])
        )
        self.connections: dict[str, Any] = {}

    def __enter__(self) -> BagWriter:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def message(self, kind: str, **values: Any) -> Any:
        return self.store.types[kind](**values)

    def header(self, time_s: float, frame_id: str = "lidar") -> Any:
        whole = int(time_s)
        stamp = self.message(
            "builtin_interfaces/msg/Time", sec=whole, nanosec=round((time_s - whole) * 1e9)
        )
        more = {"seq": 0} if self.storage == "bag" else {}
        return self.message("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id, **more)

    def write(self, topic: str, time_s: float, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        serialise = self.store.serialize_ros1 if self.storage == "bag" else self.store.serialize_cdr
        self.writer.write(self.connections[topic], round(time_s * 1e9), serialise(message, kind))

    def cloud(
        self,
        records: np.ndarray,
        stamp_s: float,
        *,
        rows: int = 1,
        row_padding: int = 0,
        frame_id: str = "lidar",
    ) -> Any:
        """A PointCloud2 of records, in rows that may be padded."""
        numbers = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
        assert records.dtype.fields is not None
        big = any(kind.byteorder == ">" for kind, *_ in records.dtype.fields.values())
        fields = [
            self.message(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=offset,
                datatype=numbers[kind.str[1:]],
                count=1,
            )
            for name, (kind, offset, *_) in records.dtype.fields.items()
        ]
        width, step = len(records) // rows, records.dtype.itemsize
        data = b"".join(
            records[i * width : (i + 1) * width].tobytes() + bytes(row_padding) for i in range(rows)
        )
        return self.message(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(stamp_s, frame_id),
            height=rows,
            width=width,
            fields=fields,
            is_bigendian=big,
            point_step=step,
            row_step=width * step + row_padding,
            data=np.frombuffer(data, np.uint8),
            is_dense=False,
        )

    def livox(self, k: int) -> Any:
        cloud = road(k)
        since = np.linspace(0, 0.0999, len(cloud))
        points = [
            self.message(
                "livox_ros_driver2/msg/CustomPoint",
                offset_time=int(t * 1e9),
                x=float(x),
                y=float(y),
                z=float(z),
                reflectivity=int(i * 255),
                tag=16,
                line=number % 4,
            )
            for number, (t, (x, y, z, i)) in enumerate(zip(since, cloud, strict=True))
        ]
        return self.message(
            "livox_ros_driver2/msg/CustomMsg",
            header=self.header(START_S + PERIOD_S * k, "livox_frame"),
            timebase=0,
            point_num=len(points),
            lidar_id=1,
            rsvd=np.zeros(3, np.uint8),
            points=points,
        )


def write_bag(path: Path, storage: Storage, driver: str, frames: int = 4) -> Path:
    """Writes a bag with one topic of clouds, and returns its path."""
    with BagWriter(path, storage) as bag:
        for k in range(frames):
            time_s = START_S + PERIOD_S * k
            message = (
                bag.livox(k) if driver == "livox" else bag.cloud(driver_records(k, driver), time_s)
            )
            bag.write("/points", time_s + 0.1, message)
    return path


def write_packets(file: Path, turns: int = 4) -> Path:
    """Writes packets of a VLP-16 that sees a wall all around at 10 m, by its public user manual.

    https://data.ouster.io/downloads/velodyne/user-manual/vlp-16-user-manual-revf.pdf, section 9:
    12 blocks of 0xEEFF, an azimuth in hundredths of degrees, and 32 returns of a distance in 2 mm
    and a reflectivity; then the time in microseconds since the hour, return mode and model.
    """
    out = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    firing_s = 55.296e-6
    steps = int(turns * 0.1 / (2 * firing_s))
    for packet in range(steps // 12):
        time_s = packet * 12 * 2 * firing_s
        blocks = b""
        for block in range(12):
            azimuth = int((packet * 12 + block) * 2 * firing_s / 0.1 * 36000) % 36000
            blocks += struct.pack("<HH", 0xEEFF, azimuth) + struct.pack("<HB", 5000, 100) * 32
        payload = blocks + struct.pack("<IBB", int(time_s * 1e6), 0x37, 0x22)
        udp = struct.pack(">HHHH", 443, 2368, 8 + len(payload), 0) + payload
        ip = struct.pack(
            ">BBHHHBBHII", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, 0xC0A801C9, 0xFFFFFFFF
        )
        frame = bytes(12) + b"\x08\x00" + ip + udp
        seconds = START_S + time_s
        head = struct.pack("<IIII", int(seconds), int(seconds % 1 * 1e6), len(frame), len(frame))
        out.append(head + frame)
    file.write_bytes(b"".join(out))
    return file
