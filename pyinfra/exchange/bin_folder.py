"""Reads float32 .bin clouds. The first columns are x y z intensity."""

from pathlib import Path

from pyinfra.exchange.bin_columns import columns_of
from pyinfra.exchange.label_files import clouds_in, open_labels
from pyinfra.exchange.recording import Options, RecordedFrame, Recording, read_bin, stem


def read(source: Path, options: Options) -> Recording:
    """Opens a folder of .bin clouds. Labels are optional.

    Raises FileNotFoundError, and Error if there is no cloud. Reading a frame raises FormatError.
    """
    labels = open_labels(clouds_in(source, [".bin"]), source, options)
    columns, note = columns_of(labels.clouds, options)
    names = tuple(stem(file) for file in labels.clouds)

    def frame(i: int) -> RecordedFrame:
        boxes = labels.read(names[i])
        return RecordedFrame(read_bin(labels.clouds[i], columns, options), boxes)

    return Recording(
        names,
        frame,
        labels.labelled,
        tracks_sha256=labels.tracks_sha256,
        notes=lambda: [*labels.notes, *([note] if note else [])],
        reads=(*labels.clouds, *labels.files),
    )
