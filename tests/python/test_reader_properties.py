"""Clouds and labels that other programs write are read correctly.

The generated files vary as those of other programs do: field names in capitals, types, orders, line
ends, blank lines and numbers of columns. The files are always the same, except in `make fuzz`,
which tries other files for FUZZ_SECONDS per reader.
"""

import math
import struct
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import LIMIT_S, tried
from scipy.spatial.transform import Rotation

from pyinfra.core.errors import FormatError
from pyinfra.exchange.bin_columns import columns_of
from pyinfra.exchange.formats import reader
from pyinfra.exchange.pcd import points_of
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import read_pcd

pytestmark = pytest.mark.timeout(LIMIT_S)
HIGHEST = 255.0  # intensity of the clouds
TYPES = {"F4": "<f4", "F8": "<f8", "I2": "<i2", "I4": "<i4", "U1": "<u1", "U2": "<u2", "U4": "<u4"}
INTENSITIES = ("Intensity", "intensity", "INTENSITY", "i", "Reflectivity", "scalar_Intensity")
EXTRAS = (("ring", "U2", 1), ("_", "U1", 3), ("_", "U1", 5), ("GpsTime", "F8", 1), ("n", "F4", 3))


# --- PCD


@dataclass(frozen=True)
class Cloud:
    """A .pcd file and the points that it describes."""

    bytes: bytes
    points: np.ndarray  # (n, 4) in the frame of the scanned site


def literals(data: bytes) -> bytes:
    """Compresses data with LZF, using literals only."""
    chunks = [data[i : i + 32] for i in range(0, len(data), 32)]
    return b"".join(bytes([len(chunk) - 1]) + chunk for chunk in chunks)


def packed(records: np.ndarray, data: str) -> bytes:
    names = records.dtype.names or ()
    if data == "ascii":
        rows = [[v for name in names for v in np.ravel(row[name])] for row in records]
        return "".join(" ".join(map(str, row)) + "\r\n" for row in rows).encode()
    if data == "binary":
        return records.tobytes()
    plain = b"".join(np.ascontiguousarray(records[name]).tobytes() for name in names)
    small = literals(plain)
    return struct.pack("<II", len(small), len(plain)) + small


@st.composite
def clouds(draw: st.DrawFn) -> Cloud:
    n = draw(st.integers(0, 12))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    data = draw(st.sampled_from(["ascii", "binary", "binary_compressed"]))
    kind = draw(st.sampled_from(["F4", "F8", "I2", "I4"]))
    xyz = random.integers(-400, 400, (n, 3)) / (1 if kind[0] == "I" else 4)
    xyz[random.random(n) < 0.2] = 0  # 0 0 0 means no return
    shares = random.integers(0, 256, n).astype(np.float64)
    intensity = draw(st.sampled_from([None, *INTENSITIES]))
    capitals = draw(st.booleans())
    columns = {name.upper() if capitals else name: xyz[:, i] for i, name in enumerate("xyz")}
    fields = [(name, kind, 1) for name in columns]
    if intensity:
        columns[intensity] = shares
        fields.append((intensity, draw(st.sampled_from(["F4", "F8", "U1", "U2"])), 1))
    fields += draw(st.lists(st.sampled_from(EXTRAS), max_size=3, unique=True))
    fields = draw(st.permutations(fields))
    names = [name if name != "_" else f"_{i}" for i, (name, _, _) in enumerate(fields)]
    shape = [
        (n, TYPES[t], (c,) if c > 1 else ()) for n, (_, t, c) in zip(names, fields, strict=True)
    ]
    records = np.zeros(n, dtype=shape)
    for name, column in columns.items():
        records[name] = column
    turn = draw(st.none() | st.tuples(*[st.integers(-3, 3)] * 4).filter(any))
    shift = draw(st.tuples(*[st.integers(-50, 50)] * 3))
    positions, header = xyz.astype(np.float64), draw(st.sampled_from(["", "# .PCD v0.7\n"]))
    header += f"VERSION {draw(st.sampled_from(['0.7', '.7']))}\n"
    header += f"FIELDS {' '.join(name for name, _, _ in fields)}\n"
    header += f"SIZE {' '.join(t[1] for _, t, _ in fields)}\n"
    header += f"TYPE {' '.join(t[0] for _, t, _ in fields)}\n"
    if any(c > 1 for _, _, c in fields) or draw(st.booleans()):
        header += f"COUNT {' '.join(str(c) for _, _, c in fields)}\n"
    header += f"WIDTH {n}\nHEIGHT 1\n"
    if turn is not None:
        w, x, y, z = np.array(turn) / np.linalg.norm(turn)
        header += "VIEWPOINT " + " ".join(f"{v:.9g}" for v in (*shift, w, x, y, z)) + "\n"
        positions = Rotation.from_quat([x, y, z, w]).apply(xyz) + shift if n else positions
        positions[~xyz.any(axis=1)] = 0
    header += f"POINTS {n}\nDATA {data}\n"
    end = draw(st.sampled_from(["\n", "\r\n"] if data == "ascii" else ["\n"]))
    content = header.replace("\n", end).encode() + packed(records, data)
    return Cloud(content, np.column_stack([positions, shares if intensity else 0 * shares]))


def test_pcd_files_of_any_writer_are_read_where_their_viewpoint_says(tmp_path: Path) -> None:
    file = tmp_path / "a.pcd"

    @given(clouds())
    def holds(cloud: Cloud) -> None:
        file.write_bytes(cloud.bytes)
        points = points_of(file, read_pcd(file), Options(intensity_max=HIGHEST))
        points[:, 3] *= HIGHEST
        np.testing.assert_allclose(points, cloud.points, atol=1e-4)

    tried(holds)


def test_pcd_files_with_more_or_fewer_bytes_than_they_say_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.pcd"

    @given(clouds(), st.integers(-20, 20).filter(bool))
    def holds(cloud: Cloud, change: int) -> None:
        at = cloud.bytes.index(b"\nDATA") + 1
        assume(b"DATA ascii" not in cloud.bytes[at:])
        # a file without points can't lose data
        assume(change > 0 or b"POINTS 0\n" not in cloud.bytes)
        assume(len(cloud.bytes) + change > cloud.bytes.index(b"\n", at))
        file.write_bytes(cloud.bytes + b"\n" * change if change > 0 else cloud.bytes[:change])
        with pytest.raises(FormatError) as error:
            read_pcd(file)
        assert str(error.value).startswith(str(file))

    tried(holds)


# --- .bin


@st.composite
def bins(draw: st.DrawFn) -> tuple[int, list[np.ndarray]]:
    """Returns files of points (n, columns), as a LiDAR sees a road."""
    columns = draw(st.sampled_from([3, 4, 5, 6]))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    top = draw(st.sampled_from([1, 255]))
    files = []
    for n in draw(st.lists(st.integers(0, 40), min_size=1, max_size=4)):
        azimuth, away = random.uniform(-3.1, 3.1, n), random.uniform(4, 80, n)
        rows = [away * np.cos(azimuth), away * np.sin(azimuth), random.uniform(-6, -2, n)]
        rows += [np.round(random.uniform(0, 1, n) * 255) / 255 * top]
        rows += [random.integers(0, 32, n), np.sort(random.uniform(0, 0.1, n))]
        files.append(np.column_stack(rows)[:, :columns].astype("<f4"))
    return columns, files


def test_the_columns_of_bin_files_are_read_off_and_reported(tmp_path: Path) -> None:
    @given(bins(), st.sampled_from(["bin", "kitti", "openpcdet"]))
    def holds(drawn: tuple[int, list[np.ndarray]], layout: str) -> None:
        columns, clouds = drawn
        # Few points of six columns may also be read as twice as many points of three columns.
        assume(sum(map(len, clouds)) >= (80 if columns == 6 else 4))
        inside = {"bin": ".", "kitti": "velodyne", "openpcdet": "points"}[layout]
        folder = tmp_path / f"{layout}_{time.monotonic_ns()}"
        (folder / inside).mkdir(parents=True)
        for i, cloud in enumerate(clouds):
            cloud.tofile(folder / inside / f"{i}.bin")
        recording = reader(layout)(folder, Options(intensity_max=HIGHEST))
        for i, cloud in enumerate(clouds):
            points = recording.read(i).points
            assert np.array_equal(points[:, :3], cloud[:, :3])
            shares = cloud[:, 3] / HIGHEST if columns > 3 else 0 * cloud[:, 0]
            assert np.array_equal(points[:, 3], shares)
        assert recording.notes is not None
        assert columns == 4 or any(f"has {columns} float32" in note for note in recording.notes())

    tried(holds)


def test_columns_that_the_user_names_are_taken(tmp_path: Path) -> None:
    cloud = np.arange(60, dtype="<f4").reshape(-1, 3)
    cloud.tofile(tmp_path / "0.bin")
    recording = reader("bin")(tmp_path, Options(columns=3))
    assert np.array_equal(recording.read(0).points, np.column_stack([cloud, np.zeros(20)]))
    assert recording.notes is not None
    assert recording.notes() == ["points of .bin files have no intensity: intensities are set to 0"]
    assert columns_of([tmp_path / "0.bin"], Options(columns=5)) == (5, "")


def test_a_size_that_no_number_of_columns_fits_is_named_with_the_usual_one(tmp_path: Path) -> None:
    for name, size in (("0.bin", 16 * 7), ("1.bin", 16 * 9 + 4)):
        (tmp_path / name).write_bytes(bytes(size))
    recording = reader("bin")(tmp_path, Options())
    assert len(recording.read(0).points) == 7
    with pytest.raises(FormatError, match=r"1\.bin: expected .* multiple of 16 .*, got 148 bytes"):
        recording.read(1)


# --- KITTI

BLANKS = ("", " ", "\t", "  ")
IGNORED = "DontCare -1 -1 -10 500.1 160 520 180 -1 -1 -1 -1000 -1000 -1000 -10"
KEYS = {
    "R0_rect": ("R0_rect:", "R_rect", "R_rect:", "R0_rect"),
    "Tr_velo_to_cam": ("Tr_velo_to_cam:", "Tr_velo_cam", "Tr_velo_cam:", "Tr_velo_to_cam"),
    "Tr_imu_to_velo": ("Tr_imu_to_velo:", "Tr_imu_velo", "Tr_imu_velo:"),
}


@dataclass(frozen=True)
class Frame:
    """The texts of a calib and a label file, and the boxes that they describe."""

    calib: str
    label: str
    names: list[str]
    boxes: np.ndarray


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    end = draw(st.sampled_from(["\n", "\r\n"]))
    tx, ty, tz = (v / 100 for v in draw(st.tuples(*[st.integers(-99, 99)] * 3)))
    values = {
        "R0_rect": "1 0 0 0 1 0 0 0 1",
        "Tr_velo_to_cam": f"0 -1 0 {tx} 0 0 -1 {ty} 1 0 0 {tz}",
    }
    if draw(st.booleans()):
        values["Tr_imu_to_velo"] = "1 0 0 0.81 0 1 0 -0.32 0 0 1 0.8"
    lines = [f"{draw(st.sampled_from(KEYS[name]))} {text}" for name, text in values.items()]
    cameras = draw(st.sampled_from([(0, 1, 2, 3), (2,), (2, 3)]))
    lines += [f"P{i}: 7.0e+02 0 6.0e+02 0 0 7.0e+02 1.8e+02 0 0 0 1 0" for i in cameras]
    calib = end.join([*draw(st.permutations(lines)), *draw(st.lists(st.sampled_from(BLANKS)))])
    names, boxes, rows = [], [], []
    for _ in range(draw(st.integers(0, 4))):
        h, w, l = (v / 100 for v in draw(st.tuples(*[st.integers(40, 2000)] * 3)))  # noqa: E741
        x, y, z = (v / 100 for v in draw(st.tuples(*[st.integers(-9000, 9000)] * 3)))
        heading = draw(st.integers(-314, 314)) / 100
        names.append(draw(st.sampled_from(["Car", "Van", "Truck", "Pedestrian", "Tram"])))
        boxes.append([x, y, z, l, w, h, heading])
        turn = (-heading - math.pi / 2 + math.pi) % (2 * math.pi) - math.pi
        row = [names[-1], 0, draw(st.integers(0, 3)), -10, 0, 0, 0, 0, h, w, l]
        row += [-y + tx, -z + ty + h / 2, x + tz, turn]
        rows.append(draw(st.sampled_from([" ", "  ", "\t"])).join(str(v) for v in row))
    for extra in draw(st.lists(st.sampled_from([*BLANKS, IGNORED]), max_size=4)):
        rows.insert(draw(st.integers(0, len(rows))), extra)
    mark = draw(st.sampled_from(["", "\ufeff"]))
    label = mark + end.join([*rows, *draw(st.lists(st.sampled_from(BLANKS), max_size=2))])
    return Frame(calib, label, names, np.array(boxes).reshape(-1, 7))


def test_kitti_files_of_any_benchmark_and_tool_place_their_boxes(tmp_path: Path) -> None:
    @given(st.lists(frames(), min_size=1, max_size=3), st.integers(0, 120), st.integers(1, 6))
    def holds(drawn: list[Frame], first: int, digits: int) -> None:
        training = tmp_path / f"{time.monotonic_ns()}/training"
        for name in ("velodyne", "label_2", "calib"):
            (training / name).mkdir(parents=True)
        for number, frame in enumerate(drawn, start=first):
            name = f"{number:0{digits}d}"
            np.zeros((number % 2, 4), dtype="<f4").tofile(training / f"velodyne/{name}.bin")
            (training / f"label_2/{name}.txt").write_text(frame.label, newline="")
            (training / f"calib/{name}.txt").write_text(frame.calib, newline="")
        recording = reader("kitti")(training.parent, Options())
        assert recording.numbers() == tuple(range(first, first + len(drawn)))
        for i, frame in enumerate(drawn):
            labels = recording.read(i).boxes
            assert labels.names.tolist() == frame.names
            np.testing.assert_allclose(labels.boxes[:, :6], frame.boxes[:, :6], atol=1e-6)
            off = np.sin((labels.boxes[:, 6] - frame.boxes[:, 6]) / 2)
            np.testing.assert_allclose(off, 0, atol=1e-6)
            file = training / f"label_2/{recording.names[i]}.txt"
            assert len(kitti.read_labels(file)) == len(frame.names)

    tried(holds)
