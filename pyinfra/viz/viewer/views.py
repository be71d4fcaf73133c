"""Writes a view of frames of one or several LiDARs: a page, or a recording for Rerun."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.files import resolved
from pyinfra.dataset.surroundings import read_surroundings
from pyinfra.viz.page_file import check_file
from pyinfra.viz.viewer.page import check_size, write_page
from pyinfra.viz.viewer.selection import (
    chosen_folders,
    chosen_frames,
    prediction_folders,
    read_views,
    title_of,
)

RERUN = ".rrd"  # ending of a recording for Rerun


@dataclass(frozen=True)
class Written:
    """The size of a file in bytes, and what it shows."""

    size: int
    lidars: int
    frames: int


def write_view(
    data: Sequence[Path],
    out: Path,
    lidars: Sequence[str] | None = None,
    frames: str | Sequence[int] | None = None,
    predictions: Sequence[str] = (),
    most_points: int | None = None,
    *,
    rerun: bool | None = None,
) -> Written:
    """Writes a view, and returns what it shows.

    data: data sets or LiDAR folders. lidars, frames, predictions: see `selection`. rerun: whether
    the file is a recording for Rerun; by default if its name ends so. Raises Error for an unknown
    LiDAR or frame, and for a page that would be too large.
    """
    is_recording = out.suffix == RERUN if rerun is None else rerun
    if most_points is not None and most_points < 1:
        raise Error(f"most_points: expected 1 or more, got {most_points}")
    check_file(out, *[b"RRF"] * is_recording)
    folders = chosen_folders(data, lidars)
    found = prediction_folders(predictions, folders)
    numbers = chosen_frames(folders[0], frames, found.get(folders[0]))
    if not is_recording:
        check_size(folders, numbers, most_points)
    views = read_views(folders, numbers, found)
    if is_recording:
        from pyinfra.viz.viewer import recording

        size = recording.write(views, out)
    else:
        around = read_surroundings(resolved(folders[0]).parent)
        size = write_page(views, title_of(folders, numbers), out, most_points, around)
    return Written(size, len(views), len(numbers))
