"""Boxes that recur where nothing moves."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pyinfra.cli import main
from pyinfra.core.arrays import FloatArray
from pyinfra.formats import kitti
from pyinfra.models.detectors import Detections
from pyinfra.models.inference.static_filter import standing, without_standing


def test_boxes_stand_that_come_back_at_a_place_where_none_moves() -> None:
    hedge, lane, once = [[20.0, 9.0]] * 4, [[30.0, 0.0]] * 4, [[50.0, 0.0]]
    boxes = vehicles_at(hedge + lane + once)
    moves = np.zeros(len(boxes), np.bool_)
    moves[5] = True
    assert standing(boxes, moves).tolist() == [True] * 4 + [False] * 5
    assert standing(np.empty((0, 7)), np.empty(0, np.bool_)).tolist() == []


def test_a_queue_on_a_lane_stays_and_a_hedge_beside_it_goes() -> None:
    queue, hedge, passing = [[30.0, 0.0]] * 9, [[30.0, 2.0]] * 9, [[31.8, 0.1]]
    boxes = vehicles_at(queue + hedge + passing)
    moves = np.arange(len(boxes)) == len(boxes) - 1
    assert standing(boxes, moves).tolist() == [False] * 9 + [True] * 9 + [False]


def test_few_seconds_are_a_warning(
    lidar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["detect", str(lidar), "--model", "generalist", "--max-frames", "4"]
    assert main.main([*words, "--drop-standing", "--out", str(tmp_path / "detected")]) == 0
    printed = capsys.readouterr()
    assert "boxes removed, because nothing ever moves at their positions" in printed.out
    assert "is not split" not in printed.err  # the detector has learnt from none of these frames
    assert (
        "warning: --drop-standing: expected frames that span 60 s or more, got 14.8" in printed.err
    )


def test_what_stands_goes_without_a_description_of_the_lidar(lidar: Path, tmp_path: Path) -> None:
    copy = tmp_path / "lidar"
    shutil.copytree(lidar / "training/velodyne", copy / "training/velodyne")
    words = ["detect", str(copy), "--model", "generalist", "--height-m", "6"]
    words += ["--max-frames", "3", "--drop-standing", "--out", str(tmp_path / "detected")]
    assert main.main(words) == 0
    assert len(list((tmp_path / "detected").glob("*.txt"))) == 3


def vehicles_at(centres: list[list[float]]) -> FloatArray:
    """Returns vehicles along x: (n, 7)."""
    size = [-5.0, 4.5, 1.9, 1.6, 0.0]
    return np.array([[*centre, *size] for centre in centres])


@pytest.fixture(scope="module")
def lidar(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Simulates twenty seconds of a motorway."""
    out = tmp_path_factory.mktemp("minute") / "data"
    infrasim(*run_command("hesai_xt32", frames="0:200:4", preset="datasheet", out=out), check=True)
    return out / "hesai_xt32"


def test_rails_go_and_vehicles_stay(lidar: Path) -> None:
    files, detections, vehicles = [], [], 0
    rail = np.array([[25.0, 19.5, -7.0, 4.5, 1.9, 1.6, 0.0]])
    for k in kitti.frames(lidar):
        objects = kitti.read_objects(kitti.frame_file(lidar, "objects", k))
        boxes = objects.label_boxes("scan")[objects.points >= 10]
        vehicles += len(boxes)
        every = np.concatenate([boxes, rail])
        files.append(partial(kitti.read_points, kitti.frame_file(lidar, "velodyne", k)))
        detections.append(
            Detections(every, np.full(len(every), 0.9), np.full(len(every), "vehicle"))
        )
    left = without_standing(files, detections, region=None)
    boxes = np.concatenate([d.boxes for d in left])
    assert not (boxes[:, :2] == rail[0, :2]).all(axis=1).any()
    assert len(boxes) >= 0.97 * vehicles
    assert sum(map(len, left)) == len(boxes)


def test_clouds_alone_say_nothing_of_what_stands(
    lidar: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = kitti.frame_file(lidar, "velodyne", 0)
    assert main.main(["detect", "run", str(cloud), "--drop-standing"]) != 0
    assert (
        "--drop-standing: expected a LiDAR's folder as DATA, got files of point clouds"
        in capsys.readouterr().err
    )


def test_people_who_wait_stay(lidar: Path) -> None:
    files = [
        partial(kitti.read_points, kitti.frame_file(lidar, "velodyne", k))
        for k in kitti.frames(lidar)
    ]
    boxes = np.array(
        [[25.0, 19.5, -7.0, 4.5, 1.9, 1.6, 0.0], [25.0, 14.0, -7.0, 0.7, 0.7, 1.7, 0.0]]
    )
    names = np.array(["vehicle", "Pedestrian"])
    detections = [Detections(boxes, np.array([0.9, 0.8]), names)] * len(files)
    left = without_standing(files, detections, region=None)
    assert {tuple(d.names.tolist()) for d in left} == {("Pedestrian",)}
