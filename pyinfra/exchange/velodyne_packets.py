"""Reads .pcap packets of Velodyne LiDARs with velodyne-decoder.

For packets of other makers, there is no suitable open package. The error message then names the
program that converts the packets to a bag, which the import reads.
"""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import velodyne_decoder as velodyne
from velodyne_decoder.util import iter_pcap

from pyinfra.core.arrays import Records
from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange.point_fields import PointFields
from pyinfra.exchange.record_clouds import FIRST, points_of
from pyinfra.exchange.recording import (
    NO_BOXES,
    Options,
    RecordedFrame,
    Recording,
    sorted_files,
)

SAMPLED = 300  # number of first packets from which the maker is determined
# First bytes of the packets of other makers, the maker, and a program that converts them to a bag.
OTHERS = (
    (b"\xee\xff", "Hesai", "HesaiLidar_ROS_2.0 (`source_type: 2`)"),
    (b"\x55\xaa\x05\x0a", "RoboSense", "rslidar_sdk (`msg_source: 3`)"),
    (b"\x55\xaa\x5a\xa5", "RoboSense", "rslidar_sdk (`msg_source: 3`)"),
)
OUSTER_BYTES = range(3000, 34_000)  # packet sizes of Ouster; other makers' packets are smaller


def read(source: Path, options: Options) -> Recording:
    """Opens a .pcap file, or a folder with one.

    Raises Error for packets of another maker. Reading a frame raises FormatError.
    """
    files = sorted_files(source, [".pcap"]) if source.is_dir() else [source]
    if len(files) > 1:
        names = ", ".join(file.name for file in files[:4])
        raise Error(f"{source}: expected one .pcap file, got {names}; merge them with mergecap")
    packets = Packets(files[0])
    stamps = packets.stamps()
    fields = PointFields(packets.records(i) for i in range(min(FIRST, len(stamps))))

    def frame(i: int) -> RecordedFrame:
        location, records = f"{files[0]}: turn {i}", packets.records(i)
        points = points_of(location, records, options)
        return RecordedFrame(points, NO_BOXES, fields.read(location, records))

    return Recording(
        tuple(f"{i:06d}" for i in range(len(stamps))),
        frame,
        labelled=False,
        times=lambda: np.array(stamps),
        notes=lambda: fields.notes,
        slots=tuple(range(len(stamps))),
        reads=(files[0],),
    )


class Packets:
    """The turns (revolutions) of a LiDAR in a .pcap file, which are decoded in order."""

    def __init__(self, file: Path) -> None:
        self.file = file
        _check_maker(file)
        self._turns: Iterator[Any] = iter(())
        self._next = -1

    def stamps(self) -> list[float]:
        """Returns the time of each turn in seconds since 1970. Raises Error without a turn."""
        stamps = [
            float(stamp.host if hasattr(stamp, "host") else stamp) for stamp, _ in self._all()
        ]
        if not stamps:
            raise Error(f"{self.file}: expected one or more complete turns of the LiDAR, got none")
        return stamps

    def records(self, i: int) -> Records:
        """Returns the points (n,) of a turn."""
        if self._next != i:
            self._turns, self._next = self._all(), 0
        for _, cloud in self._turns:
            self._next += 1
            if self._next == i + 1:
                return np.asarray(cloud)
        raise FormatError(f"{self.file}: turn {i}: expected points, got the end of the file")

    def _all(self) -> Iterator[Any]:
        try:
            yield from velodyne.read_pcap(self.file, as_pcl_structs=True)
        except Error:
            raise
        except Exception as error:  # the decoder raises many types of exceptions
            raise FormatError(f"{self.file}: cannot be decoded: {str(error)[:200]}") from None


def _check_maker(file: Path) -> None:
    """Raises Error unless some of the first packets are Velodyne's."""
    sizes: set[int] = set()
    try:
        for _, data in islice(iter_pcap(file), SAMPLED):
            data = bytes(data) if not isinstance(data, bytes) else data
            if len(data) == velodyne.PACKET_SIZE and data[:2] in (b"\xff\xee", b"\xff\xdd"):
                return
            for magic, maker, program in OTHERS:
                if data.startswith(magic):
                    raise Error(_other(file, maker, program))
            sizes.add(len(data))
    except (Error, OSError):
        raise
    except Exception as error:  # dpkt raises many types of exceptions for damaged files
        raise FormatError(f"{file}: cannot be read as .pcap: {str(error)[:200]}") from None
    if any(size in OUSTER_BYTES for size in sizes):
        raise Error(_other(file, "Ouster", f"`ouster-cli source {file.name} save out.bag`"))
    listed = ", ".join(map(str, sorted(sizes)[:6]))
    raise Error(
        f"{file}: expected packets of a Velodyne LiDAR ({velodyne.PACKET_SIZE} bytes) in .pcap, "
        f"got {f'packets of {listed} bytes' if listed else 'no packets'}; record the PointCloud2 "
        "of the sensor's driver to a bag, or save clouds as .pcd"
    )


def _other(file: Path, maker: str, program: str) -> str:
    return (
        f"{file}: expected packets of a Velodyne LiDAR in .pcap, got packets of {maker}: convert "
        f"them to a bag with PointCloud2 by {program}, and import the bag"
    )
