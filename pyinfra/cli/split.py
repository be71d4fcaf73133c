"""`pyinfra split DATA`."""

import argparse
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.split import TRAIN_UNTIL_S, VAL_FROM_S, by_random, by_seed, by_time, write


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Divides the frames of a data set into training and validation frames. Writes their "
        "numbers to ImageSets/train.txt and val.txt of every LiDAR."
    )
    parser.epilog = "example: pyinfra split data/highway --by time"
    parser.add_argument("data", type=Path, help="data set written by `infrasim run`")
    parser.add_argument(
        "--by",
        choices=["time", "seed", "random"],
        default="time",
        help="how frames are split. time: frames before 400 s are train, and frames from 410 s on "
        "are val; seed: all frames of --val-data, a data set of another seed, are val; random: a "
        "fifth of the frames is val. Default: time",
    )
    parser.add_argument("--val-data", type=Path, help="validation data set, with --by seed")
    parser.add_argument(
        "--seed", type=int, default=1, help="random seed, with --by random; default: 1"
    )
    for name, default in (("train-until-s", TRAIN_UNTIL_S), ("val-from-s", VAL_FROM_S)):
        parser.add_argument(
            f"--{name}", type=float, default=default, help=f"with --by time; default: {default:g}"
        )
    parser.add_argument(
        "--force", action="store_true", help="replace an existing split that differs"
    )


def run(args: argparse.Namespace) -> int:
    if (args.by == "seed") != (args.val_data is not None):
        raise Error("--val-data: expected exactly if --by is seed")
    data = read_data_set(args.data)
    if args.by == "seed":
        validation = read_data_set(args.val_data)
        pairs = list(zip((data, validation), by_seed(data, validation), strict=True))
    elif args.by == "random":
        pairs = [(data, by_random(data.frames, args.seed))]
    else:
        pairs = [(data, by_time(data.frames, data.period_s, args.train_until_s, args.val_from_s))]
    for folder, split in pairs:
        write(folder, split, force=args.force)
        print(f"{folder.folder}: train {len(split.train)}, val {len(split.val)} frames")
    return 0
