"""Bags of ROS 1 and ROS 2, as drivers record them, are read without ROS."""

from pathlib import Path

import numpy as np
import pytest
from exchange_data import write_recording
from recording_files import (
    DRIVERS,
    PERIOD_S,
    START_S,
    BagWriter,
    driver_records,
    road,
    write_bag,
)

from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange.bag import read
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.exports import export
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.exchange.ros_messages import cloud_records
from pyinfra.formats import kitti

OPTIONS = Options(intensity_max=255.0)


@pytest.mark.parametrize("driver", [*DRIVERS, "livox"])
@pytest.mark.parametrize("storage", ["bag", "mcap", "db3"])
def test_points_and_times_of_each_driver(storage: str, driver: str, tmp_path: Path) -> None:
    name = "street.bag" if storage == "bag" else "street"
    recording = read(write_bag(tmp_path / name, storage, driver, frames=3), OPTIONS)  # type: ignore[arg-type]
    assert len(recording.names) == 3
    assert recording.times is not None
    assert recording.times() == pytest.approx(START_S + PERIOD_S * np.arange(3))
    for k in (0, 2, 1):
        frame = recording.read(k)
        assert frame.points[:, :3] == pytest.approx(road(k)[:, :3])
        assert frame.points[:, 3] == pytest.approx(road(k)[:, 3], abs=1 / 255)
        assert frame.fields is not None
        since = np.linspace(0, 0.0999, len(frame.points))
        assert frame.fields["time_s"] == pytest.approx(since, abs=2e-6)
        assert frame.fields["ring"].max() == (3 if "livox" in driver else 31)


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_a_single_file_of_a_ros_2_bag(storage: str, tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "street", storage, "hesai", frames=2)  # type: ignore[arg-type]
    (file,) = folder.glob(f"*.{storage}")
    assert len(read(file, OPTIONS).names) == 2
    (folder / "metadata.yaml").unlink()
    assert len(read(folder, OPTIONS).names) == 2


def test_big_endian_points_in_padded_rows(tmp_path: Path) -> None:
    little = driver_records(0, "hesai")[:600]
    kinds = [(name, little.dtype[name].newbyteorder(">")) for name in little.dtype.names or ()]
    big = little[list(little.dtype.names or ())].astype(np.dtype(kinds))
    with BagWriter(tmp_path / "a.bag", "bag") as bag:
        bag.write("/a", START_S, bag.cloud(big, START_S, rows=6, row_padding=13))
    frame = read(tmp_path / "a.bag", OPTIONS).read(0)
    assert np.array_equal(frame.points[:, :3], road(0)[:600, :3])
    assert frame.fields is not None
    assert np.array_equal(frame.fields["ring"], little["ring"])


def two_topics(path: Path) -> Path:
    with BagWriter(path, "bag") as bag:
        for k in range(3):
            for name, driver in (("south", "hesai"), ("north", "velodyne")):
                message = bag.cloud(driver_records(k, driver), START_S + PERIOD_S * k)
                bag.write(f"/{name}/points", START_S + PERIOD_S * k, message)
    return path


def test_several_lidars_are_selected_by_topic(tmp_path: Path) -> None:
    bag = two_topics(tmp_path / "a.bag")
    with pytest.raises(Error, match=r"/north/points \(3 clouds\), /south/points .* `channel`"):
        read(bag, OPTIONS)
    with pytest.raises(Error, match="got /west"):
        read(bag, Options(channel="/west"))
    assert len(read(bag, Options(channel="/north/points")).names) == 3


def test_packets_in_a_bag_name_the_driver(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.bag", "bag") as bag:
        header = bag.header(START_S)
        bag.write("/rosout_header", START_S, header)
    with pytest.raises(Error, match=r"expected a topic of sensor_msgs/PointCloud2.*/rosout_header"):
        read(tmp_path / "a.bag", OPTIONS)


def test_stamps_that_are_not_set_are_replaced_by_times_of_the_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.bag", "bag") as bag:
        for k in range(3):
            bag.write("/a", START_S + 0.2 * k, bag.cloud(driver_records(k, "velodyne"), 0.0))
    recording = read(tmp_path / "a.bag", OPTIONS)
    assert recording.times is not None
    assert recording.times() == pytest.approx(START_S + 0.2 * np.arange(3))
    assert recording.notes is not None
    assert any("stamps of clouds are not set" in note for note in recording.notes())


def test_boxes_of_detections_and_the_pose_from_tf(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "street", "mcap") as bag:

        def pose(x: float, y: float, z: float, half_yaw: float = 0.0):
            return bag.message(
                "geometry_msgs/msg/Pose",
                position=bag.message("geometry_msgs/msg/Point", x=x, y=y, z=z),
                orientation=bag.message(
                    "geometry_msgs/msg/Quaternion",
                    x=0.0,
                    y=0.0,
                    z=np.sin(half_yaw),
                    w=np.cos(half_yaw),
                ),
            )

        transform = bag.message(
            "geometry_msgs/msg/Transform",
            translation=bag.message("geometry_msgs/msg/Vector3", x=10.0, y=20.0, z=6.0),
            rotation=pose(0, 0, 0, 0.25).orientation,
        )
        stamped = bag.message(
            "geometry_msgs/msg/TransformStamped",
            header=bag.header(START_S, "map"),
            child_frame_id="lidar",
            transform=transform,
        )
        bag.write(
            "/tf_static", START_S, bag.message("tf2_msgs/msg/TFMessage", transforms=[stamped])
        )
        for k in range(3):
            time_s = START_S + PERIOD_S * k
            bag.write("/points", time_s, bag.cloud(driver_records(k, "hesai"), time_s))
            hypothesis = bag.message("vision_msgs/msg/ObjectHypothesis", class_id="Car", score=0.8)
            result = bag.message(
                "vision_msgs/msg/ObjectHypothesisWithPose",
                hypothesis=hypothesis,
                pose=bag.message(
                    "geometry_msgs/msg/PoseWithCovariance",
                    pose=pose(0, 0, 0),
                    covariance=np.zeros(36),
                ),
            )
            box = bag.message(
                "vision_msgs/msg/BoundingBox3D",
                center=pose(-20 + 2.0 * k, 5.0, -5.2, 0.05),
                size=bag.message("geometry_msgs/msg/Vector3", x=4.2, y=1.8, z=1.5),
            )
            detection = bag.message(
                "vision_msgs/msg/Detection3D",
                header=bag.header(time_s),
                results=[result],
                bbox=box,
                id="T7",
            )
            bag.write(
                "/boxes",
                time_s,
                bag.message(
                    "vision_msgs/msg/Detection3DArray",
                    header=bag.header(time_s),
                    detections=[detection],
                ),
            )
    recording = read(tmp_path / "street", OPTIONS)
    assert recording.pose is not None
    assert recording.pose.x == pytest.approx(10)
    assert recording.pose.yaw == pytest.approx(0.5)
    boxes = [recording.read(k).boxes for k in range(3)]
    assert [b.names.tolist() for b in boxes] == [["Car"]] * 3
    assert boxes[2].boxes[0] == pytest.approx([-16, 5, -5.2, 4.2, 1.8, 1.5, 0.1])
    assert len({int(b.ids[0]) for b in boxes if b.ids is not None}) == 1


def test_what_is_exported_as_mcap_is_read(tmp_path: Path) -> None:
    source = write_recording(tmp_path)
    frames = kitti.frames(source)
    export(source, frames, "mcap", tmp_path / "out")
    (file,) = (tmp_path / "out").glob("*.mcap")
    recording = read(file, Options())
    assert len(recording.names) == len(frames)
    for i, number in enumerate(frames):
        frame = recording.read(i)
        assert np.array_equal(
            frame.points, kitti.read_points(kitti.frame_file(source, "velodyne", number))
        )
        fields = kitti.read_fields(kitti.frame_file(source, "fields", number))
        assert frame.fields is not None
        assert np.array_equal(frame.fields, fields)
        objects = kitti.read_objects(kitti.frame_file(source, "objects", number))
        assert frame.boxes.boxes == pytest.approx(objects.label_boxes("frame"), abs=1e-5)
        assert frame.boxes.names.tolist() == objects.names.tolist()
        assert frame.boxes.ids is not None
        assert frame.boxes.ids.tolist() == objects.ids.tolist()


def test_a_bag_is_imported_with_height_and_times(tmp_path: Path) -> None:
    source = write_bag(tmp_path / "a.bag", "bag", "robosense", frames=12)
    facts = LidarFacts("pole", "street")
    summary, labelled = import_recording(source, "bag", tmp_path / "in/pole", facts, Options())
    assert (summary.frames, labelled) == (12, False)
    lidar = kitti.read_lidar(tmp_path / "in/pole")
    assert lidar.T_world_levelled.z == pytest.approx(6, abs=0.05)
    assert lidar.period_s == pytest.approx(0.1)
    assert len(kitti.read_fields(kitti.frame_file(tmp_path / "in/pole", "fields", 3))) > 500


def test_sizes_that_do_not_fit_are_errors() -> None:
    class Field:
        name, offset, datatype, count = "x", 0, 7, 1

    class Message:
        is_bigendian, fields, data = False, (Field(),), bytes(40)
        point_step, width, height, row_step = 4, 11, 1, 44

    with pytest.raises(FormatError, match=r"a: expected 44 bytes of points \(11 x 1\), got 40"):
        cloud_records("a", Message())
