"""OpenLABEL files, checked by `openlabel-checker` with the schema of the standard."""

import json
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import openlabel_checker.core
import pytest
from exchange_data import (
    BOXES,
    FRAMES,
    LIDARS,
    heading,
    points,
    rotation,
    to_world,
    without,
    write_recording,
)

from pyinfra.core.errors import FormatError
from pyinfra.exchange import openlabel
from pyinfra.exchange.exports import export
from pyinfra.formats import kitti


def exported(folder: Path, frames: list[int], out: Path) -> dict[str, Any]:
    """Exports frames, runs all checks on the file, and returns the content of its key
    `openlabel`."""
    out.mkdir()
    openlabel.export(folder, frames, out)
    file = out / f"{folder.name}.json"
    assert {path.name for path in out.iterdir()} == {file.name, "points"}
    document = json.loads(file.read_text())
    schema = resources.files("openlabel_checker.schema_data")
    text = schema.joinpath("openlabel_json_schema-v1.0.0.json").read_text()
    jsonschema.Draft7Validator(json.loads(text)).validate(document)
    report = openlabel_checker.core.check_file(str(file))
    assert [str(issue) for issue in report.issues] == []
    return dict(document["openlabel"])


def cuboids(frame: dict[str, Any]) -> dict[int, dict[str, Any]]:
    objects = {int(uid): item["object_data"] for uid, item in frame["objects"].items()}
    return {uid: data["cuboid"][0] for uid, data in objects.items()}


def box(cuboid: dict[str, Any]) -> list[float]:
    val = cuboid["val"]
    return [*val[:3], *val[7:10], heading(val[3:7])]


def numbers(cuboid: dict[str, Any]) -> dict[str, float]:
    return {item["name"]: item["val"] for item in cuboid["attributes"]["num"]}


def test_a_known_recording_comes_back_whole(tmp_path: Path) -> None:
    document = exported(write_recording(tmp_path), list(FRAMES), tmp_path / "out")
    assert list(document["frames"]) == ["0", "1", "2"]
    for (number, ids), frame in zip(FRAMES.items(), document["frames"].values(), strict=True):
        properties = frame["frame_properties"]
        assert properties["timestamp"] == f"0.{number}50000000"
        stream = properties["streams"]["pole"]
        sync = {"frame_stream": number, "timestamp": f"0.{number}00000000"}
        assert stream["stream_properties"]["sync"] == sync
        cloud = np.fromfile(tmp_path / "out" / stream["uri"], dtype="<f4").reshape(-1, 4)
        np.testing.assert_array_equal(cloud, points(number))
        got = cuboids(frame)
        assert list(got) == list(ids)
        for uid, cuboid in got.items():
            assert cuboid["coordinate_system"] == "pole"
            np.testing.assert_allclose(box(cuboid), BOXES[uid], atol=1e-5)


def test_the_pose_takes_the_lidar_to_the_world(tmp_path: Path) -> None:
    document = exported(write_recording(tmp_path), [5], tmp_path / "out")
    systems = document["coordinate_systems"]
    assert systems["world"]["parent"] == ""
    assert systems["world"]["children"] == ["pole"]
    assert systems["pole"]["parent"] == "world"
    pose = systems["pole"]["pose_wrt_parent"]
    got = points(5)[:, :3] @ rotation(pose["quaternion"]).T + pose["translation"]
    np.testing.assert_allclose(got, to_world(points(5)[:, :3]), atol=1e-5)


def test_objects_know_when_they_are_there(tmp_path: Path) -> None:
    document = exported(write_recording(tmp_path), list(FRAMES), tmp_path / "out")
    intervals = {
        uid: [(i["frame_start"], i["frame_end"]) for i in item["frame_intervals"]]
        for uid, item in document["objects"].items()
    }
    assert intervals == {"3": [(0, 0), (2, 2)], "8": [(0, 0)]}
    assert {uid: item["type"] for uid, item in document["objects"].items()} == {
        "3": "Car",
        "8": "Truck",
    }
    assert document["frame_intervals"] == [{"frame_start": 0, "frame_end": 2}]


def test_neighbouring_frames_are_one_interval(tmp_path: Path) -> None:
    document = exported(write_recording(tmp_path), [5, 7], tmp_path / "out")
    assert document["objects"]["3"]["frame_intervals"] == [{"frame_start": 0, "frame_end": 1}]


def test_what_is_not_known_is_left_out(tmp_path: Path) -> None:
    document = exported(write_recording(tmp_path), [5], tmp_path / "out")
    car, truck = cuboids(document["frames"]["0"]).values()
    assert numbers(car) == {"points_in_box": 3, "speed": 15.0, "visibility": 0.5}
    assert numbers(truck) == {"points_in_box": 3, "speed": 0.0}


def test_frames_without_any_object_make_a_valid_file(tmp_path: Path) -> None:
    document = exported(write_recording(tmp_path), [6], tmp_path / "out")
    assert document["objects"] == {}
    assert document["frames"]["0"]["objects"] == {}


def test_without_fields_and_objects_and_dataset_every_label_is_an_object(tmp_path: Path) -> None:
    whole = write_recording(tmp_path)
    folder = without(whole, tmp_path / "bare", "fields", "objects")
    document = exported(folder, list(FRAMES), tmp_path / "out")
    assert list(document["objects"]) == ["0", "1", "2"]
    assert document["metadata"]["name"] == "bare, pole"
    shapes = [c for frame in document["frames"].values() for c in cuboids(frame).values()]
    assert [numbers(shape) for shape in shapes] == [{"points_in_box": 3}] * 3
    np.testing.assert_allclose(box(shapes[1]), BOXES[8], atol=1e-5)


@pytest.mark.parametrize("lidar", LIDARS)
def test_each_lidar_comes_back(motorway: Path, tmp_path: Path, lidar: str) -> None:
    folder = motorway / lidar
    document = exported(folder, [0, 1, 2], tmp_path / "out")
    for number, frame in enumerate(document["frames"].values()):
        uri = frame["frame_properties"]["streams"][lidar]["uri"]
        expected = kitti.frame_file(folder, "velodyne", number).read_bytes()
        assert (tmp_path / "out" / uri).read_bytes() == expected
        objects = kitti.read_objects(kitti.frame_file(folder, "objects", number))
        got = cuboids(frame)
        assert list(got) == objects.ids.tolist()
        np.testing.assert_allclose([box(c) for c in got.values()], objects.boxes, atol=1e-5)


def test_a_broken_frame_is_named_and_leaves_no_labels(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    kitti.frame_file(folder, "objects", 7).write_text("id\n")
    out = tmp_path / "out"
    out.mkdir()
    with pytest.raises(FormatError, match=r"000007\.csv:1: expected .*got 'id'"):
        openlabel.export(folder, [5, 6, 7], out)
    assert [path.name for path in out.iterdir()] == ["points"]


def test_no_frame_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected one or more frames to export, got none"):
        export(write_recording(tmp_path), [], "openlabel", tmp_path / "out")
