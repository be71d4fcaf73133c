"""Reads float32 .bin clouds. The first columns are x y z intensity."""

from pathlib import Path

from pyinfra.exchange.bin_columns import columns_of
from pyinfra.exchange.label_files import clouds_in, open_labels
from pyinfra.exchange.recording import (
    NO_BOXES,
    Options,
    RecordedFrame,
    Recording,
    read_bin,
    stem,
)


def read(source: Path, options: Options) -> Recording:
    """Opens a folder of .bin clouds. Labels are optional.

    Raises FileNotFoundError, and Error if there is no cloud. Reading a frame raises FormatError.
    """
    clouds = clouds_in(source, [".bin"])
    labels = open_labels(clouds, source, options)
    clouds = labels.clouds if labels else clouds
    columns, note = columns_of(clouds, options)
    names = tuple(stem(file) for file in clouds)
    notes = [*(labels.notes if labels else ()), *([note] if note else [])]

    def frame(i: int) -> RecordedFrame:
        boxes = labels.read(names[i]) if labels else NO_BOXES
        return RecordedFrame(read_bin(clouds[i], columns, options), boxes)

    return Recording(
        names,
        frame,
        labelled=labels is not None,
        tracks_sha256=labels.tracks_sha256 if labels else "",
        notes=lambda: notes,
        reads=(*clouds, *(labels.files if labels else ())),
    )
