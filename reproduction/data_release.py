"""Writes the whole data set: `python -m reproduction dataset`, which `make dataset` runs.

The data set contains three scenes with four LiDARs, a split by time, a data card and the SHA-256 of
every file. Run the same command again to resume a stopped run. A data set is complete when it has
the file SHA256SUMS, because that file is written last.
"""

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path

from pyinfra.core import files
from pyinfra.core.errors import Error
from pyinfra.dataset import catalogue, split
from pyinfra.dataset.data_set import DataSet, read_data_set
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import read_csv
from reproduction.data_card import data_card
from reproduction.simulate import simulate

FRAMES = 5000  # number of frames in the 500 s of a scene
CARD = "DATASET.md"
SUMS = "SHA256SUMS"
TIMES = "summary.csv"  # file with times, which differ between runs


def spread(count: int) -> range:
    """Returns at most `count` frame numbers, evenly spaced over all frames of a scene.

    Raises Error if count is less than 2 or more than FRAMES.
    """
    if not 2 <= count <= FRAMES:
        raise Error(f"frames: expected 2 to {FRAMES}, got {count}")
    last = FRAMES - 1
    gaps = last // (last // count + 1)
    return range(0, FRAMES, last // gaps)


def check_folder(folder: Path, frames: range) -> None:
    """Raises Error if `folder` contains a frame of any LiDAR that is not in `frames`."""
    for velodyne in sorted(folder.glob("[!.]*/training/velodyne")):
        lidar = velodyne.parents[1]
        if others := set(kitti.frames(lidar)) - set(frames):
            raise Error(
                f"{lidar}: expected frames 0, {frames.step}, {2 * frames.step}, ... as `frames` "
                f"selects, got frame {min(others)}; choose a different `out`"
            )


def write_scene(name: str, frames: range, preset: str, folder: Path) -> DataSet:
    """Simulates one scene, splits it and returns its data set.

    Existing frames are not simulated again. Raises FileExistsError if the folder already has
    another split.
    """
    numbers = f"0:{frames.stop}:{frames.step}"
    simulate(name, catalogue.LIDARS, folder, preset=preset, frames=numbers)
    data = read_data_set(folder)
    split.write(data, split.by_time(data.frames, data.period_s), grown=True)
    return data


def checksums(out: Path) -> Iterator[str]:
    """Yields a line in the format of `sha256sum` for the data card and each scene file.

    `summary.csv` is left out, because its times differ between runs.
    """
    of_scenes = (file for scene in catalogue.SCENES for file in (out / scene).rglob("*"))
    for file in sorted([out / CARD, *of_scenes]):
        if file.is_file() and file.name != TIMES and not file.name.startswith("."):
            with file.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
            yield f"{digest}  {file.relative_to(out).as_posix()}\n"


def write(
    out: Path, frames: range, preset: str, progress: Callable[[str], None] | None = None
) -> None:
    """Creates the folder `out` and writes the scenes, the data card and the checksums to it.

    Parameters
    ----------
    progress : callback that receives a message after each scene

    Raises
    ------
    SimulatorError
        If a simulation fails.
    Error
        If `out` contains frames that are not in `frames`.
    """
    for scene in catalogue.SCENES:
        check_folder(out / scene, frames)
    (out / SUMS).unlink(missing_ok=True)
    sets = []
    for scene in catalogue.SCENES:
        sets.append(write_scene(scene, frames, preset, out / scene))
        if progress:
            progress(f"{out / scene}: {len(frames)} frames")
    summaries = [read_csv(data.folder / TIMES) for data in sets]
    files.write(out / CARD, data_card(sets, summaries))
    files.write(out / SUMS, "".join(checksums(out)))
