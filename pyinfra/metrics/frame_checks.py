"""Checks of frames and predictions: `pyinfra validate DATA [--pred DIR]`.

Files that can't be read as their format says are errors. What makes most toolboxes show an AP of 0
on roadside frames is named: heights, ranges, filters by the image, headings, frames of reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.errors import FormatError
from pyinfra.dataset.data_set import read_data_set, read_lidars
from pyinfra.dataset.frame_tables import (
    Vehicles,
    other_types,
    read_cameras,
    read_labelled,
    read_predictions,
    read_vehicles,
)
from pyinfra.dataset.frames import data_set_of, frame_numbers
from pyinfra.dataset.outlines import OUTLINES_FILE, read_outlines
from pyinfra.dataset.regions import read_roads
from pyinfra.formats import kitti
from pyinfra.formats.text_table import lines_of
from pyinfra.metrics.ground_truth_checks import ground_truth_findings
from pyinfra.metrics.match_results import Settings
from pyinfra.metrics.prediction_checks import Finding, check_predictions, find_files

MOST_ERRORS = 20  # listed
CLOUDS = 50  # looked into, spread over all
USUAL_LOW_Z = -3.0  # where the point range of the usual car-mounted configurations ends
USUAL_FAR_M = 70.4
HEIGHT_FILTER_PX = 25.0  # of the 2-D box; KITTI's tools leave out lower ones
MARGIN_M = 0.1  # around a box that is to hold points


def validate(
    folder: Path, pred: Path | None = None, split: str | None = None, *, allow_missing: bool = False
) -> list[Finding]:
    """Everything that was found in a LiDAR's folder, and in predictions of its frames.

    Raises FileNotFoundError if the folder is none of the KITTI layout.
    """
    frames = frame_numbers(folder, "all")
    if not frames:
        return [Finding("error", "no-frames", f"{folder}: found no frame, allowed one or more")]
    found = [*_unreadable(folder, frames), *_unreadable_data_set(folder)]
    if found:
        return found
    vehicles = read_vehicles(folder, frames)
    types = Settings().types
    found += ground_truth_findings(folder, frames, vehicles, types)
    labelled = read_labelled(folder, frames)  # which other tools read
    if vehicles.ids.max(initial=-1) >= 0 and (
        other := other_types(folder, frames, labelled, types)
    ):
        found.append(Finding("warning", "other-types", other))
    found += [*_labels(folder, frames), *_clouds(folder, frames), *_ranges(folder, vehicles)]
    if pred is not None:
        found += _predictions(folder, pred, split, allow_missing)
    return found


def _unreadable(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    """Errors of the text files, the first MOST_ERRORS of them."""
    readers: dict[kitti.Part, Callable[[Path], object]] = {
        "label_2": kitti.read_labels,
        "objects": kitti.read_objects,
        "calib": kitti.read_calibration,
    }
    errors = []
    for part, read in readers.items():
        if part != "label_2" and not (folder / "training" / part).is_dir():
            continue
        for frame in frames:
            try:
                read(kitti.frame_file(folder, part, frame))
            except FileNotFoundError as error:
                errors.append(Finding("error", "missing-file", f"{error.filename}: missing"))
            except FormatError as error:
                errors.append(Finding("error", "wrong-file", str(error)))
    yield from errors[:MOST_ERRORS]
    if len(errors) > MOST_ERRORS:
        more = f"{folder}: {len(errors) - MOST_ERRORS} more errors"
        yield Finding("error", "more-errors", more)


def _unreadable_data_set(folder: Path) -> Iterator[Finding]:
    """Errors of what describes the LiDARs and the region, where they are described."""
    data_set = data_set_of(folder)
    checks: dict[Path, Callable[[], object]] = {}
    if (folder / "lidar.yaml").is_file():
        checks[folder / "lidar.yaml"] = partial(read_lidars, data_set)
        checks[data_set / "roads.csv"] = partial(read_roads, data_set / "roads.csv")
        checks[data_set / OUTLINES_FILE] = partial(read_outlines, data_set)
        checks[data_set / "dataset.yaml"] = partial(read_data_set, data_set)
    for file, check in checks.items():
        try:
            if file.is_file():
                check()
        except (FormatError, ValueError, OSError) as error:
            yield Finding("error", "wrong-data-set", str(error))


def _labels(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    files = [kitti.frame_file(folder, "label_2", frame) for frame in frames]
    rows = [line.split() for file in files for line in lines_of(file)]
    rows = [row for row in rows if row[0] != "DontCare"]
    if not rows:
        yield Finding("warning", "no-labels", f"{folder}: no frame has a label")
        return
    heights = np.array([float(row[7]) - float(row[5]) for row in rows])
    low = (heights < HEIGHT_FILTER_PX).mean()
    if low > 0.5:
        text = (
            f"{folder}: {100 * low:.0f} % of the 2-D boxes are lower than {HEIGHT_FILTER_PX:g} px: "
            "tools with KITTI's height rule leave these labels out, so AP is 0"
        )
        yield Finding("warning", "image-height", text)
    unknown = np.mean([row[2] == "3" for row in rows])
    if unknown > 0:
        text = (
            f"{folder}: {100 * unknown:.0f} % of the labels have occluded 3 (unknown, outside the "
            "region): tools that go by KITTI's difficulty leave them out"
        )
        yield Finding("note", "occlusion", text)
    empty = sum(file.stat().st_size == 0 for file in files)
    if empty > 0:
        text = f"{folder}: {empty} of {len(files)} frames have no label: valid, keep them"
        yield Finding("note", "empty-frames", text)


def _clouds(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    """Errors of some clouds, and whether the labelled boxes hold points."""
    if not (folder / "training/velodyne").is_dir():
        return
    boxes_with_points = boxes = 0
    bright = False
    chosen = frames[:: max(1, len(frames) // CLOUDS)]
    cameras = read_cameras(folder, chosen)
    for frame, camera in zip(chosen, cameras.of_frame, strict=True):
        try:
            points = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
        except FormatError as error:
            yield Finding("error", "wrong-cloud", str(error))
            continue
        file = kitti.frame_file(folder, "label_2", frame)
        labels = kitti.read_labels(file, calibration=cameras.different[camera])
        boxes += len(labels)
        boxes_with_points += sum(_holds_points(box, points) for box in labels.boxes)
        bright |= bool((points[:, 3] > 1).any() or (points[:, 3] < 0).any())
    if bright:
        text = (
            f"{folder}: intensities outside 0 to 1: scale them, or a detector sees something else"
        )
        yield Finding("warning", "intensity", text)
    if boxes > 0 and boxes_with_points < 0.5 * boxes:
        text = (
            f"{folder}: {boxes_with_points} of {boxes} labelled boxes hold a point: are labels and "
            "points in the same frame (camera convention, bottom centre, heading)?"
        )
        yield Finding("warning", "labels-off-points", text)


def _holds_points(box: FloatArray, points: Points) -> bool:
    offset = points[:, :3] - box[:3]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    ahead = cos * offset[:, 0] + sin * offset[:, 1]
    left = cos * offset[:, 1] - sin * offset[:, 0]
    half = box[3:6] / 2 + MARGIN_M
    inside = (np.abs(ahead) <= half[0]) & (np.abs(left) <= half[1])
    return bool((inside & (np.abs(offset[:, 2]) <= half[2])).any())


def _ranges(folder: Path, vehicles: Vehicles) -> Iterator[Finding]:
    """What a detector's configuration must hold; the usual causes of an AP of 0."""
    captured = vehicles.select(vehicles.points > 0)
    if len(captured) == 0:
        return
    boxes = captured.boxes
    bottom, top = boxes[:, 2] - boxes[:, 5] / 2, boxes[:, 2] + boxes[:, 5] / 2
    cut = (boxes[:, 2] < USUAL_LOW_Z).mean()
    text = f"{folder}: vehicles stand at z {np.median(bottom):.2f} m (median), {bottom.min():.2f} "
    text += f"at the lowest, and end at {top.max():.2f}: anchors' bottom and point range must fit"
    if cut > 0:
        text += f"; {100 * cut:.0f} % have their centre below {USUAL_LOW_Z:g} m, where the usual "
        text += "ranges end: they would be cut, and AP be 0"
    yield Finding("note", "z-range", text)
    reach = np.abs(boxes[:, :2]).max(axis=1)
    far = 100 * (reach > USUAL_FAR_M).mean()
    behind = 100 * (boxes[:, 0] < 0).mean()
    text = f"{folder}: vehicles reach to {reach.max():.0f} m; {far:.0f} % lie beyond "
    text += f"{USUAL_FAR_M:g} m and {behind:.0f} % behind the sensor (x < 0), where a forward "
    text += "range does not see them"
    yield Finding("note", "xy-range", text)


def _predictions(folder: Path, pred: Path, split: str | None, allow_missing: bool) -> list[Finding]:
    chosen, known = frame_numbers(folder, split), frame_numbers(folder, "all")
    try:
        found = find_files(pred, chosen, known, allow_missing=allow_missing)
        predictions = read_predictions(found.files, read_cameras(folder, chosen))
        vehicles = read_vehicles(folder, chosen)
        checks = check_predictions(predictions, found.files, vehicles, Settings().types)
    except FormatError as error:
        return [Finding("error", "wrong-predictions", str(error))]
    return [*found.findings, *checks]


def folders_with_frames(data: Path) -> list[Path]:
    """The folder itself if it has frames, or those in it that have, with a lidar.yaml or without.

    Raises FileNotFoundError if there is none.
    """
    if (data / "training").is_dir():
        return [data]
    found = (path.parent for path in data.glob("*/training"))
    folders = sorted(folder for folder in found if not folder.name.startswith("."))
    if not folders:
        raise FileNotFoundError(2, "No training folder in it or in its folders", str(data))
    return folders
