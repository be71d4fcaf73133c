"""Labels of a recording become trajectories: by the ids of its tracks, else by their positions."""

from pathlib import Path

import numpy as np
import pytest
from recording_files import road

import pyinfra as pi
from pyinfra.core.errors import FormatError
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import read_words
from pyinfra.scenes.maps.recorded_boxes import BoxColumns, read_boxes, read_frames

SPEED_M_S = 8.0
CAR = (5.0, -5.25, 4.2, 1.8, 1.5, 0.0)  # y z dx dy dz heading


def imported(tmp_path: Path, ids: list[str], period_s: float, hidden: range, step: int = 1) -> Path:
    """Imports 8 s of two cars, one behind the other. ids: in turn, those of the frames."""
    source = tmp_path / "source"
    source.mkdir()
    rows = ["frame,id,class,x,y,z,length,width,height,yaw"]
    count = round(8 / period_s)
    for k in range(count):
        (road(k) + np.float32(k * 1e-4)).tofile(source / f"{step * k:06d}.bin")
        for car, behind_m in enumerate((0.0, 15.0)):
            if k not in hidden:
                number, kind = ids[k % len(ids)], "Van" if k % 5 == 2 else "Car"
                x = -30 + SPEED_M_S * period_s * k - behind_m
                number = f"{number}{car}" if number != "-1" else number
                rows.append(",".join(map(str, (step * k, number, kind, x, *CAR))))
    (tmp_path / "boxes.csv").write_text("\n".join(rows) + "\n")
    out = tmp_path / "data/pole"
    options = Options(labels=tmp_path / "boxes.csv")
    facts = LidarFacts("pole", "street", period_s=period_s / step)
    import_recording(source, "bin", out, facts, options)
    return out


def test_the_ids_of_tracks_are_those_of_the_labels(tmp_path: Path) -> None:
    """A car that is hidden for longer than boxes are linked, and whose class varies, stays one."""
    folder = imported(tmp_path, ["7"], 0.1, range(30, 37))
    tracks = read_frames(folder)
    assert [len(track.times) for track in tracks] == [73, 73]
    assert {track.object_class for track in tracks} == {"Car"}
    site = tmp_path / "site"
    site.mkdir()
    pi.import_trajectories(folder, site)
    table = read_words(site / "trajectories.csv")
    assert sorted(table["id"].value_counts()) == [80, 80]


@pytest.mark.parametrize(("ids", "count"), [(["-1"], 4), (["7", "-1"], 4)])
def test_objects_without_an_id_are_linked(tmp_path: Path, ids: list[str], count: int) -> None:
    folder = imported(tmp_path, ids, 0.1, range(0))
    objects = [kitti.read_objects(kitti.frame_file(folder, "objects", k)) for k in range(2)]
    assert (objects[1].ids == -1).all()
    tracks = read_frames(folder)
    assert sum(len(track.times) for track in tracks) == 160
    for track in tracks:
        x = track.boxes[:, 0] - SPEED_M_S * track.times
        assert np.ptp(x) < 1e-3  # each track has the boxes of one car
    by_kind = {"Car", "Van"} if ids == ["-1"] else {"Car"}
    assert {track.object_class for track in tracks} >= by_kind


@pytest.mark.parametrize("step", [1, 5])
def test_boxes_of_2_hz_are_linked(tmp_path: Path, step: int) -> None:
    """Key frames may have the numbers of the sensor's frames, so that the period is shorter."""
    folder = imported(tmp_path, ["-1"], 0.5, range(0), step)
    (folder.parent / "dataset.yaml").unlink()
    assert kitti.read_lidar(folder).period_s == pytest.approx(0.5 / step)
    tracks = [track for track in read_frames(folder) if track.object_class == "Car"]
    assert [len(track.times) for track in tracks] == [13, 13]
    rows = ["t,class,x,y,z,dx,dy,dz,heading"]
    for k in range(16):
        cells = (0.5 * k, "Car", -30 + 4.0 * k, *CAR)
        rows.append(",".join(map(str, cells)))
    (tmp_path / "in.csv").write_text("\n".join(rows) + "\n")
    (track,) = read_boxes(tmp_path / "in.csv", BoxColumns())
    assert len(track.times) == 16


def test_a_folder_without_labels_is_refused(tmp_path: Path) -> None:
    folder = imported(tmp_path, ["7"], 0.5, range(100))
    with pytest.raises(FormatError, match="expected one or more labels, got none"):
        read_frames(folder)
    for file in (folder / "training/velodyne").iterdir():
        file.unlink()
    with pytest.raises(FormatError, match="expected one or more labels, got none"):
        read_frames(folder)


def test_the_tracks_of_a_simulated_folder_are_its_objects(tmp_path: Path) -> None:
    """Also where other vehicles hide a vehicle, and in frames without a point on it."""
    data = pi.simulate("crossroad", "helios_16", frames=range(0, 12, 4)).save(tmp_path / "data")
    folder = data if (data / "training").is_dir() else data / "helios_16"
    files = [kitti.frame_file(folder, "objects", k) for k in (0, 4, 8)]
    ids = np.concatenate([kitti.read_objects(file).ids for file in files])
    tracks = read_frames(folder)
    assert len(tracks) == len(np.unique(ids)) > 20
    assert sum(len(track.times) for track in tracks) == len(ids)
