"""Runs a trained detector on the frames of a LiDAR's folder and writes KITTI results."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.files import alone
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.frames import frame_numbers, frame_range, has_labels, period_of, spread
from pyinfra.dataset.frames_version import number_at
from pyinfra.dataset.ground import CHECKED, Ground, check_height, height_warnings, level_ground
from pyinfra.dataset.prediction_origin import read_origin, write_origin
from pyinfra.dataset.regions import Region, outline_region
from pyinfra.formats import kitti
from pyinfra.models.detectors import Detections, Detector
from pyinfra.models.inference.detect import (
    accumulation_of,
    detect,
    ground_and_region_of,
    inputs_used,
    load_detector,
    stacking,
    transfer,
    write,
)
from pyinfra.models.inference.frames_learnt import frames_warning, model_origin
from pyinfra.models.inference.static_filter import length_warning, without_standing
from pyinfra.models.training.provenance import read_provenance

OUTLINE_MARGIN_M = 1.0  # margin around an outline for inexact boxes, as in the detector Background

Warn = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Place:
    """Ground and region of the site where a detector is used.

    If a value is None, it is unknown, and the detector uses the value of its training site.
    height_m: height of the sensor above the road, if the user sets it. given: names of the
    arguments that the user sets.
    """

    ground: Ground | None = None
    region: Region | None = None
    height_m: float | None = None
    given: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class FolderDetections:
    """The detections in each cloud file, and the computing time of each file."""

    files: Sequence[Path]
    detections: Sequence[Detections]
    times_ms: FloatArray  # (n,) time of each frame from points to boxes, ms
    left_out: int | None = None  # number of removed standing boxes; None if the filter is off
    inputs: str = ""  # the inputs that the model used, such as "single frames"


@dataclass(frozen=True, eq=False)
class InOutline:
    """A `Detector` that leaves out vehicles outside an outline that the user has drawn.

    Vehicles outside the roads of a simulated site are kept, because `evaluate` counts them.
    """

    detector: Detector
    region: Region

    def predict(self, points: Points) -> Detections:
        detections = self.detector.predict(points)
        keep = self.region.holds(detections.boxes, OUTLINE_MARGIN_M)
        keep |= np.isin(detections.names, PERSON_TYPES)
        return detections.select(keep)


def place(
    lidar_folder: Path | None, height_m: float | None = None, outline: Path | None = None
) -> Place:
    """Returns ground and region of a folder. Arguments that are not None replace them.

    height_m: height of the sensor above a level road. outline: file with `outline_m: [[x, y],
    ...]`. Raises Error for a height out of range, FormatError, and ConfigError for an invalid
    outline.
    """
    ground, region = (
        ground_and_region_of(lidar_folder) if lidar_folder is not None else (None, None)
    )
    inside = outline_region(outline) if outline is not None else None
    return replaced(ground, region, height_m, inside)


def replaced(
    ground: Ground | None, region: Region | None, height_m: float | None, inside: Region | None
) -> Place:
    """Returns a place. If height_m or `inside` is not None, it replaces the ground or the region.

    Raises Error for a height out of range.
    """
    if height_m is not None:
        check_height(height_m)
        ground = level_ground(-height_m)
    arguments = {"height_m": height_m, "region": inside}
    given = tuple(key for key, value in arguments.items() if value is not None)
    return Place(ground, region if inside is None else inside, height_m, given)


def detector_at_place(model: Path, where: Place, device: str = "cpu", threads: int = 1) -> Detector:
    """Loads a detector for a site. The detector may need stacked frames.

    Raises Error if the user sets a height or a region for a background model. Such a model can only
    be used at the site of its training.
    """
    if model.suffix == ".npz" and where.given:
        name = where.given[0]
        raise Error(
            f"{name}: expected no value for a background model, got one; the model uses the value "
            "of its training"
        )
    detector = load_detector(
        model,
        ground=where.ground,
        region=where.region,
        device=device,
        stacks=True,
        threads=threads,
    )
    if where.region is None or where.region.axes is not None or model.suffix == ".npz":
        return detector
    return InOutline(detector, where.region)


def frame_files(
    lidar_folder: Path, split: str | None, most: int, numbers_in: str | None = None
) -> list[Path]:
    """Returns the cloud files of a folder's frames.

    most: largest number of files, which are evenly spread; 0 means all. numbers_in: a range
    A:B[:STEP] of frames, which replaces the split. Raises Error for a folder, a split or a range
    without frames.
    """
    if not (lidar_folder / "training/velodyne").is_dir():
        raise Error(f"data: expected a folder with training/velodyne, got {lidar_folder}")
    numbers = frame_range(numbers_in, lidar_folder) if numbers_in else None
    numbers = frame_numbers(lidar_folder, split) if numbers is None else numbers
    chosen = spread(numbers, most) if most else numbers
    if not chosen:
        raise Error(f"{lidar_folder}: expected one or more frames in the split, got none")
    return [kitti.frame_file(lidar_folder, "velodyne", k) for k in chosen]


def readable_clouds(
    files: Sequence[Path], read: Callable[[Path], Points]
) -> tuple[list[Path], list[str]]:
    """Returns the files that can be read, and the errors of the files that cannot.

    Raises Error if no file can be read.
    """
    good, errors = [], []
    for file in files:
        try:
            read(file)
        except FormatError as error:
            errors.append(str(error))
        else:
            good.append(file)
    if not good:
        raise Error(f"expected a point cloud that can be read, got none; first error: {errors[0]}")
    return good, errors


def detect_folder(
    model: Path,
    lidar_folder: Path,
    out: Path,
    *,
    files: Sequence[Path],
    where: Place,
    drop_standing: bool = False,
    device: str = "cpu",
    threads: int = 1,
    skip_bad: bool = False,
    warn: Warn,
) -> FolderDetections:
    """Runs a model on frames of a folder, and writes its boxes and origin.yaml to `out`.

    Frames are stacked if the model needs stacked frames. drop_standing: whether to remove vehicle
    boxes that recur at a position where no box ever moves. threads: as in load_detector. skip_bad:
    whether to leave out neighbouring frames that cannot be read, if the model uses neighbours.
    warn: called with a text for each problem that may reduce accuracy.
    """
    if out.name == "label_2":
        raise Error(f"out: expected a folder other than that of the labels, got {out}")
    numbers = [int(file.stem) for file in files]
    if text := frames_warning(model, number_at(lidar_folder)):
        warn(text)
    detector = detector_at_place(model, where, device, threads)
    known = frame_numbers(lidar_folder, "all")
    accumulation = accumulation_of(model)
    if skip_bad and accumulation.frames > 1:
        clouds = [kitti.frame_file(lidar_folder, "velodyne", k) for k in known]
        known = [int(file.stem) for file in readable_clouds(clouds, kitti.read_points)[0]]
    read = stacking(lidar_folder, numbers, accumulation, existing=known)
    inputs = inputs_used(model)
    with alone(out):
        out.mkdir(parents=True, exist_ok=True)
        if read_origin(out) is not None or not others(out, files):
            write_origin(out, model_origin(lidar_folder, model))
        warn_of_height(files, read, where, warn)
        if not drop_standing:
            return FolderDetections(files, *detect(detector, files, out, read=read), inputs=inputs)
        detections_of_all, times = detect(detector, files, None, read=read)
        reads = [partial(kitti.read_points, file) for file in files]
        filtered = without_standing(reads, detections_of_all, where.region, where.ground)
        if text := length_warning(numbers, period_of(lidar_folder)):
            warn(text)
        for file, detections in zip(files, filtered, strict=True):
            write(out, file, detections)
    left_out = sum(map(len, detections_of_all)) - sum(map(len, filtered))
    return FolderDetections(files, filtered, times, left_out, inputs)


def warn_of_height(
    files: Sequence[Path], read: Callable[[Path], Points], where: Place, warn: Warn
) -> None:
    """Warns if the road in some clouds is not at the height that the user sets."""
    if where.height_m is not None:
        clouds = [read(files[i])[:, :4] for i in spread(range(len(files)), CHECKED)]
        for text in height_warnings(clouds, where.height_m):
            warn(text)


def region_warning(model: Path, where: Place) -> str:
    """Returns a warning if no region limits where a network finds boxes; else an empty text.

    A background model has the region of its training.
    """
    if where.region is not None or model.suffix == ".npz":
        return ""
    return "no region is known, so boxes off the road are kept"


def learnt_warning(
    model: Path, lidar_folder: Path, split: str | None, *, allow_transfer: bool
) -> str:
    """Returns a warning if a model was trained on other data or on the frames to detect.

    The text is empty if there is no reason for a warning.
    """
    if difference := transfer(model, lidar_folder):
        text = f"the frames differ from those of the training: {difference}"
        return "" if allow_transfer else f"{text}; set `allow_transfer` if this is intended"
    is_split = split or (lidar_folder / "ImageSets/val.txt").is_file()
    anywhere = model.suffix != ".npz" and read_provenance(model).anywhere
    if is_split or not has_labels(lidar_folder) or anywhere:
        return ""
    return (
        f"{lidar_folder} is not split, so all frames are used, including the training frames; run "
        "`pyinfra split` first, or set `split` to all"
    )


def others(out: Path, files: Sequence[Path]) -> list[Path]:
    """Returns the result files in `out` that do not belong to one of the clouds `files`."""
    ours = {f"{file.stem}.txt" for file in files}
    return [file for file in out.glob("*.txt") if file.name not in ours]


def others_warning(out: Path, files: Sequence[Path]) -> str:
    """Returns a warning about result files of other frames in `out`; empty without such files."""
    other_files = others(out, files)
    if not other_files:
        return ""
    text = (
        f"{out} already has {len(other_files)} result files of other frames, such as "
        f"{other_files[0].name}; they are kept"
    )
    return text if read_origin(out) else f"{text}, and their origin is not known"
