"""The representation of a recording that all readers return. Frames are read one by one."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from hashlib import sha256
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import AnyArray, FloatArray, IntArray, NameArray, Points, Records
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.files import write
from pyinfra.exchange.name_times import times_in
from pyinfra.formats.kitti import WorldPose
from pyinfra.formats.kitti.layout import FARTHEST_M
from pyinfra.formats.text_table import lines_of


@dataclass(frozen=True)
class Options:
    """Properties that files do not state. None selects the default of the format."""

    intensity_max: float | None = None  # largest intensity of the source, which is scaled to 1
    columns: int | None = None  # number of float32 values per point in a .bin file
    labels: Path | None = None  # folder of labels, if not the usual folder, or .csv file of labels
    channel: str | None = None  # name of the LiDAR, if the recording has several
    unit_m: float = 1.0  # length unit of the source's coordinates, metres
    # Maps the keys of `formats.box_csv` to the columns of a .csv file with labels.
    label_columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Boxes:
    """The k labelled objects of a frame, in the frame of its points."""

    names: NameArray  # (k,) class names of the source
    boxes: FloatArray  # (k, 7) x y z dx dy dz heading
    ids: IntArray | None = None  # (k,) ids of tracks; None if they are unknown
    visibility: FloatArray | None = None  # (k,) visible share in [0, 1]; None if it is unknown
    left_out: tuple[str, ...] = ()  # texts about objects of the frame that could not be read
    unread: frozenset[str] = frozenset()  # keys of labelled objects that are not read

    def __len__(self) -> int:
        return len(self.names)


NO_BOXES = Boxes(np.empty(0, dtype=np.str_), np.empty((0, 7)))


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """One frame of a recording."""

    points: Points  # (n, 4) x y z intensity, intensity in [0, 1]
    boxes: Boxes
    fields: Records | None = None  # (n,) records of kitti.FIELDS


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames of one stationary LiDAR."""

    names: tuple[str, ...]  # names of the frames in the source, in order of time
    read: Callable[[int], RecordedFrame]  # reads a frame by its index in `names`
    labelled: bool
    splits: dict[str, tuple[str, ...]] = field(default_factory=dict)  # frame names of train and val
    period_s: float | None = None
    pose: WorldPose | None = None
    # Pitch and roll (rad) of the sensor, which were already removed from the points.
    tilt: tuple[float, float] | None = None
    # Digest of the tracks that ids identify; empty if ids do not identify tracks.
    tracks_sha256: str = ""
    times: Callable[[], FloatArray | None] = lambda: None  # returns frame times of the files in s
    notes: Callable[[], list[str]] = list  # returns texts about assumptions of the reader
    origin: Callable[[], FloatArray | None] = lambda: None  # sensor position in the points' frame
    slots: tuple[int, ...] | None = None  # frame numbers; if None, numbers() derives them
    reads: tuple[Path, ...] = ()  # files and folders that are read; empty if they are unknown
    unread_parts: Callable[[], list[str]] = list  # returns texts about unread fields or topics

    @property
    def counted(self) -> bool:
        """Whether frames are numbered 0, 1, 2, ... in their order.

        This is the case if the names are not unique numbers up to 999,999.
        """
        if not all(re.fullmatch("0*[0-9]{1,6}", name) for name in self.names):
            return True
        # Names such as 1 and 01 have the same number.
        return len({int(name) for name in self.names}) < len(self.names)

    def numbers(self) -> tuple[int, ...]:
        """Returns the frame numbers: `slots`, else the names as numbers, else 0, 1, 2, ..."""
        if self.slots is not None:
            return self.slots
        if self.counted:
            return tuple(range(len(self.names)))
        return tuple(int(name) for name in self.names)


def sorted_files(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Returns the files of a folder with one of the suffixes, sorted by times or numbers in names.

    Hidden files are skipped, because they belong to the system or are still being written. Raises
    FileNotFoundError if the folder does not exist. Raises Error if it has no file with a suffix, or
    two files of the same frame.
    """
    candidates = (file for file in folder.iterdir() if not file.name.startswith("."))
    files = [file for file in candidates if file.name.lower().endswith(tuple(suffixes))]
    if not files:
        raise Error(f"{folder}: expected at least one {' or '.join(suffixes)} file, got none")
    first: dict[str, Path] = {}
    for file in files:
        if (other := first.setdefault(stem(file), file)) is not file:
            raise Error(
                f"{folder}: expected one file for each frame, got {other.name} and {file.name}"
            )
    times = times_in([stem(file) for file in files])
    if times is not None:
        return [files[i] for i in sorted(range(len(files)), key=lambda i: (times[i], files[i]))]
    of_name = _numbers_in([file.name for file in files])
    return sorted(files, key=lambda file: (of_name[file.name], file.name))


def read_splits(folder: Path, names: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """Reads the frame names of train and val in an ImageSets folder, limited to `names`.

    Returns an empty dict unless both lists have a frame of `names`, and notes on frames that are
    left out or in both lists.
    """
    existing = set(names)
    files = {part: folder / f"{part}.txt" for part in ("train", "val")}
    listed = {
        part: [name for line in lines_of(file) for name in line.split()]
        for part, file in files.items()
        if file.is_file()
    }
    splits = {part: tuple(n for n in listed.get(part, ()) if n in existing) for part in files}
    notes = []
    absent = [name for part in listed.values() for name in part if name not in existing]
    if absent:
        notes.append(
            f"{folder.name}: {len(absent)} listed frames, such as {absent[0]}, have no cloud of "
            "this name and are left out"
        )
    if both := set(splits["train"]) & set(splits["val"]):
        notes.append(f"{folder.name}: {len(both)} frames, such as {min(both)}, are in both lists")
    return (splits if all(splits.values()) else {}), notes


def write_splits(folder: Path, splits: Mapping[str, Sequence[int]]) -> None:
    """Writes the frame numbers of each part, such as train and val, to an ImageSets folder."""
    for part, numbers in splits.items():
        folder.mkdir(exist_ok=True)
        write(folder / f"{part}.txt", "".join(f"{number:06d}\n" for number in numbers))


def as_points(
    file: Path, columns: Sequence[AnyArray], options: Options, usual: float = 1.0
) -> Points:
    """Converts columns x, y, z and intensity, (n,) each, to points (n, 4) in metres.

    Intensities are divided by the source's largest intensity, and limited to 0 to 1. Points with
    non-finite values stay in the result. Raises FormatError for a coordinate beyond 10 km, or an
    intensity above 10,000 times the largest intensity.
    """
    highest = usual if options.intensity_max is None else options.intensity_max
    for name, column in zip(("x", "y", "z", "intensity"), columns, strict=True):
        # The limits of coordinates and intensities are those of kitti.read_points.
        most = FARTHEST_M * (highest if name == "intensity" else 1 / options.unit_m)
        bad = np.flatnonzero(np.isfinite(column) & (np.abs(column) > most))
        if len(bad) > 0:
            location = f"{file}: point {bad[0]}: {name}"
            raise FormatError(f"{location}: expected {-most:g} to {most:g}, got {column[bad[0]]:g}")
    points = np.stack([column.astype(np.float32) for column in columns], axis=1)
    points[:, 3] = np.clip(points[:, 3] / highest, 0, 1)  # a few intensities may exceed `highest`
    if options.unit_m != 1:
        points[:, :3] *= options.unit_m
    return points


def read_bin(file: Path, columns: int, options: Options, usual: float = 1.0) -> Points:
    """Reads the first four columns of a float32 .bin file and converts them with `as_points`.

    `options.columns` overrides `columns`. If there are three columns, the intensity is 0. Raises
    FormatError for a truncated file and for values that `as_points` does not accept.
    """
    columns, size = options.columns or columns, file.stat().st_size
    if size % (4 * columns) != 0:
        raise FormatError(
            f"{file}: expected a multiple of {4 * columns} bytes ({columns} float32 per point), "
            f"got {size} bytes"
        )
    values = np.fromfile(file, dtype="<f4").reshape(-1, columns)
    if columns == 3:
        values = np.column_stack([values, np.zeros(len(values), dtype=np.float32)])
    return as_points(file, list(values.T[:4]), options, usual)


def check_pairs(clouds: Sequence[Path], labels: Sequence[Path]) -> None:
    """Raises Error for a label file without a cloud, and for a cloud without a label file."""
    have, want = {stem(file) for file in clouds}, {stem(file) for file in labels}
    for file in labels:
        if stem(file) not in have:
            raise Error(f"{file}: expected a cloud for each label file, got none for this file")
    for file in clouds:
        if stem(file) not in want:
            raise Error(
                f"{file}: expected a label file for each cloud, got none for this cloud; write an "
                "empty label file for a cloud without objects"
            )


def selected(where: Path, names: Sequence[str], channel: str | None, what: str = "LiDAR") -> int:
    """Returns the index of the name that equals `channel`; None selects the only name.

    Raises Error unless exactly one of the names fits.
    """
    fitting = [i for i, name in enumerate(names) if channel in (None, name)]
    if len(fitting) != 1:
        wanted = f"{what} '{channel}'" if channel else what
        got = f"the {what}s {', '.join(names)}" if names else "none"
        raise Error(f"{where}: expected one {wanted}, got {got}; `channel` selects one")
    return fitting[0]


def digest_of(files: Sequence[Path]) -> str:
    """Returns a digest of the content of files, one after the other."""
    digest = sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def stem(file: Path) -> str:
    """Returns a file name without its extension, such as `.pcd.bin` in any letter case."""
    return re.sub(r"(\.pcd)?(\.bin)?$", "", file.name, flags=re.I).removesuffix(file.suffix)


def records_of(columns: Mapping[str, AnyArray]) -> Records:
    """Returns packed records (n,) with the columns, (n,) each, as their fields."""
    types = [(name, column.dtype) for name, column in columns.items()]
    records = np.empty(len(next(iter(columns.values()))), dtype=types)
    for name, column in columns.items():
        records[name] = column
    return records


def _numbers_in(names: Sequence[str]) -> dict[str, tuple[Decimal, ...]]:
    """Returns the numbers in each name.

    A point between two numbers, as in 1.25, is a decimal point if a program has written decimals
    without trailing zeros, such as 1.0, 1.15 and 1.2. Otherwise, as in 1.9 and 1.10, it separates
    whole numbers.
    """
    words = {name: re.findall(r"\d+(?:\.\d+)*", name) for name in names}
    decimals = [word.partition(".")[2] for found in words.values() for word in found]
    decimals = [digits for digits in decimals if digits]
    separated = any("." in d or (len(d) > 1 and d.endswith("0")) for d in decimals)
    return {
        name: tuple(
            Decimal(part) for word in found for part in (word.split(".") if separated else [word])
        )
        for name, found in words.items()
    }
