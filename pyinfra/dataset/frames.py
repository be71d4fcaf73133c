"""Which LiDARs and frames a folder holds."""

from __future__ import annotations

import errno
import re
from pathlib import Path

from pyinfra.core.errors import Error, FormatError
from pyinfra.formats import kitti
from pyinfra.formats.text_table import lines_of

PERIOD_S = 0.1  # of the simulator's frames, and of a folder without lidar.yaml


def period_of(lidar_folder: Path) -> float:
    """Seconds of a frame of a LiDAR's folder. Raises FormatError."""
    timed = (lidar_folder / "lidar.yaml").is_file()
    return kitti.read_lidar(lidar_folder).period_s if timed else PERIOD_S


def frame_range(word: str, gt: Path) -> list[int]:
    """The frames of a folder in A:B[:STEP]. Raises Error if there is none."""
    parts = word.split(":")
    if len(parts) not in (2, 3) or not all(part.isdecimal() for part in parts):
        raise Error(f"frames: found '{word}', allowed A:B[:STEP]")
    wanted = range(*(int(part) for part in parts)) if "0" not in parts[2:] else range(0)
    frames = [frame for frame in frame_numbers(gt, "all") if frame in wanted]
    if not frames:
        raise Error(f"frames: found '{word}', allowed a range with frames of {gt}")
    return frames


def frame_numbers(folder: Path, split: str | None = None) -> list[int]:
    """Frames of a folder, ascending.

    split: those of ImageSets/SPLIT.txt; left out, those of val.txt if there is one, else all; `all`
    is all. Raises FileNotFoundError, and FormatError with file and line.
    """
    training = folder / "training"
    if (training / "velodyne").is_dir():
        present = kitti.frames(folder)
    elif (training / "label_2").is_dir():
        stems = (file.stem for file in (training / "label_2").glob("*.txt"))
        present = sorted(int(stem) for stem in stems if stem.isdecimal())
    else:
        raise FileNotFoundError(2, "No training/velodyne or training/label_2 in it", str(folder))
    if split == "all" or (split is None and not (folder / "ImageSets/val.txt").is_file()):
        return present
    return _split(folder / f"ImageSets/{split or 'val'}.txt", set(present))


def _split(file: Path, present: set[int]) -> list[int]:
    frames: set[int] = set()
    for line, word in enumerate(lines_of(file), start=1):
        digits = word.strip()
        if not re.fullmatch(r"[0-9]{1,9}", digits) or int(digits) not in present:
            raise FormatError(f"{file}:{line}: found '{word[:40]}', allowed a frame of the folder")
        if int(digits) in frames:
            raise FormatError(f"{file}:{line}: found {digits} twice, allowed once")
        frames.add(int(digits))
    return sorted(frames)


def lidar_folders(data_set: Path) -> list[Path]:
    """The LiDAR folders of a data set, by name. Raises FileNotFoundError if there is none."""
    folders = lidars_in(data_set)
    if not folders:
        raise FileNotFoundError(
            errno.ENOENT, "found no LiDAR folder with a lidar.yaml", str(data_set)
        )
    return folders


def lidars_in(data_set: Path) -> list[Path]:
    """The LiDAR folders of a data set, by name, or none.

    A hidden folder is none: it is being written, or its writer was killed.
    """
    files = data_set.glob("*/lidar.yaml")
    return sorted(file.parent for file in files if not file.parent.name.startswith("."))


def data_set_of(lidar_folder: Path) -> Path:
    """The data set that a LiDAR's folder, maybe `.`, stands in."""
    named = lidar_folder.name not in ("", "..")
    return lidar_folder.parent if named else lidar_folder.resolve().parent


def has_labels(lidar_folder: Path) -> bool:
    """Whether any frame of a folder has one."""
    files = (lidar_folder / "training/label_2").glob("*.txt")
    return any(file.stat().st_size > 0 for file in files)


def check_no_data_set(folder: Path) -> None:
    """Raises Error for a data set where the folder of one LiDAR is needed."""
    if inside := ", ".join(lidar.name for lidar in lidars_in(folder)):
        raise Error(f"{folder}: found a data set, allowed a LiDAR of it: {inside}")
