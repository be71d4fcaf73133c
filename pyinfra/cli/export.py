"""`pyinfra export DATA/LIDAR --to FORMAT --out DIR`."""

import argparse
import time
from pathlib import Path

from pyinfra.cli.messages import note
from pyinfra.dataset.frames import frame_numbers, frame_range
from pyinfra.exchange.exports import export, split_note
from pyinfra.exchange.formats import EXPORTS
from pyinfra.exchange.rates import Shown, summary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Writes frames of one LiDAR in the format of another tool."
    parser.epilog = (
        "example: pyinfra export data/highway/livox_avia --to openpcdet --out out/openpcdet"
    )
    parser.add_argument("data", type=Path, help="folder of one LiDAR")
    parser.add_argument("--to", choices=EXPORTS, required=True, help="format to write")
    parser.add_argument("--out", type=Path, required=True, help="new or empty folder to write to")
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--frames", metavar="A:B[:STEP]", help="frame numbers from A to B, without B"
    )
    frames.add_argument(
        "--split",
        default="all",
        help="which frames: the name of a list in ImageSets, such as train or val, or all; "
        "default: all",
    )


def run(args: argparse.Namespace) -> int:
    since = time.perf_counter()
    if args.frames:
        frames = frame_range(args.frames, args.data)
    else:
        frames = frame_numbers(args.data, args.split)
    export(args.data, Shown(frames), args.to, args.out)
    if text := split_note(args.data, frames, args.to):
        note(text, args)
    print(f"{args.out}: {summary(len(frames), args.out, since)}")
    return 0
