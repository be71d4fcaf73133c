"""Reads .las and .laz clouds, one file per frame, with laspy."""

import struct
from pathlib import Path

import laspy
import numpy as np

from pyinfra.core.arrays import Records, unchecked
from pyinfra.core.errors import FormatError
from pyinfra.exchange.record_clouds import read_clouds
from pyinfra.exchange.recording import Options, Recording, records_of

FIELDS = ("intensity", "gps_time", "ring", "line", "reflectivity", "timestamp", "scan_channel")
MOST_POINTS = 200_000_000
LEAST_POINT_BYTES = 20  # minimum size of a point in LAS; LAZ is up to RATIO times smaller
RATIO = 20
HEAD_BYTES, OLD_HEAD_BYTES = 375, 227  # header sizes of versions 1.4 and 1.2
COMPRESSED = 0x80  # bit that marks a compressed file (LAZ) in the header's point format
RECORD_BYTES, EXTENDED_BYTES = 54, 60  # header sizes of variable length records and extended ones


def read(source: Path, options: Options) -> Recording:
    """Opens a .las or .laz file, or a folder of them. Reading a frame raises FormatError."""
    return read_clouds(source, [".las", ".laz"], read_las, options)


@unchecked
def read_las(file: Path) -> Records:
    """Reads a file into records (n,) with x, y, z and all fields of FIELDS that it has.

    Raises FormatError for a file that laspy cannot read.
    """
    _check_counts(file)
    try:
        # With a damaged file, the parallel decompressor allocates too much memory, and the process
        # ends.
        with laspy.open(file, laz_backend=laspy.LazBackend.Lazrs) as stream:
            count = stream.header.point_count
            most = min(MOST_POINTS, RATIO * file.stat().st_size // LEAST_POINT_BYTES)
            if count > most:
                raise FormatError(
                    f"{file}: expected at most {most} points in a LAS file of this size, got "
                    f"{count}; save the file again, for example with PDAL"
                )
            cloud = stream.read()
    except FormatError:
        raise
    except Exception as error:  # laspy raises many types of exceptions for damaged files
        raise FormatError(
            f"{file}: cannot be read as LAS or LAZ: {str(error)[:200]}; save the file again, for "
            "example with PDAL or CloudCompare"
        ) from None
    names = {name.lower(): name for name in cloud.point_format.dimension_names}
    present = [name for name in FIELDS if name in names]
    columns = {axis: np.asarray(cloud[axis], dtype=np.float64) for axis in "xyz"}
    return records_of(columns | {name: np.asarray(cloud[names[name]]) for name in present})


def _check_counts(file: Path) -> None:
    """Raises FormatError for more records than the file can hold, which laspy would read for hours.

    The offsets are those of the public header block: version 1.4 also has extended records.
    """
    size = file.stat().st_size
    with file.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    if len(head) < OLD_HEAD_BYTES:
        raise FormatError(
            f"{file}: expected a LAS header of {OLD_HEAD_BYTES} or more bytes, got {len(head)}"
        )
    records, extended = struct.unpack_from("<I", head, 100)[0], 0
    if head[25] >= 4 and len(head) >= HEAD_BYTES:
        (extended,) = struct.unpack_from("<I", head, 243)
    if records * RECORD_BYTES + extended * EXTENDED_BYTES > size:
        raise FormatError(
            f"{file}: expected records that fit the file's {size} bytes, got {records} variable "
            f"length records and {extended} extended ones"
        )
    if head[104] & COMPRESSED:
        _check_chunks(file, size, struct.unpack_from("<I", head, 96)[0])


def _check_chunks(file: Path, size: int, at: int) -> None:
    """Raises FormatError for a LAZ file with more chunks than it can hold.

    The points begin with the position of the table of chunks, which is -1 if the position is in the
    last 8 bytes of the file. The table begins with a version and the number of chunks.
    """
    with file.open("rb") as stream:
        stream.seek(at)
        position = int.from_bytes(stream.read(8), "little", signed=True)
        if position == -1 and size >= 8:
            stream.seek(size - 8)
            position = int.from_bytes(stream.read(8), "little", signed=True)
        stream.seek(min(max(position, 0), size))
        table = stream.read(8)
    chunks = int.from_bytes(table[4:], "little")
    if len(table) < 8 or not 0 <= position < size or chunks > size // LEAST_POINT_BYTES:
        raise FormatError(
            f"{file}: expected a chunk table that fits the file's {size} bytes, got {chunks} chunks"
        )
