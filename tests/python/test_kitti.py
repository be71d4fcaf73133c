"""Frames on disk: written values are read back, and errors in files name the line."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from message_pattern import pattern

from pyinfra.core.errors import FormatError
from pyinfra.dataset.frame_readers import Cameras, read_cameras, read_predictions
from pyinfra.formats import kitti

WITHOUT_SCAN = "id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility"
HEADER = f"{WITHOUT_SCAN},scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box"
VEHICLE = "7,Car,10.5,-2,-5.2,4.5,1.8,1.6,0.25,16.5,12,9,10.7,0.75,10.9,-1.9,-5.1,0.24,0.06,11"
LABEL = "Car 0.00 0 0.1 0 0 50 50 1.6 1.8 4.5 2 6 10 -1.570796"
LIDAR = """\
name: "two"
model: "Two Units"
preset: "paper"
price_total_usd: {low: 100, high: 200.5}
period_s: 0.1
T_world_levelled: {x_m: 1, y_m: -2, z_m: 6, yaw_deg: 90}
T_levelled_sensor: {pitch_deg: 5, roll_deg: 0}
field_of_view:
  - {yaw_deg: 45, pitch_deg: 0, azimuth_deg: [-35, 35], elevation_deg: [-9, 9], range_m: [1, 300]}
  - {yaw_deg: -45, pitch_deg: 10, azimuth_deg: [-35, 35], elevation_deg: [-9, 9], range_m: [1, 2]}
label_time: frame
"""


@pytest.fixture(scope="module")
def data_set(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Simulates two frames of two LiDARs, with fields."""
    out = tmp_path_factory.mktemp("kitti") / "highway"
    command = run_command("helios_16", "livox_avia", frames="3:6:2", out=out)
    infrasim(*command, "--fields", check=True)
    return out


def written(folder: Path, text: str | bytes, name: str = "file") -> Path:
    file = folder / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def lidar_folder(folder: Path, text: str) -> Path:
    written(folder, text, "lidar.yaml")
    return folder


@pytest.mark.parametrize("lidar", ["helios_16", "livox_avia"])
def test_all_parts_of_a_simulated_frame_agree(data_set: Path, lidar: str) -> None:
    folder = data_set / lidar
    assert kitti.frames(folder) == [3, 5]
    for frame in kitti.frames(folder):
        points = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
        fields = kitti.read_fields(kitti.frame_file(folder, "fields", frame))
        objects = kitti.read_objects(kitti.frame_file(folder, "objects", frame))
        labels = kitti.read_labels(kitti.frame_file(folder, "label_2", frame))
        assert points.shape == (len(fields), 4)
        assert points.dtype == np.float32
        assert fields["time_s"].min() >= 0
        assert fields["time_s"].max() < 0.1001

        counted = [int((fields["object_id"] == i).sum()) for i in objects.ids]
        assert objects.points.tolist() == counted
        assert sum(counted) > 0

        hit = objects.points > 0
        assert labels.names.tolist() == objects.names[hit].tolist()
        np.testing.assert_allclose(labels.boxes[:, :6], objects.boxes[hit, :6], atol=2e-4)
        turn = labels.boxes[:, 6] - objects.boxes[hit, 6]
        np.testing.assert_allclose(np.cos(turn), 1, atol=1e-9)


def test_points_counted_in_a_box_lie_in_it(data_set: Path) -> None:
    folder = data_set / "livox_avia"
    points = kitti.read_points(kitti.frame_file(folder, "velodyne", 3))
    fields = kitti.read_fields(kitti.frame_file(folder, "fields", 3))
    objects = kitti.read_objects(kitti.frame_file(folder, "objects", 3))
    at_mid_frame = zip(objects.boxes, objects.ids, objects.points_in_box, strict=True)
    at_scan = zip(objects.scan_boxes, objects.ids, objects.points_in_scan_box, strict=True)
    for box, object_id, expected in (*at_mid_frame, *at_scan):
        from_centre = points[fields["object_id"] == object_id, :3] - box[:3]
        cos, sin = np.cos(box[6]), np.sin(box[6])
        along = from_centre @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        inside = (np.abs(along) <= box[3:6] / 2 + 0.01).all(axis=1)
        # a point may lie on a face of the box, within 4 decimals
        assert abs(int(inside.sum()) - expected) <= 1


def test_lidar_of_a_run_is_what_its_files_say(data_set: Path) -> None:
    avia = kitti.read_lidar(data_set / "livox_avia")
    assert (avia.name, avia.preset, avia.price_usd) == ("livox_avia", "paper", (2079, 2079))
    assert avia.T_world_levelled == kitti.WorldPose(x=0, y=0, z=6, yaw=0)
    (view,) = avia.field_of_view
    assert view.range_m == (0, 260)
    assert math.degrees(view.azimuth[1]) == pytest.approx(35.3, abs=0.1)
    (spinning,) = kitti.read_lidar(data_set / "helios_16").field_of_view
    assert math.degrees(spinning.azimuth[1] - spinning.azimuth[0]) > 359


def test_lidar_file_gives_radians_and_every_unit(tmp_path: Path) -> None:
    lidar = kitti.read_lidar(lidar_folder(tmp_path, LIDAR))
    assert lidar.T_world_levelled == kitti.WorldPose(1, -2, 6, math.pi / 2)
    assert lidar.price_usd == (100, 200.5)
    assert [unit.yaw for unit in lidar.field_of_view] == [math.pi / 4, -math.pi / 4]
    assert lidar.field_of_view[0].range_m == (1, 300)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "z_m: 6",
            "z_m: high",
            "lidar.yaml:6: T_world_levelled.z_m: expected a number, got 'high'",
        ),
        ("z_m: 6, ", "", "lidar.yaml:6: T_world_levelled: expected a key 'z_m', got none"),
        (
            "[1, 2]",
            "[2, 1]",
            "lidar.yaml:10: field_of_view[1].range_m: expected ..., got [2.0, 1.0]",
        ),
        ("[1, 2]", "2", "lidar.yaml:10: field_of_view[1].range_m: expected a list"),
        ('name: "two"', "name: [two]", "lidar.yaml:1: name: expected ..., got a list"),
        ("period_s: 0.1\n", "", "lidar.yaml:1: expected a key 'period_s', got none"),
        ("label_time: frame\n", "", "lidar.yaml:1: expected a key 'label_time', got none"),
        ("{low: 100", "{low: 100}}", "lidar.yaml:4: cannot be read as YAML"),
        (LIDAR, "", "lidar.yaml:1: expected a mapping"),
        ("period_s: 0.1", "period_s: 0", "lidar.yaml:5: period_s: expected 0.001 to 60, got 0"),
        (
            "period_s: 0.1",
            "period_s: .nan",
            "lidar.yaml:5: period_s: expected 0.001 to 60, got .nan",
        ),
        (
            "period_s: 0.1",
            "period_s: 1000",
            "lidar.yaml:5: period_s: expected 0.001 to 60, got 1000",
        ),
        (
            "period_s: 0.1",
            "period_s: 0.1\nperiod_s: 1",
            "lidar.yaml:6: period_s: expected the key once",
        ),
        ("low: 100", "low: -1", "lidar.yaml:4: price_total_usd.low: expected 0 ..., got -1"),
        ("low: 100", "low: 300", "lidar.yaml:4: price_total_usd: expected ..., got low 300"),
        (
            "yaw_deg: 90",
            "yaw_deg: 1e30",
            "lidar.yaml:6: T_world_levelled.yaw_deg: expected ..., got 1e30",
        ),
        ("[1, 2]", "[1, 1e9]", "lidar.yaml:10: field_of_view[1].range_m[1]: expected ..., got 1e9"),
        ('"two"', '"t\0"', "lidar.yaml: cannot be read as YAML: "),
        (
            LIDAR,
            "[" * 10**5 + "]" * 10**5,
            "lidar.yaml:1: cannot be read as YAML: expected at most 100 nested levels",
        ),
    ],
)
def test_wrong_lidar_file_is_named_by_line_and_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in LIDAR
    with pytest.raises(FormatError, match=pattern(message)):
        kitti.read_lidar(lidar_folder(tmp_path, LIDAR.replace(old, new)))


def test_a_frame_exists_if_its_bin_does(tmp_path: Path) -> None:
    velodyne = tmp_path / "training/velodyne"
    velodyne.mkdir(parents=True)
    for name in ("000010.bin", "000002.bin", ".000003.bin.tmp", "000004.txt", "notes.bin"):
        (velodyne / name).touch()
    assert kitti.frames(tmp_path) == [2, 10]


def test_folder_without_frames_is_an_error_and_not_empty(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        kitti.frames(tmp_path)


def test_points_are_little_endian_float32(tmp_path: Path) -> None:
    rows = np.array([[1, 2, 3, 0.5], [-4, 5, -6, 1]], dtype="<f4")
    read = kitti.read_points(written(tmp_path, rows.tobytes()))
    assert read.tolist() == rows.tolist()
    assert kitti.read_points(written(tmp_path, b"")).shape == (0, 4)


def test_cut_file_is_an_error_with_its_size(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"expected .* multiple of 16 .*, got 31 bytes"):
        kitti.read_points(written(tmp_path, bytes(31)))
    with pytest.raises(FormatError, match=r"expected .* multiple of 12.*, got 13 bytes"):
        kitti.read_fields(written(tmp_path, bytes(13)))


def test_point_that_is_not_finite_is_an_error(tmp_path: Path) -> None:
    rows = np.zeros((3, 4), dtype="<f4")
    rows[1, 2] = np.nan
    with pytest.raises(FormatError, match=r"point 1: expected finite .*got "):
        kitti.read_points(written(tmp_path, rows.tobytes()))


def test_fields_are_packed_records(tmp_path: Path) -> None:
    record = np.array([(0.05, 127, 3, 1, -1)], dtype=kitti.FIELDS)
    assert record.nbytes == 12
    read = kitti.read_fields(written(tmp_path, record.tobytes()))
    assert (read["ring"][0], read["class"][0], read["object_id"][0]) == (127, 3, -1)
    assert read["echo"][0] == 1


def test_fields_of_older_frames_have_the_first_echo(tmp_path: Path) -> None:
    before = [("time_s", "<f4"), ("ring", "<u2"), ("class", "<u2"), ("object_id", "<i4")]
    record = np.array([(0.05, 127, 16, 3)], dtype=before)
    read = kitti.read_fields(written(tmp_path, record.tobytes()))
    assert (read["class"][0], read["echo"][0], read["object_id"][0]) == (16, 0, 3)


def test_objects_are_read_by_column(tmp_path: Path) -> None:
    objects = kitti.read_objects(written(tmp_path, f"{HEADER}\n{VEHICLE}\n"))
    assert len(objects) == 1
    assert objects.names.tolist() == ["Car"]
    assert objects.boxes.tolist() == [[10.5, -2, -5.2, 4.5, 1.8, 1.6, 0.25]]
    assert (objects.ids[0], objects.points[0], objects.points_in_box[0]) == (7, 12, 9)
    assert (objects.speed[0], objects.distance[0], objects.visibility[0]) == (16.5, 10.7, 0.75)
    assert objects.scan_boxes.tolist() == [[10.9, -1.9, -5.1, 4.5, 1.8, 1.6, 0.24]]
    assert (objects.scan_time_s[0], objects.points_in_scan_box[0]) == (0.06, 11)
    assert objects.label_boxes("scan") is objects.scan_boxes
    assert objects.label_boxes("frame") is objects.boxes


def test_objects_of_a_run_whose_vehicles_lean_have_a_pitch(tmp_path: Path) -> None:
    text = f"{HEADER},pitch\n{VEHICLE},-0.06\n{VEHICLE.replace('7,', '8,', 1)},0\n"
    objects = kitti.read_objects(written(tmp_path, text))
    assert objects.pitch is not None
    assert objects.pitch.tolist() == [-0.06, 0]
    level = kitti.read_objects(written(tmp_path, f"{HEADER}\n{VEHICLE}\n"))
    assert level.pitch is None
    np.testing.assert_array_equal(objects.boxes[0], level.boxes[0])


@pytest.mark.parametrize("expected", ["frame", "scan"])
def test_labels_of_a_folder_hold_when_its_lidar_says(expected: str, tmp_path: Path) -> None:
    folder = lidar_folder(tmp_path, LIDAR.replace("label_time: frame", f"label_time: {expected}"))
    assert kitti.read_label_time(folder) == kitti.read_lidar(folder).label_time == expected


def test_labels_of_a_folder_without_a_lidar_hold_at_mid_frame(tmp_path: Path) -> None:
    assert kitti.read_label_time(tmp_path) == "frame"


def test_an_unknown_label_time_is_an_error(tmp_path: Path) -> None:
    folder = lidar_folder(tmp_path, LIDAR.replace("label_time: frame", "label_time: end"))
    with pytest.raises(
        FormatError, match=r"lidar\.yaml:11: label_time: expected frame or scan, got 'end'"
    ):
        kitti.read_lidar(folder)


def test_frame_without_vehicles_has_none(tmp_path: Path) -> None:
    objects = kitti.read_objects(written(tmp_path, HEADER + "\n"))
    assert len(objects) == 0
    assert objects.boxes.shape == (0, 7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: expected the header 'id,class,...', got ''"),
        (f"{HEADER},more\n", ":1: expected the header 'id,class,...', got 'id,class,..."),
        (f"{HEADER}\n{VEHICLE}\n7,Car\n", ":3: expected 20 columns ..., got 2"),
        (f"{HEADER}\n{VEHICLE}\n\n", ":3: expected 20 columns ..., got 1"),
        (f"{HEADER}\n{VEHICLE.replace('10.5', 'ten')}\n", ":2: x: expected a number, got 'ten'"),
        (
            f"{HEADER}\n{VEHICLE.replace('10.5', 'nan')}\n",
            ":2: x: expected a finite number, got nan",
        ),
        (
            f"{HEADER}\n{VEHICLE.replace('4.5', '-4.5')}\n",
            ":2: dx: expected more than 0.001, at most 1000, got -4.5",
        ),
        (f"{HEADER}\n{VEHICLE.replace('12', '-1')}\n", ":2: points: expected a whole ..., got -1"),
        (
            f"{HEADER}\n{VEHICLE.replace('12', '1.5')}\n",
            ":2: points: expected a whole ..., got 1.5",
        ),
        (
            f"{HEADER}\n{VEHICLE.replace('0.75', '1.5')}\n",
            ":2: visibility: expected 0 to 1, or -1, got 1.5",
        ),
        (
            f"{HEADER}\n{VEHICLE.replace('Car', '')}\n",
            ":2: class: expected a name, got an empty cell",
        ),
        (
            f"{HEADER}\n{VEHICLE}\n{VEHICLE}\n",
            ":3: id: expected each id once per frame, got 7 twice",
        ),
        (f"{HEADER}\n{VEHICLE}", ":2: expected a newline at the end of the last line, got none"),
        (
            f"{HEADER}\n{VEHICLE.replace('0.25', '90')}\n",
            ":2: heading: expected -2 pi to 2 pi, in radians, got 90",
        ),
        (
            f"{HEADER}\n{VEHICLE.replace('10.5', '1e30')}\n",
            ":2: x: expected -10000 to 10000, got 1e+30",
        ),
        (
            f"{HEADER}\n{VEHICLE.replace(',9,', ',13,')}\n",
            ":2: points_in_box: expected ..., got 13",
        ),
        (
            f"{HEADER}\n{VEHICLE.replace(',11', ',13')}\n",
            ":2: points_in_scan_box: expected ..., got 13",
        ),
        (
            f"{HEADER}\n{VEHICLE.replace('0.06', '-1')}\n",
            ":2: scan_time_s: expected -0.2 to 60, got -1",
        ),
        (
            f"{WITHOUT_SCAN}\n",
            ":1: expected ..., got 'id,class,x,y,z,dx,dy,dz,heading,speed,points",
        ),
        (f"{HEADER},pitch\n{VEHICLE},9\n", ":2: pitch: expected -2 pi to 2 pi, in radians, got 9"),
        (f"{HEADER},pitch\n{VEHICLE}\n", ":2: expected 21 columns ..., got 20"),
        (f"{HEADER},pitch\n{VEHICLE},up\n", ":2: pitch: expected a number, got 'up'"),
        (f"{HEADER}\n{VEHICLE.replace('10.7', '20')}\n", ":2: distance: expected ..., got 20"),
        (f"{HEADER}\n{VEHICLE.replace('7,', '1e99,', 1)}\n", ":2: id: expected ..., got 1e+99"),
    ],
)
def test_wrong_objects_file_is_named_by_line_and_column(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(FormatError, match=pattern(f"file{message}")):
        kitti.read_objects(written(tmp_path, text))


def test_label_becomes_a_box_around_its_centre(tmp_path: Path) -> None:
    labels = kitti.read_labels(written(tmp_path, LABEL + "\n"))
    # The box is 10 m ahead and 2 m to the right, with its bottom 6 m below the sensor. A rotation_y
    # of -90 degrees looks ahead.
    np.testing.assert_allclose(labels.boxes, [[10, -2, -5.2, 4.5, 1.8, 1.6, 0]], atol=1e-6)
    assert labels.names.tolist() == ["Car"]
    assert labels.scores is None


@pytest.mark.parametrize("heading", [-3.0, -1.0, 0.0, 0.5, 2.0, 3.1])
def test_heading_survives_the_camera_frame(tmp_path: Path, heading: float) -> None:
    line = LABEL.replace("-1.570796", f"{-heading - math.pi / 2:.6f}")
    assert kitti.read_labels(written(tmp_path, line)).boxes[0, 6] == pytest.approx(
        heading, abs=1e-6
    )


def test_predictions_have_a_score_and_labels_have_none(tmp_path: Path) -> None:
    file = written(tmp_path, f"{LABEL} 0.9\n{LABEL} 0.25\n")
    scores = kitti.read_labels(file, scores=True).scores
    assert scores is not None
    assert scores.tolist() == [0.9, 0.25]
    with pytest.raises(FormatError, match=r"file:1: expected 15 columns .*, got 16"):
        kitti.read_labels(file)
    with pytest.raises(FormatError, match=r"file:1: expected 16 columns .*, got 15"):
        kitti.read_labels(written(tmp_path, LABEL), scores=True)


def test_dont_care_regions_are_left_out(tmp_path: Path) -> None:
    region = "DontCare -1 -1 -10 500 160 520 180 -1 -1 -1 -1000 -1000 -1000 -10"
    labels = kitti.read_labels(written(tmp_path, f"{region}\n{LABEL}\n"))
    assert labels.names.tolist() == ["Car"]


@pytest.mark.parametrize("scores", [False, True])
def test_blank_lines_are_no_boxes_and_keep_the_numbers_of_lines(
    tmp_path: Path, scores: bool
) -> None:
    line = LABEL + " 0.5" * scores
    text = f"\r\n{line.replace(' ', '  ')}\r\n \t\r\n{line}\r\n\r\n"
    file = written(tmp_path, text)
    assert len(kitti.read_labels(file, scores=scores)) == 2
    if scores:
        cameras = Cameras((kitti.simulated(),), np.zeros(1, dtype=np.int64))
        named = file.rename(file.with_suffix(".txt"))
        assert read_predictions([named], cameras).line.tolist() == [2, 4]
    wrong = written(tmp_path, text.replace(line, line.replace(" 1.6 ", " 0 ")))
    with pytest.raises(FormatError, match=r"file:4: h: expected more than 0.*, got 0"):
        kitti.read_labels(wrong, scores=scores)


def test_empty_label_file_is_a_frame_without_objects(tmp_path: Path) -> None:
    labels = kitti.read_labels(written(tmp_path, ""), scores=True)
    assert labels.boxes.shape == (0, 7)
    assert labels.scores is not None
    assert len(labels.scores) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{LABEL}\n{LABEL.replace(' 10 ', ' far ')}\n", ":2: z: expected a number, got 'far'"),
        (LABEL.replace("1.6 1.8", "1.6 0"), ":1: w: expected more than 0.001, at most 1000, got 0"),
        (LABEL.replace(" 10 ", " inf "), ":1: z: expected a finite number, got inf"),
        (b"Car \xff", ": expected UTF-8, got an invalid byte at offset 4"),
    ],
)
def test_wrong_label_file_is_named_by_line_and_column(
    tmp_path: Path, text: str | bytes, message: str
) -> None:
    with pytest.raises(FormatError, match=pattern(f"file{message}")):
        kitti.read_labels(written(tmp_path, text))


def test_a_byte_order_mark_is_no_part_of_a_table(tmp_path: Path) -> None:
    objects = written(tmp_path, f"\ufeff{HEADER}\r\n{VEHICLE}\r\n", "objects")
    assert kitti.read_objects(objects).names.tolist() == ["Car"]
    assert kitti.read_labels(written(tmp_path, f"\ufeff{LABEL}\n")).names.tolist() == ["Car"]


def test_an_empty_calib_file_is_no_missing_one(tmp_path: Path) -> None:
    assert len(read_cameras(tmp_path, [0]).different) == 1
    file = kitti.frame_file(tmp_path, "calib", 0)
    file.parent.mkdir(parents=True)
    file.write_bytes(b"")
    with pytest.raises(FormatError, match=r"000000\.txt: expected the matrices"):
        read_cameras(tmp_path, [0])


def test_missing_file_is_an_error_of_the_system(tmp_path: Path) -> None:
    for read in (kitti.read_points, kitti.read_objects, kitti.read_labels):
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "none")
