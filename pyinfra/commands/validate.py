"""`pyinfra validate DATA/LIDAR [--pred DIR]`."""

from __future__ import annotations

import argparse
from pathlib import Path

from pyinfra.evaluation.frame_checks import folders_with_frames, validate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Checks frames, and predictions of them; names the usual causes of AP 0."
    parser.epilog = (
        "example: pyinfra validate data/highway/livox_avia --pred runs/pillars/predictions"
    )
    parser.add_argument("data", type=Path, help="folder of a LiDAR, or a data set without --pred")
    parser.add_argument("--pred", type=Path, help="folder of NNNNNN.txt or NNNNNN.csv")
    parser.add_argument("--split", help="frames to be predicted; default val if there is one")
    parser.add_argument("--allow-missing", action="store_true", help="of prediction files")


def run(args: argparse.Namespace) -> int:
    folders = folders_with_frames(args.data)
    if args.pred is not None and len(folders) > 1:
        names = ", ".join(folder.name for folder in folders)
        raise ValueError(f"{args.data}: found several LiDARs with --pred, allowed one of {names}")
    found = [
        finding
        for folder in folders
        for finding in validate(folder, args.pred, args.split, allow_missing=args.allow_missing)
    ]
    for finding in found:
        print(finding)
    errors = sum(finding.level == "error" for finding in found)
    warnings = sum(finding.level == "warning" for finding in found)
    print(f"{args.data}: {errors} errors, {warnings} warnings")
    return 1 if errors else 0
