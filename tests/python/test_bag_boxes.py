"""Boxes of a bag come into the frame of the cloud of their time, from any frame of tf."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_files import PERIOD_S, START_S, BagWriter, driver_records
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from pyinfra.core.errors import Error
from pyinfra.exchange.bag import read
from pyinfra.exchange.recording import Options

# Poses of frames in their parents: the sensor is tilted, on a pole in the map.
FRAMES = {
    "pole": ("map", (50.0, 10.0, 0.0), (40.0, 0.0, 0.0)),
    "lidar": ("pole", (0.5, 0.0, 6.0), (5.0, 12.0, -4.0)),
    "camera": ("pole", (0.0, 0.5, 5.0), (-30.0, 20.0, 90.0)),
}
BOX_M = ((20.0, 3.0, -5.25), (4.2, 1.8, 1.5), 30.0)  # in the levelled frame of the LiDAR; degrees
KINDS = ("markers", "detections", "jsk")
JSK = {
    "jsk_recognition_msgs/msg/BoundingBox": "std_msgs/Header header\ngeometry_msgs/Pose pose\n"
    "geometry_msgs/Vector3 dimensions\nfloat32 value\nuint32 label\n",
    "jsk_recognition_msgs/msg/BoundingBoxArray": "std_msgs/Header header\n"
    "jsk_recognition_msgs/BoundingBox[] boxes\n",
}


def in_map(frame: str) -> tuple[Rotation, np.ndarray]:
    """Returns rotation and position of a frame in the map."""
    if frame == "map":
        return Rotation.identity(), np.zeros(3)
    parent, shift, angles = FRAMES[frame]
    turn, position = in_map(parent)
    return turn * Rotation.from_euler("ZYX", angles, True), position + turn.apply(shift)


def levelled() -> Rotation:
    """Returns the rotation of the levelled frame of the LiDAR in the map."""
    yaw = in_map("lidar")[0].as_euler("ZYX")[0]
    return Rotation.from_euler("z", yaw)


class Messages:
    """Makes messages of a bag."""

    def __init__(self, bag: BagWriter) -> None:
        self.bag, self.message = bag, bag.message

    def vector(self, kind: str, values: Any) -> Any:
        return self.message(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", values, strict=True)))

    def quaternion(self, turn: Rotation) -> Any:
        values = dict(zip("xyzw", turn.as_quat(), strict=True))
        return self.message("geometry_msgs/msg/Quaternion", **values)

    def tf(self) -> Any:
        transforms = [
            self.message(
                "geometry_msgs/msg/TransformStamped",
                header=self.bag.header(START_S, parent),
                child_frame_id=child,
                transform=self.message(
                    "geometry_msgs/msg/Transform",
                    translation=self.vector("Vector3", shift),
                    rotation=self.quaternion(Rotation.from_euler("ZYX", angles, True)),
                ),
            )
            for child, (parent, shift, angles) in FRAMES.items()
        ]
        return self.message("tf2_msgs/msg/TFMessage", transforms=transforms)

    def pose(self, frame: str) -> Any:
        """Returns the pose of BOX_M in a frame."""
        centre, _, heading = BOX_M
        turn, position = in_map(frame)
        at_map = in_map("lidar")[1] + levelled().apply(centre)
        upright = levelled() * Rotation.from_euler("z", heading, True)
        return self.message(
            "geometry_msgs/msg/Pose",
            position=self.vector("Point", turn.inv().apply(at_map - position)),
            orientation=self.quaternion(turn.inv() * upright),
        )

    def marker(
        self, frame: str, time_s: float, *, action: int = 0, number: int = 7, ns: str = "Car"
    ) -> Any:
        header = self.bag.header(time_s, frame)
        zero = self.message("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
        colour = self.message("std_msgs/msg/ColorRGBA", r=1.0, g=1.0, b=1.0, a=1.0)
        return self.message(
            "visualization_msgs/msg/Marker",
            header=header,
            ns=ns,
            id=number,
            type=1,
            action=action,
            pose=self.pose(frame or "lidar"),
            scale=self.vector("Vector3", BOX_M[1]),
            color=colour,
            lifetime=zero,
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=self.message(
                "sensor_msgs/msg/CompressedImage",
                header=header,
                format="",
                data=np.zeros(0, np.uint8),
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self.message(
                "visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)
            ),
            mesh_use_embedded_materials=False,
        )

    def markers(self, *markers: Any) -> Any:
        return self.message("visualization_msgs/msg/MarkerArray", markers=list(markers))

    def boxes(self, kind: str, frame: str, time_s: float, *, inside: bool = True) -> Any:
        """Returns a message with one box. inside: whether the frame is stated in the box."""
        if kind == "markers":
            return self.markers(self.marker(frame, time_s))
        outer = self.bag.header(time_s, "" if inside else frame)
        inner = self.bag.header(time_s if inside else 0.0, frame if inside else "")
        pose, size = self.pose(frame or "lidar"), self.vector("Vector3", BOX_M[1])
        if kind == "jsk":
            name = "jsk_recognition_msgs/msg/BoundingBox"
            box = self.message(
                name, header=inner, pose=pose, dimensions=size, value=1.0, label=np.uint32(1)
            )
            return self.message(f"{name}Array", header=outer, boxes=[box])
        return self.detections("7", header=outer, inner=inner, pose=pose)

    def detections(self, *ids: str, header: Any, inner: Any = None, pose: Any = None) -> Any:
        """Returns a message with a box for each id."""
        box = self.message(
            "vision_msgs/msg/BoundingBox3D",
            center=pose or self.pose("lidar"),
            size=self.vector("Vector3", BOX_M[1]),
        )
        boxes = [
            self.message(
                "vision_msgs/msg/Detection3D", header=inner or header, results=[], bbox=box, id=word
            )
            for word in ids
        ]
        return self.message("vision_msgs/msg/Detection3DArray", header=header, detections=boxes)


def write(path: Path, message: Any, *, topics: tuple[str, ...] = ("lidar",), tf: bool = True):
    """Writes clouds of each topic, and the boxes that `message` makes of a time, 0.12 s later."""
    with BagWriter(path, "mcap") as bag:
        for name, text in JSK.items():
            bag.store.register(get_types_from_msg(text, name))
        messages = Messages(bag)
        if tf:
            bag.write("/tf_static", START_S, messages.tf())
        for k in range(4):
            time_s = START_S + PERIOD_S * k
            for topic in topics:
                cloud = bag.cloud(driver_records(k, "hesai"), time_s, frame_id=topic)
                bag.write(f"/{topic}/points", time_s + 0.01, cloud)
            bag.write("/boxes", time_s + 0.12, message(messages, time_s))
    return path


def check_box(recording: Any, rows: int = 1) -> None:
    centre, size, heading = BOX_M
    boxes = recording.read(2).boxes.boxes
    assert len(boxes) == rows
    for box in boxes:
        assert box == pytest.approx([*centre, *size, np.radians(heading)], abs=1e-9)


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("frame", ["lidar", "/lidar", "map", "pole", "camera"])
@pytest.mark.parametrize("kind", KINDS)
def test_boxes_in_any_frame_of_tf(kind: str, frame: str, inside: bool, tmp_path: Path) -> None:
    def message(m: Messages, time_s: float) -> Any:
        out = m.boxes(kind, frame.lstrip("/"), time_s, inside=inside)
        for part in (out, *getattr(out, "markers", ())):
            if frame.startswith("/") and hasattr(part, "header"):
                part.header.frame_id = frame
        return out

    recording = read(write(tmp_path / "a", message), Options())
    check_box(recording)
    moved = any("are transformed by tf" in note for note in recording.notes())
    assert moved == (frame not in ("lidar", "/lidar"))


def test_markers_of_one_array_may_be_in_different_frames(tmp_path: Path) -> None:
    def message(m: Messages, time_s: float) -> Any:
        frames = enumerate(("map", "camera", "lidar", ""))
        return m.markers(*(m.marker(frame, time_s, number=i) for i, frame in frames))

    check_box(read(write(tmp_path / "a", message), Options()), rows=4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_without_a_transform_is_refused(kind: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a", lambda m, t: m.boxes(kind, "map", t), tf=False)
    with pytest.raises(
        Error, match=r"/boxes: expected boxes in the frame 'lidar' .*, got the frame 'map'"
    ):
        read(path, Options())


def test_boxes_of_one_sensor_with_the_clouds_of_another(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a", lambda m, t: m.boxes("jsk", "camera", t), topics=("lidar", "camera")
    )
    check_box(read(path, Options(channel="/lidar/points")))


@pytest.mark.parametrize("kind", KINDS)
def test_boxes_belong_to_the_cloud_of_their_stamp(kind: str, tmp_path: Path) -> None:
    """The boxes arrive after the next cloud. The first stamp in the message is not set."""

    def message(m: Messages, time_s: float) -> Any:
        if kind == "markers":
            return m.markers(m.marker("", 0.0, action=3), m.marker("lidar", time_s))
        out = m.boxes(kind, "lidar", time_s)
        out.header.stamp = m.bag.header(0.0).stamp
        return out

    recording = read(write(tmp_path / "a", message), Options())
    assert [len(recording.read(k).boxes) for k in range(4)] == [1, 1, 1, 1]
    assert not any("without a stamp" in note for note in recording.notes())


def test_boxes_without_any_stamp_are_paired_by_the_times_of_the_bag(tmp_path: Path) -> None:
    recording = read(
        write(tmp_path / "a", lambda m, _: m.boxes("markers", "lidar", 0.0)), Options()
    )
    assert [len(recording.read(k).boxes) for k in range(4)] == [0, 1, 1, 1]
    assert any("4 messages without a stamp are paired" in note for note in recording.notes())


@pytest.mark.parametrize("topic", ["lidar", "camera"])
def test_each_name_of_a_track_has_a_number_of_its_own(topic: str, tmp_path: Path) -> None:
    """Decimal names keep their numbers. Clouds of both topics have the same numbers."""
    names = [("1", "", "a1-uuid"), ("0", "a1-uuid", "7.0"), ("7", "7", "-1", "1"), ("7", "01")]

    def message(m: Messages, time_s: float) -> Any:
        k = round((time_s - START_S) / PERIOD_S)
        return m.detections(*names[k], header=m.bag.header(time_s, "lidar"))

    path = write(tmp_path / "a", message, topics=("lidar", "camera"))
    recording = read(path, Options(channel=f"/{topic}/points"))
    new = 2**30
    ids = {k: recording.read(k).boxes.ids for k in (3, 1, 0, 2)}
    assert ids[0].tolist() == [1, new, new + 1]
    assert ids[1].tolist() == [0, new + 1, 7]
    assert ids[2].tolist() == [new + 2, new + 3, new + 4, 1]
    assert ids[3].tolist() == [7, 1]


def test_a_marker_is_identified_by_namespace_and_number(tmp_path: Path) -> None:
    """This is the identity of RViz. A repeated marker has a number of its own."""

    def message(m: Messages, time_s: float) -> Any:
        marks = [("car", 0), ("pedestrian", 0), ("", 0), ("", -1), ("car", 5), ("car", 5)]
        return m.markers(*(m.marker("lidar", time_s, ns=ns, number=n) for ns, n in marks))

    recording = read(write(tmp_path / "a", message), Options())
    first, later = (recording.read(k).boxes.ids.tolist() for k in (0, 3))
    assert first[0] == 0
    assert len(set(first)) == 6
    assert later[:4] == first[:4]
    assert not set(later[4:]) & set(first)
