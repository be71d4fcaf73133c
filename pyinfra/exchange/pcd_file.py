"""The PCD file format, version 0.7: a header of text, then the points.

After its public description (Point Cloud Library, "The PCD file format").
"""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np

from pyinfra.arrays import Records
from pyinfra.atomic import write
from pyinfra.exchange.formats import missing
from pyinfra.kitti import FormatError

TYPES = {"F4": "<f4", "F8": "<f8"} | {
    f"{t}{n}": f"<{t.lower()}{n}" for t in "IU" for n in (1, 2, 4, 8)
}
LETTERS = {"f": "F", "i": "I", "u": "U"}
NEEDED = ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA")
KEYS = (*NEEDED, "VERSION", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT")
MOST_LINES = 50  # of a header
MOST_POINTS = 999_999_999
MOST_LZF = 90  # LZF makes of 3 bytes at most 264


def write_pcd(file: Path, records: Records) -> None:
    """records: (n,) with one number per field, in binary; the viewpoint is the origin."""
    names = records.dtype.names or ()
    types = [records.dtype[name] for name in names]
    header = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(str(t.itemsize) for t in types)}",
        f"TYPE {' '.join(LETTERS[t.kind] for t in types)}",
        f"COUNT {' '.join('1' for _ in types)}",
        f"WIDTH {len(records)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(records)}",
        "DATA binary",
    ]
    # Not by tofile, which does not see that a disk is full when it closes the file.
    write(file, "".join(f"{line}\n" for line in header).encode() + records.tobytes())


def read_pcd(file: Path) -> Records:
    """(n,) records with the fields of the file, ascii, binary or compressed.

    Raises FormatError with the line of the header, ImportError for a compressed file without the
    extra `exchange`.
    """
    with file.open("rb") as stream:
        header = _read_header(file, stream)
        ways = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed}
        if header.data not in ways:
            _fail(file, f"DATA: found '{header.data}', allowed {', '.join(ways)}")
        return ways[header.data](header, stream)


@dataclass(frozen=True)
class _Header:
    file: Path
    record: np.dtype[np.void]
    points: int
    data: str


def _read_header(file: Path, stream: BinaryIO) -> _Header:
    words: dict[str, list[str]] = {}
    for number in range(1, MOST_LINES + 1):
        line = stream.readline(10_000)
        key, *rest = line.decode("ascii", "replace").split() or [""]
        if line and (not key or key.startswith("#")):
            continue
        if key not in KEYS or not rest:
            _fail(file, f"found '{key[:20]}', allowed {', '.join(KEYS)} and a value", number)
        words[key] = rest
        if key == "DATA":
            break
    absent = [key for key in NEEDED if key not in words]
    if absent:
        _fail(file, f"found no {', '.join(absent)} in the header, needed")
    words.setdefault("COUNT", ["1"] * len(words["FIELDS"]))
    return _Header(file, _record(file, words), _count(file, "POINTS", words), words["DATA"][0])


def _record(file: Path, words: dict[str, list[str]]) -> np.dtype[np.void]:
    names, sizes, letters, counts = (words[key] for key in ("FIELDS", "SIZE", "TYPE", "COUNT"))
    if not len(names) == len(sizes) == len(letters) == len(counts):
        _fail(file, "FIELDS, SIZE, TYPE, COUNT: found different lengths, allowed the same")
    fields = []
    for i, (name, size, letter, count) in enumerate(
        zip(names, sizes, letters, counts, strict=True)
    ):
        if letter + size not in TYPES:
            _fail(file, f"{name}: found TYPE {letter} SIZE {size}, allowed {', '.join(TYPES)}")
        if not count.isdecimal() or len(count) > 5 or not 1 <= int(count) <= 10_000:
            _fail(file, f"{name}: found COUNT {count[:20]}, allowed 1 to 10000")
        shape = () if count == "1" else (int(count),)
        fields.append((f"_{i}" if name == "_" else name, TYPES[letter + size], shape))
    try:
        return np.dtype(fields)
    except ValueError as error:
        _fail(file, f"FIELDS: {error}")


def _count(file: Path, key: str, words: dict[str, list[str]]) -> int:
    if not words[key][0].isdecimal() or len(words[key][0]) > len(str(MOST_POINTS)):
        found = words[key][0][:20]
        _fail(file, f"{key}: found '{found}', allowed a whole number from 0 to {MOST_POINTS}")
    return int(words[key][0])


def _ascii(header: _Header, stream: BinaryIO) -> Records:
    lines = stream.read().decode("ascii", "replace").splitlines()
    lines = [line for line in lines if line.strip()]
    if len(lines) != header.points:
        _fail(header.file, f"found {len(lines)} points, allowed {header.points}")
    if not lines:
        return np.empty(0, dtype=header.record)
    try:
        return np.atleast_1d(np.loadtxt(io.StringIO("\n".join(lines)), dtype=header.record))
    except ValueError as error:
        _fail(header.file, f"points: {error}")


def _binary(header: _Header, stream: BinaryIO) -> Records:
    size = header.points * header.record.itemsize
    data = stream.read()
    if len(data) < size:
        _fail(header.file, f"found {len(data)} bytes of points, allowed {size}: is it cut short?")
    return np.frombuffer(data, dtype=header.record, count=header.points)


def _compressed(header: _Header, stream: BinaryIO) -> Records:
    """One field after another, all of it by LZF."""
    try:
        import lzf
    except ImportError:
        raise missing("python-neo-lzf", "exchange") from None
    size = header.points * header.record.itemsize
    if size == 0:
        return np.empty(0, dtype=header.record)
    lengths, data = stream.read(8), stream.read()
    packed, unpacked = struct.unpack("<II", lengths) if len(lengths) == 8 else (0, 0)
    if unpacked != size or len(data) < packed or len(lengths) < 8 or size > MOST_LZF * packed:
        found = f"{len(data)} of {packed} packed bytes for {unpacked}"
        _fail(header.file, f"found {found}, allowed all of them for {size}: is it cut short?")
    try:
        plain = lzf.decompress(data[:packed], size)
    except ValueError:
        plain = None
    if plain is None or len(plain) != size:
        _fail(header.file, "points: found no LZF data, allowed what DATA binary_compressed says")
    out = np.empty(header.points, dtype=header.record)
    start = 0
    for name in header.record.names or ():
        column = out[name]
        out[name] = np.frombuffer(plain, column.dtype, column.size, start).reshape(column.shape)
        start += column.nbytes
    return out


def _fail(file: Path, what: str, line: int | None = None) -> NoReturn:
    raise FormatError(f"{file}:{line}: {what}" if line else f"{file}: {what}")
