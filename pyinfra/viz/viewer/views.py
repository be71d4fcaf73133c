"""Writes a view of the chosen LiDARs, frames and predictions: a page, or a recording for Rerun."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.files import resolved
from pyinfra.dataset.frames import lidar_folders
from pyinfra.dataset.surroundings import read_surroundings
from pyinfra.formats import kitti
from pyinfra.tracking.table_file import read_tracks
from pyinfra.viz.page_file import check_file
from pyinfra.viz.viewer.frames import ViewFrame, read_view_frames
from pyinfra.viz.viewer.page import check_size, write_page

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

    data: data sets or LiDAR folders. lidars, frames, predictions: as in `chosen_folders`,
    `chosen_frames` and `prediction_folders`. rerun: whether the file is a recording for Rerun; by
    default, this is so if its name ends in .rrd. Raises Error for an unknown LiDAR or frame, and
    for a page that would be too large.
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


def read_views(
    folders: Sequence[Path], frames: Sequence[int], predictions: Mapping[Path, Path]
) -> dict[str, list[ViewFrame]]:
    """Reads frames of LiDAR folders, and returns them by display name.

    The display name is the model. If it is ambiguous, the data set is appended.

    predictions: folders of predictions by LiDAR folder. Raises the exceptions of
    read_view_frames().
    """
    names = _names(folders)
    return {
        name: read_view_frames(folder, frames, predictions.get(folder))
        for name, folder in zip(names, folders, strict=True)
    }


def chosen_folders(data: Sequence[Path], lidars: Sequence[str] | None) -> list[Path]:
    """Returns the LiDAR folders of `data` whose LiDARs are in `lidars`, or all if it is None.

    data: data sets or LiDAR folders. Raises FileNotFoundError for any other folder, and
    Error for an unknown LiDAR.
    """
    folders = []
    for path in data:
        folders += [path] if (path / "training").is_dir() else lidar_folders(path)
    if lidars is None:
        return folders
    known = [folder.name for folder in folders]
    for name in lidars:
        if name not in known:
            raise Error(f"lidar: expected one of {', '.join(known)}; got '{name}'")
    return [folder for folder in folders if folder.name in lidars]


def chosen_frames(
    folder: Path, words: str | Sequence[int] | None, predictions: Path | None = None
) -> list[int]:
    """Returns the frames of a folder that `words` selects: numbers, or A, A:B or A:B:STEP.

    If `words` is None, the result is the first frame, or the first frame that has predictions.
    Raises Error if `words` has none of these forms, or selects no frame of the folder.
    """
    present = kitti.frames(folder)
    if words is None:
        found = _frames_of(predictions) if predictions else set()
        return [frame for frame in present if f"{frame:06d}" in found][:1] or present[:1]
    try:
        numbers = [int(word) for word in words.split(":")] if isinstance(words, str) else words
        wanted = range(*numbers) if isinstance(words, str) and len(numbers) > 1 else numbers
    except (TypeError, ValueError):
        raise Error(f"frames: expected A:B or A:B:STEP, got '{words}'") from None
    chosen = [frame for frame in present if frame in wanted]
    if not chosen:
        raise Error(f"{folder}: frames: expected {kitti.extent(present)}, got {words}")
    return chosen


def prediction_folders(words: Sequence[str], folders: Sequence[Path]) -> dict[Path, Path]:
    """Returns folders of predictions by LiDAR folder.

    words: LIDAR=DIR for each LiDAR, or DIR if there is only one LiDAR. A tracks.csv may stand in
    place of DIR.

    Raises Error for an unknown LiDAR, for DIR with several LiDARs, and for two folders of one
    LiDAR.
    """
    by_name = {folder.name: folder for folder in folders}
    chosen = {}
    for word in words:
        name, equals, folder = word.partition("=")
        if not equals and len(folders) == 1:
            name, folder = folders[0].name, word
        if name not in by_name or not folder:
            raise Error(
                f"pred: expected LIDAR=DIR with LIDAR one of {', '.join(by_name)}; got '{word}'"
            )
        if by_name[name] in chosen:
            raise Error(
                f"pred: expected one folder for each LiDAR, got a second for {name}: '{word}'"
            )
        chosen[by_name[name]] = Path(folder)
    return chosen


def _frames_of(predictions: Path) -> set[str]:
    """Returns the numbers of the frames of a folder of predictions or of a tracks.csv."""
    if predictions.is_file():
        return {f"{frame:06d}" for frame in read_tracks(predictions).frame}
    return {file.stem for file in predictions.iterdir()}


def title_of(folders: Sequence[Path], frames: Sequence[int]) -> str:
    scenes = dict.fromkeys(resolved(folder).parent.name for folder in folders)
    last = f" to {frames[-1]}" if len(frames) > 1 else ""
    return f"{', '.join(scenes)}: frame{'s' if last else ''} {frames[0]}{last}"


def _names(folders: Sequence[Path]) -> list[str]:
    """Returns the LiDARs' models. If a model is not unique, data set and folder are appended."""
    models = [
        kitti.read_lidar(folder).model if (folder / "lidar.yaml").is_file() else folder.name
        for folder in folders
    ]
    names = [
        f"{model} ({'/'.join(resolved(folder).parts[-2:])})" if models.count(model) > 1 else model
        for model, folder in zip(models, folders, strict=True)
    ]
    if len(set(names)) < len(names):
        raise Error(f"data: expected each LiDAR once, got {', '.join(map(str, folders))}")
    return names
