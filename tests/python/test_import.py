"""Recordings of other tools and own recordings become data sets."""

import json
import math
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exchange_data import BOXES, LIDARS, fields_of, points, write_recording

from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.dataset.data_set import read_data_set
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.exports import export
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import read_words

LAYOUTS = ("kitti", "openpcdet", "pcd", "nuscenes")
FACTS = LidarFacts("pole", "junction")


def source_of(layout: str, folder: Path, frames: list[int], to: Path) -> Path:
    """Writes frames of a LiDAR's folder as a recording in another layout."""
    if layout == "kitti":
        return Path(shutil.copytree(folder, to))
    export(folder, frames, layout, to)
    return to


def objects(lidar: Path, frame: int) -> kitti.Objects:
    return kitti.read_objects(kitti.frame_file(lidar, "objects", frame))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_frames_that_went_out(layout: str, tmp_path: Path) -> None:
    pole = write_recording(tmp_path / "made_up")
    source = source_of(layout, pole, [5, 6, 7], tmp_path / "source")
    summary, labelled = import_recording(source, layout, tmp_path / "in/pole", FACTS, Options())
    assert (summary.frames, summary.points, labelled) == (3, 30, True)
    numbers = kitti.frames(tmp_path / "in/pole")
    for old, new in zip((5, 6, 7), numbers, strict=True):
        cloud = kitti.read_points(kitti.frame_file(tmp_path / "in/pole", "velodyne", new))
        assert np.allclose(cloud, points(old), atol=1e-5, rtol=0)
    first = objects(tmp_path / "in/pole", numbers[0])
    assert np.allclose(first.boxes, [BOXES[3], BOXES[8]], atol=1e-5)
    assert first.points.tolist() == first.points_in_box.tolist() == [3, 3]
    if layout == "openpcdet":
        assert first.names.tolist() == ["vehicle", "vehicle"]
    else:
        assert first.names.tolist() == ["Car", "Truck"]
    assert len(objects(tmp_path / "in/pole", numbers[1])) == 0


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("lidar", LIDARS)
def test_frames_of_each_lidar(motorway: Path, lidar: str, layout: str, tmp_path: Path) -> None:
    folder = motorway / lidar
    source = source_of(layout, folder, [0, 1, 2], tmp_path / "source")
    import_recording(source, layout, tmp_path / "in" / lidar, FACTS, Options())
    for old, new in zip(range(3), kitti.frames(tmp_path / "in" / lidar), strict=True):
        cloud = kitti.read_points(kitti.frame_file(folder, "velodyne", old))
        imported = kitti.read_points(kitti.frame_file(tmp_path / "in" / lidar, "velodyne", new))
        assert np.allclose(imported, cloud, atol=1e-5, rtol=0)
        want = kitti.read_labels(kitti.frame_file(folder, "label_2", old)).boxes
        boxes = objects(tmp_path / "in" / lidar, new).boxes
        if layout == "nuscenes":  # this layout also has vehicles without a point
            every = objects(folder, old).boxes
            assert np.allclose(np.unique(boxes[:, :6], axis=0), np.unique(every[:, :6], axis=0))
        else:
            assert np.allclose(boxes, want, atol=1e-4)
            apart = np.abs(np.sin((boxes[:, 6] - want[:, 6]) / 2))
            assert apart.max(initial=0) < 1e-5


def test_fields_of_a_pcd_come_along(tmp_path: Path) -> None:
    export(write_recording(tmp_path / "made_up"), [5], "pcd", tmp_path / "source")
    import_recording(tmp_path / "source", "pcd", tmp_path / "in/pole", FACTS, Options())
    fields = kitti.read_fields(kitti.frame_file(tmp_path / "in/pole", "fields", 5))
    assert np.array_equal(fields, fields_of(5))


def test_what_is_known_stands_in_the_data_set(tmp_path: Path) -> None:
    source = source_of("kitti", write_recording(tmp_path / "made_up"), [], tmp_path / "source")
    facts = LidarFacts("pole", "junction", model="Some 32", price_usd=(900, 1200), period_s=0.05)
    import_recording(source, "kitti", tmp_path / "in/pole", facts, Options())
    data = read_data_set(tmp_path / "in")
    assert (data.scene, data.preset, data.names) == ("junction", "recorded", ("pole",))
    (lidar,) = data.lidars
    assert (lidar.model, lidar.price_usd, lidar.period_s) == ("Some 32", (900, 1200), 0.05)
    # The bottoms of the vehicles are at -6, -5.5 and -6.
    assert lidar.T_world_levelled == kitti.WorldPose(0, 0, 6, 0)
    assert (tmp_path / "in/pole/sources.csv").read_text().splitlines()[1] == "5,000005"
    unknown = LidarFacts("pole", "junction", height_m=4.5)
    import_recording(source, "kitti", tmp_path / "two/pole", unknown, Options())
    (lidar,) = read_data_set(tmp_path / "two").lidars
    assert lidar.T_world_levelled.z == 4.5
    assert math.isnan(lidar.price_usd[0])


def test_the_field_of_view_is_that_of_the_returns(tmp_path: Path) -> None:
    """Returns are at azimuths from 170 to 190.5 degrees. The field of view is behind the sensor and
    is not a full turn."""
    azimuth = np.radians(np.linspace(170, 190.5, 200))
    cloud = np.column_stack([10 * np.cos(azimuth), 10 * np.sin(azimuth), np.full(200, -1), azimuth])
    folder = tmp_path / "source/velodyne"
    folder.mkdir(parents=True)
    cloud.astype("<f4").tofile(folder / "000000.bin")
    import_recording(tmp_path / "source", "kitti", tmp_path / "in/pole", FACTS, Options())
    (unit,) = kitti.read_lidar(tmp_path / "in/pole").field_of_view
    low, high = np.degrees(unit.azimuth)
    assert high - low == pytest.approx(21)
    assert low % 360 == pytest.approx(170)
    assert np.degrees(unit.elevation) == pytest.approx([-6, -5])
    assert unit.range_m == (0, 11)


def test_a_leaning_sensor_is_turned_upright(tmp_path: Path) -> None:
    """A pitch of 30 degrees looks down. In the levelled frame, a point ahead of the sensor is
    lower, and a point above it is further ahead."""
    (tmp_path / "source/points").mkdir(parents=True)
    (tmp_path / "source/labels").mkdir()
    cloud = np.array([[10, 0, 0, 0.5], [0, 0, 10, 0.5], [0, 10, 0, 0.5]], dtype=np.float32)
    np.save(tmp_path / "source/points/a.npy", cloud)
    (tmp_path / "source/labels/a.txt").write_text("10 0 0 4 2 1.5 0 car\n")
    facts = LidarFacts("pole", "junction", tilt=(math.radians(30), 0))
    import_recording(tmp_path / "source", "openpcdet", tmp_path / "in/pole", facts, Options())
    imported = kitti.read_points(kitti.frame_file(tmp_path / "in/pole", "velodyne", 0))
    side, down = 10 * math.cos(math.pi / 6), 10 * math.sin(math.pi / 6)
    assert imported[:, :3] == pytest.approx(
        np.array([[side, 0, -down], [down, 0, side], [0, 10, 0]])
    )
    assert objects(tmp_path / "in/pole", 0).boxes[0, :3] == pytest.approx(
        [side, 0, -down], abs=1e-4
    )
    assert kitti.read_tilt(tmp_path / "in/pole").pitch == pytest.approx(math.pi / 6)
    (unit,) = kitti.read_lidar(tmp_path / "in/pole").field_of_view
    assert np.degrees(unit.elevation) == pytest.approx([0, 90])


def test_types_intensities_columns_and_points_without_a_return(tmp_path: Path) -> None:
    folder = tmp_path / "source"
    (folder / "points").mkdir(parents=True)
    (folder / "boxes").mkdir()
    cloud = np.array([[9, 1, 2, 255, 7], [np.nan, 0, 0, 1, 7], [0, 0, 0, 5, 7], [1, 0, 0, 51, 7]])
    cloud.astype("<f4").tofile(folder / "points/frame_10.bin")
    cloud[:1].astype("<f4").tofile(folder / "points/frame_9.bin")
    (folder / "boxes/frame_10.txt").write_text("9 1 2 4 2 2 0 Lkw\n5 0 0 1 1 1 0 Hund\n")
    (folder / "boxes/frame_9.txt").write_text("")
    options = Options(intensity_max=255, columns=5, labels=folder / "boxes")
    facts = LidarFacts("pole", "junction", types={"Lkw": "Truck"})
    summary, _ = import_recording(folder, "openpcdet", tmp_path / "in/pole", facts, options)
    assert summary.without_return == 2
    last = kitti.read_points(kitti.frame_file(tmp_path / "in/pole", "velodyne", 1))
    assert last.tolist() == pytest.approx(np.array([[9, 1, 2, 1], [1, 0, 0, 0.2]]))
    assert objects(tmp_path / "in/pole", 1).names.tolist() == ["Truck", "Hund"]
    assert objects(tmp_path / "in/pole", 1).points.tolist() == [1, 0]


# --- tables of nuScenes by hand


def tables(folder: Path) -> Path:
    """Writes tables of a LiDAR at (100, 200, 6) with a yaw of 90 degrees and a pitch of 90 degrees
    down. It looks at its own foot."""
    half = math.sqrt(0.5)
    rows: dict[str, list[dict[str, Any]]] = {
        "sensor": [{"token": "s", "channel": "LIDAR_TOP", "modality": "lidar"}],
        "calibrated_sensor": [
            {"token": "m", "sensor_token": "s", "translation": [0, 0, 6]}
            | {"rotation": [half, 0, half, 0]}
        ],
        "ego_pose": [{"token": "e", "translation": [100, 200, 0], "rotation": [half, 0, 0, half]}],
        "sample": [{"token": "f", "timestamp": 2_000_000}],
        "sample_data": [
            {"token": f"d{i}", "sample_token": "f", "calibrated_sensor_token": "m"}
            | {"ego_pose_token": "e", "is_key_frame": i == 0, "timestamp": 2_000_000}
            | {"filename": f"samples/LIDAR_TOP/{i}.pcd.bin"}
            for i in range(2)
        ],
        "category": [{"token": "c", "name": "vehicle.bus.rigid"}],
        "instance": [{"token": "x", "category_token": "c"}, {"token": "i", "category_token": "c"}],
        "sample_annotation": [
            {"token": "a", "sample_token": "f", "instance_token": "i", "visibility_token": "2"}
            | {"translation": [100, 220, 1.5], "size": [2.5, 12, 3], "rotation": [half, 0, 0, half]}
        ],
    }
    (folder / "v1.0").mkdir(parents=True)
    for name, content in rows.items():
        (folder / f"v1.0/{name}.json").write_text(json.dumps(content))
    (folder / "samples/LIDAR_TOP").mkdir(parents=True)
    np.array([[6, 0, 1, 51, 3]], "<f4").tofile(folder / "samples/LIDAR_TOP/0.pcd.bin")
    return folder


def test_tables_by_hand(tmp_path: Path) -> None:
    import_recording(tables(tmp_path / "a"), "nuscenes", tmp_path / "in/pole", FACTS, Options())
    # The foot is 6 m along the sensor's x. The sensor's z, 1 m, points ahead.
    (point,) = kitti.read_points(kitti.frame_file(tmp_path / "in/pole", "velodyne", 0))
    assert point == pytest.approx([1, 0, -6, 0.2], abs=1e-5)
    # The bus is 20 m along the world's y, which is ahead, and has this direction.
    bus = objects(tmp_path / "in/pole", 0)
    assert bus.boxes[0] == pytest.approx([20, 0, -4.5, 12, 2.5, 3, 0], abs=1e-5)
    assert (bus.names[0], bus.ids[0], bus.visibility[0]) == ("Bus", 1, 0.5)
    pose = kitti.read_lidar(tmp_path / "in/pole").T_world_levelled
    assert (pose.x, pose.y, pose.z, pose.yaw) == pytest.approx((100, 200, 6, math.pi / 2))
    assert kitti.read_tilt(tmp_path / "in/pole").pitch == pytest.approx(math.pi / 2)


def test_gaps_between_key_frames_stay_gaps(tmp_path: Path) -> None:
    """As between the scenes of nuScenes, and where only some frames were exported."""
    folder = tables(tmp_path / "a")
    row = json.loads((folder / "v1.0/sample_data.json").read_text())[0]
    rows = [
        row | {"token": f"d{i}", "timestamp": round(2e6 + 1e6 * t)}
        for i, t in enumerate((0, 0.5, 1, 3, 3.5))
    ]
    (folder / "v1.0/sample_data.json").write_text(json.dumps(rows))
    out = tmp_path / "in/pole"
    summary, _ = import_recording(folder, "nuscenes", out, FACTS, Options())
    assert kitti.frames(out) == [0, 1, 2, 6, 7]
    assert kitti.read_lidar(out).period_s == 0.5
    assert any("frames are missing at 1 places" in note for note in summary.assumed)
    assert not any("moves" in note for note in summary.assumed)


def test_a_lidar_that_moves_is_reported(tmp_path: Path) -> None:
    folder = tables(tmp_path / "a")
    later = {
        "ego_pose": {"token": "later", "translation": [112, 205, 0]},
        "sample_data": {"token": "d", "ego_pose_token": "later", "timestamp": 2_500_000},
    }
    for table, keys in later.items():
        file = folder / f"v1.0/{table}.json"
        rows = json.loads(file.read_text())
        file.write_text(json.dumps([*rows, rows[0] | keys]))
    summary, _ = import_recording(folder, "nuscenes", tmp_path / "in/pole", FACTS, Options())
    assert any("the LiDAR moves by up to 13.0 m" in note for note in summary.assumed)


WRONG_TABLES: dict[str, tuple[str, Callable[[Any], Any], str]] = {
    "no JSON": ("sample", lambda rows: None, "cannot be read as JSON"),
    "no list": ("sample", lambda rows: {"token": 1}, "expected a list of rows"),
    "no pose": ("ego_pose", lambda rows: [], "expected a row with token 'e', got none"),
    "no number": (
        "ego_pose",
        lambda rows: [rows[0] | {"translation": "far"}],
        r"translation: expected finite numbers of shape \(3,\), got far",
    ),
    "turn of 0": (
        "ego_pose",
        lambda rows: [rows[0] | {"rotation": [0] * 4}],
        r"rotation: expected a quaternion of length 1, got \[0",
    ),
    "token twice": (
        "sample_annotation",
        lambda rows: [*rows, rows[0]],
        r"expected each token once, got \w+ twice",
    ),
    "vehicle twice": (
        "sample_annotation",
        lambda rows: [*rows, rows[0] | {"token": "new"}],
        "row 'new': expected each instance_token once in a sample, got '",
    ),
    "endless digits": ("ego_pose", lambda rows: f"[{'9' * 5000}]", "cannot be read as JSON"),
    "no width": (
        "sample_annotation",
        lambda rows: [rows[0] | {"size": [0, 1, 1]}],
        r"expected sizes above .*, got length, width, height \[1\. 0\. 1\.\] and",
    ),
    "NUL": ("sample_data", lambda rows: [rows[0] | {"filename": "a\0b"}], "expected a file inside"),
    "no category": ("category", lambda rows: [{"token": "c"}], "expected the key 'name', got none"),
    "no LiDAR": ("sensor", lambda rows: [], "expected one LiDAR, got none"),
    "no frame": (
        "sample_data",
        lambda rows: rows[1:],
        "expected a key frame of the LiDAR, got none",
    ),
    "outside": (
        "sample_data",
        lambda rows: [rows[0] | {"filename": "../../secret"}],
        "expected a file inside",
    ),
    "no time": (
        "sample_data",
        lambda rows: [rows[0] | {"timestamp": None}],
        r"timestamp: expected a finite number, got None",
    ),
}


@pytest.mark.parametrize("case", WRONG_TABLES)
def test_wrong_tables_are_named(case: str, tmp_path: Path) -> None:
    table, change, message = WRONG_TABLES[case]
    file = tables(tmp_path / "a") / f"v1.0/{table}.json"
    changed = change(json.loads(file.read_text()))
    text = "[{" if changed is None else json.dumps(changed)
    file.write_text(changed if isinstance(changed, str) else text)
    with pytest.raises(ValueError, match=message):
        import_recording(tmp_path / "a", "nuscenes", tmp_path / "in/pole", FACTS, Options())
    assert not any(path.name.startswith(".pole") for path in tmp_path.rglob("*"))


# --- the command


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Exports the artificial recording in OpenPCDet's layout."""
    export(write_recording(tmp_path / "made_up"), [5, 6, 7], "openpcdet", tmp_path / "source")
    return tmp_path / "source"


def fails(words: list[object], capsys: pytest.CaptureFixture[str], code: int, *parts: str) -> None:
    assert main.main([str(word) for word in words]) == code
    stderr = capsys.readouterr().err
    assert len(stderr.splitlines()) == 1, stderr
    for part in parts:
        assert part in stderr


def truncated(folder: Path) -> None:
    file = folder / "points/000005.npy"
    file.write_bytes(file.read_bytes()[:-20])


def header(before: bytes, after: bytes) -> Callable[[Path], object]:
    """Returns a function that replaces words of the header by words of the same length."""

    def change(folder: Path) -> None:
        file = folder / "points/000005.npy"
        assert before in file.read_bytes()
        file.write_bytes(file.read_bytes().replace(before, after))

    return change


def with_pickle(folder: Path) -> None:
    bad = np.array([{"a": 1}], dtype=object)
    np.save(folder / "points/000005.npy", bad, allow_pickle=True)


def narrow(folder: Path) -> None:
    np.save(folder / "points/000005.npy", np.zeros((9, 3), dtype=np.float32))


def odd_bin(folder: Path) -> None:
    (folder / "points/000005.npy").unlink()
    np.zeros(7, dtype="<f4").tofile(folder / "points/000005.bin")


def far(folder: Path) -> None:
    points = np.zeros((9, 4), dtype=np.float32)
    points[2, 1] = 3e38
    np.save(folder / "points/000005.npy", points)


def archive(folder: Path) -> None:
    with zipfile.ZipFile(folder / "points/000005.npy", "w") as file:
        file.writestr("a.npy", b"")


def test_fields_that_are_not_those_of_the_points_are_named(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "made_up")
    kitti.frame_file(folder, "fields", 6).write_bytes(b"")
    with pytest.raises(FormatError, match=r"fields/000006\.bin: expected 10 records, .*, got 0"):
        import_recording(folder, "kitti", tmp_path / "in/pole", FACTS, Options())


def test_hidden_files_are_no_frames(tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "made_up")
    (folder / "training/velodyne/._000005.bin").write_bytes(b"of another system")
    import_recording(folder, "kitti", tmp_path / "in/pole", FACTS, Options())
    assert kitti.frames(tmp_path / "in/pole") == [5, 6, 7]


WRONG_FILES: dict[str, tuple[Callable[[Path], object], int, list[str]]] = {
    "truncated": (truncated, 2, ["points/000005.npy", "cannot be read as an array"]),
    "pickle": (with_pickle, 2, ["points/000005.npy", "cannot be read as an array"]),
    "more rows than bytes": (
        header(b"(10, 4), }      ", b"(99999999, 4), }"),
        2,
        ["points/000005.npy", "cannot be read as an array"],
    ),
    "keys of two kinds": (
        header(b"'shape'", b"1234567"),
        2,
        ["points/000005.npy", "cannot be read as an array"],
    ),
    "open bracket": (
        header(b"'shape'", b"((((((("),
        2,
        ["points/000005.npy", "cannot be read as an array"],
    ),
    "columns": (narrow, 2, ["intensity, got (9, 3) float32"]),
    "far": (far, 2, ["000005.npy: point 2: y: expected -10000 to 10000, got 3e+38"]),
    "bytes": (odd_bin, 2, ["000005.bin", "expected a multiple of 16 bytes", "got 28 bytes"]),
    "archive": (archive, 2, ["points/000005.npy", "cannot be read as an array"]),
    "label": (
        lambda f: (f / "labels/000005.txt").write_text("1 2 3 Car\n"),
        2,
        ["labels/000005.txt:1: expected 8 columns ", ", got 4"],
    ),
    "degrees": (
        lambda f: (f / "labels/000005.txt").write_text(
            "9 1 2 4 2 2 6.28 Car\n\n9 1 2 4 2 2 -90 Car\n"
        ),
        2,
        ["labels/000005.txt:3: heading: expected -2 pi to 2 pi, in radians, got -90"],
    ),
    "label alone": (
        lambda f: (f / "labels/000009.txt").write_text(""),
        2,
        ["labels/000009.txt: expected a cloud for each label file, got none"],
    ),
    "cloud alone": (
        lambda f: (f / "labels/000006.txt").unlink(),
        2,
        ["points/000006.npy: expected a label file for each cloud", "got none"],
    ),
    "no clouds": (lambda f: shutil.rmtree(f / "points"), 1, ["points: No such file or directory"]),
    "height": (
        lambda f: (f / "sensor.yaml").write_text("T_road_lidar: {z_m: high}\n"),
        2,
        ["sensor.yaml:1: T_road_lidar.z_m: expected a number, got 'high'"],
    ),
}


@pytest.mark.parametrize("case", WRONG_FILES)
def test_wrong_files_are_named_and_nothing_is_left(
    case: str, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, code, parts = WRONG_FILES[case]
    change(source)
    words = ["import", source, "--from", "openpcdet", "--out", tmp_path / "in/pole"]
    fails(words, capsys, code, *parts)
    assert not any((tmp_path / "in").iterdir()) if (tmp_path / "in").exists() else True


def test_degrees_in_labels_of_kitti_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_recording(tmp_path / "made_up")
    file = kitti.frame_file(source, "label_2", 7)
    words = file.read_text().split()
    ignored = "DontCare -1 -1 -10 1 1 9 9 -1 -1 -1 -1000 -1000 -1000 -10"
    file.write_text(f"{ignored}\n{' '.join([*words[:14], '85'])}\n")
    command = ["import", source, "--from", "kitti", "--out", tmp_path / "in/pole"]
    fails(command, capsys, 2, f"{file}:2: rotation_y: expected -2 pi to 2 pi, in radians, got 85")
    assert not (tmp_path / "in/pole").exists()


LINE = "Van 0 1 -10 0 0 0 0 1.5 1.8 4.2 -3 1.73 25 -1.5707963"
IGNORED = "DontCare -1 -1 -10 1 1 9 9 -1 -1 -1 -1000 -1000 -1000 -10"


@pytest.mark.parametrize("name", ["{:06d}", "{}", "{:04d}"])
def test_numbers_of_frames_are_kept_and_blank_lines_are_no_objects(
    name: str, tmp_path: Path
) -> None:
    """The labels come from a tool on Windows. The files are numbered from 1, and one frame has no
    return."""
    training = tmp_path / "source/training"
    texts = ["", f"{IGNORED}\r\n{LINE}\r\n\r\n", "\r\n", f"{LINE}\r\n"]
    for folder in ("velodyne", "label_2", "calib"):
        (training / folder).mkdir(parents=True)
    for number, text in enumerate(texts, start=9):
        stem = name.format(number)
        cloud = np.zeros((0 if number == 9 else 3, 4), dtype="<f4") + number
        cloud.tofile(training / f"velodyne/{stem}.bin")
        (training / f"label_2/{stem}.txt").write_bytes(text.encode())
    summary, _ = import_recording(
        tmp_path / "source", "kitti", tmp_path / "in/pole", FACTS, Options()
    )
    assert kitti.frames(tmp_path / "in/pole") == [9, 10, 11, 12]
    assert [len(objects(tmp_path / "in/pole", k)) for k in (9, 10, 11, 12)] == [0, 1, 0, 1]
    assert summary.empty == [name.format(9)]
    assert any("4 of 4 frames have no calib file" in note for note in summary.assumed)
    # Without calib, the camera is at the sensor and looks along x.
    van = objects(tmp_path / "in/pole", 10).boxes[0]
    assert van == pytest.approx([25, 3, -0.98, 4.2, 1.8, 1.5, 0], abs=1e-4)


def test_a_sequence_of_the_tracking_benchmark_keeps_its_tracks(tmp_path: Path) -> None:
    """Frame 3 has a label file and no cloud, as in the sequence 0001 of the benchmark."""
    training = tmp_path / "source/training"
    for sequence, count in (("0000", 1), ("0001", 3)):
        (training / "velodyne" / sequence).mkdir(parents=True)
        for k in range(count):
            cloud = np.full((2, 4), k + 1, dtype="<f4")
            cloud.tofile(training / f"velodyne/{sequence}/{k:06d}.bin")
    (training / "label_02").mkdir()
    lines = [f"0 -1 {IGNORED}", f"0 7 {LINE}", f"2 7 {LINE}", f"2 8 {LINE}", f"3 8 {LINE}", ""]
    (training / "label_02/0001.txt").write_text("\n".join(lines))
    (training / "calib").mkdir()
    (training / "calib/0001.txt").write_text(
        "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nR_rect 1 0 0 0 1 0 0 0 1\n"
        "Tr_velo_cam 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\nTr_imu_velo 1 0 0 0 0 1 0 0 0 0 1 0\n"
    )
    source, out = tmp_path / "source", tmp_path / "in/pole"
    with pytest.raises(ValueError, match=r"expected one sequence, got the sequences 0000, 0001"):
        import_recording(source, "kitti", out, FACTS, Options())
    with pytest.raises(ValueError, match="expected one sequence '0009', got the sequences 0000, "):
        import_recording(source, "kitti", out, FACTS, Options(channel="0009"))
    summary, labelled = import_recording(source, "kitti", out, FACTS, Options(channel="0001"))
    assert labelled
    assert "1 labelled frames, such as 3, have no cloud and are left out" in summary.assumed
    assert [objects(out, k).ids.tolist() for k in (0, 1, 2)] == [[7], [], [7, 8]]
    van = objects(out, 0).boxes[0]
    assert van == pytest.approx([25.27, 3, -1.06, 4.2, 1.8, 1.5, 0], abs=1e-4)


def test_a_file_is_refused_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "infos.pkl").write_bytes(b"cos\nsystem\n(S'false'\ntR.")
    words = ["import", tmp_path / "infos.pkl", "--from", "kitti", "--out", tmp_path / "in/pole"]
    fails(words, capsys, 2, "expected a folder, or a file", "pickles are not read")
    assert not (tmp_path / "in/pole").exists()


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--price-usd", "5", "4"], "--price-usd: expected 0 <= low <= high"),
        (["--period-s", "0"], "--period-s: expected 0.001 to 60"),
        (["--tilt-deg", "100", "0"], "--tilt-deg: expected -90 to 90"),
        (["--point-values", "2"], "--point-values: expected 3 to 64, got 2"),
        (["--intensity-max", "-1"], "--intensity-max: expected above 0, got -1"),
        (["--type", "Lkw"], "--type: expected NAME=TYPE, got 'Lkw'"),
    ],
)
def test_wrong_options(
    words: list[str], part: str, source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["import", source, "--from", "openpcdet", "--out", tmp_path / "in/pole"]
    fails([*command, *words], capsys, 2, part)
    assert not (tmp_path / "in/pole").exists()


def test_a_pickle_format_is_not_among_the_imports(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main.main(["import", str(source), "--from", "mmdet3d", "--out", "x"])
    assert end.value.code == 2
    assert "got 'mmdet3d'" in capsys.readouterr().err


def test_a_folder_that_is_there_stays(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["import", source, "--from", "openpcdet", "--out", tmp_path / "in/pole"]
    assert main.main([str(word) for word in words]) == 0
    capsys.readouterr()
    fails(words, capsys, 1, "in/pole: expected a new or empty folder, got a folder with files")
    words[-1] = tmp_path / "in/second"
    fails(words, capsys, 2, "expected a new folder", "without these track ids")
    assert sorted(path.name for path in (tmp_path / "in").iterdir()) == ["dataset.yaml", "pole"]


def test_lidars_of_the_same_tables_stand_in_one_data_set(tmp_path: Path) -> None:
    recording = tables(tmp_path / "a")
    for name in ("one", "two"):
        facts = LidarFacts(name, "junction")
        import_recording(recording, "nuscenes", tmp_path / "in" / name, facts, Options())
    assert read_data_set(tmp_path / "in").names == ("one", "two")


def test_lidars_of_other_tables_need_another_data_set(tmp_path: Path) -> None:
    other = tables(tmp_path / "b")
    for table in ("instance", "sample_annotation"):
        file = other / f"v1.0/{table}.json"
        file.write_text(file.read_text().replace('"i"', '"j"'))
    import_recording(tables(tmp_path / "a"), "nuscenes", tmp_path / "in/pole", FACTS, Options())
    with pytest.raises(ValueError, match="without these track ids"):
        import_recording(other, "nuscenes", tmp_path / "in/other", FACTS, Options())
    assert read_data_set(tmp_path / "in").names == ("pole",)


def test_two_files_of_one_frame_are_refused(source: Path, tmp_path: Path) -> None:
    shutil.copy(source / "points/000006.npy", source / "points/000006.bin")
    with pytest.raises(ValueError, match=r"one file for each frame, got 000006.* and 000006"):
        import_recording(source, "openpcdet", tmp_path / "in/pole", FACTS, Options())


def test_listed_frames_that_cannot_be_split_are_reported(source: Path, tmp_path: Path) -> None:
    for part, frames in (("train", "000005 000007 000009"), ("val", "000007 6")):
        (source / f"ImageSets/{part}.txt").write_text("\n".join(frames.split()))
    summary, _ = import_recording(source, "openpcdet", tmp_path / "in/pole", FACTS, Options())
    text = "\n".join(summary.assumed)
    assert "ImageSets: 2 listed frames, such as 000009, have no cloud of this name" in text
    assert "ImageSets: 1 frames, such as 000007, are in both lists" in text


def test_vehicles_that_are_wider_than_long_are_reported(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["import", source, "--from", "openpcdet", "--out", tmp_path / "in/pole"]
    assert main.main([str(word) for word in words]) == 0
    assert "wider than long" not in capsys.readouterr().err
    for file in (source / "labels").iterdir():
        rows = [line.split() for line in file.read_text().splitlines()]
        swapped = [" ".join([*row[:3], row[4], row[3], *row[5:]]) + "\n" for row in rows]
        file.write_text("".join(swapped))
    words[-1] = tmp_path / "again/pole"
    assert main.main([str(word) for word in words]) == 0
    assert "3 of 3 labelled vehicles are wider than long" in capsys.readouterr().err


def test_names_of_frames_may_have_commas(source: Path, tmp_path: Path) -> None:
    (tmp_path / "clouds").mkdir()
    names = ["a, 1", 'b "2"']
    for i, name in enumerate(names):
        points(5 + i).tofile(tmp_path / f"clouds/{name}.bin")
    import_recording(
        tmp_path / "clouds", "bin", tmp_path / "in/pole", FACTS, Options(), upright="as-is"
    )
    assert read_words(tmp_path / "in/pole/sources.csv").source.tolist() == names


def test_labels_need_clouds_with_z_up(tmp_path: Path) -> None:
    for part in ("points", "labels"):
        (tmp_path / "source" / part).mkdir(parents=True)
    rng = np.random.default_rng(0)
    for i in range(3):
        road = np.column_stack([rng.uniform(-40, 40, (4000, 2)), np.full((4000, 2), (-5, 0.5))])
        np.save(tmp_path / f"source/points/{i}.npy", road[:, [1, 2, 0, 3]].astype("<f4"))
        (tmp_path / f"source/labels/{i}.txt").write_text("1 -4.2 9 4 2 1.6 0.5 Car\n")
    with pytest.raises(ValueError, match=r"expected z up in clouds with labels, got y up"):
        import_recording(
            tmp_path / "source", "openpcdet", tmp_path / "in/p", FACTS, Options(), upright="road"
        )


def test_without_labels_there_is_a_warning(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(source / "labels")
    words = ["import", source, "--from", "openpcdet", "--out", tmp_path / "in/pole"]
    words += ["--upright", "as-is"]  # artificial points have no road
    assert main.main([str(word) for word in words]) == 0
    assert "source: the frames have no labels: " in capsys.readouterr().err
    assert len(objects(tmp_path / "in/pole", 5)) == 0
