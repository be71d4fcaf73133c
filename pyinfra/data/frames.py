"""Which LiDARs and frames a folder holds."""

from __future__ import annotations

import errno
from pathlib import Path

from pyinfra import kitti
from pyinfra.kitti import FormatError

PERIOD_S = 0.1  # of the simulator's frames, and of a folder without lidar.yaml


def frame_range(word: str, gt: Path) -> list[int]:
    """The frames of a folder in A:B[:STEP]. Raises ValueError if there is none."""
    parts = word.split(":")
    if len(parts) not in (2, 3) or not all(part.isdecimal() for part in parts):
        raise ValueError(f"--frames: found '{word}', allowed A:B[:STEP]")
    wanted = range(*(int(part) for part in parts)) if "0" not in parts[2:] else range(0)
    frames = [frame for frame in frame_numbers(gt, "all") if frame in wanted]
    if not frames:
        raise ValueError(f"--frames: found '{word}', allowed a range with frames of {gt}")
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
        present = sorted(int(stem) for stem in stems if stem.isdigit())
    else:
        raise FileNotFoundError(2, "No training/velodyne or training/label_2 in it", str(folder))
    if split == "all" or (split is None and not (folder / "ImageSets/val.txt").is_file()):
        return present
    return _split(folder / f"ImageSets/{split or 'val'}.txt", set(present))


def _split(file: Path, present: set[int]) -> list[int]:
    frames = []
    for line, word in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        if not word.strip().isdecimal() or int(word) not in present:
            raise FormatError(f"{file}:{line}: found '{word}', allowed a frame of the folder")
        frames.append(int(word))
    return sorted(frames)


def lidar_folders(data_set: Path) -> list[Path]:
    """The LiDAR folders of a data set, by name. Raises FileNotFoundError if there is none."""
    folders = sorted(file.parent for file in data_set.glob("*/lidar.yaml"))
    if not folders:
        raise FileNotFoundError(
            errno.ENOENT, "found no LiDAR folder with a lidar.yaml", str(data_set)
        )
    return folders
