"""`pyinfra split DATA`."""

import argparse
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.split import TRAIN_UNTIL_S, VAL_FROM_S, by_random, by_seed, by_time, write


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
        raise Error("--by seed and --val-data go together")
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
