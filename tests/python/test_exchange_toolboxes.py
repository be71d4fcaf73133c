"""Frames for OpenPCDet and MMDetection3D, read as in the guides of these tools."""

import math
from pathlib import Path

import numpy as np
import pytest
from exchange_data import BOXES, LIDARS, points, write_recording
from toolbox_readers import grid_of, listed, mmdet3d, openpcdet, openpcdet_config

from pyinfra.exchange.exports import export
from pyinfra.formats import kitti

MODELS = ("pointpillars", "pointrcnn", "pv_rcnn", "dsvt")
UP = np.array([0, 0, 6, 0, 0, 0, 0])  # shift from the sensor to the road


@pytest.fixture(scope="module")
def pole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("made_up"))


@pytest.fixture(scope="module")
def out(pole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Makes both exports of the artificial recording, whose road is 6 m below the sensor."""
    folder = tmp_path_factory.mktemp("out")
    for name in ("openpcdet", "mmdet3d"):
        export(pole, [5, 6, 7], name, folder / name)
    return folder


def at_road_level(box: tuple[float, ...]) -> list[float]:
    return [*box[:2], box[2] + 6, *box[3:]]


def test_openpcdet_has_points_and_boxes_above_the_road(out: Path) -> None:
    exported = openpcdet(out / "openpcdet", "000005")
    assert exported.names == ["Vehicle", "Vehicle"]
    assert np.allclose(exported.boxes, [at_road_level(BOXES[i]) for i in (3, 8)], atol=1e-6)
    assert np.allclose(exported.points, points(5) + UP[:4], atol=1e-6)
    assert (out / "openpcdet/sensor.yaml").read_text().count("z_m: 6,") == 1


def test_frames_without_a_label_are_written_but_not_listed(out: Path) -> None:
    assert listed(out / "openpcdet", "train") == ["000005"]
    assert listed(out / "openpcdet", "val") == ["000007"]
    assert openpcdet(out / "openpcdet", "000006").names == []
    assert listed(out / "mmdet3d", "train") == ["000005", "000006"]


def test_mmdet3d_boxes_stand_on_the_middle_of_their_bottom(out: Path) -> None:
    frames = mmdet3d(out / "mmdet3d", "train")
    assert sorted(frames) == ["000005", "000006"]
    assert np.allclose(frames["000005"].boxes, [at_road_level(BOXES[i]) for i in (3, 8)], atol=1e-6)
    assert frames["000005"].counts == [3, 3]
    assert np.allclose(frames["000005"].points, points(5) + UP[:4], atol=1e-6)
    assert frames["000006"].boxes.shape == (0, 7)


def test_ranges_by_hand(out: Path) -> None:
    """The range contains the corners of car and truck with a margin of 2 m, rounded up to 16 cells
    of 0.32 m or 0.1 m."""
    pillars = openpcdet_config(out / "openpcdet", "pointpillars")
    assert pillars["DATA_CONFIG"]["POINT_CLOUD_RANGE"] == [-19.2, -8, -2, 37.12, 12.48, 4]
    voxels = openpcdet_config(out / "openpcdet", "pv_rcnn")
    assert voxels["DATA_CONFIG"]["POINT_CLOUD_RANGE"][0::3] == [-19.2, 35.2]
    (anchors,) = pillars["MODEL"]["DENSE_HEAD"]["ANCHOR_GENERATOR_CONFIG"]
    assert anchors["anchor_sizes"] == [[4, 2, 1.5], [10, 2.5, 3]]
    assert anchors["anchor_bottom_heights"] == [0]


def test_lists_follow_image_sets(pole: Path, tmp_path: Path) -> None:
    (pole / "ImageSets").mkdir()
    (pole / "ImageSets/train.txt").write_text("000007\n")
    (pole / "ImageSets/val.txt").write_text("000005\n000006\n")
    export(pole, [5, 6, 7], "mmdet3d", tmp_path / "out")
    assert listed(tmp_path / "out", "train") == ["000007"]
    assert list(mmdet3d(tmp_path / "out", "val")) == ["000005", "000006"]


@pytest.mark.parametrize("lidar", LIDARS)
def test_frames_of_each_lidar(motorway: Path, lidar: str, tmp_path: Path) -> None:
    folder = motorway / lidar
    for name in ("openpcdet", "mmdet3d"):
        export(folder, [0, 1, 2], name, tmp_path / name)
    infos = mmdet3d(tmp_path / "mmdet3d", "train") | mmdet3d(tmp_path / "mmdet3d", "val")
    for frame in range(3):
        cloud = kitti.read_points(kitti.frame_file(folder, "velodyne", frame)) + UP[:4]
        labels = kitti.read_labels(kitti.frame_file(folder, "label_2", frame))
        boxes = labels.boxes + UP
        for exported in (openpcdet(tmp_path / "openpcdet", f"{frame:06d}"), infos[f"{frame:06d}"]):
            assert np.allclose(exported.points, cloud, atol=1e-5, rtol=0)
            assert np.allclose(exported.boxes, boxes, atol=1e-5, rtol=0)
            assert set(exported.names) == {"Vehicle"}
            assert np.abs(exported.boxes[:, 2] - exported.boxes[:, 5] / 2).max() < 1e-4
    check_configs(tmp_path / "openpcdet", boxes)


def check_configs(folder: Path, boxes: np.ndarray) -> None:
    """Checks the rules of the guide and of the networks. All vehicles must be inside the ranges."""
    configs = {model: openpcdet_config(folder, model) for model in MODELS}
    for config in configs.values():
        assert config["CLASS_NAMES"] == ["Vehicle"]
        area = np.array(config["DATA_CONFIG"]["POINT_CLOUD_RANGE"])
        assert ((boxes[:, :3] > area[:3]) & (boxes[:, :3] < area[3:])).all()
        assert (boxes[:, 2] + boxes[:, 5] / 2 < area[5]).all()
    for model in ("pointpillars", "pv_rcnn", "dsvt"):
        assert (grid_of(configs[model])[:2] % 16 == 0).all()
    assert grid_of(configs["pv_rcnn"])[2] == 40
    assert grid_of(configs["pointpillars"])[2] == 1
    grid = grid_of(configs["dsvt"]).tolist()
    model = configs["dsvt"]["MODEL"]
    assert model["BACKBONE_3D"]["INPUT_LAYER"]["sparse_shape"] == grid
    assert model["MAP_TO_BEV"]["INPUT_SHAPE"] == grid
    assert model["BACKBONE_3D"]["output_shape"] == grid[:2]
    (size,) = configs["pointrcnn"]["MODEL"]["POINT_HEAD"]["TARGET_CONFIG"]["BOX_CODER_CONFIG"][
        "mean_size"
    ]
    assert 3 < size[0] < 8


def test_frames_without_a_vehicle_are_an_error(pole: Path, tmp_path: Path) -> None:
    for name in ("openpcdet", "mmdet3d"):
        with pytest.raises(
            ValueError, match="expected one or more vehicles in the labels of the frames"
        ):
            export(pole, [6], name, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_pedestrian_keeps_its_class_and_others_have_none(tmp_path: Path) -> None:
    boxes = np.tile([10.0, 0, -5, 4, 2, 2, math.pi / 4], (4, 1))
    names = np.array(["Bus", "Pedestrian", "Tram", "Cyclist"])
    kitti.write_frame(tmp_path / "a", 0, points(0), kitti.Labels(names, boxes, None))
    (tmp_path / "a/lidar.yaml").write_text((write_recording(tmp_path) / "lidar.yaml").read_text())
    export(tmp_path / "a", [0], "openpcdet", tmp_path / "out")
    assert openpcdet(tmp_path / "out", "000000").names == ["Vehicle", "Pedestrian", "Cyclist"]
