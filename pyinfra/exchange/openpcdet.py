"""Reads and writes OpenPCDet's custom layout: points/*.npy, labels/*.txt, ImageSets, cfgs.

The layout follows the public guide "Custom Dataset Tutorial". The class names come from OpenPCDet's
CustomDataset, which also requires a label in each listed frame.
"""

import io
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tokenize import TokenError

import numpy as np

from pyinfra.core.arrays import Points
from pyinfra.core.errors import FormatError
from pyinfra.core.files import write
from pyinfra.exchange.bin_columns import columns_of
from pyinfra.exchange.box_text import write_boxes
from pyinfra.exchange.label_files import open_labels
from pyinfra.exchange.openpcdet_configs import write_configs
from pyinfra.exchange.recording import (
    Options,
    RecordedFrame,
    Recording,
    as_points,
    read_bin,
    read_splits,
    sorted_files,
    stem,
    write_splits,
)
from pyinfra.exchange.road_level import (
    SENSOR_FILE,
    read_labels,
    read_sensor_height,
    road_frames,
    site_of,
    train_and_val,
    write_sensor,
)
from pyinfra.formats import kitti

# Exceptions of NumPy for an invalid .npy header, which NumPy evaluates as a Python literal.
_UNREADABLE = (
    *(ValueError, TypeError, EOFError, MemoryError, OverflowError, RecursionError, TokenError),
)


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes the frames with the road moved to z = 0. Raises Error if no frame has a vehicle."""
    labels = read_labels(lidar_folder, frames)
    site = site_of(lidar_folder, labels)
    # OpenPCDet's info script fails on a frame without a label. Therefore frames without a label are
    # written, but not listed in ImageSets.
    listed = {k for k, entries in zip(frames, labels, strict=True) if len(entries) > 0}
    lists = train_and_val(lidar_folder, frames).items()
    write_splits(out / "ImageSets", {part: [k for k in ks if k in listed] for part, ks in lists})
    write_sensor(out, site)
    write_configs(out, site.vehicles, kitti.read_lidar(lidar_folder))
    for part in ("points", "labels"):
        (out / part).mkdir()
    for frame in road_frames(lidar_folder, frames, labels, site):
        _write_cloud(out / f"points/{frame.number:06d}.npy", frame.points)
        write_boxes(out / f"labels/{frame.number:06d}.txt", frame.names, frame.boxes)


def read(source: Path, options: Options) -> Recording:
    """Opens a folder in this layout. Clouds may also be points/*.bin. labels/ is optional.

    If there is a `sensor.yaml`, z is converted from height above the road to height above the
    sensor. Raises FileNotFoundError, and Error for labels that do not pair with clouds. Reading a
    frame raises FormatError.
    """
    labels = open_labels(sorted_files(source / "points", [".npy", ".bin"]), source, options)
    clouds = labels.clouds
    height = read_sensor_height(source)
    names = tuple(stem(file) for file in clouds)
    bins = [file for file in clouds if file.suffix.lower() == ".bin"]
    columns, note = columns_of(bins, options)

    def frame(i: int) -> RecordedFrame:
        points = _read_cloud(clouds[i], columns, options)
        points[:, 2] -= np.float32(height)
        boxes = labels.read(names[i])
        lowered = boxes.boxes - [0, 0, height, 0, 0, 0, 0]
        return RecordedFrame(points, replace(boxes, boxes=lowered))

    splits, notes = read_splits(source / "ImageSets", names)
    notes += [*labels.notes, *([note] if note else [])]
    return Recording(
        names,
        frame,
        labels.labelled,
        splits,
        tracks_sha256=labels.tracks_sha256,
        notes=lambda: notes,
        reads=(
            *(*clouds, *labels.files),
            *(source / name for name in ("ImageSets", SENSOR_FILE, "cfgs")),
        ),
    )


def _write_cloud(file: Path, points: Points) -> None:
    """Writes a .npy file with `write`, because `np.save` may not raise an error for a full disk."""
    buffer = io.BytesIO()
    np.save(buffer, points)
    write(file, buffer.getvalue())


def _read_cloud(file: Path, columns: int, options: Options) -> Points:
    """Reads points (n, 4). Pickled objects in a .npy file are never read. Raises FormatError."""
    if file.suffix.lower() == ".bin":
        return read_bin(file, columns, options)
    try:
        with warnings.catch_warnings(action="ignore"):  # NumPy warns about headers of Python 2
            # A memory map compares the file size with the header before it allocates memory.
            points = np.lib.format.open_memmap(file, mode="r")
    except _UNREADABLE as error:
        raise FormatError(f"{file}: cannot be read as an array of numbers: {error}") from None
    if points.ndim != 2 or points.shape[1] < 4 or points.dtype.kind != "f":
        raise FormatError(
            f"{file}: expected an array (n, 4 or more) of floats with columns x y z intensity, got "
            f"{points.shape} {points.dtype}"
        )
    return as_points(file, list(points.T[:4]), options)
