"""A folder of .bin clouds without labels: float32, the first four columns x y z intensity."""

from __future__ import annotations

from pathlib import Path

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
    """Raises FileNotFoundError, ValueError without a cloud, and on reading one FormatError."""
    clouds = sorted_files(source, [".bin"])

    def frame(i: int) -> RecordedFrame:
        return RecordedFrame(read_bin(clouds[i], 4, options), NO_BOXES)

    return Recording(tuple(stem(file) for file in clouds), frame, labelled=False)
