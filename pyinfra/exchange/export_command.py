"""`pyinfra export DATA/LIDAR --to FORMAT --out DIR`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from pyinfra.atomic import new_folder
from pyinfra.evaluate import frame_range
from pyinfra.evaluation.ground_truth import frame_numbers
from pyinfra.exchange.formats import EXPORTS, exporter
from pyinfra.exchange.rates import Shown, summary


def export(lidar_folder: Path, frames: Sequence[int], name: str, out: Path) -> None:
    """Writes the frames in a format of EXPORTS into a new folder, whole or not at all.

    Raises what the format raises, ValueError without a frame, and FileExistsError.
    """
    write = exporter(name)
    if not frames:
        raise ValueError(f"{lidar_folder}: found no frame to export, allowed one or more")
    with new_folder(out) as beside:
        write(lidar_folder, frames, beside)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Writes frames of a LiDAR as another tool takes them."
    parser.epilog = (
        "example: pyinfra export data/highway/livox_avia --to openpcdet --out out/openpcdet"
    )
    parser.add_argument("data", type=Path, help="folder of a LiDAR")
    parser.add_argument("--to", choices=EXPORTS, required=True)
    parser.add_argument("--out", type=Path, required=True, help="new or empty folder")
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument("--frames", metavar="A:B[:STEP]", help="B excluded; default: all")
    frames.add_argument("--split", default="all", help="train or val of ImageSets; default: all")


def run(args: argparse.Namespace) -> int:
    since = time.perf_counter()
    if args.frames:
        frames = frame_range(args.frames, args.data)
    else:
        frames = frame_numbers(args.data, args.split)
    export(args.data, Shown(frames), args.to, args.out)
    print(f"{args.out}: {summary(len(frames), args.out, since)}")
    return 0
