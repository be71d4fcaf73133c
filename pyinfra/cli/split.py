"""`pyinfra split DATA`."""

import argparse
from pathlib import Path

from pyinfra.cli.parser import argument, usage
from pyinfra.dataset.split import TRAIN_UNTIL_S, VAL_FROM_S
from pyinfra.folders import split

add_arguments = usage(
    "Divides the frames of a data set into training and validation frames. Writes their "
    "numbers to ImageSets/train.txt and val.txt of every LiDAR.",
    "example: pyinfra split data/highway --by time",
    argument("data", type=Path, help="data set written by `infrasim run`"),
    argument(
        "--by",
        choices=["time", "seed", "random"],
        default="time",
        help="how frames are split. time: frames before 400 s are train, and frames from 410 s on "
        "are val; seed: all frames of --val-data, a data set of another seed, are val; random: a "
        "fifth of the frames is val. Default: time",
    ),
    argument("--val-data", type=Path, help="validation data set, with --by seed"),
    argument("--seed", type=int, default=1, help="random seed, with --by random; default: 1"),
    argument(
        "--train-until-s",
        type=float,
        default=TRAIN_UNTIL_S,
        help=f"with --by time; default: {TRAIN_UNTIL_S:g}",
    ),
    argument(
        "--val-from-s",
        type=float,
        default=VAL_FROM_S,
        help=f"with --by time; default: {VAL_FROM_S:g}",
    ),
    argument("--force", action="store_true", help="replace an existing split that differs"),
)


def run(args: argparse.Namespace) -> int:
    table = split(
        args.data,
        args.by,
        val_data=args.val_data,
        seed=args.seed,
        train_until_s=args.train_until_s,
        val_from_s=args.val_from_s,
        force=args.force,
    )
    for folder, train, val in table.itertuples(index=False):
        print(f"{folder}: train {train}, val {val} frames")
    return 0
