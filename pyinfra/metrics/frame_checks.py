"""Checks of frames and predictions.

A file that does not follow its format is an error. The checks also report common causes of an AP of
0 on roadside frames. Examples are wrong heights, short point ranges, filters by image size, wrong
headings and wrong frames of reference.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.errors import FormatError, not_found
from pyinfra.core.progress import track
from pyinfra.dataset.data_set import read_data_set, read_lidars
from pyinfra.dataset.frame_readers import (
    other_types,
    read_cameras,
    read_labelled,
    read_predictions,
    read_vehicles,
)
from pyinfra.dataset.frame_tables import Vehicles
from pyinfra.dataset.frames import check_lidar_folder, data_set_of, frame_numbers
from pyinfra.dataset.health import health_text, recorded_health
from pyinfra.dataset.outlines import OUTLINES_FILE, read_outlines
from pyinfra.dataset.roads import read_roads
from pyinfra.formats import kitti
from pyinfra.formats.text_table import lines_of
from pyinfra.metrics.ground_truth_checks import ground_truth_findings
from pyinfra.metrics.prediction_checks import Finding, check_predictions, find_files
from pyinfra.metrics.settings import Settings

MOST_ERRORS = 20  # largest number of errors that one check lists
# Every n-th cloud is checked. n is the number of clouds divided by CLOUDS or COUNTED, rounded down.
CLOUDS = 50  # number of clouds whose format, intensities and points in boxes are checked
COUNTED = 1000  # number of clouds whose points in the objects' boxes are counted
POINT_BYTES, FIELD_BYTES = 16, kitti.FIELDS.itemsize
NEIGHBOURS = 21  # number of frames whose median size is compared with the size of a cloud
SMALL = 0.5  # clouds smaller than this share of the median are reported
# A cloud may lack this number of the points in the objects' boxes, or this share if it is more.
FEW_POINTS, LOST_SHARE = 10, 0.05
FAR_MARGIN_M = 5.0  # tolerance for points beyond the LiDAR's range, because of range noise
USUAL_LOW_Z = -3.0  # lower limit of z in common detector configurations for cars, metres
USUAL_FAR_M = 70.4  # limit of x and y in common detector configurations for cars, metres
HEIGHT_FILTER_PX = 25.0  # KITTI's tools ignore labels whose 2-D box is lower than this
MOST_PERIODS = 1.5  # largest time of a point, in frame periods
MARGIN_M = 0.1  # margin around a box when points in it are counted


def validate(
    folder: Path, pred: Path | None = None, split: str | None = None, *, allow_missing: bool = False
) -> list[Finding]:
    """Checks a LiDAR's folder, and predictions for its frames; returns all findings.

    Raises FileNotFoundError if the folder does not have the KITTI layout.
    """
    frames = frame_numbers(folder, "all")
    if not frames:
        return [Finding("error", "no-frames", f"{folder}: expected one or more frames, got none")]
    findings = [*_unreadable(folder, frames), *_unreadable_data_set(folder)]
    if findings:
        return findings
    vehicles = read_vehicles(folder, frames)
    types = Settings().types
    findings += ground_truth_findings(folder, frames, vehicles, types)
    labelled = read_labelled(folder, frames)  # the label files, which other tools use
    has_objects = (folder / "training/objects").is_dir()
    if has_objects and (other := other_types(folder, frames, labelled, types, "label_2")):
        findings.append(Finding("warning", "other-types", other))
    findings += [*_labels(folder, frames), *_clouds(folder, frames), *_ranges(folder, vehicles)]
    findings += [*_sizes(folder, frames), *_counts(folder, frames)]
    if text := health_text(recorded_health(folder, frames)):
        findings.append(Finding("warning", "health", f"{folder}: {text}"))
    findings += _point_times(folder, frames)
    if pred is not None:
        findings += _predictions(folder, pred, split, allow_missing)
    return findings


def _point_times(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    """Yields a warning of times of points outside the frame."""
    if not (folder / "lidar.yaml").is_file():
        return
    period_s = kitti.read_lidar(folder).period_s
    late = []
    for frame in frames[:: 1 + len(frames) // CLOUDS]:
        file = kitti.frame_file(folder, "fields", frame)
        times = kitti.read_fields(file)["time_s"] if file.is_file() else np.zeros(0)
        if len(times) and not -0.001 <= times.min() <= times.max() <= MOST_PERIODS * period_s:
            late.append(frame)
    if late:
        text = (
            f"{folder}: {len(late)} of the checked frames, such as {late[0]}, have times of points "
            f"outside 0 to {MOST_PERIODS * period_s:g} s. The unit or the start of the times may "
            "be wrong"
        )
        yield Finding("warning", "point-times", text)


def _unreadable(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    """Yields errors of label, object and calibration files, at most MOST_ERRORS."""
    readers: dict[kitti.Part, Callable[[Path], object]] = {
        "label_2": kitti.read_labels,
        "objects": kitti.read_objects,
        "calib": kitti.read_calibration,
    }
    errors = []
    for part, read in readers.items():
        if part != "label_2" and not (folder / "training" / part).is_dir():
            continue
        for frame in track(frames, "frame"):
            try:
                read(kitti.frame_file(folder, part, frame))
            except FileNotFoundError as error:
                errors.append(Finding("error", "missing-file", f"{error.filename}: missing"))
            except FormatError as error:
                errors.append(Finding("error", "wrong-file", str(error)))
    yield from _shortened(errors, folder)


def _shortened(errors: Sequence[Finding], folder: Path, where: str = "") -> Iterator[Finding]:
    """Yields at most MOST_ERRORS of the errors, and the number of the others."""
    yield from errors[:MOST_ERRORS]
    if more := len(errors[MOST_ERRORS:]):
        yield Finding("error", "more-errors", f"{folder}: {more} more errors{where}")


def _unreadable_data_set(folder: Path) -> Iterator[Finding]:
    """Yields errors of the files that describe the LiDARs, the region and the data set."""
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
    rows = [row for row in rows if row and row[0] != "DontCare"]
    if not rows:
        yield Finding("warning", "no-labels", f"{folder}: no frame has a label")
        return
    heights = np.array([float(row[7]) - float(row[5]) for row in rows])
    low = (heights < HEIGHT_FILTER_PX).mean()
    if low > 0.5:
        text = (
            f"{folder}: {100 * low:.0f} % of the 2-D boxes are less than {HEIGHT_FILTER_PX:g} px "
            "high. Tools that apply KITTI's minimum height leave these labels out and can give an "
            "AP of 0"
        )
        yield Finding("warning", "image-height", text)
    unknown = np.mean([row[2] == "3" for row in rows])
    if unknown > 0:
        text = (
            f"{folder}: {100 * unknown:.0f} % of the labels have the value 3 in the column "
            "`occluded` (unknown occlusion, because the object is outside the region). Tools that "
            "filter by KITTI's difficulty levels leave these labels out"
        )
        yield Finding("note", "occlusion", text)
    empty = sum(file.stat().st_size == 0 for file in files)
    if empty > 0:
        text = (
            f"{folder}: {empty} of {len(files)} frames have no label. These frames are valid; keep "
            "them"
        )
        yield Finding("note", "empty-frames", text)


def _clouds(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    """Yields errors of some clouds, and warnings about intensities and boxes without points."""
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
        boxes_with_points += sum(_points_in(box, points) > 0 for box in labels.boxes)
        bright |= bool((points[:, 3] > 1).any() or (points[:, 3] < 0).any())
    if bright:
        text = (
            f"{folder}: clouds contain intensities outside 0 to 1; scale the intensities, because "
            "detectors expect 0 to 1"
        )
        yield Finding("warning", "intensity", text)
    if boxes > 0 and boxes_with_points < 0.5 * boxes:
        text = (
            f"{folder}: only {boxes_with_points} of {boxes} labelled boxes contain a point; the "
            "labels may be in another frame of reference than the points (check camera convention, "
            "bottom centre, heading)"
        )
        yield Finding("warning", "labels-off-points", text)


def _sizes(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    """Yields findings about clouds whose size differs from their fields or is unusually small."""
    if not (folder / "training/velodyne").is_dir():
        return
    files = [kitti.frame_file(folder, "velodyne", frame) for frame in frames]
    points = np.array([file.stat().st_size / POINT_BYTES for file in files])
    has_fields = (folder / "training/fields").is_dir()
    errors = []
    for frame, file, count in zip(frames, files, points, strict=True):
        fields = kitti.frame_file(folder, "fields", frame)
        if has_fields and fields.is_file() and fields.stat().st_size != count * FIELD_BYTES:
            rows = fields.stat().st_size / FIELD_BYTES
            text = f"{file}: expected {rows:g} points, as in fields/{fields.name}, got {count:g}"
            errors.append(Finding("error", "cloud-size", text))
    around = median_filter(points, size=min(NEIGHBOURS, len(points)), mode="nearest")
    for i in np.flatnonzero((points < SMALL * around) & (points > 0))[:MOST_ERRORS]:
        text = (
            f"{files[i]}: {points[i]:g} points, but the median of the frames around it is "
            f"{around[i]:g}; the file may be truncated"
        )
        yield Finding("warning", "small-cloud", text)
    yield from errors[:MOST_ERRORS]


def _counts(folder: Path, frames: Sequence[int]) -> Iterator[Finding]:
    """Yields errors of clouds that lack points in the objects' boxes or have points out of range.

    Points in the objects' boxes are missing if a cloud was truncated or belongs to another frame.
    """
    has_objects = (folder / "training/objects").is_dir() and (folder / "lidar.yaml").is_file()
    if not has_objects or not (folder / "training/velodyne").is_dir():
        return
    lidar = kitti.read_lidar(folder)
    if lidar.preset == kitti.RECORDED:
        return  # the import of a recording counted these points in the same cloud
    farthest = max(unit.range_m[1] for unit in lidar.field_of_view) + FAR_MARGIN_M
    farthest += max(float(np.hypot(sensor.x, sensor.y)) for sensor in lidar.sensors)
    errors = []
    for frame in frames[:: max(1, len(frames) // COUNTED)]:
        file = kitti.frame_file(folder, "velodyne", frame)
        try:
            points = kitti.read_points(file)
        except FormatError:
            continue  # _clouds reports this error
        objects = kitti.read_objects(kitti.frame_file(folder, "objects", frame))
        hit = objects.points_in_box > 0
        expected = objects.points_in_box[hit]
        counts = [_points_in(box, points) for box in objects.boxes[hit]]
        lost = int(np.maximum(expected - np.array(counts, dtype=np.int64), 0).sum())
        if lost > max(FEW_POINTS, LOST_SHARE * expected.sum()):
            text = (
                f"{file}: expected {expected.sum()} points in the objects' boxes, but the cloud "
                f"lacks {lost} of them; it may be truncated or belong to another frame"
            )
            errors.append(Finding("error", "cloud-objects", text))
        distance = np.linalg.norm(points[:, :3], axis=1)
        if len(points) and distance.max() > farthest:
            text = (
                f"{file}: expected points within {farthest:.0f} m, got a point at "
                f"{distance.max():.1f} m"
            )
            errors.append(Finding("error", "cloud-range", text))
    yield from _shortened(errors, folder, " in clouds")


def _points_in(box: FloatArray, points: Points) -> int:
    """Counts the points in a box that is enlarged by MARGIN_M on each side."""
    near = np.abs(points[:, 0] - box[0]) <= np.hypot(box[3], box[4]) / 2 + 2 * MARGIN_M
    offset = points[near, :3] - box[:3]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    ahead = cos * offset[:, 0] + sin * offset[:, 1]
    left = cos * offset[:, 1] - sin * offset[:, 0]
    half = box[3:6] / 2 + MARGIN_M
    inside = (np.abs(ahead) <= half[0]) & (np.abs(left) <= half[1])
    return int(np.count_nonzero(inside & (np.abs(offset[:, 2]) <= half[2])))


def _ranges(folder: Path, vehicles: Vehicles) -> Iterator[Finding]:
    """Yields notes on the point range (z, x, y) that a detector's configuration must cover."""
    captured = vehicles.select(vehicles.points > 0)
    if len(captured) == 0:
        return
    boxes = captured.boxes
    bottom, top = boxes[:, 2] - boxes[:, 5] / 2, boxes[:, 2] + boxes[:, 5] / 2
    cut = (boxes[:, 2] < USUAL_LOW_Z).mean()
    text = (
        f"{folder}: the median underside of vehicles is at z = {np.median(bottom):.2f} m, the "
        f"lowest underside at {bottom.min():.2f} m, and the highest top at {top.max():.2f} m; "
        "anchor heights and point range of a detector must cover these heights"
    )
    if cut > 0:
        text += (
            f". The centres of {100 * cut:.0f} % of the vehicles are below {USUAL_LOW_Z:g} m, the "
            "usual lower limit of the point range; a detector with this limit misses them"
        )
    yield Finding("note", "z-range", text)
    reach = np.abs(boxes[:, :2]).max(axis=1)
    far = 100 * (reach > USUAL_FAR_M).mean()
    behind = 100 * (boxes[:, 0] < 0).mean()
    text = (
        f"{folder}: the largest absolute x or y of a vehicle is {reach.max():.0f} m; {far:.0f} % "
        f"of the vehicles lie beyond {USUAL_FAR_M:g} m and {behind:.0f} % behind the sensor "
        "(x < 0); the usual forward point range does not cover these vehicles"
    )
    yield Finding("note", "xy-range", text)


def _predictions(folder: Path, pred: Path, split: str | None, allow_missing: bool) -> list[Finding]:
    chosen, all_frames = frame_numbers(folder, split), frame_numbers(folder, "all")
    try:
        prediction_files = find_files(
            pred, chosen, all_frames, lidar_folder=folder, allow_missing=allow_missing
        )
        predictions = read_predictions(prediction_files.files, read_cameras(folder, chosen))
        vehicles = read_vehicles(folder, chosen)
        checks = check_predictions(predictions, prediction_files.files, vehicles, Settings().types)
    except FormatError as error:
        return [Finding("error", "wrong-predictions", str(error))]
    return [*prediction_files.findings, *checks]


def folders_with_frames(data: Path) -> list[Path]:
    """Returns the folder `data` if it has frames, else its subfolders that have frames.

    Raises FileNotFoundError if no folder has frames.
    """
    if (data / "training").is_dir():
        return [data]
    candidates = (path.parent for path in data.glob("*/training"))
    folders = sorted(folder for folder in candidates if not folder.name.startswith("."))
    if not folders:
        check_lidar_folder(data)
        raise not_found(data, "The folder and its subfolders have no `training`")
    return folders
