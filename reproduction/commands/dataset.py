"""Writes the study's data set of three scenes and four LiDARs, with split and data card."""

import argparse
from functools import partial
from pathlib import Path

from reproduction.data_release import CARD, FRAMES, SUMS, spread, write


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Simulates three scenes with four LiDARs and writes the split, a data card "
        "(DATASET.md) and the SHA-256 of every file (SHA256SUMS, for `sha256sum -c`). Run the "
        "same command again to resume.",
        epilog="example: python -m reproduction dataset --frames 500 --out data/paper",
    )
    parser.add_argument(
        "--frames",
        type=int,
        default=FRAMES,
        help="maximum number of frames per scene (default: %(default)s)",
    )
    parser.add_argument(
        "--preset", default="paper", help="preset of the LiDARs (default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=Path, required=True, help="output folder, with a folder for each scene"
    )
    args = parser.parse_args()
    write(args.out, spread(args.frames), args.preset, partial(print, flush=True))
    print(f"card {args.out / CARD}\nsums {args.out / SUMS}")
