"""Splits a data set into training and test frames (`ImageSets`), for `pyinfra split DATA`.

The default is a split by time, because neighbouring frames show the same vehicles. With a random
split, the same vehicles would be in the training and test frames (`val`). See
docs/conventions/evaluation.md, "Split".
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pyinfra.core.errors import Error
from pyinfra.core.files import write as write_text
from pyinfra.dataset.data_set import DataSet

By = Literal["time", "seed", "random"]
TRAIN_UNTIL_S = 400.0
VAL_FROM_S = 410.0
VAL_SHARE = 0.2


@dataclass(frozen=True)
class Split:
    """The frames of both parts, ascending."""

    train: tuple[int, ...]
    val: tuple[int, ...]


def by_time(
    frames: Sequence[int],
    period_s: float,
    train_until_s: float = TRAIN_UNTIL_S,
    val_from_s: float = VAL_FROM_S,
    where: object = "frames",
) -> Split:
    """Splits by the start time of the frames. where: name of the frames in errors.

    Frames that start before train_until_s are train. Frames that start at val_from_s or later are
    val. Raises Error if both parts overlap or one part is empty.
    """
    if val_from_s < train_until_s:
        raise Error(
            f"{where}: val_from_s: expected train_until_s ({train_until_s:g}) or more, "
            f"got {val_from_s:g}"
        )
    starts = [round(frame * period_s, 6) for frame in frames]
    pairs = list(zip(frames, starts, strict=True))
    split = Split(
        train=tuple(frame for frame, start in pairs if start < train_until_s),
        val=tuple(frame for frame, start in pairs if start >= val_from_s),
    )
    if not split.train or not split.val:
        raise Error(
            f"{where}: expected frames before {train_until_s:g} s (train) and from "
            f"{val_from_s:g} s on (val), got frames from {min(starts, default=0):g} to "
            f"{max(starts, default=0):g} s; `pyinfra split` can set both times"
        )
    return split


def by_random(
    frames: Sequence[int], seed: int, val_share: float = VAL_SHARE, where: object = "frames"
) -> Split:
    """Splits at random: a share `val_share` of the frames is val, and the rest is train.

    where: name of the frames in errors.

    The number of val frames is rounded, and both parts have at least one frame. Raises Error for
    fewer than two frames or a share outside (0, 1).
    """
    if len(frames) < 2 or not 0 < val_share < 1:
        raise Error(
            f"{where}: val_share: expected 2 or more frames and a share between 0 and 1, got "
            f"{len(frames)} frames and a share of {val_share:g}"
        )
    count = min(max(round(val_share * len(frames)), 1), len(frames) - 1)
    val = np.random.default_rng(seed).choice(np.array(frames), count, replace=False)
    chosen = set(val.tolist())
    return Split(
        train=tuple(frame for frame in frames if frame not in chosen),
        val=tuple(sorted(chosen)),
    )


def by_seed(train: DataSet, val: DataSet) -> tuple[Split, Split]:
    """Splits by data set, and returns the split of each data set.

    All frames of the first data set are train, and all frames of the second are val. Raises Error
    unless both have the same scene, preset, label time and LiDARs, but different seeds.
    """
    for key in ("scene", "preset", "label_time", "names"):
        a, b = getattr(train, key), getattr(val, key)
        if a != b:
            raise Error(f"{val.folder}: {key}: expected {a} as in {train.folder}, got {b}")
    if train.seed == val.seed:
        raise Error(
            f"{val.folder}: expected a seed other than that of {train.folder}, got seed "
            f"{val.seed} in both"
        )
    return Split(train.frames, ()), Split((), val.frames)


def write(data: DataSet, split: Split, *, force: bool = False, grown: bool = False) -> list[Path]:
    """Writes ImageSets/train.txt and val.txt of each LiDAR, and returns the files.

    With `grown`, an existing file may list only a part of the frames, because more frames were
    simulated later. Raises FileExistsError, and writes nothing, if a file lists other frames. With
    `force`, such a file is overwritten.
    """
    files = {
        data.lidar_folder(name) / "ImageSets" / f"{part}.txt": "".join(
            f"{frame:06d}\n" for frame in getattr(split, part)
        )
        for name, part in itertools.product(data.names, ("train", "val"))
    }
    for file, text in files.items():
        old = file.read_text(encoding="utf-8-sig") if file.exists() and not force else text
        if old != text and not (grown and set(old.splitlines()) <= set(text.splitlines())):
            raise FileExistsError(
                f"{file}: expected no file or the same split, got a different split; `force` "
                "overwrites the file"
            )
    for file, text in files.items():
        file.parent.mkdir(exist_ok=True)
        write_text(file, text)
    return list(files)
