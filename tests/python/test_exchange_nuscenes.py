"""nuScenes tables, read by a strict reader of the public description."""

import json
import math
from pathlib import Path

import matplotlib.image
import numpy as np
import nuscenes_reader
import pytest
from exchange_data import BOXES, FRAMES, LIDARS, points, to_world, without, write_recording
from nuscenes_reader import Database

from pyinfra.core.errors import FormatError
from pyinfra.exchange import nuscenes
from pyinfra.exchange.exports import export
from pyinfra.formats import kitti


def exported(folder: Path, frames: list[int], out: Path) -> Database:
    out.mkdir()
    nuscenes.export(folder, frames, out)
    return nuscenes_reader.read(out, "v1.0-infrasim")


def names(database: Database, annotation: dict) -> tuple[str, list[str], str]:
    """Returns category, attributes and visibility of an annotation."""
    instance = database.get("instance", annotation["instance_token"])
    attributes = [database.get("attribute", t)["name"] for t in annotation["attribute_tokens"]]
    token = annotation["visibility_token"]
    level = database.get("visibility", token)["level"] if token else ""
    return database.get("category", instance["category_token"])["name"], attributes, level


def test_a_known_recording_comes_back_whole(tmp_path: Path) -> None:
    database = exported(write_recording(tmp_path), list(FRAMES), tmp_path / "out")
    for sample, (frame, ids) in zip(database.rows("sample"), FRAMES.items(), strict=True):
        data = database.data(sample)
        assert sample["timestamp"] == data["timestamp"] == frame * 100_000 + 50_000
        cloud = database.cloud(data)
        np.testing.assert_array_equal(cloud[:, :3], points(frame)[:, :3])
        np.testing.assert_allclose(cloud[:, 3] / 255, points(frame)[:, 3], atol=1e-6)
        assert cloud[:, 4].tolist() == [ring + frame for ring in range(10)]
        np.testing.assert_allclose(
            database.to_global(cloud[:, :3], data), to_world(cloud[:, :3]), atol=1e-5
        )
        got = [database.box_in_sensor(a, data) for a in database.annotations(sample)]
        expected = np.array([BOXES[i] for i in ids]).reshape(-1, 7)
        np.testing.assert_allclose(np.reshape(got, (-1, 7)), expected, atol=1e-5)
        assert all(a["num_lidar_pts"] == 3 for a in database.annotations(sample))


def test_annotations_are_in_the_world(tmp_path: Path) -> None:
    database = exported(write_recording(tmp_path), [5], tmp_path / "out")
    car, truck = database.annotations(database.rows("sample")[0])
    assert car["translation"] == pytest.approx([10 + 4, 20 + 30, 6 - 5.25])
    assert car["size"] == [2.0, 4.0, 1.5]
    w, x, y, z = car["rotation"]
    assert (x, y) == (0, 0)
    assert 2 * math.atan2(z, w) == pytest.approx(0.5 + math.pi / 2)
    assert truck["size"] == [2.5, 10.0, 3.0]


def test_classes_attributes_and_visibility_have_the_names_of_nuscenes(tmp_path: Path) -> None:
    database = exported(write_recording(tmp_path), [5], tmp_path / "out")
    car, truck = database.annotations(database.rows("sample")[0])
    assert names(database, car) == ("vehicle.car", ["vehicle.moving"], "v40-60")
    assert names(database, truck) == ("vehicle.truck", ["vehicle.stopped"], "")


@pytest.mark.parametrize(
    ("visibility", "token"),
    [(-1, ""), (0, "1"), (0.39, "1"), (0.4, "2"), (0.6, "3"), (0.79, "3"), (0.8, "4"), (1, "4")],
)
def test_levels_of_visibility_begin_where_they_say(visibility: float, token: str) -> None:
    assert nuscenes.visibility_token(visibility) == token


def test_an_object_that_returns_is_one_instance(tmp_path: Path) -> None:
    database = exported(write_recording(tmp_path), list(FRAMES), tmp_path / "out")
    counts = [instance["nbr_annotations"] for instance in database.rows("instance")]
    assert counts == [2, 1]


def test_image_sets_become_scenes_that_share_no_instance(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    (folder / "ImageSets").mkdir()
    (folder / "ImageSets/train.txt").write_text("000005\n")
    (folder / "ImageSets/val.txt").write_text("000007\n")
    database = exported(folder, list(FRAMES), tmp_path / "out")
    scenes = {scene["name"]: scene["nbr_samples"] for scene in database.rows("scene")}
    assert scenes == {f"made_up-pole-{part}": 1 for part in ("train", "val", "all")}
    splits = json.loads((tmp_path / "out/v1.0-infrasim/splits.json").read_text())
    expected = {f"infrasim_{part}": [f"made_up-pole-{part}"] for part in ("train", "val", "all")}
    assert splits == expected
    assert len(database.rows("instance")) == 3


def test_a_frame_of_both_lists_is_an_error(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    (folder / "ImageSets").mkdir()
    for part in ("train", "val"):
        (folder / f"ImageSets/{part}.txt").write_text("000005\n")
    with pytest.raises(
        FormatError, match=r"val\.txt: expected frames that are not in train\.txt, got frame 5"
    ):
        nuscenes.export(folder, [5], tmp_path)


def test_without_fields_and_objects_and_dataset_every_label_is_an_instance(tmp_path: Path) -> None:
    whole = write_recording(tmp_path)
    folder = without(whole, tmp_path / "bare", "fields", "objects")
    database = exported(folder, list(FRAMES), tmp_path / "out")
    assert [i["nbr_annotations"] for i in database.rows("instance")] == [1, 1, 1]
    assert [s["name"] for s in database.rows("scene")] == ["bare-pole-all"]
    for sample in database.rows("sample"):
        data = database.data(sample)
        assert (database.cloud(data)[:, 4] == -1).all()
        for annotation in database.annotations(sample):
            assert annotation["num_lidar_pts"] == 3
            assert names(database, annotation)[1:] == ([], "")


def test_the_mask_of_the_map_says_nothing(tmp_path: Path) -> None:
    exported(write_recording(tmp_path), [5], tmp_path / "out")
    assert (matplotlib.image.imread(tmp_path / "out/maps/none.png")[..., :3] == 0).all()


@pytest.mark.parametrize("lidar", LIDARS)
def test_each_lidar_comes_back(motorway: Path, tmp_path: Path, lidar: str) -> None:
    folder = motorway / lidar
    database = exported(folder, [0, 1, 2], tmp_path / "out")
    for frame, sample in enumerate(database.rows("sample")):
        data = database.data(sample)
        expected = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
        fields = kitti.read_fields(kitti.frame_file(folder, "fields", frame))
        objects = kitti.read_objects(kitti.frame_file(folder, "objects", frame))
        cloud = database.cloud(data)
        assert len(cloud) > 1000
        np.testing.assert_allclose(cloud[:, :4] / [1, 1, 1, 255], expected, atol=1e-5)
        assert cloud[:, 4].tolist() == fields["ring"].tolist()
        instances = [a["instance_token"] for a in database.annotations(sample)]
        order = {token: i for i, token in enumerate(instances)}
        assert len(order) == len(objects)
        boxes = np.array([database.box_in_sensor(a, data) for a in database.annotations(sample)])
        by_position = np.lexsort(boxes[:, :2].T), np.lexsort(objects.boxes[:, :2].T)
        turn = boxes[by_position[0], 6] - objects.boxes[by_position[1], 6]
        np.testing.assert_allclose(
            boxes[by_position[0], :6], objects.boxes[by_position[1], :6], atol=1e-5
        )
        np.testing.assert_allclose(np.cos(turn), 1, atol=1e-10)


def test_the_same_recording_has_the_same_tokens_and_no_other_has_them(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "a")
    first = exported(folder, [5, 6, 7], tmp_path / "first")
    again = exported(folder, [5, 6, 7], tmp_path / "again")
    assert first.tables == again.tables
    text = (tmp_path / "a/dataset.yaml").read_text()
    (tmp_path / "a/dataset.yaml").write_text(text.replace("seed: 7", "seed: 8"))
    other = exported(folder, [5, 6, 7], tmp_path / "other")
    assert not first.tables["sample"].keys() & other.tables["sample"].keys()


def test_a_broken_frame_is_named_and_leaves_no_table(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    kitti.frame_file(folder, "objects", 7).write_text("id\n")
    out = tmp_path / "out"
    out.mkdir()
    with pytest.raises(FormatError, match=r"000007\.csv:1: expected .*got 'id'"):
        nuscenes.export(folder, [5, 6, 7], out)
    assert list((out / "v1.0-infrasim").iterdir()) == []


def test_no_frame_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected one or more frames to export, got none"):
        export(write_recording(tmp_path), [], "nuscenes", tmp_path / "out")
