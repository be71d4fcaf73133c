"""Checks of predictions: whether their files are complete, and whether their boxes are plausible.

Invalid files are errors. Implausible boxes give named warnings, which explain most cases of an AP
of 0. A common cause is the height of a roadside sensor. Vehicles are 3 to 6 m below it, which
toolboxes for car-mounted sensors do not expect.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray
from pyinfra.core.errors import FormatError
from pyinfra.core.vocabulary import PERSON_TYPES, VEHICLE_TYPES
from pyinfra.dataset.frame_tables import Predictions, Vehicles
from pyinfra.dataset.frames_version import FIRST, MAY_BE_BETTER, number_at, other_frames
from pyinfra.dataset.prediction_origin import (
    MODEL_FRAMES,
    ORIGIN_FILE,
    check_origin,
    read_origin,
)
from pyinfra.metrics.prediction_errors import errors_of

OTHER_FRAMES = "other-frames"  # finding that the model was trained on frames of another version
FEW_PREDICTED = 0.5  # a larger share of frames without predictions causes a warning
FRAMES = 300  # every n-th frame is checked; n is the number of frames divided by FRAMES


@dataclass(frozen=True)
class Finding:
    """A result of a check; its text begins with the file and line, if there is one."""

    level: str  # error, warning, note
    name: str
    text: str

    def __str__(self) -> str:
        return f"{self.level}: {self.name}: {self.text}"


@dataclass(frozen=True)
class PredictionFiles:
    """The prediction files of all frames, and findings about them."""

    files: tuple[Path | None, ...]  # prediction file of each frame; None if it may be missing
    findings: tuple[Finding, ...]


def find_files(
    folder: Path,
    frames: Sequence[int],
    known: Sequence[int],
    *,
    lidar_folder: Path | None = None,
    allow_missing: bool = False,
) -> PredictionFiles:
    """Returns the prediction files NNNNNN.txt (KITTI results) or NNNNNN.csv of the given frames.

    frames: frame numbers to evaluate. known: all frame numbers of the ground truth. lidar_folder:
    the LiDAR's folder. allow_missing: whether a frame may have no prediction file. Raises
    FormatError for a file of an unknown frame, for a missing file, and for a folder without
    predictions. Raises Error if origin.yaml states that the predictions belong to other frames.
    """
    present = [file for file in sorted(folder.iterdir()) if file.suffix in (".txt", ".csv")]
    by_frame = {int(file.stem): file for file in present if _of_frame(file)}
    suffixes = {file.suffix for file in present if _of_frame(file)}
    if not by_frame:
        raise FormatError(f"{folder}: expected predictions NNNNNN.txt or NNNNNN.csv, got none")
    if len(suffixes) > 1:
        raise FormatError(f"{folder}: expected either .txt or .csv files, got both")
    unknown = sorted(by_frame.keys() - set(known))
    if unknown:
        raise FormatError(
            f"{by_frame[unknown[0]]}{_and_more(unknown)}: expected one of the {len(known)} frames "
            f"of the ground truth ({min(known)} to {max(known)}), got frame {unknown[0]}"
        )
    findings = []
    if lidar_folder is not None and not check_origin(folder, lidar_folder):
        text = f"{folder}: no {ORIGIN_FILE}, so the frames of these predictions are not known"
        findings.append(Finding("note", "origin", text))
    if lidar_folder is not None and (text := other_frames_of(folder, lidar_folder)):
        findings.append(Finding("warning", OTHER_FRAMES, text))
    named = set(by_frame.values())
    odd = [file for file in present if file not in named]
    if odd:
        text = (
            f"{odd[0]}{_and_more(odd)}: expected a file name of six digits, got '{odd[0].stem}'; "
            "files with such names are left out"
        )
        findings.append(Finding("warning", "other-files", text))
    outside = by_frame.keys() - set(frames)
    if outside:
        text = f"{folder}: left out {len(outside)} files of frames outside the split"
        findings.append(Finding("note", "outside-split", text))
    missing = [frame for frame in frames if frame not in by_frame]
    if missing:
        text = (
            f"{folder}/{missing[0]:06d}{suffixes.pop()}: this file is missing; {len(missing)} of "
            f"{len(frames)} frames have no file"
        )
        if not allow_missing:
            raise FormatError(f"{text}; write an empty file for a frame without boxes")
        findings.append(
            Finding("warning", "missing-files", f"{text} and are evaluated as frames without boxes")
        )
    return PredictionFiles(tuple(by_frame.get(frame) for frame in frames), tuple(findings))


def other_frames_of(predictions: Path, lidar_folder: Path) -> str:
    """Returns a warning if the model of predictions learnt from frames of another frames_version.

    Models of versions before 0.5 learnt from frames of frames_version 3. The text is empty for
    predictions without a model in their origin.
    """
    origin = read_origin(predictions) or {}
    if "model" not in origin:
        return ""
    learnt = origin.get(MODEL_FRAMES, FIRST)
    return other_frames(origin["model"], learnt, number_at(lidar_folder), MAY_BE_BETTER)


def _of_frame(file: Path) -> bool:
    return file.stem.isdecimal() and len(file.stem) >= 6


def check_predictions(
    predictions: Predictions,
    files: Sequence[Path | None],
    vehicles: Vehicles,
    types: Sequence[str],
    min_score: float = 0.0,
) -> list[Finding]:
    """Returns warnings and notes about the names, values and positions of predictions.

    types: names that are evaluated. vehicles: vehicles of these types in the same frames.
    """
    if len(predictions) == 0:
        text = f"{_folder(files)}: all {len(files)} files are empty: AP is 0 if there is a vehicle"
        return [Finding("warning", "all-empty", text)]
    findings = [
        *_names(predictions, files, types),
        *_scores(predictions, files, min_score),
        *_angles(predictions, files),
    ]
    used = predictions.select(np.isin(predictions.names, types) & (predictions.scores >= min_score))
    step = max(1, len(files) // FRAMES)
    used = used.select(used.frame % step == 0)
    vehicles = vehicles.select(vehicles.frame % step == 0)
    if len(used) > 0 and len(vehicles) > 0:
        findings += [Finding("warning", *pair) for pair in errors_of(used, vehicles)]
    return findings


def few_predicted(
    predictions: Predictions, vehicles: Vehicles, frames: Sequence[int]
) -> Iterator[Finding]:
    """Yields a warning if most frames with vehicles have no prediction at all.

    vehicles: the vehicles with points. frames: numbers of the evaluated frames.
    """
    with_vehicles = np.unique(vehicles.frame)
    empty = np.setdiff1d(with_vehicles, predictions.frame)
    if len(predictions) and len(empty) > FEW_PREDICTED * len(with_vehicles):
        text = (
            f"{len(empty)} of {len(with_vehicles)} frames with vehicles have no prediction, for "
            f"example frame {frames[empty[0]]}; their vehicles are counted as missed. `frames` "
            "selects the frames to evaluate"
        )
        yield Finding("warning", "frames-without-predictions", text)


def _names(
    predictions: Predictions, files: Sequence[Path | None], types: Sequence[str]
) -> Iterator[Finding]:
    unevaluated = ~np.isin(predictions.names, types)
    if not unevaluated.any():
        return
    known = np.isin(predictions.names, (*VEHICLE_TYPES, *PERSON_TYPES))
    if not known[unevaluated].all():
        unevaluated &= ~known  # if some names are unknown, only these are reported
    names, counts = np.unique(predictions.names[unevaluated], return_counts=True)
    listed = ", ".join(f"{name} ({count})" for name, count in zip(names, counts, strict=True))
    location = _first(predictions, files, unevaluated)
    text = f"{location}: types that are not evaluated: {listed}; expected {', '.join(types)}"
    if known[unevaluated].all():
        # A detector may have found only classes that are not evaluated.
        text = f"types that are not evaluated: {listed}; `classes` sets the evaluated classes"
        yield Finding("warning" if unevaluated.all() else "note", "other-classes", text)
    elif unevaluated.all():
        raise FormatError(text)
    else:
        yield Finding("warning", "other-classes", text)


def _scores(
    predictions: Predictions, files: Sequence[Path | None], min_score: float
) -> Iterator[Finding]:
    scores = predictions.scores
    odd = (scores < 0) | (scores > 1)
    if odd.any():
        location = _first(predictions, files, odd)
        text = (
            f"{location}: {odd.sum()} scores outside 0 to 1; predictions with a score below "
            f"{min_score:g} are not used"
        )
        yield Finding("warning", "score-range", text)
    if (scores < min_score).all():
        text = f"{_folder(files)}: all scores are below {min_score:g}, so no prediction is used"
        yield Finding("warning", "scores-low", text)


def _angles(predictions: Predictions, files: Sequence[Path | None]) -> Iterator[Finding]:
    large = np.abs(predictions.angle) > 2 * math.pi + 0.01
    if large.any():
        text = (
            f"{_first(predictions, files, large)}: {large.sum()} of {len(large)} headings exceed "
            f"2 pi (the first is {predictions.angle[large][0]:g}); expected radians, but the "
            "headings may be in degrees"
        )
        yield Finding("warning", "heading-degrees", text)


def _first(predictions: Predictions, files: Sequence[Path | None], which: BoolArray) -> str:
    first = int(np.flatnonzero(which)[0])
    return f"{files[predictions.frame[first]]}:{predictions.line[first]}"


def _folder(files: Sequence[Path | None]) -> str:
    return next((str(file.parent) for file in files if file is not None), "predictions")


def _and_more(items: Sequence[object]) -> str:
    return f" (and {len(items) - 1} more)" if len(items) > 1 else ""
