"""Reads .ply clouds, one file per frame: the properties of the element `vertex`.

Follows the public description ("The PLY Polygon File Format", Greg Turk, 1994).
"""

from pathlib import Path
from typing import BinaryIO

import numpy as np

from pyinfra.core.arrays import Records
from pyinfra.core.errors import fail
from pyinfra.exchange.record_clouds import read_clouds
from pyinfra.exchange.recording import Options, Recording
from pyinfra.formats.pcd_file import text_records

TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    **{f"int{8 * n}": f"i{n}" for n in (1, 2, 4, 8)},
    **{f"uint{8 * n}": f"u{n}" for n in (1, 2, 4, 8)},
    "float32": "f4",
    "float64": "f8",
}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "<"}
MOST_LINES = 1000


def read(source: Path, options: Options) -> Recording:
    """Opens a .ply file, or a folder of them. Reading a frame raises FormatError."""
    return read_clouds(source, [".ply"], read_ply, options)


def read_ply(file: Path) -> Records:
    """Reads the vertices (n,) with all their properties; other elements may follow them.

    Raises FormatError with the line in the header.
    """
    with file.open("rb") as stream:
        encoding, count, kinds = _header(file, stream)
        data = stream.read()
    try:
        dtype = np.dtype(kinds)
    except ValueError as error:
        fail(file, f"element vertex: {error}")
    if encoding == "ascii":
        lines = data.decode("ascii", "replace").splitlines()[:count]
        if len(lines) < count:
            fail(file, f"expected {count} vertices, got {len(lines)} lines")
        return text_records(file, lines, dtype, "vertices")
    if len(data) < count * dtype.itemsize:
        fail(file, f"expected {count * dtype.itemsize} bytes of vertices, got {len(data)}")
    return np.frombuffer(data, dtype, count)


def _header(file: Path, stream: BinaryIO) -> tuple[str, int, list[tuple[str, str]]]:
    if stream.readline(100).strip() != b"ply":
        fail(file, "expected 'ply' as the first line, got a different line or an empty file", 1)
    encoding, elements, kinds, count = "", [], [], -1
    for number in range(2, MOST_LINES):
        line = stream.readline(10_000)
        words = line.decode("ascii", "replace").split()
        if words == ["end_header"] or not line:
            break
        if words[:1] == ["format"] and len(words) == 3 and words[1] in ORDERS:
            encoding = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            elements.append(words[1])
            if words[1] == "vertex":
                if not words[2].isdecimal() or len(words[2]) > 9:
                    fail(file, f"element vertex: expected a count, got '{words[2][:20]}'", number)
                count = int(words[2])
        elif words[:1] == ["property"] and elements[-1:] == ["vertex"]:
            if len(words) != 3 or words[1] not in TYPES:
                fail(file, f"expected a property with one value per vertex, got {words}", number)
            kinds.append((words[2].lower(), ORDERS[encoding or "ascii"] + TYPES[words[1]]))
        elif words and words[0] not in ("property", "comment", "obj_info"):
            fail(file, f"expected format, element or property, got '{words[0][:20]}'", number)
    if not encoding or count < 0 or not kinds or elements[0] != "vertex":
        fail(
            file,
            "expected a header with a format and then the element vertex with properties, got a "
            "header without one of them or in another order",
        )
    return encoding, count, kinds
