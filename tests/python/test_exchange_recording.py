"""What every export is given: one frame after another, with or without the optional parts."""

from pathlib import Path

import numpy as np
import pytest
from exchange_data import BOXES, without, write_recording

from pyinfra import kitti
from pyinfra.exchange.recording import read_frames, read_recording


def test_frames_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    recording = read_recording(write_recording(tmp_path))
    frames = list(read_frames(recording, [7, 5]))
    assert [frame.number for frame in frames] == [5, 7]
    assert [frame.middle_s - frame.start_s for frame in frames] == pytest.approx([0.05, 0.05])


def test_a_recording_says_where_it_comes_from(tmp_path: Path) -> None:
    recording = read_recording(write_recording(tmp_path))
    assert (recording.scene, recording.lidar) == ("made_up", "pole")
    assert recording.about["seed"] == "7"


def test_a_folder_without_a_data_set_is_named_by_its_path(tmp_path: Path) -> None:
    folder = without(write_recording(tmp_path / "data"), tmp_path / "site")
    (folder / "lidar.yaml").unlink()
    recording = read_recording(folder)
    assert (recording.scene, recording.lidar, recording.about) == ("site", "pole", {})
    assert recording.period_s == 0.1


def test_points_of_a_label_are_those_in_its_box_or_a_centimetre_outside(tmp_path: Path) -> None:
    folder = without(write_recording(tmp_path), tmp_path / "bare", "objects")
    x, y, z, dx, _, _, heading = BOXES[3]
    ahead = np.array([np.cos(heading), np.sin(heading), 0])
    places = [np.array([x, y, z]) + ahead * (dx / 2 + gap) for gap in (-0.01, 0.009, 0.011)]
    cloud = np.column_stack([places, np.ones(3)]).astype(np.float32)
    kitti.write_points(kitti.frame_file(folder, "velodyne", 5), cloud)
    (folder / "training/fields/000005.bin").write_bytes(bytes(36))
    (frame,) = read_frames(read_recording(folder), [5])
    assert frame.objects.points_in_box.tolist() == [2, 0]


def test_an_id_twice_in_a_frame_is_named(tmp_path: Path) -> None:
    folder = write_recording(tmp_path)
    file = kitti.frame_file(folder, "objects", 5)
    file.write_text(file.read_text().replace("\n8,", "\n3,"))
    with pytest.raises(kitti.FormatError, match=r"000005\.csv: id: found 3 twice, allowed once"):
        list(read_frames(read_recording(folder), [5]))
