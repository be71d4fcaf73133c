"""Lists the LiDARs and frames of a folder."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median_low

from pyinfra.core.errors import Error, FormatError, not_found
from pyinfra.core.files import resolved
from pyinfra.formats import kitti
from pyinfra.formats.text_table import lines_of

MOST_LISTED = 8  # maximum number of folders in a message
PERIOD_S = 0.1  # frame period of the simulator in seconds, and default without lidar.yaml


def period_of(lidar_folder: Path) -> float:
    """Returns the frame period of a LiDAR's folder in seconds. Raises FormatError."""
    timed = (lidar_folder / "lidar.yaml").is_file()
    return kitti.read_lidar(lidar_folder).period_s if timed else PERIOD_S


def usual_step(numbers: Sequence[int]) -> int:
    """Returns the usual difference of successive frame numbers; 1 for a single frame."""
    return median_low([b - a for a, b in pairwise(numbers)]) if len(numbers) > 1 else 1


def recorded_s(numbers: Sequence[int], period_s: float) -> float:
    """Returns the seconds that frames represent; with a step of 5, a frame represents 5 periods."""
    return len(numbers) * usual_step(numbers) * period_s


def frame_range(word: str, gt: Path) -> list[int]:
    """Returns the frames of a folder in a range A:B[:STEP], without B.

    Raises Error if the folder has no frame in the range.
    """
    parts = word.split(":")
    if len(parts) not in (2, 3) or not all(part.isdecimal() for part in parts):
        raise Error(f"frames: expected A:B[:STEP], got '{word}'")
    numbers = [int(part) for part in parts]
    if 0 in numbers[2:]:
        raise Error(f"frames: expected A:B[:STEP] with STEP above 0, got '{word}'")
    wanted = range(*numbers)
    frames = [frame for frame in frame_numbers(gt, "all") if frame in wanted]
    if not frames:
        raise Error(f"frames: expected a range that contains frames of {gt}, got '{word}'")
    return frames


def frame_numbers(folder: Path, split: str | None = None) -> list[int]:
    """Returns the frame numbers of a folder, ascending.

    `split` selects the frames of ImageSets/SPLIT.txt, and `all` selects all frames. By default,
    the frames of val.txt are returned if the file exists, else all frames. Raises
    FileNotFoundError, and FormatError with file and line.
    """
    training = folder / "training"
    if (training / "velodyne").is_dir():
        present = kitti.frames(folder)
    elif (training / "label_2").is_dir():
        stems = (file.stem for file in (training / "label_2").glob("*.txt"))
        present = sorted(int(stem) for stem in stems if stem.isdecimal())
    else:
        check_lidar_folder(folder)
        raise not_found(folder, "The folder has no training/velodyne and no training/label_2")
    if split == "all" or (split is None and not (folder / "ImageSets/val.txt").is_file()):
        return present
    return _split(folder / f"ImageSets/{split or 'val'}.txt", set(present))


def _split(file: Path, present: set[int]) -> list[int]:
    frames: set[int] = set()
    for line, word in enumerate(lines_of(file), start=1):
        digits = word.strip()
        if not re.fullmatch(r"[0-9]{1,9}", digits) or int(digits) not in present:
            raise FormatError(
                f"{file}:{line}: expected the number of an existing frame, got '{word[:40]}'"
            )
        if int(digits) in frames:
            raise FormatError(f"{file}:{line}: expected each frame once, got {digits} twice")
        frames.add(int(digits))
    return sorted(frames)


def lidar_folders(data_set: Path) -> list[Path]:
    """Returns the LiDAR folders of a data set, sorted by name.

    Raises FileNotFoundError if there is none.
    """
    folders = lidars_in(data_set)
    if not folders:
        check_data_set(data_set)
        raise not_found(data_set, "expected a LiDAR folder with a lidar.yaml, got none")
    return folders


def lidars_in(data_set: Path) -> list[Path]:
    """Returns the LiDAR folders of a data set, sorted by name. The list may be empty.

    Hidden folders are skipped, because they are incomplete.
    """
    files = data_set.glob("*/lidar.yaml")
    return sorted(file.parent for file in files if not file.parent.name.startswith("."))


def data_set_of(lidar_folder: Path) -> Path:
    """Returns the data set folder that contains a LiDAR's folder. The argument may be `.`."""
    named = lidar_folder.name not in ("", "..")
    return lidar_folder.parent if named else resolved(lidar_folder).parent


def has_labels(lidar_folder: Path) -> bool:
    """Returns whether any frame of a folder has a label."""
    files = (lidar_folder / "training/label_2").glob("*.txt")
    return any(file.stat().st_size > 0 for file in files)


def lidar_folder(folder: Path) -> Path:
    """Returns `folder`, or the folder of the only LiDAR if it is a data set with one LiDAR.

    Raises Error as `check_lidar_folder` does.
    """
    inside = [] if (folder / "training").is_dir() else lidars_in(folder)
    if len(inside) == 1:
        return inside[0]
    check_lidar_folder(folder)
    return folder


def check_lidar_folder(folder: Path) -> None:
    """Raises Error for a folder that contains LiDAR folders, or lies inside a LiDAR folder.

    A folder that contains `training` is a LiDAR folder and is accepted.
    """
    if (folder / "training").is_dir():
        return
    if inside := lidars_in(folder) or sorted(file.parent for file in folder.glob("*/*/lidar.yaml")):
        names = ", ".join(str(lidar) for lidar in inside[:MOST_LISTED])
        more = ", ..." if len(inside) > MOST_LISTED else ""
        raise Error(
            f"{folder}: expected the folder of one LiDAR, got a data set with the LiDARs "
            f"{names}{more}"
        )
    for parent in _parents(folder):
        if (parent / "training").is_dir():
            raise Error(
                f"{folder}: expected a LiDAR's folder, got a folder inside one; use {parent}"
            )


def check_data_set(folder: Path) -> None:
    """Raises Error for a folder that lies inside a data set, or contains data sets.

    A folder that contains dataset.yaml or LiDAR folders is a data set and is accepted.
    """
    if (folder / "dataset.yaml").is_file() or lidars_in(folder):
        return
    for parent in _parents(folder):
        if (parent / "dataset.yaml").is_file():
            raise Error(f"{folder}: expected a data set, got a folder inside one; use {parent}")
    if inside := sorted(file.parent for file in folder.glob("*/dataset.yaml")):
        names = ", ".join(str(path) for path in inside[:MOST_LISTED])
        raise Error(f"{folder}: expected one data set, got a folder with the data sets {names}")


def _parents(folder: Path) -> list[Path]:
    """Returns at most three parent folders, the nearest first.

    The parents of a relative path are relative, unless the path has only one part.
    """
    named = [folder.parents[i] for i in range(len(folder.parts) - 1)]
    return (named or list(resolved(folder).parents))[:3]


def spread(numbers: Sequence[int], most: int) -> tuple[int, ...]:
    """Returns at most `most` of the frame numbers, evenly spread."""
    if len(numbers) <= most:
        return tuple(numbers)
    return tuple(numbers[i * len(numbers) // most] for i in range(most))
