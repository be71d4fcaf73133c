"""Inputs of an evaluation: the frames, the predictions and the default settings of a class."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyinfra.core.errors import Error
from pyinfra.core.names import check_name, path_of
from pyinfra.core.vocabulary import OBJECT_CLASSES
from pyinfra.dataset.frame_readers import Cameras, read_cameras, read_predictions
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.loading import one_lidar
from pyinfra.formats import kitti
from pyinfra.metrics.match_input import are_people
from pyinfra.metrics.matching import PERSON_IOU
from pyinfra.metrics.prediction_checks import PredictionFiles, find_files
from pyinfra.metrics.prediction_table import AnyPredictions, prediction_table, predictions_of
from pyinfra.metrics.settings import Settings


def chosen_frames(
    gt: FrameSequence | str | os.PathLike[str],
    pred: object,
    frames: Sequence[int] | None,
    split: str | None,
) -> FrameSequence:
    """Returns the frames to evaluate."""
    if isinstance(gt, FrameSequence):
        if split is not None:
            raise Error(
                "split: expected a LiDAR's folder as `gt`, got frames in memory; `frames` selects "
                "frames in memory"
            )
        wanted = sorted(gt.numbers if frames is None else frames)
        if other := sorted(set(wanted) - set(gt.numbers)):
            raise Error(f"frames: expected numbers of the {len(gt)} frames in gt, got {other[0]}")
        return gt if wanted == list(gt.numbers) else gt.of(wanted)
    folder = path_of(gt, "gt")
    if not isinstance(pred, (str, os.PathLike)):
        one_lidar(folder, "gt")  # raises Error for a data set with several LiDARs
    return RecordedFrames(
        folder, tuple(frame_numbers(folder, split) if frames is None else sorted(frames))
    )


def predictions_in(
    pred: AnyPredictions,
    sequence: FrameSequence,
    folder: Path | None,
    *,
    allow_missing: bool,
) -> tuple[PredictionFiles, Predictions]:
    """Returns the prediction files and the predictions, read from a table or from a folder.

    folder: the LiDAR's folder; None if the frames are in memory.
    """
    numbers = sequence.numbers
    if not isinstance(pred, (str, os.PathLike)):
        names = tuple(Path(f"frame {k}") for k in numbers)
        return PredictionFiles(names, ()), predictions_of(prediction_table(pred, numbers), numbers)
    all_frames = frame_numbers(folder, "all") if folder else numbers
    prediction_files = find_files(
        Path(pred), numbers, all_frames, lidar_folder=folder, allow_missing=allow_missing
    )
    simulated_camera = Cameras((kitti.simulated(),), np.zeros(len(numbers), dtype=np.int64))
    cameras = read_cameras(folder, numbers) if folder else simulated_camera
    return prediction_files, read_predictions(prediction_files.files, cameras)


def default_settings(gt: Path, object_class: str = "vehicle") -> Settings:
    """Returns the default settings of a class for the LiDAR's folder `gt`.

    If the folder has no training/objects, `captured` is the only ground-truth subset.
    """
    return settings_of(object_class, has_objects=(gt / "training/objects").is_dir())


def settings_of(object_class: str, *, has_objects: bool) -> Settings:
    """Returns the default settings of a class. Raises Error for an unknown class."""
    check_name(object_class, OBJECT_CLASSES, "object_class", "a known class")
    settings = class_settings({object_class: OBJECT_CLASSES[object_class]})
    return settings if has_objects else replace(settings, ground_truths=("captured",))


def class_settings(classes: Mapping[str, tuple[str, ...]], *, custom_iou: bool = False) -> Settings:
    """Returns the default settings of classes.

    Pedestrians and cyclists have a lower IoU threshold than vehicles, and are also matched by
    centres. Because the thresholds differ, the function raises Error for vehicles together with
    pedestrians or cyclists. custom_iou: whether the user sets the threshold; then no error is
    raised.
    """
    of_people = [are_people(types) for types in classes.values()]
    if not any(of_people) or (custom_iou and not all(of_people)):
        return Settings(classes=classes)
    if not all(of_people):
        names = ", ".join(classes)
        raise Error(
            f"classes: expected only vehicles or only people, or both with `ious`; got {names}"
        )
    return Settings(classes=classes, ious=(PERSON_IOU,), metrics=("bev", "centre"))
