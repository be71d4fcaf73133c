"""Average precision of predictions.

Predictions can come from any detector, as KITTI result files or as CSV in the LiDAR frame.
match_results.py defines which predictions and vehicles count. ap.py defines AP. The other rules are
in the section "AP and matching" of docs/conventions/evaluation.md.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyinfra.core.errors import Error, FindingWarning
from pyinfra.core.names import path_of, suggestion
from pyinfra.core.public import CALLER, public
from pyinfra.core.vocabulary import OBJECT_CLASSES
from pyinfra.dataset.frame_readers import Cameras, read_cameras, read_predictions
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.frame_tables import Predictions
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.loading import one_lidar
from pyinfra.formats import kitti
from pyinfra.metrics.evaluation_result import Evaluation, evaluate_tables
from pyinfra.metrics.ground_truth import ground_truth_of, read_ground_truth
from pyinfra.metrics.ground_truth_checks import ground_truth_findings
from pyinfra.metrics.match_input import are_people, match_input
from pyinfra.metrics.match_results import MatchResult, count_matches
from pyinfra.metrics.matching import PERSON_IOU
from pyinfra.metrics.prediction_checks import (
    PredictionFiles,
    check_predictions,
    few_predicted,
    find_files,
)
from pyinfra.metrics.prediction_table import AnyPredictions, prediction_table, predictions_of
from pyinfra.metrics.settings import Settings

SEEN_IN_TABLES = ("few-blocks",)  # warnings whose cause the tables show, as NaN


@public()
def evaluate(
    gt: FrameSequence | str | os.PathLike[str],
    pred: AnyPredictions,
    settings: Settings | None = None,
    *,
    object_class: str | None = None,
    frames: Sequence[int] | None = None,
    split: str | None = None,
    allow_missing: bool = False,
    ranges: bool = False,
) -> Evaluation:
    """Computes the average precision (AP) of predictions, with intervals.

    Parameters
    ----------
    gt : frames in memory (`simulate`, `load_dataset`), or a LiDAR's folder
    pred : a table with the columns frame, type, x y z dx dy dz heading, score (levelled LiDAR
        frame, metres, radians), or a folder of KITTI results or CSV files. Or a list with the boxes
        of each frame, or a dict from frame numbers to boxes, which are whatever a detector may
        return to `detect`
    settings : classes, ground-truth subsets, thresholds; by default vehicles at BEV IoU 0.5
    object_class : a name of OBJECT_CLASSES (`vehicle`, `pedestrian`, `cyclist`), by default
        `vehicle`. Give either this or `settings`
    frames : frame numbers to evaluate; by default all frames in memory, or all frames of the split.
        Give either this or `split`
    split : name of a list in the folder's ImageSets, or `all`; by default `val` if it exists
    allow_missing : whether a frame without a prediction file counts as a frame without boxes
    ranges : whether to also compute AP and recall within 10, 20 ... 100 m of the sensor
        (`result.ranges`)

    Returns
    -------
    Tables: `result.ap`, `result.by_distance`, `result.matches`, `result.distance_ap` (along the
    roads), `result.areas`, `result.errors`, `result.pr_curve`, and `result.findings`. Suspicious
    input is also a warning: headings in degrees, boxes far from all vehicles or at another height,
    frames without predictions.

    Raises
    ------
    Error : for a table with a missing column, a value out of range or a frame that is not
        evaluated, and for arguments that exclude each other
    FormatError : for an invalid file, with its line
    FileNotFoundError : for a folder without frames or predictions

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 500, 100))
    >>> perfect = frames.labels.assign(score=1.0)
    >>> float(pi.evaluate(frames, perfect).ap.ap_r1000.iloc[0])
    100.0
    """
    result = evaluated(
        gt,
        pred,
        settings,
        object_class=object_class,
        frames=frames,
        split=split,
        allow_missing=allow_missing,
        ranges=ranges,
    )
    for finding in result.findings:
        if finding.level != "note" and finding.name not in SEEN_IN_TABLES:
            warnings.warn(f"{finding.name}: {finding.text}", FindingWarning, stacklevel=CALLER)
    return result


@public()
def evaluated(
    gt: FrameSequence | str | os.PathLike[str],
    pred: AnyPredictions,
    settings: Settings | None = None,
    *,
    object_class: str | None = None,
    frames: Sequence[int] | None = None,
    split: str | None = None,
    allow_missing: bool = False,
    ranges: bool = False,
) -> Evaluation:
    """Returns the result of `evaluate`, whose findings are no warnings here."""
    if settings and object_class:
        raise Error("object_class: expected either object_class or settings, got both")
    if frames is not None and split is not None:
        raise Error("frames: use frames or split, not both")
    in_memory = isinstance(gt, FrameSequence) or not isinstance(pred, (str, os.PathLike))
    sequence = _chosen(gt, pred, frames, split)
    folder = sequence.folder if isinstance(sequence, RecordedFrames) else None
    prediction_files, predictions = _predictions(
        pred, sequence, folder, allow_missing=allow_missing
    )
    truth = ground_truth_of(sequence)
    if settings is None:
        settings = settings_of(object_class or "vehicle", has_objects=truth.has_objects)
    if in_memory and "common" in settings.ground_truths and len(truth.neighbours) < 2:
        raise Error("ground_truths: expected frames of several LiDARs for `common`, got one LiDAR")
    if settings.min_points > 1 and not truth.has_objects:
        raise Error(
            "min_points: expected 1 for labels, which do not have numbers of points, got "
            f"{settings.min_points}"
        )
    types, numbers = settings.types, sequence.numbers
    of_types = truth.vehicles.select(np.isin(truth.vehicles.names, types))
    findings = [
        *(ground_truth_findings(folder, numbers, truth.vehicles, types) if folder else ()),
        *prediction_files.findings,
        *few_predicted(predictions, of_types.select(of_types.points > 0), numbers),
        *check_predictions(
            predictions, prediction_files.files, of_types, types, settings.min_score
        ),
    ]
    return evaluate_tables(truth, predictions, settings, findings, ranges=ranges)


def _chosen(
    gt: FrameSequence | str | os.PathLike[str],
    pred: object,
    frames: Sequence[int] | None,
    split: str | None,
) -> FrameSequence:
    """Returns the frames to evaluate."""
    if isinstance(gt, FrameSequence):
        if split is not None:
            raise Error(
                f"split: expected a LiDAR's folder as gt, got frames in memory and split '{split}'"
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


def _predictions(
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


def match_results_of(
    gt: Path,
    pred: Path,
    settings: Settings,
    *,
    frames: Sequence[int] | None = None,
    split: str | None = None,
) -> list[MatchResult]:
    """Returns the match result of each ground-truth subset in the settings.

    Boxes are matched by the IoU of their footprints, for the first class and the first threshold of
    the settings. The arguments `frames` and `split` and the exceptions are as in `evaluate`.
    """
    frames = frame_numbers(gt, split) if frames is None else sorted(frames)
    truth = read_ground_truth(gt, frames, beyond_range=True)
    files = find_files(pred, frames, frame_numbers(gt, "all"), lidar_folder=gt).files
    predictions = read_predictions(files, read_cameras(gt, frames))
    class_input = match_input(truth, predictions, next(iter(settings.classes)), settings, "bev")
    matches = class_input.match(settings.ious[0], strict=False)
    return [
        count_matches(class_input, which, matches, settings.min_points)
        for which in settings.ground_truths
    ]


def default_settings(gt: Path, object_class: str = "vehicle") -> Settings:
    """Returns the default settings of a class for the LiDAR's folder `gt`.

    If the folder has no training/objects, `captured` is the only ground-truth subset.
    """
    return settings_of(object_class, has_objects=(gt / "training/objects").is_dir())


def settings_of(object_class: str, *, has_objects: bool) -> Settings:
    """Returns the default settings of a class. Raises Error for an unknown class."""
    if object_class not in OBJECT_CLASSES:
        near = suggestion(object_class, OBJECT_CLASSES)
        raise Error(f"object_class: expected a class, got '{object_class}'{near}")
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


def write(evaluation: Evaluation, out: Path) -> list[Path]:
    """Writes the tables as CSV; returns the files."""
    return evaluation.save(out)
