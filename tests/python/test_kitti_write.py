"""Written values are read back: rounded to the decimals of the file, with every camera, and with
equal bytes for clouds."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from message_pattern import pattern

from pyinfra.core.errors import Error, FormatError
from pyinfra.formats import kitti

# A calibration and a label with the digits of KITTI, in the devkit's format.
CALIB = """\
P0: 7.215377e+02 0.0 6.095593e+02 0.0 0.0 7.215377e+02 1.728540e+02 0.0 0.0 0.0 1.0 0.0
P1: 7.215377e+02 0.0 6.095593e+02 -3.875744e+02 0.0 7.215377e+02 1.728540e+02 0.0 0.0 0.0 1.0 0.0
P2: 7.215377e+02 0 6.095593e+02 4.485728e+01 0 7.215377e+02 1.728540e+02 2.163791e-01 0 0 1 2.7e-03
P3: 7.215377e+02 0 6.095593e+02 -3.395242e+02 0 7.215377e+02 1.728540e+02 2.199936e+00 0 0 1 2.7e-03
R0_rect: 9.999239e-01 9.837760e-03 -7.445048e-03 -9.869795e-03 9.999421e-01 -4.278459e-03 \
7.402527e-03 4.351614e-03 9.999631e-01
Tr_velo_to_cam: 7.533745e-03 -9.999714e-01 -6.166020e-04 -4.069766e-03 1.480249e-02 7.280733e-04 \
-9.998902e-01 -7.631618e-02 9.998621e-01 7.523790e-03 1.480755e-02 -2.717806e-01
Tr_imu_to_velo: 9.999976e-01 7.553071e-04 -2.035826e-03 -8.086759e-01 -7.854027e-04 9.998898e-01 \
-1.482298e-02 3.195559e-01 2.024406e-03 1.482454e-02 9.998881e-01 -7.997231e-01

"""
LABEL = """\
Pedestrian 0.00 0 -0.20 712.40 143.00 810.73 307.92 1.89 0.48 1.20 1.84 1.47 8.41 0.01
DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10
"""

metres = st.floats(-300, 300)
sizes = st.floats(0.05, 30)
names = st.sampled_from(["Car", "Van", "Truck", "Tram", "Person_sitting"])
boxes = st.tuples(metres, metres, metres, sizes, sizes, sizes, st.floats(-math.pi, math.pi))


@pytest.fixture
def calibration(tmp_path: Path) -> kitti.Calibration:
    return kitti.read_calibration(written(tmp_path, CALIB))


def written(folder: Path, text: str) -> Path:
    file = folder / "file.txt"
    file.write_text(text)
    return file


def turn_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs((a - b + math.pi) % (2 * math.pi) - math.pi)


def test_a_real_label_stands_where_its_matrices_put_it(
    tmp_path: Path, calibration: kitti.Calibration
) -> None:
    labels = kitti.read_labels(written(tmp_path, LABEL), calibration=calibration)
    # By hand: x_rect = R0 (R x_velo + t), solved for the centre of the box, which is 1.89 / 2 above
    # (1.84, 1.47, 8.41). The camera is 0.27 m ahead of the LiDAR and 0.08 m below it. The LiDAR
    # looks down by 0.85 degrees, which is 0.13 m at this distance.
    middle = np.array([1.84, 1.47 - 1.89 / 2, 8.41])
    R, t = calibration.Tr_velo_to_cam[:, :3], calibration.Tr_velo_to_cam[:, 3]
    expected = np.linalg.solve(R, np.linalg.solve(calibration.R0_rect, middle) - t)
    np.testing.assert_allclose(labels.boxes[0, :3], expected, atol=1e-6)
    np.testing.assert_allclose(expected, [8.69, -1.84, -0.5], atol=0.05)
    assert labels.boxes[0, 3:6].tolist() == [1.2, 0.48, 1.89]
    # The vehicle looks to the camera's right, which is the LiDAR's -y.
    assert labels.boxes[0, 6] == pytest.approx(-math.pi / 2, abs=0.03)


def test_a_label_and_a_calib_file_round_trip(
    tmp_path: Path, calibration: kitti.Calibration
) -> None:
    labels = kitti.read_labels(written(tmp_path, LABEL), calibration=calibration, dont_care=True)
    kitti.write_labels(tmp_path / "label.txt", labels, calibration)
    before = [line.split() for line in LABEL.splitlines()]
    after = [line.split() for line in (tmp_path / "label.txt").read_text().splitlines()]
    assert [row[0] for row in after] == ["Pedestrian", "DontCare"]
    for a, b in zip(before, after, strict=True):
        np.testing.assert_allclose(np.array(b[1:14], float), np.array(a[1:14], float), atol=1e-4)
    # the camera is tilted by 0.6 degrees
    assert float(after[0][14]) == pytest.approx(0.01, abs=2e-4)

    kitti.write_calibration(tmp_path / "calib.txt", calibration)
    again = kitti.read_calibration(tmp_path / "calib.txt")
    for name, matrix in vars(calibration).items():
        np.testing.assert_array_equal(getattr(again, name), matrix)


def test_the_simulators_files_are_written_back_as_they_are(
    infrasim: Callable[..., object], run_command: Callable[..., list[str]], tmp_path: Path
) -> None:
    infrasim(
        *run_command("livox_avia", frames="7:8", out=tmp_path / "data"), "--fields", check=True
    )
    folder, copy = tmp_path / "data/livox_avia", tmp_path / "copy"
    kitti.write_frame(
        copy,
        7,
        kitti.read_points(kitti.frame_file(folder, "velodyne", 7)),
        kitti.read_labels(kitti.frame_file(folder, "label_2", 7)),
        objects=kitti.read_objects(kitti.frame_file(folder, "objects", 7)),
        fields=kitti.read_fields(kitti.frame_file(folder, "fields", 7)),
    )
    assert kitti.frames(copy) == [7]
    parts: list[kitti.Part] = ["velodyne", "label_2", "objects", "fields", "calib"]
    for part in parts:
        ours = kitti.frame_file(copy, part, 7).read_bytes()
        assert ours == kitti.frame_file(folder, part, 7).read_bytes(), part
    assert not list(copy.rglob(".*"))


@given(rows=st.lists(st.tuples(names, boxes), max_size=5), real=st.booleans(), data=st.data())
def test_any_boxes_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[str, tuple[float, ...]]],
    real: bool,
    data: st.DataObject,
) -> None:
    folder = tmp_path_factory.mktemp("labels")
    camera = kitti.read_calibration(written(folder, CALIB)) if real else None
    scores = data.draw(st.none() | arrays(np.float64, len(rows), elements=st.floats(0, 1)))
    labels = kitti.Labels(
        names=np.array([name for name, _ in rows], dtype=np.str_),
        boxes=np.array([box for _, box in rows], dtype=np.float64).reshape(-1, 7),
        scores=scores,
    )
    kitti.write_labels(folder / "label.txt", labels, camera)
    read = kitti.read_labels(folder / "label.txt", scores=scores is not None, calibration=camera)
    assert read.names.tolist() == labels.names.tolist()
    np.testing.assert_allclose(read.boxes[:, :6], labels.boxes[:, :6], atol=2e-4)
    limit = 1e-3 if real else 2e-6  # a tilted camera stores the heading in its own plane
    assert (turn_between(read.boxes[:, 6], labels.boxes[:, 6]) < limit).all()
    if scores is not None and read.scores is not None:
        np.testing.assert_allclose(read.scores, scores, atol=1e-6)


@given(
    points=arrays(
        np.float32,
        st.tuples(st.integers(0, 20), st.just(4)),
        elements=st.floats(-1e4, 1e4, width=32),
    )
)
def test_any_cloud_round_trips(
    tmp_path_factory: pytest.TempPathFactory, points: np.ndarray
) -> None:
    file = tmp_path_factory.mktemp("cloud") / "000000.bin"
    kitti.write_points(file, points)
    assert kitti.read_points(file).tobytes() == points.astype("<f4").tobytes()


@given(
    rows=st.lists(st.tuples(names, boxes, st.integers(0, 10**6), st.integers(-1, 1)), max_size=5),
    leans=st.booleans(),
)
def test_any_objects_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[str, tuple[float, ...], int, int]],
    leans: bool,
) -> None:
    file = tmp_path_factory.mktemp("objects") / "000000.csv"
    counts = np.array([row[2] for row in rows], dtype=np.int64)
    poses = np.array([row[1] for row in rows], dtype=np.float64).reshape(-1, 7)
    objects = kitti.Objects(
        ids=np.arange(len(rows)),
        names=np.array([row[0] for row in rows], dtype=np.str_),
        boxes=poses,
        speed=counts / 1e3,
        points=counts,
        points_in_box=counts // 2,
        distance=np.hypot(poses[:, 0], poses[:, 1]),
        visibility=np.array([row[3] for row in rows], dtype=np.float64),
        scan_boxes=poses[:, [1, 0, 2, 3, 4, 5, 6]],
        scan_time_s=np.minimum(counts / 1e5, 1),
        points_in_scan_box=counts // 3,
        pitch=counts / 1e6 - 0.5 if leans else None,
    )
    kitti.write_objects(file, objects)
    read = kitti.read_objects(file)
    assert (read.pitch is None) == (not leans)
    for name, column in vars(objects).items():
        if name == "names":
            assert read.names.tolist() == column.tolist()
        elif column is not None:
            np.testing.assert_allclose(getattr(read, name), column, atol=6e-5, rtol=1e-12)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("visibility", 1.5, "objects: visibility: expected 0 to 1, or -1, got 1.5 for object 1"),
        ("speed", -1.0, "objects: speed: expected 0 to 1000, got -1 for object 1"),
        ("points_in_box", 9, "objects: points_in_box: expected at most the value of `points`"),
    ],
)
def test_a_wrong_value_of_an_object_is_named(
    tmp_path: Path, column: str, value: float, message: str
) -> None:
    boxes = np.array([[10.0, 0, 0, 4, 2, 1.5, 0], [20.0, 0, 0, 4, 2, 1.5, 0]])
    objects = kitti.Objects(
        ids=np.arange(2),
        names=np.array(["Car", "Car"]),
        boxes=boxes,
        speed=np.zeros(2),
        points=np.array([5, 5]),
        points_in_box=np.array([5, 5]),
        distance=np.array([10.0, 20.0]),
        visibility=np.ones(2),
        scan_boxes=boxes,
        scan_time_s=np.zeros(2),
        points_in_scan_box=np.array([5, 5]),
        pitch=None,
    )
    getattr(objects, column)[1] = value
    with pytest.raises(Error, match=message):
        kitti.write_objects(tmp_path / "000000.csv", objects)
    assert list(tmp_path.iterdir()) == []


@settings(max_examples=300)
@given(text=st.text(alphabet="Car0123456789.-e \n\tnaifNP:R_DontTrveloc,", max_size=200))
def test_readers_give_a_value_or_a_format_error(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    file = written(tmp_path_factory.mktemp("any"), text)
    for read in (
        kitti.read_labels,
        kitti.read_objects,
        kitti.read_calibration,
        kitti.read_points,
        kitti.read_fields,
    ):
        message = refusal(read, file)
        assert message is None or message.startswith(str(file))


def refusal(read: Callable[[Path], object], file: Path) -> str | None:
    """Returns the message for a file that a reader refuses, or None."""
    try:
        read(file)
    except FormatError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("P0:", "P9:", ":1: expected ...; got 'P9:"),
        ("P1:", "P0:", ":2: P0: expected the matrix once, got it twice"),
        (
            "R0_rect: 9.999239e-01",
            "R0_rect: ",
            ":5: R0_rect: expected 9 finite numbers up to 1e+06, got 8 numbers",
        ),
        (
            "R0_rect: 9.999239e-01",
            "R0_rect: nan",
            ":5: R0_rect: expected 9 finite numbers up to 1e+06, got ",
        ),
        ("R0_rect: 9.999239e-01", "R0_rect: one", ":5: R0_rect: expected numbers, got 'one"),
        (
            "R0_rect: 9.999239e-01",
            "R0_rect: 2",
            ": R0_rect, Tr_velo_to_cam: expected rotation matrices",
        ),
        (CALIB[CALIB.index("Tr_velo") :], "", ": expected the matrices Tr_velo_to_cam; got none"),
        (CALIB[: CALIB.index("R0_rect")], "", ": expected the matrices P2; got none"),
        ("R0_rect: ", "R_rect_01 ", ":5: expected ...; got 'R_rect_01"),
    ],
)
def test_wrong_calib_file_is_named_by_line_and_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in CALIB
    with pytest.raises(FormatError, match=pattern(f"file.txt{message}")):
        kitti.read_calibration(written(tmp_path, CALIB.replace(old, new, 1)))


TRACKING = {
    "R0_rect:": "R_rect",
    "Tr_velo_to_cam:": "Tr_velo_cam",
    "Tr_imu_to_velo:": "Tr_imu_velo",
}


def replaced(text: str, words: dict[str, str]) -> str:
    for old, new in words.items():
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize(
    "text",
    [
        CALIB[: CALIB.index("Tr_imu")],
        CALIB.replace("\n", "\r\n") + "\r\n \r\n",
        replaced(CALIB, TRACKING),
        replaced(CALIB, {old: new + ":" for old, new in TRACKING.items()}),
        replaced(CALIB, {":": " "}),
        replaced(CALIB, {": ": ":"}),
        CALIB[CALIB.index("P2") : CALIB.index("P3")] + CALIB[CALIB.index("R0_rect") :],
        "calib_time: 09-Jan-2012 13:57:47\n" + CALIB + "Tr_cam_to_road: 1 0 0 0\n",
    ],
    ids=["no IMU", "CRLF and blank", "tracking", "colons", "blanks", "tight", "P2 alone", "more"],
)
def test_calib_files_of_all_benchmarks_place_the_same_boxes(
    calibration: kitti.Calibration, tmp_path: Path, text: str
) -> None:
    parsed = kitti.read_calibration(written(tmp_path, text))
    assert np.array_equal(parsed.T_camera_lidar, calibration.T_camera_lidar)
    assert np.array_equal(parsed.P[2], calibration.P[2])


def test_the_transform_of_the_odometry_benchmark_is_rectified(tmp_path: Path) -> None:
    text = CALIB[: CALIB.index("R0_rect")] + "Tr: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n"
    transform = kitti.read_calibration(written(tmp_path, text)).T_camera_lidar
    assert transform[:3].tolist() == [[0, -1, 0, 0], [0, 0, -1, -0.08], [1, 0, 0, -0.27]]


def test_wrong_arrays_are_refused_and_nothing_is_written(tmp_path: Path) -> None:
    file = tmp_path / "out"
    for points in (np.zeros((2, 3), np.float32), np.zeros((2, 4)), np.full((1, 4), np.nan, "f4")):
        with pytest.raises(ValueError, match=r"points: .*expected .*got "):
            kitti.write_points(file, points)
    flat = kitti.Labels(np.array(["Car"]), np.array([[0, 0, 0, 4, 2, 0, 0.0]]), None)
    with pytest.raises(ValueError, match="boxes: expected sizes above 0, got 0"):
        kitti.write_labels(file, flat)
    assert list(tmp_path.iterdir()) == []
