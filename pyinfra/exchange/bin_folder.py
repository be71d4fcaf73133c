"""Reads a folder of float32 .bin clouds without labels. The first columns are x y z intensity."""

from __future__ import annotations

from pathlib import Path

from pyinfra.exchange.bin_columns import columns_of
from pyinfra.exchange.recording import (
    NO_BOXES,
    Options,
    RecordedFrame,
    Recording,
    read_bin,
    sorted_files,
    stem,
)


def read(source: Path, options: Options) -> Recording:
    """Opens a folder of .bin clouds.

    Raises FileNotFoundError, and Error if there is no cloud. Reading a frame raises FormatError.
    """
    clouds = sorted_files(source, [".bin"])
    columns, note = columns_of(clouds, options)

    def frame(i: int) -> RecordedFrame:
        return RecordedFrame(read_bin(clouds[i], columns, options), NO_BOXES)

    names = tuple(stem(file) for file in clouds)
    return Recording(names, frame, labelled=False, notes=lambda: [note] if note else [])
