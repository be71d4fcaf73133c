"""The KITTI object layout of any camera: training/velodyne, label_2, calib, and ImageSets."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pyinfra import kitti
from pyinfra.arrays import FloatArray, Records
from pyinfra.exchange.bin_columns import columns_of
from pyinfra.exchange.recording import (
    NO_BOXES,
    Boxes,
    Options,
    RecordedFrame,
    Recording,
    check_pairs,
    read_bin,
    read_splits,
    sorted_files,
    stem,
)
from pyinfra.kitti import FormatError

# Middle of the share that KITTI's `occluded` 0, 1, 2 stands for here; 3 is unknown.
VISIBILITY = (0.9, 0.6, 0.2, 1.0)


def read(source: Path, options: Options) -> Recording:
    """A folder with `training` in it, or `training` itself; without label_2 nothing is labelled.

    Raises FileNotFoundError, ValueError for labels that do not pair with clouds, and on reading a
    frame FormatError. A frame without calib has the camera of a simulated LiDAR.
    """
    training = source / "training" if (source / "training").is_dir() else source
    clouds = sorted_files(training / "velodyne", [".bin"])
    folder = options.labels or training / "label_2"
    labelled = folder.is_dir() or options.labels is not None
    if labelled:
        check_pairs(clouds, sorted_files(folder, [".txt"]))
    names = tuple(stem(file) for file in clouds)
    columns, said = columns_of(clouds, options)

    def frame(i: int) -> RecordedFrame:
        points = read_bin(clouds[i], columns, options)
        calib = training / f"calib/{names[i]}.txt"
        boxes = _boxes(folder / f"{names[i]}.txt", calib) if labelled else NO_BOXES
        fields = training / f"fields/{names[i]}.bin"
        return RecordedFrame(points, boxes, _fields(fields, len(points)))

    splits = read_splits(source / "ImageSets", names)
    return Recording(names, frame, labelled, splits, notes=lambda: [said] if said else [])


def _fields(file: Path, count: int) -> Records | None:
    found = kitti.read_fields(file) if file.is_file() else None
    if found is not None and len(found) != count:
        raise FormatError(f"{file}: found {len(found)} records, allowed {count}, as points")
    return found


def _boxes(file: Path, calib: Path) -> Boxes:
    calibration = kitti.read_calibration(calib) if calib.is_file() else None
    labels = kitti.read_labels(file, calibration=calibration)
    assert labels.image is not None
    return Boxes(labels.names, labels.boxes, visibility=_visibility(labels.image[:, 1]))


def _visibility(occluded: FloatArray) -> FloatArray:
    level = np.where(np.isin(occluded, (0, 1, 2)), occluded, 3).astype(np.int64)
    return np.array(VISIBILITY)[level]
