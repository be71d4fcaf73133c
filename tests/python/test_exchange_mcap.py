"""MCAP files, read by the decoder of `mcap-ros2-support`."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from exchange_data import (
    BOXES,
    FRAMES,
    LIDARS,
    fields_of,
    heading,
    points,
    rotation,
    to_world,
    without,
    write_recording,
)
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from pyinfra.core.errors import FormatError
from pyinfra.exchange import mcap
from pyinfra.formats import kitti

TYPES = {2: "u1", 4: "<u2", 5: "<i4", 7: "<f4"}  # types of sensor_msgs/PointField


def read(file: Path) -> dict[str, list[tuple[int, SimpleNamespace]]]:
    """Returns the log times (ns) and messages of each topic."""
    by_topic: dict[str, list[tuple[int, SimpleNamespace]]] = {}
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            by_topic.setdefault(channel.topic, []).append((message.log_time, decoded))
    return by_topic


def exported(folder: Path, frames: list[int], out: Path) -> dict[str, list[SimpleNamespace]]:
    out.mkdir()
    mcap.export(folder, frames, out)
    (file,) = out.iterdir()
    assert file.name == f"{folder.name}.mcap"
    return {topic: [m for _, m in messages] for topic, messages in read(file).items()}


def records(cloud: SimpleNamespace) -> np.ndarray:
    """Returns the points of a PointCloud2 with the types of its fields."""
    assert not cloud.is_bigendian
    assert cloud.row_step == cloud.width * cloud.point_step == len(cloud.data)
    dtype = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [TYPES[field.datatype] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    return np.frombuffer(cloud.data, dtype=dtype)


def seconds(header: SimpleNamespace) -> float:
    return header.stamp.sec + header.stamp.nanosec / 1e9


def vector(v: SimpleNamespace) -> list[float]:
    return [v.x, v.y, v.z]


def quaternion(q: SimpleNamespace) -> list[float]:
    return [q.x, q.y, q.z, q.w]


def boxes(array: SimpleNamespace) -> np.ndarray:
    cubes = [m for m in array.markers if m.action == 0]
    rows = [
        [*vector(m.pose.position), *vector(m.scale), heading(quaternion(m.pose.orientation))]
        for m in cubes
    ]
    return np.array(rows).reshape(len(rows), 7)


def test_a_known_recording_comes_back_whole(tmp_path: Path) -> None:
    by_topic = exported(write_recording(tmp_path), list(FRAMES), tmp_path / "out")
    clouds, arrays, poses = by_topic["/pole/points"], by_topic["/pole/boxes"], by_topic["/tf"]
    assert len(clouds) == len(arrays) == len(poses) == 3
    for (frame, ids), cloud, array, pose in zip(FRAMES.items(), clouds, arrays, poses, strict=True):
        got, fields = records(cloud), fields_of(frame)
        xyzi = np.column_stack([got[n] for n in ("x", "y", "z", "intensity")])
        np.testing.assert_array_equal(xyzi, points(frame))
        for name, key in {"time": "time_s", "class_id": "class", "echo": "echo"}.items():
            np.testing.assert_array_equal(got[name], fields[key])
        np.testing.assert_array_equal(got["ring"], fields["ring"])
        np.testing.assert_array_equal(got["object_id"], fields["object_id"])
        assert seconds(cloud.header) == pytest.approx(frame * 0.1, abs=1e-9)
        # The first marker deletes the markers of the previous frame. A frame without objects has
        # this marker too.
        assert array.markers[0].action == 3
        assert all(seconds(m.header) == pytest.approx(frame * 0.1 + 0.05) for m in array.markers)
        assert [m.id for m in array.markers[1:]] == list(ids)
        np.testing.assert_allclose(boxes(array), np.array([BOXES[i] for i in ids]).reshape(-1, 7))
        assert {m.header.frame_id for m in array.markers} == {cloud.header.frame_id} == {"pole"}
        times = [seconds(t.header) for t in pose.transforms]
        assert times == [seconds(cloud.header), seconds(array.markers[0].header)]


def test_the_transform_takes_points_to_the_world(tmp_path: Path) -> None:
    by_topic = exported(write_recording(tmp_path), [5], tmp_path / "out")
    for stamped in by_topic["/tf"][0].transforms:
        assert (stamped.header.frame_id, stamped.child_frame_id) == ("world", "pole")
        turn = rotation(quaternion(stamped.transform.rotation))
        got = points(5)[:, :3] @ turn.T + vector(stamped.transform.translation)
        np.testing.assert_allclose(got, to_world(points(5)[:, :3]), atol=1e-5)


def test_messages_are_logged_at_the_end_of_their_frame(tmp_path: Path) -> None:
    mcap.export(write_recording(tmp_path), [5, 7], tmp_path)
    by_topic = read(tmp_path / "pole.mcap")
    for messages in by_topic.values():
        assert [time for time, _ in messages] == [600_000_000, 800_000_000]


def test_without_fields_and_objects_and_dataset_there_are_points_and_labels(
    tmp_path: Path,
) -> None:
    whole = write_recording(tmp_path)
    folder = without(whole, tmp_path / "bare", "fields", "objects")
    by_topic = exported(folder, list(FRAMES), tmp_path / "out")
    for frame, cloud in zip(FRAMES, by_topic["/pole/points"], strict=True):
        assert records(cloud).dtype.names == ("x", "y", "z", "intensity")
        xyzi = records(cloud).view("<f4").reshape(-1, 4)
        np.testing.assert_array_equal(xyzi, points(frame))
    numbers = [m.id for array in by_topic["/pole/boxes"] for m in array.markers[1:]]
    assert numbers == [0, 1, 2]  # label files have no ids
    np.testing.assert_allclose(boxes(by_topic["/pole/boxes"][2])[0], BOXES[3], atol=1e-5)


def test_a_folder_of_kitti_alone_stands_at_the_origin(tmp_path: Path) -> None:
    folder = without(write_recording(tmp_path), tmp_path / "bare", "fields", "objects")
    (folder / "lidar.yaml").unlink()
    stamped = exported(folder, [5], tmp_path / "out")["/tf"][0].transforms[0]
    assert vector(stamped.transform.translation) == [0, 0, 0]
    assert quaternion(stamped.transform.rotation) == [0, 0, 0, 1]


@pytest.mark.parametrize("lidar", LIDARS)
def test_each_lidar_comes_back(motorway: Path, tmp_path: Path, lidar: str) -> None:
    folder = motorway / lidar
    by_topic = exported(folder, [0, 1, 2], tmp_path / "out")
    for frame in range(3):
        cloud, array = by_topic[f"/{lidar}/points"][frame], by_topic[f"/{lidar}/boxes"][frame]
        expected = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
        fields = kitti.read_fields(kitti.frame_file(folder, "fields", frame))
        objects = kitti.read_objects(kitti.frame_file(folder, "objects", frame))
        got = records(cloud)
        assert len(got) > 1000
        assert got["z"].tolist() == expected[:, 2].tolist()
        assert got["object_id"].tolist() == fields["object_id"].tolist()
        assert [m.ns for m in array.markers[1:]] == objects.names.tolist()
        np.testing.assert_allclose(boxes(array), objects.boxes, atol=1e-5)


def test_a_broken_frame_is_named_and_leaves_no_file(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    file = kitti.frame_file(folder, "fields", 7)
    file.write_bytes(file.read_bytes()[:-12])
    out = tmp_path / "out"
    out.mkdir()
    with pytest.raises(FormatError, match=r"000007\.bin: expected 10 records, .*, got 9"):
        mcap.export(folder, [5, 6, 7], out)
    assert list(out.iterdir()) == []


def test_a_frame_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"000009\.bin"):
        mcap.export(write_recording(tmp_path), [9], tmp_path)
