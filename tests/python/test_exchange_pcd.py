"""PCD files: pypcd4 reads our files, and we read its files."""

from pathlib import Path

import numpy as np
import pytest
from exchange_data import BOXES, LIDARS, fields_of, points, write_recording
from pypcd4 import Encoding, PointCloud

from pyinfra.core.errors import FormatError
from pyinfra.exchange.exports import export
from pyinfra.exchange.formats import reader
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import read_pcd

ALL = ("x", "y", "z", "intensity", "time", "ring", "object_id", "class", "echo")


def columns(cloud: PointCloud, names: tuple[str, ...]) -> np.ndarray:
    return np.column_stack([cloud.pc_data[name].astype(np.float64) for name in names])


def test_all_fields_by_hand(tmp_path: Path) -> None:
    export(write_recording(tmp_path), [5], "pcd", tmp_path / "out")
    cloud = PointCloud.from_path(tmp_path / "out/points/000005.pcd")
    assert cloud.fields == ALL
    assert np.array_equal(columns(cloud, ALL[:4]), points(5))
    for name, ours in zip(ALL[4:], ("time_s", "ring", "object_id", "class", "echo"), strict=True):
        assert np.array_equal(cloud.pc_data[name], fields_of(5)[ours])
    first, second = (tmp_path / "out/labels/000005.txt").read_text().splitlines()
    assert [float(word) for word in first.split()[:7]] == pytest.approx(BOXES[3])
    assert second.split()[7] == "Truck"


def test_without_fields_place_and_intensity_remain(tmp_path: Path) -> None:
    export(write_recording(tmp_path, fields=False), [5], "pcd", tmp_path / "out")
    assert PointCloud.from_path(tmp_path / "out/points/000005.pcd").fields == ALL[:4]


@pytest.mark.parametrize("lidar", LIDARS)
def test_frames_of_each_lidar(motorway: Path, lidar: str, tmp_path: Path) -> None:
    export(motorway / lidar, [0, 2], "pcd", tmp_path / "out")
    for frame in (0, 2):
        cloud = PointCloud.from_path(tmp_path / f"out/points/{frame:06d}.pcd")
        original = kitti.read_points(kitti.frame_file(motorway / lidar, "velodyne", frame))
        assert np.array_equal(columns(cloud, ALL[:4]), original)
        fields = kitti.read_fields(kitti.frame_file(motorway / lidar, "fields", frame))
        assert np.array_equal(cloud.pc_data["object_id"], fields["object_id"])
        assert np.array_equal(cloud.pc_data["time"], fields["time_s"])


@pytest.mark.parametrize("encoding", list(Encoding)[:3])
@pytest.mark.parametrize("count", [0, 1, 500])
def test_files_of_another_writer(encoding: Encoding, count: int, tmp_path: Path) -> None:
    draw = np.random.default_rng(1)
    names, types = ("x", "y", "z", "i", "ring"), ("f4", "f4", "f8", "f4", "u2")
    values = [draw.uniform(0, 9, count).astype(t) for t in types]
    cloud = PointCloud.from_points(values, names, [np.dtype(t) for t in types])
    cloud.save(tmp_path / "a.pcd", encoding=encoding)
    records = read_pcd(tmp_path / "a.pcd")
    for name, value in zip(names, values, strict=True):
        assert np.allclose(records[name], value, atol=1e-5)


HEADER = """VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH 2
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 2
DATA """


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: expected one of the keys FIELDS, .*; got ''"),
        ("hello world\n", ":1: expected one of the keys FIELDS, .*; got 'hello'"),
        (HEADER + "zip\n", "DATA: expected one of ascii, binary, binary_compressed; got 'zip'"),
        (HEADER + "binary\n1234", "expected 24 bytes of points, got 4; the file may be truncated"),
        (HEADER + "binary_compressed\n1234", "the file may be truncated"),
        (
            HEADER + "binary_compressed\n\x02\0\0\0\x18\0\0\0\x7f\x7f",
            "points: expected LZF data of .*, got data",
        ),
        (HEADER + "ascii\n1 2 3\n", "expected 2 points, got 1"),
        (HEADER + "ascii\n1 2 3\n4 5\n", "points: "),
        (HEADER + "ascii\n1 2 3\n4 five 6\n", "points: "),
        (
            HEADER.replace("POINTS 2\n", "") + "ascii\n",
            "expected the keys POINTS in the header; got none",
        ),
        (HEADER.replace("POINTS 2", "POINTS -2") + "ascii\n", "POINTS: expected .*, got '-2'"),
        (
            HEADER.replace("SIZE 4 4 4", "SIZE 4 4") + "ascii\n",
            "SIZE, TYPE, COUNT: expected equally many values",
        ),
        (HEADER.replace("SIZE 4", "SIZE 3") + "ascii\n", "x: expected .*; got F3"),
        (
            HEADER.replace("COUNT 1", "COUNT 0") + "ascii\n",
            "expected 2 points, got 0",
        ),
        (
            HEADER.replace("POINTS 2", "POINTS " + 5000 * "9") + "ascii\n",
            "POINTS: expected .*, got '999",
        ),
        (
            HEADER.replace("COUNT 1", "COUNT " + 5000 * "9") + "ascii\n",
            "x: expected a COUNT .*, got 999",
        ),
        (HEADER.replace("x y z", "x x z") + "ascii\n", "FIELDS: "),
        (HEADER.replace("POINTS 2", "POINTS 999999999") + "binary\n", "the file may be truncated"),
        (HEADER + "binary\n" + 25 * "a", "expected 24 bytes of points, got 25"),
        (
            HEADER.replace("0 0 0 1 0 0 0", "0 0 5") + "ascii\n",
            ":8: VIEWPOINT: expected 7 finite numbers up to .*, got '0 0 5'",
        ),
        (HEADER.replace("0 0 0 1 0", "0 0 inf 1 0") + "ascii\n", ":8: VIEWPOINT: expected 7 fin"),
        (HEADER.replace("0 0 0 1 0", "0 0 0 1e200 0") + "ascii\n", ":8: VIEWPOINT: expected 7 f"),
        (
            HEADER.replace("0 0 0 1 0", "0 0 0 30 0") + "ascii\n",
            ":8: VIEWPOINT: expected a quaternion of length 1, got 30",
        ),
    ],
)
def test_wrong_files_are_named(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "a.pcd"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(FormatError, match=message) as error:
        read_pcd(file)
    assert str(error.value).startswith(str(file))


def test_a_field_of_several_numbers_and_padding(tmp_path: Path) -> None:
    record = np.dtype([("x", "<f4"), ("pad", "<u1", (3,)), ("normal", "<f4", (3,)), ("z", "<f4")])
    data = np.zeros(2, dtype=record)
    data["normal"] = [[1, 2, 3], [4, 5, 6]]
    data["z"] = [7, 8]
    header = (
        "FIELDS x _ normal z\nSIZE 4 1 4 4\nTYPE F U F F\nCOUNT 1 3 3 1\nPOINTS 2\nDATA binary\n"
    )
    (tmp_path / "a.pcd").write_bytes(header.encode() + data.tobytes())
    records = read_pcd(tmp_path / "a.pcd")
    assert records["normal"].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert records["z"].tolist() == [7, 8]


def test_a_compressed_file_without_its_package_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "lzf", None)
    (tmp_path / "a.pcd").write_text(HEADER + "binary_compressed\n")
    with pytest.raises(ImportError, match=r"pip install 'infrasim\[exchange\]'"):
        read_pcd(tmp_path / "a.pcd")


def written(folder: Path, viewpoints: list[str], fields: str) -> Path:
    """Writes a cloud of one point, 1 2 3, for each viewpoint."""
    folder.mkdir()
    for i, viewpoint in enumerate(viewpoints):
        text = HEADER.replace("0 0 0 1 0 0 0", viewpoint).replace("2\n", "1\n")
        text = text.replace("FIELDS x y z", f"FIELDS {fields}")
        (folder / f"{i}.pcd").write_text(text + "ascii\n1 2 3\n")
    return folder


@pytest.mark.parametrize("layout", ["pcd", "tumtraf", "dair-v2x", "rcooper"])
@pytest.mark.parametrize(
    ("viewpoints", "position", "notes"),
    [
        (["0 0 0 1 0 0 0"] * 2, (1, 2, 3), []),
        (["10 0 5 0.5 0.5 0.5 0.5"] * 2, (13, 1, 7), ["turned by 120.00 degrees and moved by (10"]),
        (["0 0 5 0 0 0 0"] * 2, (1, 2, 8), ["turned by 0.00 degrees and moved by (0, 0, 5)"]),
        (
            ["691000 5e6 520 0 1 0 0"] * 2,
            (1, -2, -3),
            ["the shift (691000, 5e+06, 520) is ignored"],
        ),
        (
            ["0 0 5 1 0 0 0", "0 0 6 1 0 0 0"],
            (1, 2, 8),
            ["2 of 2", "in 0.pcd; other clouds have another"],
        ),
        (
            ["0 0 5 1 0 0 0", "0 0 0 1 0 0 0"],
            (1, 2, 8),
            ["1 of 2", "in 0.pcd; other clouds have another"],
        ),
    ],
)
def test_every_reader_of_clouds_applies_their_viewpoint_and_says_so(
    layout: str,
    viewpoints: list[str],
    position: tuple[float, ...],
    notes: list[str],
    tmp_path: Path,
) -> None:
    inside = {"pcd": ".", "tumtraf": ".", "dair-v2x": "velodyne", "rcooper": "lidar"}[layout]
    source = tmp_path / "data/scene/pole/seq-1"
    source.mkdir(parents=True)
    folder = written(source / "clouds", viewpoints, "X y Z")
    source = folder if inside == "." else source
    if inside != ".":
        folder.rename(source / inside)
    recording = reader(layout)(source, Options())
    assert recording.read(0).points[0, :3] == pytest.approx(position, abs=1e-5)
    assert recording.notes is not None
    text = "; ".join(recording.notes())
    assert ("VIEWPOINT" in text) == bool(notes)
    assert all(note in text for note in notes)
    assert text.endswith("2 of 2 clouds have no intensity field (x y z): intensities are set to 0")


def test_names_that_differ_in_capitals_alone_keep_them(tmp_path: Path) -> None:
    folder = written(tmp_path / "a", ["0 0 0 1 0 0 0"], "Ring ring RING2")
    assert read_pcd(folder / "0.pcd").dtype.names == ("Ring", "ring", "ring2")
