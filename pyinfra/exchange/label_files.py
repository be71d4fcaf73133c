"""Finds the labels of a folder of clouds, and reads them: text, CSV, or JSON of several tools."""

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import IntArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange.box_text import read_boxes
from pyinfra.exchange.cuboids import read_cuboids, read_sequence
from pyinfra.exchange.json_boxes import read_json, read_objects, shown, track_digest
from pyinfra.exchange.recording import (
    NO_BOXES,
    Boxes,
    Options,
    check_pairs,
    digest_of,
    sorted_files,
    stem,
)
from pyinfra.exchange.tool_labels import has_degrees, read_label_cloud, read_sustech
from pyinfra.formats.box_csv import BoxTable, read_box_csv, rows_of_frames
from pyinfra.formats.track_names import names_in_frame, track_name

FOLDERS = ("labels", "label")  # usual folders of labels in a recording
CLOUD_FOLDERS = ("points", "", "lidar", "pcd", "pointclouds")  # usual folders of clouds
MOST_JSON = 20  # maximum number of files beside the clouds that are checked for OpenLABEL
SUFFIXES = (".txt", ".json", ".csv")


@dataclass(frozen=True, eq=False)
class LabelFiles:
    """The clouds of a recording and their labels. Without labels, `files` is empty."""

    clouds: list[Path]  # the clouds with labels, or all clouds if there are no labels
    # Maps the name of a cloud to its boxes. Raises FormatError.
    read: Callable[[str], Boxes] = lambda name: NO_BOXES
    files: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()
    tracks_sha256: str = ""

    @property
    def labelled(self) -> bool:
        return bool(self.files)


def clouds_in(source: Path, suffixes: Sequence[str]) -> list[Path]:
    """Returns the clouds of a recording: a file, or those in the first folder of CLOUD_FOLDERS.

    Raises FileNotFoundError, and Error if no folder has such a file.
    """
    if source.is_file():
        return [source]
    folders = [source / name for name in CLOUD_FOLDERS]
    return sorted_files(next((f for f in folders if _has(f, suffixes)), source), suffixes)


def _has(folder: Path, suffixes: Sequence[str]) -> bool:
    return folder.is_dir() and any(
        path.name.lower().endswith(tuple(suffixes)) and not path.name.startswith(".")
        for path in folder.iterdir()
    )


def label_folder(source: Path) -> Path | None:
    """Returns the usual folder of labels in a recording, if it has files of a known kind."""
    folders = (source / name for name in FOLDERS)
    return next((f for f in folders if f.is_dir() and _suffixes(f)), None)


def open_labels(clouds: list[Path], source: Path, options: Options) -> LabelFiles:
    """Opens the labels of clouds: `options.labels`, else those of the usual folder of `source`.

    Labels are .txt or .csv files for each cloud, one .csv file with a column of frames, one
    OpenLABEL file with all frames, or .json files of labelCloud, SUSTechPOINTS, OpenLABEL or
    DAIR-V2X for each cloud. Raises Error for labels that do not pair with clouds, and FormatError
    for an unknown kind.
    """
    place = options.labels or label_folder(source) or _open_label(source)
    if place is None:
        return LabelFiles(clouds)
    if place.is_file() and place.suffix.lower() == ".json":
        by_cloud = read_sequence(place, [stem(cloud) for cloud in clouds])
        kept, notes = _labelled(clouds, by_cloud, f"are not in {place.name}")
        digest = digest_of([place])
        return LabelFiles(kept, by_cloud.__getitem__, (place,), tuple(notes), digest)
    if place.is_file():
        return _of_one_csv(clouds, place, options)
    suffixes = _suffixes(place) or SUFFIXES[:1]
    if len(suffixes) > 1:
        raise Error(
            f"{place}: expected label files of one format, got the endings {', '.join(suffixes)}"
        )
    files = [f for f in sorted_files(place, suffixes) if not f.name.startswith("_")]
    if suffixes[0] == ".txt":
        check_pairs(clouds, files)
        by_name = {stem(file): file for file in files}
        return LabelFiles(clouds, lambda name: read_boxes(by_name[name]), tuple(files))
    if suffixes[0] == ".csv":
        return _of_csv_files(clouds, files, options)
    return _of_json(clouds, files)


def paired_labels(
    clouds: list[Path], folder: Path | None, read: Callable[[Path], Boxes]
) -> LabelFiles:
    """Opens a folder with a .json file for each cloud. Without a folder, there are no labels.

    Raises Error for labels that do not pair with clouds.
    """
    if folder is None:
        return LabelFiles(clouds)
    check_pairs(clouds, sorted_files(folder, [".json"]))
    return LabelFiles(clouds, lambda name: read(folder / f"{name}.json"), (folder,))


def object_labels(clouds: list[Path], folder: Path | None) -> LabelFiles:
    """Opens the labels of DAIR-V2X or RCooper. Raises Error like `paired_labels`."""
    ids: dict[str, int] = {}
    labels = paired_labels(clouds, folder, lambda file: read_objects(file, ids if tracks else None))
    tracks = track_digest(sorted_files(folder, [".json"])) if folder else ""
    return replace(labels, tracks_sha256=tracks)


def _open_label(source: Path) -> Path | None:
    """Returns the OpenLABEL file of a recording, or None unless there is exactly one."""
    files = sorted(source.glob("*.json")) if source.is_dir() else []
    found = []
    for file in files[:MOST_JSON]:
        with file.open("rb") as stream:
            if b'"openlabel"' in stream.read(200):
                found.append(file)
    return found[0] if len(found) == 1 else None


def _suffixes(folder: Path) -> list[str]:
    names = [p.name.lower() for p in folder.iterdir() if not p.name.startswith((".", "_"))]
    return [s for s in SUFFIXES if any(name.endswith(s) for name in names)]


def _with_labels(clouds: list[Path], files: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Returns the clouds that have a label file, and a note on the clouds that have none.

    Labelling tools write a file only for the frames that were labelled.
    """
    kept, notes = _labelled(clouds, {stem(file) for file in files}, "have no label file")
    check_pairs(kept, files)
    return kept, notes


def _labelled(
    clouds: list[Path], names: Container[str], problem: str
) -> tuple[list[Path], list[str]]:
    """Returns the clouds with one of the names, and a note with the problem of all other clouds."""
    others = [cloud for cloud in clouds if stem(cloud) not in names]
    if not others:
        return clouds, []
    text = f"{len(others)} of {len(clouds)} clouds, such as {others[0].name}, {problem}"
    return [c for c in clouds if stem(c) in names], [f"{text}: they are left out"]


def _of_json(clouds: list[Path], files: list[Path]) -> LabelFiles:
    kind = _kind(files)
    kept, notes = _with_labels(clouds, files)
    by_name = {stem(file): file for file in files}
    ids: dict[str, int] = {}
    if kind == "labelCloud":
        degrees = has_degrees(files)
        unit = "degrees, because a value is" if degrees else "radians, because no value is"
        notes.append(f"rotations of labelCloud are in {unit} above 2 pi")
        return LabelFiles(
            kept,
            lambda name: read_label_cloud(by_name[name], degrees=degrees),
            tuple(files),
            tuple(notes),
        )
    key = {"SUSTechPOINTS": "obj_id", "DAIR-V2X": "track_id"}.get(kind, "openlabel")
    digest = track_digest(files, key)
    read: Callable[[Path], Boxes] = {
        "SUSTechPOINTS": lambda file: read_sustech(file, ids),
        "OpenLABEL": lambda file: read_cuboids(file, ids),
        "DAIR-V2X": lambda file: read_objects(file, ids if digest else None),
    }[kind]
    return LabelFiles(kept, lambda name: read(by_name[name]), tuple(files), tuple(notes), digest)


def _kind(files: Sequence[Path]) -> str:
    """Returns the tool that wrote JSON files, from the first one with an object."""
    for file in files:
        content = read_json(file)
        if isinstance(content, dict) and "openlabel" in content:
            return "OpenLABEL"
        objects = content.get("objects") if isinstance(content, dict) else content
        first = objects[0] if isinstance(objects, list) and objects else None
        if first is None and isinstance(objects, list):
            continue
        keys = set(first) if isinstance(first, dict) else set[str]()
        if "psr" in keys:
            return "SUSTechPOINTS"
        if isinstance(content, dict) and keys & {"centroid", "vertices"}:
            return "labelCloud"
        if "3d_location" in keys:
            return "DAIR-V2X"
        got = ", ".join(sorted(keys or (content if isinstance(content, dict) else []))[:8])
        raise FormatError(
            f"{file}: expected labels of labelCloud, SUSTechPOINTS, OpenLABEL or DAIR-V2X, got "
            f"{'the keys ' + got if got else shown(content)}; a .csv file with a row for each box "
            "is read too"
        )
    return "SUSTechPOINTS"


def _of_csv_files(clouds: list[Path], files: list[Path], options: Options) -> LabelFiles:
    kept, notes = _with_labels(clouds, files)
    by_name = {stem(file): file for file in files}
    ids: dict[str, int] = {}

    def read(name: str) -> Boxes:
        file = by_name[name]
        table = read_box_csv(file, options.label_columns)
        return _boxes(file, table, np.arange(len(table.boxes)), ids)

    return LabelFiles(kept, read, tuple(files), tuple(notes), _digest(files, options))


def _of_one_csv(clouds: list[Path], file: Path, options: Options) -> LabelFiles:
    table = read_box_csv(file, options.label_columns)
    rows = rows_of_frames(file, table, [(stem(cloud), stem(cloud)) for cloud in clouds])
    ids: dict[str, int] = {}
    texts = [f"{key} from {name}" for key, name in table.columns.items() if key != name]
    notes = [f"columns of {file.name}: {', '.join(texts)}"] if texts else []
    bare = len(clouds) - len(rows)
    if bare:
        notes.append(f"{bare} of {len(clouds)} clouds have no row in {file.name}, thus no objects")

    def read(name: str) -> Boxes:
        return _boxes(file, table, rows[name], ids) if name in rows else NO_BOXES

    return LabelFiles(clouds, read, (file,), tuple(notes), _digest([file], options))


def _boxes(file: Path, table: BoxTable, rows: IntArray, ids: dict[str, int]) -> Boxes:
    """Returns the boxes in rows (k,) of a table, which are those of a frame.

    `ids` maps track names to numbers, and new tracks are added to it. The id of a box without a
    track is -1. Boxes with the same track get ids of their own.
    """
    tracks = None
    if table.tracks is not None:
        words = [table.tracks[i] for i in rows]
        names = names_in_frame(words, [f"{file}:{table.lines[i]}" for i in rows])
        tracks = np.array(
            [
                ids.setdefault(name, len(ids)) if track_name(word) else -1
                for word, name in zip(words, names, strict=True)
            ],
            dtype=np.int64,
        )
    return Boxes(table.names[rows], table.boxes[rows], tracks, unread=frozenset(table.unread))


def _digest(files: Sequence[Path], options: Options) -> str:
    """Returns a digest of .csv files with a column of tracks; empty without this column."""
    if not files or read_box_csv(files[0], options.label_columns).tracks is None:
        return ""
    return digest_of(files)
