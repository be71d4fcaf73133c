"""`pyinfra dataset --out DIR`, which `make dataset` runs."""

import argparse
from functools import partial
from pathlib import Path

from pyinfra.dataset.release import CARD, FRAMES, SUMS, spread, write


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Simulates three scenes with four LiDARs and writes the split, a data card (DATASET.md) "
        "and the SHA-256 of every file (SHA256SUMS, for `sha256sum -c`). Resumes."
    )
    parser.epilog = "example: pyinfra dataset --frames 500 --out data/paper"
    parser.add_argument("--frames", type=int, default=FRAMES, help="of a scene, at most")
    parser.add_argument("--preset", default="paper", help="of the LiDARs (default: %(default)s)")
    parser.add_argument("--out", type=Path, required=True, help="a folder for each scene goes here")


def run(args: argparse.Namespace) -> int:
    write(args.out, spread(args.frames), args.preset, partial(print, flush=True))
    print(f"card {args.out / CARD}\nsums {args.out / SUMS}")
    return 0
