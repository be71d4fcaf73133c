"""Copies frames of a LiDAR's folder to a data set folder, in the layout of `infrasim run`."""

from collections.abc import Sequence
from pathlib import Path

from pyinfra.core.files import resolved, write
from pyinfra.dataset.frames import data_set_of, frame_numbers
from pyinfra.dataset.outlines import OUTLINES_FILE
from pyinfra.exchange.recording import write_splits
from pyinfra.formats import kitti
from pyinfra.formats.kitti.layout import SUFFIXES

OF_DATA_SET = ("dataset.yaml", "roads.csv", OUTLINES_FILE, "trajectories.csv")


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes the data set `out` with frames of the LiDAR. Raises FormatError for a wrong split."""
    to = out / resolved(lidar_folder).name
    files = [data_set_of(lidar_folder) / name for name in OF_DATA_SET]
    copies = {file: out / file.name for file in files if file.is_file()}
    copies |= {file: to / file.name for file in lidar_folder.iterdir() if file.is_file()}
    for part in SUFFIXES:
        if (lidar_folder / "training" / part).is_dir():
            named = [(kitti.frame_file(lidar_folder, part, k), k) for k in frames]
            copies |= {f: kitti.frame_file(to, part, k) for f, k in named if f.is_file()}
    for source, copy in copies.items():
        copy.parent.mkdir(parents=True, exist_ok=True)
        write(copy, source.read_bytes())
    parts = [file.stem for file in (lidar_folder / "ImageSets").glob("*.txt")]
    listed = {part: frame_numbers(lidar_folder, part) for part in parts}
    write_splits(to / "ImageSets", {part: sorted({*frames} & {*ks}) for part, ks in listed.items()})
