"""A recording of another tool or of a real LiDAR, read frame by frame."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import AnyArray, FloatArray, IntArray, NameArray, Points, Records
from pyinfra.core.errors import Error, FormatError
from pyinfra.formats.kitti import WorldPose
from pyinfra.formats.kitti.layout import FARTHEST_M
from pyinfra.formats.text_table import lines_of


@dataclass(frozen=True)
class Options:
    """What a reader cannot see in the files; None is what the format usually has."""

    intensity_max: float | None = None  # of the source; 1 here
    columns: int | None = None  # of a .bin file, float32: x y z, intensity unless 3, others
    labels: Path | None = None  # folder, in place of the usual one
    channel: str | None = None  # which LiDAR of several
    unit_m: float = 1.0  # of a coordinate in the source


@dataclass(frozen=True, eq=False)
class Boxes:
    """The k labelled objects of a frame, in the frame of its points."""

    names: NameArray  # (k,) as the source has them
    boxes: FloatArray  # (k, 7) x y z dx dy dz heading
    ids: IntArray | None = None  # (k,) the same for the same object in all frames; None: unknown
    visibility: FloatArray | None = None  # (k,) [0, 1]; None: unknown

    def __len__(self) -> int:
        return len(self.names)


NO_BOXES = Boxes(np.empty(0, dtype=np.str_), np.empty((0, 7)))


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """One frame of a recording."""

    points: Points  # (n, 4) x y z intensity, intensity in [0, 1]
    boxes: Boxes
    fields: Records | None = None  # (n,) kitti.FIELDS


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames of one LiDAR that stands still."""

    names: tuple[str, ...]  # of the frames in the source, in order of time
    read: Callable[[int], RecordedFrame]  # by place in `names`
    labelled: bool
    splits: dict[str, tuple[str, ...]] = field(default_factory=dict)  # train, val: some of `names`
    period_s: float | None = None
    pose: WorldPose | None = None
    tilt: tuple[float, float] | None = None  # pitch, roll (rad) that are out of the points already
    ids_are_tracks: bool = False
    times: Callable[[], FloatArray | None] | None = None  # s, by the clock in the files; None: none
    notes: Callable[[], list[str]] | None = None  # what was made of what the files say, in words
    origin: Callable[[], FloatArray | None] | None = None  # of the sensor, if not 0 0 0; as stored
    slots: tuple[int, ...] | None = None  # numbers of the frames; None: see numbers()

    @property
    def counted(self) -> bool:
        """Whether the names are no frame numbers of up to six digits."""
        if not all(re.fullmatch("[0-9]{1,6}", name) for name in self.names):
            return True
        return len({int(name) for name in self.names}) < len(self.names)  # as 1 and 01

    def numbers(self) -> tuple[int, ...]:
        """Frame numbers: `slots`, else those that the names are, else from 0 on."""
        if self.slots is not None:
            return self.slots
        if self.counted:
            return tuple(range(len(self.names)))
        return tuple(int(name) for name in self.names)


def sorted_files(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """The files of a folder with one of the suffixes, by name; numbers in names count as numbers.

    Hidden ones are left out: they are of a system, or being written.
    Raises FileNotFoundError without the folder, and Error if there is no such file.
    """
    candidates = (file for file in folder.iterdir() if not file.name.startswith("."))
    files = [file for file in candidates if file.name.lower().endswith(tuple(suffixes))]
    if not files:
        raise Error(f"{folder}: found no {' or '.join(suffixes)} file, allowed one or more")
    return sorted(files, key=lambda file: (_digits(file.name), file.name))


def read_splits(folder: Path, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """The lists train and val of an ImageSets folder, without other frames; both or none."""
    known = set(names)
    splits = {}
    for part in ("train", "val"):
        file = folder / f"{part}.txt"
        listed = lines_of(file) if file.is_file() else []
        splits[part] = tuple(name for line in listed for name in line.split() if name in known)
    return splits if all(splits.values()) else {}


def as_points(
    file: Path, columns: Sequence[AnyArray], options: Options, usual: float = 1.0
) -> Points:
    """x, y, z and intensity (n,) of any type of numbers as points (n, 4), in metres.

    Intensities are divided by what is the highest in the source. What is not finite stays, and is
    no return. Raises FormatError for a point beyond 10 km or an intensity beyond 10,000 times the
    highest.
    """
    highest = usual if options.intensity_max is None else options.intensity_max
    for name, column in zip(("x", "y", "z", "intensity"), columns, strict=True):
        # As kitti.read_points has them.
        most = FARTHEST_M * (highest if name == "intensity" else 1 / options.unit_m)
        bad = np.flatnonzero(np.isfinite(column) & (np.abs(column) > most))
        if len(bad) > 0:
            location = f"{file}: point {bad[0]}: {name}"
            raise FormatError(
                f"{location}: found {column[bad[0]]:g}, allowed {-most:g} to {most:g}"
            )
    points = np.stack([column.astype(np.float32) for column in columns], axis=1)
    if highest != 1:
        points[:, 3] /= highest
    if options.unit_m != 1:
        points[:, :3] *= options.unit_m
    return points


def read_bin(file: Path, columns: int, options: Options, usual: float = 1.0) -> Points:
    """The first four of some float32 columns, or `options.columns`: (n, 4), see as_points.

    Of three columns the intensity is 0. Raises FormatError for a file cut short, and as as_points
    does.
    """
    columns, size = options.columns or columns, file.stat().st_size
    if size % (4 * columns) != 0:
        raise FormatError(
            f"{file}: found {size} bytes, allowed a multiple of {4 * columns} ({columns} float32 "
            "a point)"
        )
    values = np.fromfile(file, dtype="<f4").reshape(-1, columns)
    if columns == 3:
        values = np.column_stack([values, np.zeros(len(values), dtype=np.float32)])
    return as_points(file, list(values.T[:4]), options, usual)


def check_pairs(clouds: Sequence[Path], labels: Sequence[Path]) -> None:
    """Raises Error for a label without a cloud, and for a cloud without a label."""
    have, want = {stem(file) for file in clouds}, {stem(file) for file in labels}
    for file in labels:
        if stem(file) not in have:
            raise Error(f"{file}: found no cloud of this label, allowed one for each")
    for file in clouds:
        if stem(file) not in want:
            raise Error(
                f"{file}: found no label of this cloud, allowed one for each (empty: nothing there)"
            )


def stem(file: Path) -> str:
    """The name without .pcd.bin, .bin, .txt, ..., in small letters or capitals."""
    return re.sub(r"(\.pcd)?(\.bin)?$", "", file.name, flags=re.I).removesuffix(file.suffix)


def _digits(name: str) -> tuple[int, ...]:
    words = "".join(c if c.isdecimal() else " " for c in name).split()
    return tuple(int(word) for word in words)
