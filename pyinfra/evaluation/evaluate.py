"""Average precision of predictions: `pyinfra evaluate --gt DATA/LIDAR --pred DIR --out DIR`.

Any detector of any toolbox: predictions are KITTI result files or CSV in the LiDAR frame. What
counts and what is ignored stands in pyinfra.evaluation, AP in pyinfra.ap, the rest in
docs/conventions.md, "Evaluation".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyinfra.atomic import replacing
from pyinfra.data.frame_tables import read_cameras, read_predictions
from pyinfra.data.frames import frame_numbers
from pyinfra.evaluation.ground_truth import read_ground_truth
from pyinfra.evaluation.ground_truth_checks import ground_truth_findings
from pyinfra.evaluation.judge import (
    OBJECT_CLASSES,
    Judgement,
    Settings,
    are_people,
    contest,
    judge,
)
from pyinfra.evaluation.matching import PERSON_IOU
from pyinfra.evaluation.prediction_checks import check_predictions, find_files
from pyinfra.evaluation.result import Evaluation, evaluate_tables


def evaluate(
    gt: Path,
    pred: Path,
    settings: Settings | None = None,
    *,
    object_class: str | None = None,
    frames: Sequence[int] | None = None,
    split: str | None = None,
    allow_missing: bool = False,
) -> Evaluation:
    """Reads a LiDAR's folder and predictions of its frames, and evaluates them.

    object_class: vehicle (default), pedestrian or cyclist, in place of settings.
    frames: those to evaluate; left out, those of the split (ImageSets/SPLIT.txt; by default `val`
    if there is one, else all). Raises FormatError with file and line, FileNotFoundError, and
    ValueError for settings that do not fit the folder.
    """
    known = frame_numbers(gt, "all")
    chosen = frame_numbers(gt, split) if frames is None else sorted(frames)
    if settings and object_class:
        raise ValueError("object_class: found settings too, allowed one of them")
    settings = settings or default_settings(gt, object_class or "vehicle")
    found = find_files(pred, chosen, known, allow_missing=allow_missing)
    truth = read_ground_truth(gt, chosen, beyond_range=True)
    predictions = read_predictions(found.files, read_cameras(gt, chosen))
    types = settings.types
    findings = list(ground_truth_findings(gt, chosen, truth.vehicles, types))
    of_types = truth.vehicles.select(np.isin(truth.vehicles.names, types))
    findings += [
        *found.findings,
        *check_predictions(predictions, found.files, of_types, types, settings.min_score),
    ]
    return evaluate_tables(truth, predictions, settings, findings)


def judged(
    gt: Path,
    pred: Path,
    settings: Settings,
    *,
    frames: Sequence[int] | None = None,
    split: str | None = None,
) -> list[Judgement]:
    """What became of each prediction, for each ground truth of the settings.

    By footprints, of the first class and IoU; frames, split and errors are as of `evaluate`.
    """
    frames = frame_numbers(gt, split) if frames is None else sorted(frames)
    truth = read_ground_truth(gt, frames, beyond_range=True)
    files = find_files(pred, frames, frame_numbers(gt, "all")).files
    predictions = read_predictions(files, read_cameras(gt, frames))
    one = contest(truth, predictions, next(iter(settings.classes)), settings, "bev")
    took = one.match(settings.ious[0], strict=False)
    return [judge(one, which, took, settings.min_points) for which in settings.ground_truths]


def default_settings(gt: Path, object_class: str = "vehicle") -> Settings:
    """Those of a class; `all` can only be told with objects."""
    if object_class not in OBJECT_CLASSES:
        allowed = ", ".join(OBJECT_CLASSES)
        raise ValueError(f"object_class: found '{object_class}', allowed {allowed}")
    settings = class_settings({object_class: OBJECT_CLASSES[object_class]})
    has_objects = (gt / "training/objects").is_dir()
    return settings if has_objects else replace(settings, ground_truths=("captured",))


def class_settings(classes: Mapping[str, tuple[str, ...]], *, own_iou: bool = False) -> Settings:
    """Of vehicles or of people, who are found from another IoU on, or by their centres.

    own_iou: an IoU takes the place of these. Raises ValueError for both together without one.
    """
    of_people = [are_people(types) for types in classes.values()]
    if not any(of_people) or (own_iou and not all(of_people)):
        return Settings(classes=classes)
    if not all(of_people):
        names = ", ".join(classes)
        raise ValueError(f"--class: found {names}, allowed vehicles, or people, or both with --iou")
    return Settings(classes=classes, ious=(PERSON_IOU,), metrics=("bev", "centre"))


def write(evaluation: Evaluation, out: Path, *, figures: bool = True) -> list[Path]:
    """Writes the tables as CSV, and their figures as SVG and PNG; returns the files."""
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for name, table in evaluation.tables().items():
        files.append(out / f"{name}.csv")
        with replacing(files[-1]) as beside:
            table.to_csv(beside, index=False, float_format="%.6g")
    if figures:
        # Plotting takes a second to import.
        from pyinfra.evaluation import figures as evaluation_figures

        files += evaluation_figures.draw_all(evaluation, out)
    return files
