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

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
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
from pyinfra.metrics.matching import pairs_of_frames

OTHER_FRAMES = "other-frames"  # finding: the model learnt from frames of another frames_version
NEAR_M = 2.0  # largest horizontal distance of a near prediction from the centre of a vehicle
FAR_M = 20.0  # largest common displacement of all boxes in x or y that is recognised
LEAST_NEAR = 0.3  # below this share of near predictions, common errors of position are tested
FAR_OFF = 0.1  # below this share, a warning says that the boxes are far from all vehicles
MUCH_BETTER = 0.25  # a warning names an error if its correction adds more than this to the share
HEIGHT_OFF_M = 0.5
QUARTER_DEG = 60.0
LEAST_RATIO = 1.2  # above this length-to-width ratio of vehicles, swapped sizes are reported
CHANGES = {  # matrices for x and y that correct boxes with wrong axes
    "mirrored-left-right": [[1, 0], [0, -1]],
    "mirrored-front-back": [[-1, 0], [0, 1]],
    "turned-half": [[-1, 0], [0, -1]],
    "axes-swapped": [[0, 1], [1, 0]],
    "turned-quarter-left": [[0, -1], [1, 0]],
    "turned-quarter-right": [[0, 1], [-1, 0]],
}
FEW_PREDICTED = 0.5  # a larger share of frames without predictions causes a warning
FRAMES = 300  # every n-th frame is checked, where n is the number of frames // FRAMES


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

    files: tuple[Path | None, ...]  # one per frame; None for a missing file, if allowed
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
        findings += [Finding("warning", *pair) for pair in _position_findings(used, vehicles)]
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
        unevaluated &= ~known  # unknown names are reported first, without the known classes
    names, counts = np.unique(predictions.names[unevaluated], return_counts=True)
    listed = ", ".join(f"{name} ({count})" for name, count in zip(names, counts, strict=True))
    location = _first(predictions, files, unevaluated)
    text = f"{location}: types that are not evaluated: {listed}; expected {', '.join(types)}"
    if known[unevaluated].all():
        # A detector can detect classes that are not evaluated. It may have found only those.
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


def _position_findings(predictions: Predictions, vehicles: Vehicles) -> Iterator[tuple[str, str]]:
    p, v = np.concatenate([*pairs_of_frames(predictions.frame, vehicles.frame)], axis=1)
    boxes, truth = predictions.boxes, vehicles.boxes
    share = _share_near(boxes, truth, p, v)
    if share < LEAST_NEAR:
        elsewhere = _elsewhere(boxes, truth, p, v, share)
        if elsewhere is not None:
            yield elsewhere
            return
    gap = np.hypot(boxes[p, 0] - truth[v, 0], boxes[p, 1] - truth[v, 1])
    close = gap <= NEAR_M
    p, v = p[close], v[close]
    yield from _heights(boxes[p], truth[v])
    yield from _headings(boxes[p], truth[v])
    ratio = np.median(truth[v, 3] / truth[v, 4])
    if np.median(boxes[p, 3] / boxes[p, 4]) < 1 and ratio > LEAST_RATIO:
        yield (
            "length-width",
            "most predictions are wider than long; length and width may be swapped",
        )


def _elsewhere(
    boxes: FloatArray, truth: FloatArray, p: IntArray, v: IntArray, share: float
) -> tuple[str, str] | None:
    """Returns the name and text of a warning about the positions of predictions; None if good.

    The text names the change of axes, or the shift, that moves the predictions near vehicles.
    """
    text = f"{100 * share:.0f} % of the predictions lie within {NEAR_M:g} m of a vehicle"
    shares = {}
    for name, matrix in CHANGES.items():
        moved = boxes.copy()
        moved[:, :2] = boxes[:, :2] @ np.array(matrix, dtype=np.float64)
        shares[name] = _share_near(moved, truth, p, v)
    name = max(shares, key=lambda name: shares[name])
    if shares[name] > share + MUCH_BETTER:
        better = f"{100 * shares[name]:.0f} % do if this change of the axes is undone"
        return name, f"{text}, but {better}"
    dx, dy = _shift(boxes[p, :2] - truth[v, :2])
    moved = boxes.copy()
    moved[:, :2] -= (dx, dy)
    shifted_share = _share_near(moved, truth, p, v)
    if shifted_share > share + MUCH_BETTER:
        return (
            "displaced",
            f"{text}, but {100 * shifted_share:.0f} % do if a shift of ({dx:.1f}, {dy:.1f}) m is "
            "subtracted",
        )
    if share > FAR_OFF:
        return None  # the frame of reference is right, but the detector is poor
    causes = "a different frame of reference, predictions of other frames, or poor boxes"
    return "far-from-vehicles", f"{text}; possible causes are {causes}"


def _shift(between: FloatArray) -> tuple[float, float]:
    """Returns the most frequent difference between centres in x and y, at most FAR_M each.

    between: (n, 2) differences of centres, metres.
    """
    edges = np.arange(-FAR_M, FAR_M + 1)
    counts, _, _ = np.histogram2d(between[:, 0], between[:, 1], bins=(edges, edges))
    i, j = np.unravel_index(counts.argmax(), counts.shape)
    middle = edges[[i, j]] + 0.5
    peak = between[(np.abs(between - middle) <= 1).all(axis=1)]
    if len(peak) == 0:
        return 0.0, 0.0
    dx, dy = np.median(peak, axis=0)
    return float(dx), float(dy)


def _heights(boxes: FloatArray, truth: FloatArray) -> Iterator[tuple[str, str]]:
    off = float(np.median(boxes[:, 2] - truth[:, 2]))
    half = float(np.median(truth[:, 5])) / 2
    if abs(off) <= HEIGHT_OFF_M:
        return
    text = f"boxes are {abs(off):.2f} m too {'high' if off > 0 else 'low'} (median)"
    if abs(abs(off) - half) < 0.25:
        text += (
            ", which is half of their height; z may be the bottom of the box instead of the "
            "centre, or the reverse."
        )
    else:
        text += (
            "; z may be relative to the road instead of the sensor, or the anchor height may be "
            "wrong."
        )
    yield "height-offset", f"{text} This changes the 3-D IoU, but not the BEV IoU"


def _headings(boxes: FloatArray, truth: FloatArray) -> Iterator[tuple[str, str]]:
    as_is = _median_turn(boxes[:, 6] - truth[:, 6])
    if as_is <= QUARTER_DEG / 4:
        return
    quarter = _median_turn(boxes[:, 6] - truth[:, 6] + math.pi / 2)
    mirrored = _median_turn(-boxes[:, 6] - truth[:, 6])
    text = f"headings are off by {as_is:.0f} degrees (median)"
    if quarter < as_is / 3:
        yield "heading-quarter", f"{text}, a quarter turn; in KITTI, rotation_y = -heading - pi/2"
    elif mirrored < as_is / 3:
        better = f"only by {mirrored:.0f} with the opposite sign"
        yield "heading-sign", f"{text}, but {better}; positive headings turn to the left"
    else:
        yield "heading-off", text


def _median_turn(turn: FloatArray) -> float:
    """Returns the median absolute difference of headings in degrees, 0 to 90.

    turn: differences of headings, radians. Headings that differ by 180 degrees are taken as equal.
    """
    return float(np.median(np.abs((np.degrees(turn) + 90) % 180 - 90)))


def _share_near(boxes: FloatArray, truth: FloatArray, p: IntArray, v: IntArray) -> float:
    gap = np.hypot(boxes[p, 0] - truth[v, 0], boxes[p, 1] - truth[v, 1])
    near = np.zeros(len(boxes), dtype=np.bool_)
    near[p[gap <= NEAR_M]] = True
    return float(near.mean())


def _first(predictions: Predictions, files: Sequence[Path | None], which: BoolArray) -> str:
    first = int(np.flatnonzero(which)[0])
    return f"{files[predictions.frame[first]]}:{predictions.line[first]}"


def _folder(files: Sequence[Path | None]) -> str:
    return next((str(file.parent) for file in files if file is not None), "predictions")


def _and_more(items: Sequence[object]) -> str:
    return f" (and {len(items) - 1} more)" if len(items) > 1 else ""
