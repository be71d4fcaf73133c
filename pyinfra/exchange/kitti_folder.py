"""Reads the KITTI object layout with any camera: training/velodyne, label_2, calib, ImageSets.

The module also reads a sequence of the tracking benchmark, whose format is described in the readme
of the benchmark's devkit.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.errors import FormatError
from pyinfra.exchange.bin_columns import columns_of
from pyinfra.exchange.recording import (
    NO_BOXES,
    Boxes,
    Options,
    RecordedFrame,
    Recording,
    check_pairs,
    digest_of,
    read_bin,
    read_splits,
    selected,
    sorted_files,
    stem,
)
from pyinfra.formats import kitti
from pyinfra.formats.kitti.camera import boxes_from_camera
from pyinfra.formats.kitti.layout import LABEL_COLUMNS
from pyinfra.formats.kitti.read import LABEL_RULES
from pyinfra.formats.text_table import NamedRows, between, lines_of

# Assumed visible share for the values 0, 1, 2 and 3 (unknown) of KITTI's `occluded`.
VISIBILITY = (0.9, 0.6, 0.2, 1.0)


def read(source: Path, options: Options) -> Recording:
    """Opens a folder that contains `training`, or the folder `training`. label_2 is optional.

    In a folder of the tracking benchmark, one sequence is read by `_read_sequence`. A frame without
    a calib file gets the camera of a simulated LiDAR.
    Raises FileNotFoundError, and Error for labels that do not pair with clouds. Reading a frame
    raises FormatError.
    """
    training = source / "training" if (source / "training").is_dir() else source
    inside = [path for path in (training / "velodyne").iterdir() if path.name[0] != "."]
    if inside and all(path.is_dir() for path in inside):
        return _read_sequence(training, sorted(inside), options)
    clouds = sorted_files(training / "velodyne", [".bin"])
    usual = training / "label_2"
    folder = options.labels or (usual if usual.is_dir() else None)
    if folder is not None:
        check_pairs(clouds, sorted_files(folder, [".txt"]))
    names = tuple(stem(file) for file in clouds)
    columns, note = columns_of(clouds, options)

    def frame(i: int) -> RecordedFrame:
        points = read_bin(clouds[i], columns, options)
        calib = training / f"calib/{names[i]}.txt"
        objects = training / f"objects/{names[i]}.csv"
        boxes = _boxes(folder / f"{names[i]}.txt", calib, objects) if folder else NO_BOXES
        file = training / f"fields/{names[i]}.bin"
        fields = kitti.read_fields(file, len(points)) if file.is_file() else None
        return RecordedFrame(points, boxes, fields)

    splits, notes = read_splits(source / "ImageSets", names)
    notes += [note] if note else []
    bare = [name for name in names if not (training / f"calib/{name}.txt").is_file()]
    if folder is not None and bare:
        notes.append(_without_calib(len(bare), len(names)))
    beside = [training / name for name in ("calib", "objects", "fields")]
    reads = (*clouds, *([folder] if folder else ()), *beside, source / "ImageSets")
    return Recording(names, frame, folder is not None, splits, notes=lambda: notes, reads=reads)


def _read_sequence(training: Path, sequences: Sequence[Path], options: Options) -> Recording:
    """Opens a tracking sequence: velodyne/0000/*.bin, label_02/0000.txt and calib/0000.txt.

    `options.channel` selects one of several sequences. A row of label_02 begins with frame and
    track id.
    """
    known = [path.name for path in sequences]
    sequence = sequences[selected(training / "velodyne", known, options.channel, "sequence")]
    clouds = sorted_files(sequence, [".bin"])
    columns, note = columns_of(clouds, options)
    names = tuple(stem(file) for file in clouds)
    file = (options.labels or training / "label_02") / f"{sequence.name}.txt"
    calib = training / f"calib/{sequence.name}.txt"
    tracks = _tracks(file, calib) if file.is_file() else {}
    with_cloud = {int(name) for name in names if name.isdecimal()}
    lost = sorted(set(tracks) - with_cloud)
    notes = [note] if note else []
    if file.is_file() and not calib.is_file():
        notes.append(_without_calib(len(names), len(names)))
    if lost:
        notes.append(
            f"{len(lost)} labelled frames, such as {lost[0]}, have no cloud and are left out"
        )

    def frame(i: int) -> RecordedFrame:
        points = read_bin(clouds[i], columns, options)
        boxes = tracks.get(int(names[i]), NO_BOXES) if names[i].isdecimal() else NO_BOXES
        return RecordedFrame(points, boxes)

    labelled = file.is_file()
    return Recording(
        names,
        frame,
        labelled,
        tracks_sha256=digest_of([file]) if labelled else "",
        notes=lambda: notes,
        reads=(*clouds, file, calib),
    )


def _without_calib(count: int, frames: int) -> str:
    return (
        f"{count} of {frames} frames have no calib file: labels are assumed to be in the camera "
        "frame of a simulated LiDAR, whose camera is at the sensor"
    )


def _tracks(file: Path, calib: Path) -> dict[int, Boxes]:
    """Maps each frame that has boxes to its boxes. Raises FormatError with file and line."""
    rows = {i: line.split() for i, line in enumerate(lines_of(file), start=1) if line.strip()}
    columns = ["frame", "track_id", *LABEL_COLUMNS]
    table = NamedRows(file, list(rows), list(rows.values()), columns, "type")
    cared = table.names != "DontCare"
    table.check((between(["frame"], 0, 999_999, whole=True),))
    table.check((between(["track_id"], 0, 2**31 - 1, whole=True), *LABEL_RULES), cared)
    camera = kitti.read_calibration(calib) if calib.is_file() else kitti.simulated()
    values, names = table.values[cared], table.names[cared]
    boxes = boxes_from_camera(values[:, 9:16], camera)
    numbers, ids = values[:, 0].astype(np.int64), values[:, 1].astype(np.int64)
    by_frame = {}
    for number in np.unique(numbers):
        in_frame = numbers == number
        known, counts = np.unique(ids[in_frame], return_counts=True)
        if (counts > 1).any():
            twice = known[counts > 1][0]
            raise FormatError(
                f"{file}: frame {number}: expected each track_id once, got {twice} twice"
            )
        visibility = _visibility(values[in_frame, 3])
        by_frame[int(number)] = Boxes(names[in_frame], boxes[in_frame], ids[in_frame], visibility)
    return by_frame


def _boxes(file: Path, calib: Path, objects: Path) -> Boxes:
    calibration = kitti.read_calibration(calib) if calib.is_file() else None
    labels = kitti.read_labels(file, calibration=calibration)
    assert labels.image is not None
    if known := known_objects(objects, labels):
        return Boxes(labels.names, labels.boxes, *known)
    return Boxes(labels.names, labels.boxes, visibility=_visibility(labels.image[:, 1]))


def known_objects(file: Path, labels: kitti.Labels) -> tuple[IntArray, FloatArray] | None:
    """Returns ids and visibility (k,) of the labels of a frame, read from its file of `objects`.

    This package writes the file beside the labels, with the same objects in the same order. Labels
    may lack objects without points. Returns None if the file does not exist or does not fit the
    labels. Raises FormatError.
    """
    if not file.is_file():
        return None
    objects = kitti.read_objects(file)
    rows = np.arange(len(objects))
    if len(rows) != len(labels):
        rows = np.flatnonzero(objects.points > 0)
    if not np.array_equal(objects.names[rows], labels.names):
        return None
    return objects.ids[rows], objects.visibility[rows]


def _visibility(occluded: FloatArray) -> FloatArray:
    level = np.where(np.isin(occluded, (0, 1, 2)), occluded, 3).astype(np.int64)
    return np.array(VISIBILITY)[level]
