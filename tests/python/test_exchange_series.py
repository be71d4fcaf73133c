"""The frames that every export receives, one after the other, with and without optional parts."""

import tracemalloc
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from exchange_data import BOXES, boxes_of, names_of, objects_of, without, write_recording

from pyinfra.core.errors import FormatError
from pyinfra.exchange import mcap, nuscenes, openlabel
from pyinfra.exchange.series import read_frames, read_series
from pyinfra.formats import kitti


def test_boxes_hold_in_the_middle_of_their_frame(tmp_path: Path) -> None:
    series = read_series(write_recording(tmp_path))
    times = [(frame.start_s, frame.middle_s) for frame in read_frames(series, [5, 7])]
    np.testing.assert_allclose(times, [(0.5, 0.55), (0.7, 0.75)], atol=1e-12)


def test_frames_that_do_not_ascend_are_an_error(tmp_path: Path) -> None:
    series = read_series(write_recording(tmp_path))
    with pytest.raises(ValueError, match="expected ascending frame numbers, got 5 after 7"):
        list(read_frames(series, [7, 5]))


def test_a_recording_says_where_it_comes_from(tmp_path: Path) -> None:
    series = read_series(write_recording(tmp_path))
    assert (series.scene, series.lidar) == ("made_up", "pole")
    assert series.provenance["seed"] == "7"


def test_a_folder_without_a_data_set_is_named_by_its_path(tmp_path: Path) -> None:
    folder = without(write_recording(tmp_path / "data"), tmp_path / "site")
    (folder / "lidar.yaml").unlink()
    series = read_series(folder)
    assert (series.scene, series.lidar, series.provenance) == ("site", "pole", {})
    assert series.period_s == 0.1


def test_points_of_a_label_are_those_in_its_box_or_five_centimetres_outside(tmp_path: Path) -> None:
    folder = without(write_recording(tmp_path), tmp_path / "bare", "objects")
    x, y, z, dx, _, _, heading = BOXES[3]
    ahead = np.array([np.cos(heading), np.sin(heading), 0])
    positions = [np.array([x, y, z]) + ahead * (dx / 2 + gap) for gap in (-0.01, 0.049, 0.051)]
    cloud = np.column_stack([positions, np.ones(3)]).astype(np.float32)
    kitti.write_points(kitti.frame_file(folder, "velodyne", 5), cloud)
    (folder / "training/fields/000005.bin").write_bytes(bytes(36))
    (frame,) = read_frames(read_series(folder), [5])
    assert frame.objects.points_in_box.tolist() == [2, 0]


def test_an_id_twice_in_a_frame_is_named(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    file = kitti.frame_file(folder, "objects", 5)
    file.write_text(file.read_text().replace("\n8,", "\n3,"))
    with pytest.raises(
        FormatError, match=r"000005\.csv:3: id: expected each id once per frame, got 3 twice"
    ):
        list(read_frames(read_series(folder), [5]))


def test_objects_that_nobody_tracked_are_new_ones_in_every_frame(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    with (tmp_path / "dataset.yaml").open("a") as stream:
        stream.write("ids: rows\n")
    frames = read_frames(read_series(folder), [5, 6, 7])
    assert [frame.objects.ids.tolist() for frame in frames] == [[0, 1], [], [2]]


def test_a_description_that_is_no_mapping_is_named(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    (tmp_path / "dataset.yaml").write_text("highway\n")
    with pytest.raises(FormatError, match=r"dataset\.yaml:1: expected keys with values, got"):
        read_series(folder)


@pytest.mark.parametrize("module", [mcap, nuscenes, openlabel])
def test_memory_holds_some_frames_and_not_all(tmp_path: Path, module: ModuleType) -> None:
    folder = write_recording(tmp_path)
    cloud = np.random.default_rng(1).random((20_000, 4), dtype=np.float32)
    fields = np.zeros(len(cloud), dtype=kitti.FIELDS)
    labels = kitti.Labels(names_of((3,)), boxes_of((3,)), None)
    for frame in range(60):
        objects = objects_of((3,))
        kitti.write_frame(folder, frame, cloud, labels, objects=objects, fields=fields)
    for name in ("first", "out"):
        (tmp_path / name).mkdir()
    # the first use of a package imports its parts
    module.export(folder, range(2), tmp_path / "first")
    tracemalloc.start()
    module.export(folder, range(60), tmp_path / "out")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 15 * cloud.nbytes


@pytest.mark.parametrize(
    ("file", "name"), [("pole/lidar.yaml", "pole"), ("dataset.yaml", "made_up")]
)
def test_a_name_that_leads_out_of_the_folder_is_an_error(
    tmp_path: Path, file: str, name: str
) -> None:
    folder = write_recording(tmp_path)
    text = (tmp_path / file).read_text()
    (tmp_path / file).write_text(text.replace(f'"{name}"', '"../x"'))
    with pytest.raises(FormatError, match=rf"{file}: name: expected a name .*, got '\.\./x'"):
        read_series(folder)
