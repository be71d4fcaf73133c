"""The whole data set in one command: `python -m reproduction dataset`, which `make dataset` runs.

Three scenes as four LiDARs see them, split by time, with a data card and the SHA-256 of every file.
A stopped run goes on with the same command; SHA256SUMS is written last, so it says that the set is
whole.
"""

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.dataset import catalogue, runs, split
from pyinfra.dataset.data_set import DataSet, read_data_set
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import read_csv
from reproduction.data_card import data_card

FRAMES = 5000  # what a scene's 500 s hold
CARD = "DATASET.md"
SUMS = "SHA256SUMS"
TIMES = "summary.csv"  # differs from run to run


def spread(count: int) -> range:
    """At most `count` frames, evenly spread from the first to about the last of a scene.

    Raises Error for less than 2 or more than there are.
    """
    if not 2 <= count <= FRAMES:
        raise Error(f"frames: found {count}, allowed 2 to {FRAMES}")
    last = FRAMES - 1
    gaps = last // (last // count + 1)
    return range(0, FRAMES, last // gaps)


def check_folder(folder: Path, frames: range) -> None:
    """Raises Error if a LiDAR of a scene's folder has a frame that is not among `frames`."""
    for velodyne in sorted(folder.glob("[!.]*/training/velodyne")):
        lidar = velodyne.parents[1]
        if others := set(kitti.frames(lidar)) - set(frames):
            raise Error(
                f"{lidar}: found frame {min(others)} that `frames` does not have, "
                f"allowed every {frames.step}th; choose another `out`"
            )


def write_scene(name: str, frames: range, preset: str, folder: Path) -> DataSet:
    """Frames of one scene and their split; frames that are there stay as they are.

    Raises FileExistsError for a split of another kind, which someone else made.
    """
    words = ["--preset", preset, "--frames", f"0:{frames.stop}:{frames.step}"]
    lidars = [catalogue.lidar_file(lidar) for lidar in catalogue.LIDARS]
    runs.infrasim("run", catalogue.scene_file(name), "--lidar", *lidars, *words, "--out", folder)
    data = read_data_set(folder)
    split.write(data, split.by_time(data.frames, data.period_s), grown=True)
    return data


def checksums(out: Path) -> Iterator[str]:
    """Lines as those of `sha256sum`: of the card and every file of the scenes, except times."""
    files = [out / CARD, *(file for scene in catalogue.SCENES for file in (out / scene).rglob("*"))]
    for file in sorted(files):
        if file.is_file() and file.name != TIMES and not file.name.startswith("."):
            with file.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
            yield f"{digest}  {file.relative_to(out).as_posix()}\n"


def write(out: Path, frames: range, preset: str, say: Callable[[str], None] | None = None) -> None:
    """Scenes, card and list of sums in `out`, which is created.

    say: is told of each scene that is there. Raises SimulatorError, and Error if `out` has
    frames of another choice.
    """
    for scene in catalogue.SCENES:
        check_folder(out / scene, frames)
    (out / SUMS).unlink(missing_ok=True)
    sets = []
    for scene in catalogue.SCENES:
        sets.append(write_scene(scene, frames, preset, out / scene))
        if say:
            say(f"{out / scene}: {len(frames)} frames")
    summaries = [read_csv(data.folder / TIMES) for data in sets]
    with replacing(out / CARD) as beside:
        beside.write_text(data_card(sets, summaries), encoding="utf-8")
    with replacing(out / SUMS) as beside:
        beside.write_text("".join(checksums(out)), encoding="utf-8")
