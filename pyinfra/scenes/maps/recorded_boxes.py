"""Reads recorded boxes from a CSV file with any column names, or from the labels of frames."""

import shlex
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray, NameArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.dataset.data_set import ids_are_tracks
from pyinfra.dataset.frame_readers import read_labelled, read_vehicles
from pyinfra.dataset.frames import data_set_of, usual_step
from pyinfra.dataset.world_frame import boxes_to_world
from pyinfra.formats.csv_table import expect, numbers, read_words
from pyinfra.formats.kitti import frames, read_lidar
from pyinfra.formats.track_names import track_name
from pyinfra.scenes.maps.box_links import link
from pyinfra.scenes.maps.tracks import CLASSES

MOST_OBJECTS = 100_000
_NEEDED = ("x", "y", "heading", "dx", "dy", "class")
_COLUMNS = (*_NEEDED, "z", "dz", "t", "frame", "id")
# Names of columns in public data sets of tracks: inD, related data sets, and INTERACTION.
_KNOWN = {
    "x": ("xCenter", "center_x"),
    "y": ("yCenter", "center_y"),
    "heading": ("psi_rad", "yaw"),
    "dx": ("length",),
    "dy": ("width",),
    "dz": ("height",),
    "id": ("trackId", "track_id"),
    "frame": ("frame_id",),
    "class": ("agent_type",),
}
_RULES = {
    **dict.fromkeys("xyz", (-1e7, 1e7)),
    **dict.fromkeys(("dx", "dy", "dz"), (0.1, 50.0)),
    "heading": (-1e4, 1e4),
    "t": (-1e10, 1e10),
    "frame": (-1e10, 1e10),
}


@dataclass(frozen=True)
class BoxColumns:
    """Options for a CSV file whose column or class names differ from those of this package."""

    # Maps column names of this package to column names of the file.
    names: dict[str, str] = field(default_factory=dict)
    # Maps class names of the file to class names of this package.
    classes: dict[str, str] = field(default_factory=dict)
    rate_hz: float | None = None  # frame rate, if the file has `frame` instead of `t`
    degrees: bool = False  # whether headings are in degrees


@dataclass(frozen=True)
class BoxTrack:
    """The boxes (n, 7) of one object in the world frame, at increasing times (n,) in s."""

    name: str
    object_class: str
    times: FloatArray
    boxes: FloatArray
    has_mean_size: bool = False  # whether length and width, 0 in the file, are means of the class


def read_boxes(file: Path, how: BoxColumns) -> list[BoxTrack]:
    """Reads the objects of a CSV file. Without a column `id`, boxes are linked to tracks.

    Boxes with an unknown id are linked too. Raises Error for an unknown name of a column,
    FormatError and OSError.
    """
    unknown = sorted(set(how.names) - set(_COLUMNS))
    if unknown:
        raise Error(f"columns: expected one of the names {', '.join(_COLUMNS)}; got '{unknown[0]}'")
    words = read_words(file, separator_of(file))
    ours = {theirs: our_name for our_name, theirs in how.names.items()}
    words = _with_known_names(words.rename(columns=ours))
    clock = "frame" if how.rate_hz is not None else "t"
    if "t" not in words.columns and "timestamp_ms" in words.columns:
        words["t"] = (numbers(file, words["timestamp_ms"]) / 1000).astype(str)
    if "class" not in words.columns:
        words["class"] = _classes_of(file, words)
    for name in (*_NEEDED, clock):
        if name not in words.columns:
            have = ", ".join(map(str, words.columns))[:200]
            raise FormatError(
                f"{file}:1: expected a column '{name}', got the columns {have}; `columns` maps "
                "other names, and `class_of` =Car sets the class of objects without a class"
            )
    if not len(words):
        raise FormatError(f"{file}: expected one or more rows, got none")
    classes = np.array([_class(file, i, name, how) for i, name in enumerate(words["class"])])
    sizes = np.array([CLASSES[name].mean_m for name in classes]).reshape(-1, 3)
    unsized = _fill_sizes(file, words, sizes)
    values = {name: _checked(file, words, name) for name in (*_NEEDED[:-1], clock)}
    for name, usual in (("z", np.full(len(words), np.nan)), ("dz", sizes[:, 2])):
        values[name] = _checked(file, words, name) if name in words.columns else usual
    times = values[clock] / (how.rate_hz or 1.0)
    boxes = np.column_stack([values[n] for n in ("x", "y", "z", "dx", "dy", "dz", "heading")])
    if how.degrees:
        boxes[:, 6] = np.radians(boxes[:, 6])
    elif (np.abs(boxes[:, 6]) > 2 * np.pi + 1e-3).any():
        row = int(np.argmax(np.abs(boxes[:, 6]) > 2 * np.pi + 1e-3))
        raise FormatError(
            f"{file}:{row + 2}: heading: expected radians, got {boxes[row, 6]:g}; for degrees, set "
            "`degrees`"
        )
    ids = _ids(words, times, boxes, classes)
    tracks = _tracks(file, times, boxes, classes, ids)
    names = set(map(str, ids[unsized]))
    return [replace(track, has_mean_size=track.name in names) for track in tracks]


def _ids(
    words: pd.DataFrame, times: FloatArray, boxes: FloatArray, classes: NameArray
) -> NameArray:
    """Returns the track (n,) of each box, from the column `id` or, without an id, by linking."""
    column = words["id"] if "id" in words else pd.Series("", index=words.index)
    ids = column.map({word: track_name(word) for word in column.unique()}).to_numpy(object)
    new = np.flatnonzero(ids == "")
    linked = link(times[new], boxes[new], classes[new], _usual_step(times))
    ids[new] = [f"linked {number}" if len(new) < len(ids) else str(number) for number in linked]
    return np.asarray(ids, dtype=np.str_)


def _fill_sizes(file: Path, words: pd.DataFrame, sizes: FloatArray) -> BoolArray:
    """Replaces length and width by those of `sizes` (n, 3) where both are 0.

    inD has such rows for pedestrians and bicycles. Returns a mask (n,) of the changed rows.
    """
    is_zero = np.all([numbers(file, words[name]).to_numpy(float) == 0 for name in ("dx", "dy")], 0)
    for name, mean in zip(("dx", "dy"), sizes.T, strict=False):
        words.loc[is_zero, name] = mean[is_zero].astype(str)
    return np.asarray(is_zero)


def read_frames(folder: Path) -> list[BoxTrack]:
    """Reads the objects of a LiDAR's folder (KITTI layout) as tracks.

    If the ids of `training/objects` are tracks, all its objects are read, and those of one id are
    a track of its most frequent class. A simulated folder has objects without points there, too.
    Other objects are labels or have no id; they are linked. The tracks are in the world frame.
    Raises FormatError and OSError.
    """
    lidar, numbers = read_lidar(folder), np.array(frames(folder), dtype=np.int64)
    tracked = ids_are_tracks(data_set_of(folder)) and (folder / "training/objects").is_dir()
    found = (read_vehicles if tracked else read_labelled)(folder, numbers.tolist())
    if not len(found):
        raise FormatError(f"{folder}: expected one or more labels, got none")
    wrong = sorted(set(found.names) - set(CLASSES))
    if wrong:
        known = ", ".join(CLASSES)
        raise FormatError(f"{folder}: expected one of the classes {known}; got '{wrong[0]}'")
    times = (numbers[found.frame].astype(np.float64) + 0.5) * lidar.period_s
    boxes = boxes_to_world(found.boxes, lidar.T_world_levelled)
    ids, classes = found.ids.copy(), pd.Series(found.names)
    new = np.flatnonzero(ids < 0)
    step_s = lidar.period_s * usual_step(numbers.tolist())
    ids[new] = ids.max() + 1 + link(times[new], boxes[new], found.names[new], step_s)
    usual = classes.groupby(ids).transform(lambda names: names.mode()[0]).to_numpy(str)
    return _tracks(folder, times, boxes, usual, ids)


def _usual_step(times: FloatArray) -> float:
    """Returns the median step between times (n,) in seconds; 1 for a single time."""
    steps = np.diff(np.unique(times))
    return float(np.median(steps)) if len(steps) else 1.0


def separator_of(file: Path) -> str:
    """Returns the separator of columns: a semicolon, a tab, or a comma."""
    with file.open(encoding="utf-8-sig", errors="replace") as stream:
        head = stream.readline(10_000)
    return max(",;\t", key=head.count)


def _with_known_names(words: pd.DataFrame) -> pd.DataFrame:
    names = {}
    for ours, theirs in _KNOWN.items():
        found = next((name for name in theirs if name in words.columns), None)
        if ours not in words.columns and found:
            names[found] = ours
    return words.rename(columns=names)


def _classes_of(file: Path, words: pd.DataFrame) -> pd.Series:
    """Returns the class of each row from inD's *_tracksMeta.csv beside `file`, else empty texts."""
    meta = file.with_name(file.name.replace("_tracks.csv", "_tracksMeta.csv"))
    if meta != file and meta.is_file() and "id" in words.columns:
        tracks = read_words(meta)
        if {"trackId", "class"} <= set(tracks.columns):
            of_track = dict(zip(tracks["trackId"], tracks["class"], strict=True))
            return words["id"].map(of_track).fillna("")
    return pd.Series("", index=words.index)


def _checked(file: Path, words: pd.DataFrame, name: str) -> FloatArray:
    """Returns a column of numbers. Raises FormatError if a number is missing or out of range."""
    values = numbers(file, words[name]).to_numpy(float)
    low, high = _RULES[name]
    good = pd.Series((values >= low) & (values <= high))
    expect(file, words[name], good, f"{low:g} to {high:g}")
    return np.asarray(values)


def _class(file: Path, row: int, name: str, how: BoxColumns) -> str:
    ours = how.classes.get(name, name)
    if ours not in CLASSES:
        raise FormatError(
            f"{file}:{row + 2}: class: expected one of {', '.join(CLASSES)}; got '{name[:40]}'; "
            f"to map it to a class, use for example `class_of` {shlex.quote(f'{name}=Car')}"
        )
    return ours


def _tracks(
    file: Path, times: FloatArray, boxes: FloatArray, classes: np.ndarray, ids: np.ndarray
) -> list[BoxTrack]:
    names, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    if len(names) > MOST_OBJECTS:
        raise FormatError(f"{file}: expected up to {MOST_OBJECTS} objects, got {len(names)}")
    order = np.argsort(inverse, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(inverse))[:-1])
    tracks = []
    for i in np.argsort(first):
        rows = groups[i]
        back = np.flatnonzero(np.diff(times[rows]) <= 0)
        if len(back):
            line = rows[back[0] + 1] + 2
            raise FormatError(
                f"{file}:{line}: t: expected ascending times of object '{names[i]}', "
                f"got {times[rows[back[0] + 1]]:g} after {times[rows[back[0]]]:g}"
            )
        if len(set(classes[rows])) > 1:
            raise FormatError(
                f"{file}: expected one class for each object, got "
                f"{' and '.join(sorted(set(classes[rows])))} for object '{names[i]}'"
            )
        tracks.append(BoxTrack(str(names[i]), str(classes[rows[0]]), times[rows], boxes[rows]))
    return tracks
