"""Clouds of other programs, packets, and what is refused with the command that helps."""

import gzip
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from recording_files import START_S, road, write_bag, write_packets

from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.formats import reader
from pyinfra.exchange.guess import guess_format
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.formats.pcd_file import write_pcd

OPTIONS = Options(intensity_max=255.0)
UTM = np.array([691_000.0, 5_334_000.0, 512.0])


def write_las(file: Path, cloud: np.ndarray, offset: np.ndarray | None = None) -> None:
    header = laspy.LasHeader(point_format=3, version="1.4")
    header.offsets = np.zeros(3) if offset is None else offset
    header.scales = np.full(3, 0.0001)
    out = laspy.LasData(header)
    out.x, out.y, out.z = (cloud[:, :3] + header.offsets).T
    out.intensity = np.round(cloud[:, 3] * 255).astype(np.uint16)
    out.write(file)


def write_ply(file: Path, cloud: np.ndarray, encoding: str) -> None:
    order = ">" if "big" in encoding else "<"
    kinds = [("X", "f8"), ("y", "f4"), ("z", "f4"), ("scalar_Intensity", "f4"), ("red", "u1")]
    names = {"f8": "double", "f4": "float", "u1": "uchar"}
    out = np.zeros(len(cloud), dtype=[(name, order + kind) for name, kind in kinds])
    for i, name in enumerate(("X", "y", "z")):
        out[name] = cloud[:, i]
    out["scalar_Intensity"] = cloud[:, 3] * 255
    head = ["ply", f"format {encoding} 1.0", "comment made by hand", f"element vertex {len(cloud)}"]
    head += [f"property {names[kind]} {name}" for name, kind in kinds]
    head += ["element face 0", "property list uchar int vertex_indices", "end_header", ""]
    rows = "".join(" ".join(repr(v.item()) for v in row) + "\n" for row in out).encode()
    data = rows if encoding == "ascii" else out.tobytes()
    file.write_bytes("\n".join(head).encode() + data)


def write_csv(file: Path, cloud: np.ndarray, head: str, separator: str) -> None:
    rows = (separator.join(f"{v:.5f}" for v in (*row[:3], row[3] * 255)) for row in cloud)
    file.write_text(head + "".join(f"{row}\n" for row in rows), encoding="utf-8")


WRITERS: dict[str, tuple[str, Callable[[Path, np.ndarray], None]]] = {
    "las": (".las", write_las),
    "laz": (".laz", write_las),
    "ply ascii": (".ply", lambda f, c: write_ply(f, c, "ascii")),
    "ply little": (".ply", lambda f, c: write_ply(f, c, "binary_little_endian")),
    "ply big": (".ply", lambda f, c: write_ply(f, c, "binary_big_endian")),
    "csv": (".csv", lambda f, c: write_csv(f, c, "x,y,z,intensity\n", ",")),
    "csv of a spreadsheet": (".csv", lambda f, c: write_csv(f, c, "\ufeffX;Y;Z;Intensity\n", ";")),
    "veloview": (
        ".csv",
        lambda f, c: write_csv(
            f, c, '"Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2","intensity"\n', ","
        ),
    ),
    "cloudcompare": (".asc", lambda f, c: write_csv(f, c, "//X Y Z Scalar_Intensity\n", " ")),
    "without names": (".xyz", lambda f, c: write_csv(f, c, "", " ")),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_clouds_of_other_programs(kind: str, tmp_path: Path) -> None:
    suffix, write = WRITERS[kind]
    for k in range(2):
        write(tmp_path / f"{k}{suffix}", road(k))
    format, _ = guess_format(tmp_path)
    assert guess_format(tmp_path / f"0{suffix}")[0] == format
    recording = reader(format)(tmp_path, OPTIONS)
    for k in range(2):
        points = recording.read(k).points
        assert points[:, :3] == pytest.approx(road(k)[:, :3], abs=1e-4)
        assert points[:, 3] == pytest.approx(road(k)[:, 3], abs=1 / 255)
    alone = reader(format)(tmp_path / f"1{suffix}", OPTIONS)
    assert len(alone.names) == 1


def test_map_coordinates_keep_their_millimetres(tmp_path: Path) -> None:
    write_las(tmp_path / "a.las", road(0), UTM)
    recording = reader("las")(tmp_path, OPTIONS)
    points = recording.read(0).points[:, :3].astype(np.float64)
    difference = points - road(0)[:, :3]
    assert np.ptp(difference, axis=0) == pytest.approx(0, abs=2e-4)
    assert recording.notes is not None
    assert any("coordinates are those of a map" in note for note in recording.notes())


def test_turns_of_packets(tmp_path: Path) -> None:
    file = write_packets(tmp_path / "a.pcap")
    assert guess_format(file)[0] == guess_format(tmp_path)[0] == "pcap"
    recording = reader("pcap")(tmp_path, OPTIONS)
    assert len(recording.names) >= 3
    assert recording.times is not None
    times = recording.times()
    assert times is not None
    assert abs(times[0] - START_S) < 3600
    for k in (1, 0, 2):
        frame = recording.read(k)
        assert np.linalg.norm(frame.points[:, :3], axis=1) == pytest.approx(10, abs=0.2)
        assert frame.fields is not None
        assert set(frame.fields["ring"]) == set(range(16))
        assert frame.fields["time_s"].max() == pytest.approx(0.1, abs=0.01)
        assert frame.fields["time_s"].min() == pytest.approx(0, abs=0.001)


def packets_of(payload: bytes) -> bytes:
    """A .pcap file with one packet, whose payload replaces that of Velodyne."""
    import struct

    udp = struct.pack(">HHHH", 443, 2368, 8 + len(payload), 0) + payload
    ip = struct.pack(">BBHHHBBHII", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, 1, 2)
    frame = bytes(12) + b"\x08\x00" + ip + udp
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    return head + struct.pack("<IIII", START_S, 0, len(frame), len(frame)) + frame


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (b"\xee\xff" + bytes(1078), "packets of Hesai: convert them to a bag"),
        (b"\x55\xaa\x05\x0a" + bytes(1244), "packets of RoboSense: convert them to a bag"),
        (bytes(6464), "packets of Ouster: convert them to a bag .*ouster-cli source a.pcap"),
        (bytes(100), "got packets of 100 bytes; record the PointCloud2"),
    ],
)
def test_packets_of_other_makers_name_a_converter(
    payload: bytes, message: str, tmp_path: Path
) -> None:
    (tmp_path / "a.pcap").write_bytes(packets_of(payload))
    with pytest.raises(Error, match=message):
        reader("pcap")(tmp_path, OPTIONS)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.e57", b"ASTM-E57" + bytes(40), "got E57: save the points as .pcd"),
        ("a.pcapng", b"\x0a\x0d\x0d\x0a" + bytes(40), "editcap -F pcap"),
        ("a.zip", b"PK\x03\x04" + bytes(40), "unpack the archive"),
        ("a.npy", b"\x93NUMPY" + bytes(40), "tofile"),
        ("a.bag.gz", gzip.compress(b"#ROSBAG V2.0", mtime=0), "got gzip.*unpack"),
        ("a.pkl", b"\x80\x04\x95" + bytes(40), "pickles are not read"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "HDF5"),
        ("a.rrd", b"RRF2" + bytes(40), "unknown format, a.rrd"),
    ],
)
def test_refusals_name_what_was_found(
    name: str, content: bytes, message: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(Error, match=message):
        guess_format(tmp_path / name)
    with pytest.raises(Error, match=name):
        guess_format(tmp_path)


def test_a_file_of_another_kind_than_the_given_format(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", "bag", "hesai", frames=1)
    with pytest.raises(Error, match="expected a recording of the format las, got bag"):
        import_recording(bag, "las", tmp_path / "in/p", LidarFacts("p", "s"), Options())


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.las", b"LASF" + bytes(300)),
        ("a.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\n"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header",
        ),
        ("a.csv", b"a,b,c\n1,2,3\n"),
        ("a.csv", b"x,y,z\n1,2,far\n"),
        ("a.xyz", b"5\n1 2 3\n"),
    ],
)
def test_damaged_files_are_named(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    format, _ = guess_format(tmp_path / name)
    with pytest.raises(FormatError, match=name):
        reader(format)(tmp_path / name, OPTIONS).read(0)


HEADERS: dict[str, Callable[[Path], None]] = {
    "header.pcd": lambda file: write_pcd(file, np.zeros(0, [(axis, "f4") for axis in "xyz"])),
    "header.las": lambda file: write_las(file, np.zeros((0, 4))),
    "header.laz": lambda file: write_las(file, np.zeros((0, 4))),
    "header.ply": lambda file: write_ply(file, np.zeros((0, 4)), "ascii"),
    "header.csv": lambda file: write_csv(file, np.zeros((0, 4)), "x,y,z,intensity\n", ","),
    "header.npy": lambda file: np.save(file, np.zeros((0, 4), np.float32)),
}
ENDINGS = ("pcd", "las", "laz", "ply", "csv", "xyz", "npy", "bin", "pcap", "bag", "mcap", "db3")


@pytest.mark.parametrize("skip_bad", [False, True])
@pytest.mark.parametrize("name", [*HEADERS, *(f"empty.{ending}" for ending in ENDINGS)])
def test_files_without_a_point_are_named(name: str, skip_bad: bool, tmp_path: Path) -> None:
    file = tmp_path / "recording/points" / name
    file.parent.mkdir(parents=True)
    HEADERS.get(name, Path.touch)(file)
    of_one_file = name.endswith(("pcap", "bag", "mcap", "db3"))
    source = file if of_one_file else file.parents[name.endswith("npy")]
    format, _ = guess_format(source)
    with pytest.raises(Error, match=name):
        import_recording(
            source, format, tmp_path / "in/p", LidarFacts("p", "s"), Options(), skip_bad=skip_bad
        )
