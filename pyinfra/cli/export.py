"""`pyinfra export DATA/LIDAR --to FORMAT --out DIR`."""

import argparse
import time
from pathlib import Path

from pyinfra.cli.messages import note
from pyinfra.cli.parser import argument, one_of, usage
from pyinfra.dataset.frames import frame_numbers, frame_range
from pyinfra.exchange.exports import export, split_note
from pyinfra.exchange.formats import EXPORTS
from pyinfra.exchange.rates import Shown, summary

add_arguments = usage(
    "Writes frames of one LiDAR in the format of another tool.",
    "example: pyinfra export data/highway/livox_avia --to openpcdet --out out/openpcdet",
    argument("data", type=Path, help="folder of one LiDAR"),
    argument("--to", choices=EXPORTS, required=True, help="format to write"),
    argument("--out", type=Path, required=True, help="new or empty folder to write to"),
    one_of(
        argument("--frames", metavar="A:B[:STEP]", help="frame numbers from A to B, without B"),
        argument(
            "--split",
            default="all",
            help="which frames: the name of a list in ImageSets, such as train or val, or all; "
            "default: all",
        ),
    ),
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
