"""`pyinfra detect DATA/LIDAR --model RUN --out DIR`, or `pyinfra detect cloud.bin`."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TextIO

import numpy as np

from pyinfra.cli.messages import printed_findings, warn
from pyinfra.cli.parser import argument, usage
from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error, FormatError, refuse
from pyinfra.core.machine_load import OtherLoad, other_load
from pyinfra.core.names import suggestion
from pyinfra.dataset.frames import lidar_folder
from pyinfra.dataset.health import health_text, recorded_health
from pyinfra.exchange.lone_clouds import cloud_reader, following_reader
from pyinfra.formats import kitti
from pyinfra.models.inference.detect import (
    PERCENTILES,
    accumulation_of,
    check_single,
    detect,
    inputs_used,
    model_file,
    shipped,
    threads_of,
)
from pyinfra.models.inference.folder import (
    FolderDetections,
    detect_folder,
    detector_at_place,
    frame_files,
    learnt_warning,
    others_warning,
    place,
    readable_clouds,
    region_warning,
    warn_of_height,
)
from pyinfra.models.inference.threads import checked_threads
from pyinfra.tracking.live import boxes_of_detections, live_lines, new_clouds, time_of
from pyinfra.tracking.state import Boxes
from pyinfra.tracking.tracker import Tracker

NOTHING = (
    "no box in any frame; check the sensor's height, its frame (z up, origin at the sensor) and "
    "the region"
)
PRETRAINED = "generalist"
# Minimum score of a box that the summary counts separately. Detectors return boxes with scores of
# 0.1 or more before the calibration of scores.
LIKELY = 0.5

add_arguments = usage(
    "Runs a trained detector on point clouds and prints its latency.",
    "example: pyinfra detect data/highway/ruby_plus --model runs/pillars "
    "--out runs/pillars/predictions",
    argument(
        "inputs",
        metavar="DATA",
        nargs="+",
        type=Path,
        help="folder of one LiDAR, or point clouds: .pcd files, or .bin files with x, y, z, "
        "intensity",
    ),
    argument(
        "--model",
        type=Path,
        default=Path(PRETRAINED),
        help="detector: an output folder of `pyinfra train`, a model file, or the name of a "
        f"pretrained detector; default: {PRETRAINED}",
    ),
    argument(
        "--out",
        type=Path,
        help="folder for boxes as KITTI results; required if DATA is a folder, otherwise boxes are "
        "printed",
    ),
    argument(
        "--split",
        help="which frames of the folder: val, train or all; default: val if the data set is "
        "split, else all",
    ),
    argument(
        "--frames",
        metavar="A:B[:STEP]",
        help="frame numbers from A to B, without B; default: all frames of the split",
    ),
    argument(
        "--max-frames",
        type=int,
        default=0,
        metavar="N",
        help="maximum number of frames, evenly distributed; default: 0, which means all frames",
    ),
    argument(
        "--checkpoint",
        choices=("last", "best"),
        default="last",
        help="checkpoint of the training: the last, or the best on the validation frames "
        "(validate_frames in the detector's configuration); default: last",
    ),
    argument(
        "--height-m",
        type=float,
        help="height of the sensor above a level road, in metres; default: taken from DATA",
    ),
    argument(
        "--region",
        type=Path,
        metavar="FILE",
        help="YAML file with the outline of the area where vehicles can be, "
        "`outline_m: [[x, y], ...]`; default: taken from DATA",
    ),
    argument(
        "--drop-standing",
        action="store_true",
        help="remove vehicle boxes that recur at positions where nothing moves; needs a folder, "
        "preferably a minute of frames or more",
    ),
    argument(
        "--skip-bad",
        action="store_true",
        help="leave out and count clouds that cannot be read; default: such a cloud is an error",
    ),
    argument(
        "--follow",
        action="store_true",
        help="wait for new clouds in the folder DATA and print a JSON line of tracks for each; "
        "frames are dropped while the machine is too slow",
    ),
    argument(
        "--period-s",
        type=float,
        help="frame period of --follow, if files are named by frame number, not by time",
    ),
    argument(
        "--idle-s",
        type=float,
        default=float("inf"),
        help="end --follow after this many seconds without a new cloud; default: never",
    ),
    argument(
        "--device", default="cpu", help="device of a network: cpu, cuda, cuda:1, ...; default: cpu"
    ),
    argument(
        "--threads",
        type=int,
        help="number of threads per frame, used by the detector centerpoint-pillar on a CPU, and "
        "so by the pretrained detector; default: one per core, at most 4",
    ),
    argument(
        "--allow-transfer",
        action="store_true",
        help="do not warn if the detector was trained on a different LiDAR, preset or scene",
    ),
)


def run(args: argparse.Namespace) -> int:
    if args.follow:
        return _follow(args)
    _check(args)
    model = model_file(args.model, args.checkpoint)
    is_folder = args.inputs[0].is_dir()
    try:
        with other_load() as load:
            detections = _in_folder(args, model) if is_folder else _in_clouds(args, model)
    except FormatError as error:
        text = str(error)
        if not args.skip_bad and text.startswith(tuple(f"{path}" for path in args.inputs)):
            text += "; `skip_bad` leaves out clouds that cannot be read"
        raise FormatError(text) from error
    if args.out is None:
        _print_boxes(detections)
    elif text := others_warning(args.out, detections.files):
        warn(text, args)
    if not any(map(len, detections.detections)):
        warn(NOTHING, args)
    threads = threads_of(model, args.device, checked_threads(args.threads))
    to = sys.stderr if args.out is None else sys.stdout
    _print_summary(detections, threads, load, to)
    return 0


def _follow(args: argparse.Namespace) -> int:
    """Prints a JSON line of tracks for each new cloud of a growing folder."""
    inputs = " ".join(map(str, args.inputs))
    is_folder = len(args.inputs) == 1 and args.inputs[0].is_dir()
    refuse(
        (not is_folder, f"DATA: expected one folder with --follow, got {inputs}"),
        (args.out, f"--out: expected no folder with --follow, got {args.out}; tracks are printed"),
    )
    model = model_file(args.model, args.checkpoint)
    check_single(model, accumulation_of(model).frames)
    site = place(None, args.height_m, args.region)
    detector = detector_at_place(model, site, args.device, checked_threads(args.threads))
    read_cloud = following_reader()

    def read(file: Path) -> tuple[float, Boxes]:
        try:
            points = read_cloud(file)
        except FormatError as error:
            if not args.skip_bad:
                raise FormatError(f"{error}; `skip_bad` leaves out such clouds") from None
            warn(f"left out a cloud that cannot be read: {error}", args)
            points = np.empty((0, 4), dtype=np.float32)
        detections = detector.predict(points)
        boxes = boxes_of_detections(detections.boxes, detections.scores, detections.names)
        return time_of(file, args.period_s), boxes

    arrivals = new_clouds(args.inputs[0], idle_s=args.idle_s)
    with printed_findings(args):
        for line in live_lines(arrivals, read, Tracker()):
            print(line, flush=True)
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raises Error for arguments that exclude each other, and OSError for missing inputs."""
    model = str(args.model)
    refuse(
        (args.max_frames < 0, f"max_frames: expected 0 or more, got {args.max_frames}"),
        (
            args.frames and args.frames.isdecimal(),
            f"--frames: expected A:B[:STEP], got '{args.frames}'; for a number of "
            f"frames, use --max-frames {args.frames}",
        ),
        (args.frames and args.split, "--frames: use --frames or --split, not both"),
    )
    if not args.model.exists() and args.model.name == model and model not in shipped():
        raise Error(
            "--model: expected an output folder of `pyinfra train`, a model file or the name of a "
            f"pretrained detector, got '{model}'{suggestion(model, shipped())}"
        )
    folders = [path for path in args.inputs if path.is_dir()]
    if folders and len(args.inputs) > 1:
        raise Error(
            f"DATA: expected one folder or a list of point clouds, got {len(args.inputs)} inputs, "
            f"of which {folders[0]} is a folder"
        )
    args.inputs = [_folder_of(folder) for folder in folders] or args.inputs
    of_folders = ("drop_standing", "frames", "max_frames", "split")
    given = next((name for name in of_folders if getattr(args, name)), "")
    text = "expected a LiDAR's folder as DATA, got files of point clouds"
    refuse(
        (
            folders and args.out is None,
            "--out: expected a folder for the boxes, got none; it is required if DATA is a folder",
        ),
        (given and not folders, f"{given}: {text}"),
    )
    for path in args.inputs:
        path.stat()  # raises FileNotFoundError if the path does not exist


def _folder_of(folder: Path) -> Path:
    """Returns the LiDAR's folder. Raises Error for the folder of a trained detector."""
    if any((folder / name).is_file() for name in ("last.safetensors", "background.npz")):
        raise Error(
            f"{folder}: expected a LiDAR's folder or point clouds, got the folder of a trained "
            f"detector; use --model {folder}"
        )
    return lidar_folder(folder)


def _in_folder(args: argparse.Namespace, model: Path) -> FolderDetections:
    (data,) = args.inputs
    files = frame_files(data, args.split, args.max_frames, args.frames)
    if args.skip_bad:
        files = _without_bad(args, files, kitti.read_points)
    site = place(data, args.height_m, args.region)
    if text := region_warning(model, site):
        command = shlex.join(["pyinfra", "region", str(data), "--out", "outline.yaml"])
        draw = (
            f"`{command}` proposes an outline, and --region takes it, here and in `pyinfra import`"
        )
        warn(f"{text}; {draw}", args)
    allowed = args.allow_transfer
    if text := learnt_warning(model, data, args.split, allow_transfer=allowed):
        warn(text, args)
    if text := health_text(recorded_health(data, [int(file.stem) for file in files])):
        warn(text, args)
    how = {
        "drop_standing": args.drop_standing,
        "device": args.device,
        "threads": checked_threads(args.threads),
        "skip_bad": args.skip_bad,
    }
    progress = partial(warn, args=args)
    result = detect_folder(model, data, args.out, files=files, where=site, warn=progress, **how)
    if result.left_out is not None:
        print(f"{result.left_out} boxes removed, because nothing ever moves at their positions")
    return result


def _in_clouds(args: argparse.Namespace, model: Path) -> FolderDetections:
    check_single(model, accumulation_of(model).frames)
    site = place(None, args.height_m, args.region)
    detector = detector_at_place(model, site, args.device, checked_threads(args.threads))
    if text := region_warning(model, site):
        warn(f"{text}; --region takes an outline of the road", args)
    read, notes = cloud_reader(args.inputs)
    for note in notes:
        warn(note, args)
    if args.skip_bad:
        args.inputs = _without_bad(args, args.inputs, read)
    warn_of_height(args.inputs, read, site, partial(warn, args=args))
    found = detect(detector, args.inputs, args.out, read=read)
    return FolderDetections(args.inputs, *found, inputs=inputs_used(model))


def _without_bad(
    args: argparse.Namespace, clouds: Sequence[Path], read: Callable[[Path], Points]
) -> list[Path]:
    """Returns the clouds that can be read, and warns of the clouds that cannot be read."""
    good, bad = readable_clouds(clouds, read)
    if bad:
        warn(f"left out {len(bad)} clouds that cannot be read, such as {bad[0]}", args)
    return good


def _print_summary(result: FolderDetections, threads: int, load: OtherLoad, to: TextIO) -> None:
    boxes = result.detections
    likely = sum(int((detections.scores >= LIKELY).sum()) for detections in boxes)
    low, high = np.percentile(result.times_ms, PERCENTILES)
    print(
        f"{len(boxes)} frames, {sum(map(len, boxes))} boxes ({likely} with a score of {LIKELY} or "
        f"more), {low:.1f} ms a frame (median), {high:.1f} ms (95th percentile), "
        f"{threads} thread{'s'[: threads > 1]}; input: {result.inputs}; {load.text}",
        file=to,
    )


def _print_boxes(per_frame: FolderDetections) -> None:
    print("file,class,x,y,z,dx,dy,dz,heading,score")
    for file, detections in zip(per_frame.files, per_frame.detections, strict=True):
        for name, box, score in zip(
            detections.names, detections.boxes, detections.scores, strict=True
        ):
            numbers = ",".join(f"{v:.3f}" for v in box)
            print(f"{file},{name},{numbers},{score:.4f}")
