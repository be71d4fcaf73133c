"""Exports frames of a LiDAR's folder to the formats of other tools."""

from collections.abc import Sequence
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.files import new_folder
from pyinfra.exchange.formats import exporter
from pyinfra.exchange.road_level import train_and_val

NUSCENES = "nuscenes"
SPLIT_BY_SHARE = ("openpcdet", "mmdet3d")


def split_note(lidar_folder: Path, frames: Sequence[int], name: str) -> str:
    """Returns a note on how an export splits frames that have no ImageSets.

    The note is empty if ImageSets exist or the format has no split.
    """
    parts = ("train", "val") if name == NUSCENES else ("train",)
    if any((lidar_folder / f"ImageSets/{part}.txt").is_file() for part in parts):
        return ""
    if name == NUSCENES:
        how = f"the split infrasim_all has all {len(frames)} frames"
    elif name in SPLIT_BY_SHARE:
        lists = train_and_val(lidar_folder, list(frames))
        how = f"train has the first {len(lists['train'])} frames, val the last {len(lists['val'])}"
    else:
        return ""
    return f"{lidar_folder} is not split, so {how}; `pyinfra split` splits by time, with a gap"


def export(lidar_folder: Path, frames: Sequence[int], name: str, out: Path) -> None:
    """Writes the frames in a format of EXPORTS to a new folder.

    Nothing is written if an error occurs. Raises the errors of the format, Error if there is no
    frame, and FileExistsError if the folder exists.
    """
    write = exporter(name)
    if not frames:
        raise Error(f"{lidar_folder}: expected one or more frames to export, got none")
    with new_folder(out) as beside:
        write(lidar_folder, frames, beside)
