"""ImageSets of a data set: `pyinfra split DATA`.

Which frames train and which test (`val`). By time is the default, because neighbouring frames show
the same vehicles: a random split leaks them from train to test. See docs/conventions.md, "Split".
"""

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pyinfra.atomic import replacing
from pyinfra.statistics.data import DataSet, read_data_set

By = Literal["time", "seed", "random"]

TRAIN_UNTIL_S = 400.0
VAL_FROM_S = 410.0
VAL_SHARE = 0.2


@dataclass(frozen=True)
class Split:
    """Frames of the two lists, ascending."""

    train: tuple[int, ...]
    val: tuple[int, ...]


def by_time(
    frames: Sequence[int],
    period_s: float,
    train_until_s: float = TRAIN_UNTIL_S,
    val_from_s: float = VAL_FROM_S,
) -> Split:
    """Frames that start before train_until_s, and those that start at val_from_s or later.

    Raises ValueError if the two overlap or one is empty.
    """
    if val_from_s < train_until_s:
        raise ValueError(f"found val from {val_from_s:g} s, allowed {train_until_s:g} s or later")
    starts = [round(frame * period_s, 6) for frame in frames]
    pairs = list(zip(frames, starts, strict=True))
    split = Split(
        train=tuple(frame for frame, start in pairs if start < train_until_s),
        val=tuple(frame for frame, start in pairs if start >= val_from_s),
    )
    if not split.train or not split.val:
        raise ValueError(
            f"found frames from {min(starts, default=0):g} to {max(starts, default=0):g} s, "
            f"allowed some before {train_until_s:g} s and some from {val_from_s:g} s on"
        )
    return split


def by_random(frames: Sequence[int], seed: int, val_share: float = VAL_SHARE) -> Split:
    """A seeded share of the frames as val, the rest as train; rounded, at least one of each.

    Raises ValueError for fewer than two frames or a share outside (0, 1).
    """
    if len(frames) < 2 or not 0 < val_share < 1:
        raise ValueError(f"found {len(frames)} frames and a share of {val_share:g}, allowed 2, 0-1")
    count = min(max(round(val_share * len(frames)), 1), len(frames) - 1)
    val = np.random.default_rng(seed).choice(np.array(frames), count, replace=False)
    chosen = set(val.tolist())
    return Split(
        train=tuple(frame for frame in frames if frame not in chosen),
        val=tuple(sorted(chosen)),
    )


def by_seed(train: DataSet, val: DataSet) -> tuple[Split, Split]:
    """All frames of one data set train, all of the other are val; one split for each.

    Raises ValueError if they are not the same scene, preset and LiDARs with another seed.
    """
    for key in ("scene", "preset", "names"):
        a, b = getattr(train, key), getattr(val, key)
        if a != b:
            raise ValueError(f"{val.folder}: {key}: found {b}, allowed {a} as in {train.folder}")
    if train.seed == val.seed:
        raise ValueError(f"{val.folder}: found seed {val.seed} in both, allowed another seed")
    return Split(train.frames, ()), Split((), val.frames)


def write(data: DataSet, split: Split, *, force: bool = False) -> list[Path]:
    """ImageSets/train.txt and val.txt of every LiDAR: six digits a line; returns the files.

    Raises FileExistsError, and writes none, if a file has other frames, unless forced.
    """
    files = {
        data.lidar_folder(name) / "ImageSets" / f"{part}.txt": "".join(
            f"{frame:06d}\n" for frame in getattr(split, part)
        )
        for name, part in itertools.product(data.names, ("train", "val"))
    }
    for file, text in files.items():
        if not force and file.exists() and file.read_text(encoding="utf-8") != text:
            raise FileExistsError(f"{file}: found another split, allowed none without --force")
    for file, text in files.items():
        file.parent.mkdir(exist_ok=True)
        with replacing(file) as beside:
            beside.write_text(text, encoding="utf-8")
    return list(files)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Writes ImageSets/train.txt and val.txt for every LiDAR of a data set."
    parser.epilog = "example: pyinfra split data/highway --by time"
    parser.add_argument("data", type=Path, help="data set of `infrasim run`")
    parser.add_argument(
        "--by",
        choices=["time", "seed", "random"],
        default="time",
        help="time: 0-400 s train, from 410 s val; seed: another seed's data set is val; "
        "random: a fifth is val",
    )
    parser.add_argument("--val-data", type=Path, help="with --by seed: the data set that is val")
    parser.add_argument("--seed", type=int, default=1, help="of --by random")
    for name, default in (("train-until-s", TRAIN_UNTIL_S), ("val-from-s", VAL_FROM_S)):
        parser.add_argument(
            f"--{name}", type=float, default=default, help=f"of --by time; default: {default:g}"
        )
    parser.add_argument("--force", action="store_true", help="replace another split")


def run(args: argparse.Namespace) -> int:
    if (args.by == "seed") != (args.val_data is not None):
        raise ValueError("--by seed and --val-data go together")
    data = read_data_set(args.data)
    if args.by == "seed":
        other = read_data_set(args.val_data)
        pairs = list(zip((data, other), by_seed(data, other), strict=True))
    elif args.by == "random":
        pairs = [(data, by_random(data.frames, args.seed))]
    else:
        pairs = [(data, by_time(data.frames, data.period_s, args.train_until_s, args.val_from_s))]
    for folder, split in pairs:
        write(folder, split, force=args.force)
        print(f"{folder.folder}: train {len(split.train)}, val {len(split.val)} frames")
    return 0
