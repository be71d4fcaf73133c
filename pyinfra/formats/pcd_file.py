"""Reads and writes PCD files, version 0.7: a text header, then the points.

Follows the public description (Point Cloud Library, "The PCD file format").
"""

import io
import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import AnyArray, FloatArray, Records
from pyinfra.core.errors import fail, missing
from pyinfra.core.files import write
from pyinfra.formats.kitti.layout import FARTHEST_M

TYPES = {"F4": "<f4", "F8": "<f8"} | {
    f"{t}{n}": f"<{t.lower()}{n}" for t in "IU" for n in (1, 2, 4, 8)
}
NEEDED = ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA")
KEYS = (*NEEDED, "VERSION", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT")
MOST_LINES = 50  # maximum number of lines of a header
MOST_POINTS = 999_999_999
MOST_LZF = 90  # largest compression ratio: LZF expands 3 bytes to at most 264
FARTHEST = 1e9  # largest absolute value in a VIEWPOINT; squares of huge numbers overflow
QUATERNION = (0.9, 1.1)  # allowed length of a rounded unit quaternion


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """The sensor's pose in the site's frame, from VIEWPOINT: x y z and a quaternion w x y z."""

    shift: FloatArray  # (3,) translation, in the unit of the points
    turn: FloatArray  # (3, 3) rotation from the frame of the stored points to the site's frame

    @property
    def is_far(self) -> bool:
        """Whether the shift exceeds the largest allowed coordinate, as in geographic frames."""
        return bool(np.abs(self.shift).max() >= FARTHEST_M)

    @property
    def applied_shift(self) -> FloatArray:
        return np.zeros(3) if self.is_far else self.shift

    @property
    def angle_deg(self) -> float:
        return float(np.degrees(Rotation.from_matrix(self.turn).magnitude()))

    @property
    def is_identity(self) -> bool:
        return not self.shift.any() and np.array_equal(self.turn, np.eye(3))

    def apply(self, columns: list[AnyArray], *, shifted: bool = True) -> list[AnyArray]:
        """Transforms x, y, z, (n,) each, to the site's frame.

        Points at 0 0 0 stay unchanged, because they stand for rays without a return.
        """
        stored = np.stack([column.astype(np.float64) for column in columns], axis=1)
        with np.errstate(invalid="ignore"):  # rays without return may have NaN coordinates
            moved = stored @ self.turn.T + (self.applied_shift if shifted else 0)
        moved[~stored.any(axis=1)] = 0
        return list(moved.T)


@dataclass(frozen=True)
class Header:
    """The header of a file.

    Field names are in lower case, unless two names of the file differ only in case.
    """

    file: Path
    record: np.dtype[np.void]
    points: int
    data: str
    viewpoint: Viewpoint


def write_pcd(file: Path, records: Records) -> None:
    """Writes records (n,), one number per field, as binary PCD with the viewpoint at the origin."""
    names = records.dtype.names or ()
    types = [records.dtype[name] for name in names]
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(str(t.itemsize) for t in types)}",
        f"TYPE {' '.join(t.kind.upper() for t in types)}",
        f"COUNT {' '.join('1' for _ in types)}",
        f"WIDTH {len(records)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(records)}",
        "DATA binary",
    ]
    # ndarray.tofile is not used, because it does not report a full disk when it closes the file.
    write(file, "".join(f"{line}\n" for line in header).encode() + records.tobytes())


def read_pcd(file: Path) -> Records:
    """Reads an ascii, binary or compressed file into records (n,) with the file's fields.

    The viewpoint is not applied. Field names are in lower case, as `Header` describes. Raises
    FormatError; for some errors in the header, the message names the line. Raises ImportError for a
    compressed file if the extra `exchange` is not installed.
    """
    with file.open("rb") as stream:
        header = _read_header(file, stream)
        ways = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed}
        if header.data not in ways:
            fail(file, f"DATA: expected one of {', '.join(ways)}; got '{header.data}'")
        return ways[header.data](header, stream)


def read_header(file: Path) -> Header:
    """Reads the header of a file. Raises FormatError."""
    with file.open("rb") as stream:
        return _read_header(file, stream)


def _read_header(file: Path, stream: BinaryIO) -> Header:
    words: dict[str, list[str]] = {}
    lines: dict[str, int] = {}
    for number in range(1, MOST_LINES + 1):
        line = stream.readline(10_000)
        key, *rest = line.decode("ascii", "replace").split() or [""]
        if line and (not key or key.startswith("#")):
            continue
        if key not in KEYS or not rest:
            keys = ", ".join(KEYS)
            fail(file, f"expected one of the keys {keys} with a value; got '{key[:20]}'", number)
        words[key], lines[key] = rest, number
        if key == "DATA":
            break
    absent = [key for key in NEEDED if key not in words]
    if absent:
        fail(file, f"expected the keys {', '.join(absent)} in the header; got none of them")
    words.setdefault("COUNT", ["1"] * len(words["FIELDS"]))
    record, points = _record(file, words), words["POINTS"][0]
    if not points.isdecimal() or len(points) > len(str(MOST_POINTS)):
        got = points[:20]
        fail(file, f"POINTS: expected a whole number from 0 to {MOST_POINTS}, got '{got}'")
    viewpoint = words.get("VIEWPOINT", "0 0 0 1 0 0 0".split())
    return Header(
        file,
        record,
        int(points),
        words["DATA"][0],
        _viewpoint(file, viewpoint, lines.get("VIEWPOINT")),
    )


def _viewpoint(file: Path, words: list[str], line: int | None) -> Viewpoint:
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError:
        values = np.empty(0)
    if values.shape != (7,) or not (np.abs(values) <= FARTHEST).all():
        got = " ".join(words)[:60]
        fail(file, f"VIEWPOINT: expected 7 finite numbers up to {FARTHEST:g}, got '{got}'", line)
    shift, (w, x, y, z) = values[:3], values[3:]
    length = float(np.linalg.norm(values[3:]))
    # Some programs write a quaternion of zeros.
    if length != 0 and not QUATERNION[0] <= length <= QUATERNION[1]:
        fail(file, f"VIEWPOINT: expected a quaternion of length 1, got {length:g}", line)
    turn = np.eye(3) if x == y == z == 0 else Rotation.from_quat([x, y, z, w]).as_matrix()
    return Viewpoint(shift, turn)


def _record(file: Path, words: dict[str, list[str]]) -> np.dtype[np.void]:
    names, sizes, letters, counts = (words[key] for key in ("FIELDS", "SIZE", "TYPE", "COUNT"))
    if not len(names) == len(sizes) == len(letters) == len(counts):
        got = ", ".join(str(len(part)) for part in (names, sizes, letters, counts))
        fail(file, f"FIELDS, SIZE, TYPE, COUNT: expected equally many values, got {got}")
    small = Counter(name.lower() for name in names)
    names = [name.lower() if small[name.lower()] == 1 else name for name in names]
    fields = []
    for i, (name, size, letter, count) in enumerate(
        zip(names, sizes, letters, counts, strict=True)
    ):
        if letter + size not in TYPES:
            types = ", ".join(TYPES)
            fail(file, f"{name}: expected TYPE and SIZE to be one of {types}; got {letter}{size}")
        if not count.isdecimal() or len(count) > 5 or not 0 <= int(count) <= 10_000:
            fail(file, f"{name}: expected a COUNT of 0 to 10000, got {count[:20]}")
        if int(count) == 0:  # padding field without bytes, which PCL writes for some point types
            continue
        shape = () if count == "1" else (int(count),)
        fields.append((f"_{i}" if name == "_" else name, TYPES[letter + size], shape))
    try:
        return np.dtype(fields)
    except ValueError as error:
        fail(file, f"FIELDS: {error}")


def _ascii(header: Header, stream: BinaryIO) -> Records:
    lines = stream.read().decode("ascii", "replace").splitlines()
    lines = [line for line in lines if line.strip()]
    if len(lines) != header.points:
        fail(header.file, f"expected {header.points} points, got {len(lines)}")
    return text_records(header.file, lines, header.record, "points")


def text_records(file: Path, lines: list[str], record: np.dtype[np.void], what: str) -> Records:
    """Reads lines of numbers into records (n,). `what` describes them in a FormatError."""
    if not lines:
        return np.empty(0, dtype=record)
    try:
        return np.atleast_1d(np.loadtxt(io.StringIO("\n".join(lines)), dtype=record))
    except ValueError as error:
        fail(file, f"{what}: {error}")


def _binary(header: Header, stream: BinaryIO) -> Records:
    size = header.points * header.record.itemsize
    data = stream.read()
    if len(data) < size:
        got = f"{len(data)}; the file may be truncated"
        fail(header.file, f"expected {size} bytes of points, got {got}")
    _check_end(header, len(data), size)
    return np.frombuffer(data, dtype=header.record, count=header.points)


def _check_end(header: Header, got: int, expected: int) -> None:
    """Raises FormatError for extra data. The cause is a wrong header or two joined files."""
    if got > expected:
        mismatch = f"expected {expected} bytes of points, got {got}"
        fail(header.file, f"{mismatch}; FIELDS, SIZE, COUNT or POINTS may be wrong")


def _compressed(header: Header, stream: BinaryIO) -> Records:
    """Reads LZF-compressed points, which are stored field by field."""
    try:
        import lzf
    except ImportError:
        raise missing("python-neo-lzf", "exchange") from None
    size = header.points * header.record.itemsize
    lengths, data = stream.read(8), stream.read()
    if size == 0:
        _check_end(header, len(data), 0)
        return np.empty(0, dtype=header.record)
    packed, unpacked = struct.unpack("<II", lengths) if len(lengths) == 8 else (0, 0)
    if unpacked != size or len(data) < packed or len(lengths) < 8 or size > MOST_LZF * packed:
        got = f"got {len(data)} of {packed} compressed bytes, which give {unpacked} bytes"
        hint = "the file may be truncated"
        fail(header.file, f"expected {size} bytes of points, {got}; {hint}")
    _check_end(header, len(data), packed)
    try:
        plain = lzf.decompress(data[:packed], size)
    except ValueError:
        plain = None
    if plain is None or len(plain) != size:
        fail(
            header.file,
            f"points: expected LZF data of {size} bytes, because DATA is binary_compressed, got "
            "data that cannot be decompressed to this size",
        )
    out = np.empty(header.points, dtype=header.record)
    start = 0
    for name in header.record.names or ():
        column = out[name]
        out[name] = np.frombuffer(plain, column.dtype, column.size, start).reshape(column.shape)
        start += column.nbytes
    return out
