"""`pyinfra detect RUN --data DATA/LIDAR --out DIR`, or `pyinfra detect RUN cloud.bin`."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TextIO

import numpy as np

from pyinfra.cli.messages import warn
from pyinfra.core.errors import Error
from pyinfra.core.machine_load import OtherLoad, other_load
from pyinfra.exchange.lone_clouds import cloud_reader
from pyinfra.models.inference.detect import (
    PERCENTILES,
    accumulation_of,
    check_single,
    detect,
    model_file,
)
from pyinfra.models.inference.folder import (
    FolderDetections,
    detect_folder,
    detector_at_place,
    frame_files,
    learnt_warning,
    others_warning,
    place,
    warn_of_height,
)

NOTHING = (
    "no box in any frame: are the sensor's height, its frame (z up, origin at the sensor) and the "
    "region right?"
)
# Minimum score of a box that is counted as likely. Before the calibration of scores, detectors
# return boxes with scores of 0.1 or more.
LIKELY = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Runs a trained detector on point clouds and prints its latency."
    parser.epilog = (
        "example: pyinfra detect runs/pillars --data data/highway/ruby_plus "
        "--out runs/pillars/predictions"
    )
    parser.add_argument(
        "trained",
        metavar="RUN",
        nargs="?",
        type=Path,
        help="output folder of `pyinfra train`; or use --model",
    )
    parser.add_argument(
        "cloud",
        nargs="*",
        type=Path,
        help="point clouds: .pcd files, or .bin files with x, y, z, intensity",
    )
    parser.add_argument(
        "--model",
        type=Path,
        help="pretrained detector, such as generalist, or a model file; replaces RUN",
    )
    parser.add_argument("--data", type=Path, help="folder of one LiDAR; replaces cloud files")
    parser.add_argument(
        "--out", type=Path, help="folder for boxes as KITTI results; required with --data"
    )
    parser.add_argument(
        "--split",
        help="which frames of --data: val, train or all; default: val if the data set is split, "
        "else all",
    )
    parser.add_argument(
        "--frames",
        type=int,
        default=0,
        help="maximum number of frames of --data, evenly distributed; default: 0, which means all "
        "frames",
    )
    parser.add_argument(
        "--checkpoint",
        choices=("last", "best"),
        default="last",
        help="checkpoint of the training: the last, or the best on the validation frames "
        "(validate_frames in the detector's configuration); default: last",
    )
    parser.add_argument(
        "--height-m",
        type=float,
        help="height of the sensor above a level road, in metres; default: taken from --data",
    )
    parser.add_argument(
        "--region",
        type=Path,
        metavar="FILE",
        help="YAML file with the outline of the area where vehicles can be, "
        "`outline_m: [[x, y], ...]`; default: taken from --data",
    )
    parser.add_argument(
        "--drop-standing",
        action="store_true",
        help="remove vehicle boxes that recur at positions where nothing moves; needs --data, "
        "preferably a minute of frames or more",
    )
    parser.add_argument(
        "--device",
        default="cpu",
        help="device of a network: cpu, cuda, cuda:1, ...; default: cpu",
    )
    parser.add_argument(
        "--allow-transfer",
        action="store_true",
        help="do not warn if the detector was trained on another LiDAR, preset or scene",
    )


def run(args: argparse.Namespace) -> int:
    _check(args)
    model = model_file(args.model or args.trained, args.checkpoint)
    with other_load() as load:
        detections = _in_clouds(args, model) if args.data is None else _in_folder(args, model)
    if args.out is None:
        _print_boxes(detections)
    elif text := others_warning(args.out, detections.files):
        warn(text, args)
    if not any(map(len, detections.detections)):
        warn(NOTHING, args)
    _print_summary(detections, load, sys.stderr if args.out is None else sys.stdout)
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raises Error for arguments that exclude each other. With --model, RUN becomes a cloud."""
    if args.frames < 0:
        raise Error(f"frames: expected 0 or more, got {args.frames}")
    # With --model, the first positional argument is a cloud, but argparse assigns it to RUN.
    if args.model is not None and args.trained is not None:
        args.trained, args.cloud = None, [args.trained, *args.cloud]
    if args.model is None and args.trained is None:
        raise Error("detect: expected RUN or --model, got no detector")
    if (args.data is None) == (not args.cloud) or (args.data is not None and args.out is None):
        raise Error("detect: expected --data with --out, or clouds, got no or two inputs")
    if args.drop_standing and args.data is None:
        raise Error("--drop-standing: expected --data, got only clouds")


def _in_folder(args: argparse.Namespace, model: Path) -> FolderDetections:
    files = frame_files(args.data, args.split, args.frames)
    where = place(args.data, args.height_m, args.region)
    allowed = args.allow_transfer
    if text := learnt_warning(model, args.data, args.split, allow_transfer=allowed):
        warn(text, args)
    how = {"drop_standing": args.drop_standing, "device": args.device}
    progress = partial(warn, args=args)
    result = detect_folder(
        model, args.data, args.out, files=files, where=where, warn=progress, **how
    )
    if result.left_out is not None:
        print(f"{result.left_out} boxes removed, because they are where nothing moves")
    return result


def _in_clouds(args: argparse.Namespace, model: Path) -> FolderDetections:
    check_single(model, accumulation_of(model).frames)
    where = place(None, args.height_m, args.region)
    detector = detector_at_place(model, where, args.device)
    read, notes = cloud_reader(args.cloud)
    for note in notes:
        warn(note, args)
    warn_of_height(args.cloud, read, where, partial(warn, args=args))
    return FolderDetections(args.cloud, *detect(detector, args.cloud, args.out, read=read))


def _print_summary(result: FolderDetections, load: OtherLoad, to: TextIO) -> None:
    boxes = result.detections
    likely = sum(int((one.scores >= LIKELY).sum()) for one in boxes)
    low, high = np.percentile(result.times_ms, PERCENTILES)
    print(
        f"{len(boxes)} frames, {sum(map(len, boxes))} boxes ({likely} with a score of {LIKELY} or "
        f"more), {low:.1f} ms a frame (median), {high:.1f} ms (95 %); {load.text}",
        file=to,
    )


def _print_boxes(per_frame: FolderDetections) -> None:
    print("file,class,x,y,z,dx,dy,dz,heading,score")
    for file, own in zip(per_frame.files, per_frame.detections, strict=True):
        for name, box, score in zip(own.names, own.boxes, own.scores, strict=True):
            numbers = ",".join(f"{v:.3f}" for v in box)
            print(f"{file},{name},{numbers},{score:.4f}")
