"""`pyinfra detect RUN --data DATA/LIDAR --out DIR`, or `pyinfra detect RUN cloud.bin`."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.errors import Error
from pyinfra.core.machine_load import OtherLoad, other_load
from pyinfra.dataset.frames import frame_numbers, has_labels, period_of
from pyinfra.dataset.ground import MOST_HEIGHT_M, Ground, level_ground
from pyinfra.dataset.prediction_origin import origin_of, read_origin, write_origin
from pyinfra.dataset.regions import Region, outline_region
from pyinfra.exchange import pcd
from pyinfra.exchange.bin_columns import USUAL, columns_of
from pyinfra.exchange.data_set import has_return
from pyinfra.exchange.pose_estimation import WIDE, road_of, usual_intensity_max
from pyinfra.exchange.recording import Options, read_bin
from pyinfra.formats import kitti, pcd_file
from pyinfra.models.detectors import Detections, Detector
from pyinfra.models.inference.detect import (
    PERCENTILES,
    accumulation_of,
    check_single,
    detect,
    ground_and_region_of,
    is_of_anywhere,
    load_detector,
    model_file,
    once,
    stacking,
    transfer,
    write,
)
from pyinfra.models.inference.static_filter import without_standing
from pyinfra.models.training.accumulation import Accumulation
from pyinfra.models.training.sources import spread

NOTHING = (
    "no box in any frame: are the sensor's height, its frame (z up, origin at the sensor) and the "
    "region right?"
)
LOOKED_AT = 5  # clouds, for their road
HEIGHT_OFF_M = 0.2  # beyond the errors that version 3 of the pretrained detector learnt from
LEAN_DEG = 0.3  # a quarter of a degree cost it 3 to 9 AP, half of one 8 to 25
LEAST_S = 60.0  # of a recording that tells what stands
LIKELY = 0.5  # a score; a detector gives all boxes from 0.1 on, before calibration

Read = Callable[[Path], Points]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Finds vehicles with a trained detector; prints its latency."
    parser.epilog = (
        "example: pyinfra detect runs/pillars --data data/highway/ruby_plus "
        "--out runs/pillars/predictions"
    )
    parser.add_argument(
        "trained", metavar="RUN", nargs="?", type=Path, help="folder of `pyinfra train`, or --model"
    )
    parser.add_argument(
        "cloud", nargs="*", type=Path, help=".bin files, x y z intensity, or .pcd files"
    )
    parser.add_argument(
        "--model", type=Path, help="in place of RUN: of the package, as generalist, or a file"
    )
    parser.add_argument("--data", type=Path, help="folder of a LiDAR")
    parser.add_argument("--out", type=Path, help="folder of the KITTI results; needed with --data")
    parser.add_argument(
        "--split", help="val, train or all, with --data; default: val if split, else all"
    )
    parser.add_argument("--frames", type=int, default=0, help="at most so many, evenly spread")
    parser.add_argument(
        "--checkpoint",
        choices=("last", "best"),
        default="last",
        help="default: last; best: by the recipe's validate_frames",
    )
    parser.add_argument(
        "--height-m", type=float, help="of the sensor above the road; default: what --data says"
    )
    parser.add_argument(
        "--region",
        type=Path,
        metavar="FILE",
        help="where vehicles can be, `outline_m: [[x, y], ...]`; default: what --data says",
    )
    parser.add_argument(
        "--drop-standing",
        action="store_true",
        help="with --data of a minute or more: no boxes that come back where nothing ever moves",
    )
    parser.add_argument("--device", default="cpu", help="of a network: cpu, cuda, cuda:1, ...")
    parser.add_argument(
        "--allow-transfer", action="store_true", help="another LiDAR, preset or scene is meant"
    )


def run(args: argparse.Namespace) -> int:
    _check(args)
    model = model_file(args.model or args.trained, args.checkpoint)
    accumulation = accumulation_of(model)
    if args.data is None:
        check_single(model, accumulation.frames)
    detector = _detector(model, args)
    files, read = _clouds(args, accumulation)
    if args.data is not None:
        warn(model, args)
        args.out.mkdir(parents=True, exist_ok=True)
        if read_origin(args.out) is not None or not _others(args.out, files):
            write_origin(args.out, origin_of(args.data, model))
    if args.height_m is not None:
        chosen = spread(range(len(files)), LOOKED_AT)
        _warn_of_height([read(files[i]) for i in chosen], args.height_m)
    with other_load() as load:
        if args.drop_standing:
            detections, times = _without_standing(detector, files, args, read)
        else:
            detections, times = detect(detector, files, args.out, read=read)
    if args.out is None:
        _print_boxes(files, detections)
    else:
        _warn_of_others(args.out, files)
    _print_summary(detections, times, load, sys.stderr if args.out is None else sys.stdout)
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raises Error for words that do not go together."""
    if args.frames < 0:
        raise Error(f"--frames: found {args.frames}, allowed 0 or more")
    if args.model is not None and args.trained is not None:  # it is the first cloud
        args.trained, args.cloud = None, [args.trained, *args.cloud]
    if args.model is None and args.trained is None:
        raise Error("detect: found no detector, allowed RUN or --model")
    if (args.data is None) == (not args.cloud) or (args.data is not None and args.out is None):
        raise Error("detect: found no or two inputs, allowed --data with --out, or clouds")
    if args.drop_standing and args.data is None:
        raise Error("--drop-standing: found clouds alone, allowed with --data")
    if args.data is not None and not (args.data / "training/velodyne").is_dir():
        raise Error(f"--data: found {args.data} without training/velodyne, allowed a LiDAR's")
    if args.out is not None and args.out.name == "label_2":
        raise Error(f"--out: found {args.out}, allowed another folder: labels are there")


def _clouds(args: argparse.Namespace, accumulation: Accumulation) -> tuple[list[Path], Read]:
    """The files of the clouds, and what reads one. Raises Error if there is none."""
    if args.data is None:
        return args.cloud, _lone(args.cloud)
    numbers = frame_numbers(args.data, args.split)
    chosen = spread(numbers, args.frames) if args.frames else numbers
    if not chosen:
        raise Error(f"{args.data}: found no frame in the split, allowed one or more")
    files = [kitti.frame_file(args.data, "velodyne", k) for k in chosen]
    return files, stacking(args.data, chosen, accumulation)


def _detector(model: Path, args: argparse.Namespace) -> Detector:
    """Where the data were taken, but for what the user says of the place."""
    ground, region = _ground_and_region(args)
    if model.suffix == ".npz":
        for option in ("height_m", "region"):
            if getattr(args, option) is not None:
                name = option.replace("_", "-")
                raise Error(f"--{name}: found one for background, allowed where it learnt")
    return load_detector(model, ground=ground, region=region, device=args.device, stacks=True)


def _ground_and_region(args: argparse.Namespace) -> tuple[Ground | None, Region | None]:
    if args.height_m is not None and not 0 < args.height_m <= MOST_HEIGHT_M:
        raise Error(
            f"--height-m: found {args.height_m:g}, allowed more than 0 to {MOST_HEIGHT_M:g}"
        )
    ground, region = ground_and_region_of(args.data) if args.data is not None else (None, None)
    if args.height_m is not None:
        ground = level_ground(-args.height_m)
    if args.region is not None:
        region = outline_region(args.region)
    return ground, region


def _without_standing(
    detector: Detector, files: Sequence[Path], args: argparse.Namespace, read: Read
) -> tuple[list[Detections], FloatArray]:
    """As `detect`; what stands is known when all frames are."""
    once(files)
    every, times = detect(detector, files, None, read=read)
    road, region = _ground_and_region(args)
    remaining = without_standing(files, every, region, road)
    numbers = [int(file.stem) for file in files]
    seconds = (max(numbers) - min(numbers)) * period_of(args.data)
    gone = sum(map(len, every)) - sum(map(len, remaining))
    print(f"{gone} boxes left out, as they stand where nothing moves")
    if seconds < LEAST_S:
        text = (
            f"found {seconds:g} s, meant for {LEAST_S:g} s or more: who waits is left out as well"
        )
        print(f"pyinfra: warning: --drop-standing: {text}", file=sys.stderr)
    args.out.mkdir(parents=True, exist_ok=True)
    for file, detections in zip(files, remaining, strict=True):
        write(args.out, file, detections)
    return remaining, times


def _lone(clouds: Sequence[Path]) -> Read:
    """What reads clouds that are no data set's; says on stderr what is made of them.

    .pcd files are turned by their VIEWPOINT, and their intensities divided as an import does.
    """
    pcds = [cloud for cloud in clouds if cloud.suffix.lower() == ".pcd"]
    bins = [cloud for cloud in clouds if cloud not in pcds]
    columns, column_note = columns_of(bins, Options())
    notes = [column_note] if columns != USUAL else []
    notes += pcd.Headers(pcds, labelled=False).notes(shifted=False)
    looked = spread(range(len(pcds)), LOOKED_AT)
    brightest = max((_brightest(pcds[i]) for i in looked), default=0.0)
    highest = usual_intensity_max(brightest)
    if highest != 1:
        notes.append(f"intensities reach {brightest:.6g}: divided by {highest:g}")
    for note in notes:
        print(f"pyinfra: warning: {note}", file=sys.stderr)

    def read(cloud: Path) -> Points:
        if cloud in pcds:
            points = _points(cloud, Options(intensity_max=highest))
        elif columns == USUAL:
            return kitti.read_points(cloud)
        else:
            points = read_bin(cloud, columns, Options())
        return points[has_return(points)]

    return read


def _points(file: Path, options: Options) -> Points:
    return pcd.points_of(file, pcd_file.read_pcd(file), options, shifted=False)


def _brightest(file: Path) -> float:
    """The highest finite intensity of a .pcd file, or 0."""
    shares = _points(file, Options(intensity_max=WIDE.intensity_max))[:, 3]
    return float(shares[np.isfinite(shares)].max(initial=0)) * (WIDE.intensity_max or 1)


def warn(model: Path, args: argparse.Namespace) -> None:
    """Of what makes AP lower or higher than a user may think."""
    other = transfer(model, args.data)
    if other and not args.allow_transfer:
        print(f"pyinfra: warning: {other}; --allow-transfer if this is meant", file=sys.stderr)
    split = args.split or (args.data / "ImageSets/val.txt").is_file()
    if not other and not split and has_labels(args.data) and not is_of_anywhere(model):
        print(
            f"pyinfra: warning: {args.data} is not split, so all frames are taken, also those that "
            "were learnt from; `pyinfra split` it first, or --split all if this is meant",
            file=sys.stderr,
        )


def _warn_of_height(clouds: Sequence[Points], height_m: float) -> None:
    """Where the clouds have their road elsewhere: a network sees vehicles by their height on it."""
    road = road_of(clouds)
    if road is None:
        return
    warning = (
        f"--height-m says {height_m:g} m, the road of the clouds lies {road.height_m:.2f} m below"
    )
    if abs(road.height_m - height_m) > HEIGHT_OFF_M:
        print(f"pyinfra: warning: {warning} the sensor", file=sys.stderr)
    lean = math.degrees(math.hypot(*road.tilt))
    if lean > LEAN_DEG:
        text = f"the sensor leans by {lean:.1f} degrees to the road; `pyinfra import` levels clouds"
        print(f"pyinfra: warning: {text}", file=sys.stderr)


def _others(out: Path, files: Sequence[Path]) -> list[Path]:
    """Results of other frames than those of some clouds, perhaps of another detector."""
    current = {f"{file.stem}.txt" for file in files}
    return [file for file in out.glob("*.txt") if file.name not in current]


def _warn_of_others(out: Path, files: Sequence[Path]) -> None:
    if others := _others(out, files):
        text = f"{len(others)} files of other frames were there and stay, as {others[0].name}"
        unknown = "" if read_origin(out) else "; where they come from is not known"
        print(f"pyinfra: warning: {out}: {text}{unknown}", file=sys.stderr)


def _print_summary(
    boxes: Sequence[Detections], times: FloatArray, load: OtherLoad, to: TextIO
) -> None:
    if not any(map(len, boxes)):
        print(f"pyinfra: warning: {NOTHING}", file=sys.stderr)
    likely = sum(int((one.scores >= LIKELY).sum()) for one in boxes)
    low, high = np.percentile(times, PERCENTILES)
    print(
        f"{len(boxes)} frames, {sum(map(len, boxes))} boxes ({likely} with a score of {LIKELY} or "
        f"more), {low:.1f} ms a frame (median), {high:.1f} ms (95 %); {load.text}",
        file=to,
    )


def _print_boxes(files: Sequence[Path], per_frame: Sequence[Detections]) -> None:
    print("file,class,x,y,z,dx,dy,dz,heading,score")
    for file, detections in zip(files, per_frame, strict=True):
        rows = zip(detections.names, detections.boxes, detections.scores, strict=True)
        for name, box, score in rows:
            numbers = ",".join(f"{v:.3f}" for v in box)
            print(f"{file},{name},{numbers},{score:.4f}")
