"""`pyinfra detect RUN --data DATA/LIDAR --out DIR`, or `pyinfra detect RUN cloud.bin`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from pyinfra import kitti
from pyinfra.detectors import Detections, Detector, Points
from pyinfra.detectors.background import Background
from pyinfra.evaluation.ground_truth import frame_numbers
from pyinfra.kitti import FloatArray, Labels
from pyinfra.training.sources import scene_of, spread

PERCENTILES = (50, 95)


def load_detector(run: Path, *, device: str = "cpu") -> Detector:
    """The detector of a run's folder, or of a file in it.

    Raises FileNotFoundError, and ValueError for a file that is no model.
    """
    file = model_file(run)
    if file.suffix == ".npz":
        return Background.load(file)
    from pyinfra.detectors.fused import fused
    from pyinfra.detectors.network import device_of
    from pyinfra.training import checkpoint

    return fused(checkpoint.load(file).network()).to(device_of(device))


def model_file(run: Path, which: Literal["last", "best"] = "last") -> Path:
    """The model in a run's folder, or the file itself. Raises FileNotFoundError."""
    if run.is_file():
        return run
    names = (f"{which}.safetensors", "background.npz")
    for name in names:
        if (run / name).is_file():
            return run / name
    raise FileNotFoundError(2, f"No {' or '.join(names)} in it", str(run))


def transfer(run: Path, lidar_folder: Path) -> str:
    """How the folder differs from what the run learnt from; empty if it does not."""
    file = model_file(run)
    if file.suffix == ".npz" or not (lidar_folder / "lidar.yaml").is_file():
        return ""
    from pyinfra.training import checkpoint

    about, lidar = checkpoint.load(file).about, kitti.read_lidar(lidar_folder)
    pairs = {
        "LiDAR": (about.lidar, lidar.name),
        "preset": (about.preset, lidar.preset),
        "scene": (about.scene, scene_of(lidar_folder)),
    }
    return ", ".join(
        f"{name} {theirs} (learnt on {ours})"
        for name, (ours, theirs) in pairs.items()
        if theirs not in ours.split()
    )


def detect(
    detector: Detector, files: Sequence[Path], out: Path | None
) -> tuple[list[Detections], FloatArray]:
    """Detections and milliseconds, points to boxes, of each cloud; written as KITTI results.

    The results are in the camera of the frame's calib file, if there is one where a data set has
    it, else in that of a simulated LiDAR. Raises FormatError for a cloud that is none, and
    ValueError for two clouds of one name.
    """
    found, times = [], []
    if out is not None:
        once(files)
        out.mkdir(parents=True, exist_ok=True)
    for file in files:
        points = kitti.read_points(file)
        detections, seconds = timed(detector, points)
        found.append(detections)
        times.append(1000 * seconds)
        if out is not None:
            labels = Labels(detections.names, detections.boxes, detections.scores)
            kitti.write_labels(out / f"{file.stem}.txt", labels, calibration_of(file))
    return found, np.array(times)


def once(files: Sequence[Path]) -> None:
    """Raises ValueError if the results of two clouds would be one file."""
    named: dict[str, Path] = {}
    for file in files:
        if file.stem in named:
            raise ValueError(
                f"{file}: found the name of {named[file.stem]}, allowed once with --out"
            )
        named[file.stem] = file


def calibration_of(cloud: Path) -> kitti.Calibration | None:
    """That of a cloud in `velodyne`, from `calib` beside it. Raises FormatError."""
    file = cloud.parent.parent / "calib" / f"{cloud.stem}.txt"
    beside = cloud.parent.name == "velodyne" and file.is_file()
    return kitti.read_calibration(file) if beside else None


def timed(detector: Detector, points: Points) -> tuple[Detections, float]:
    start = time.perf_counter()
    found = detector.predict(points)
    return found, time.perf_counter() - start


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Finds vehicles with a trained detector; prints its latency."
    parser.epilog = (
        "example: pyinfra detect runs/pillars --data data/highway/ruby_plus "
        "--out runs/pillars/predictions"
    )
    parser.add_argument("model", metavar="RUN", type=Path, help="folder of `pyinfra train`")
    parser.add_argument("cloud", nargs="*", type=Path, help=".bin files, x y z intensity")
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
    parser.add_argument("--device", default="cpu", help="of a network: cpu, cuda, cuda:1, ...")
    parser.add_argument(
        "--allow-transfer", action="store_true", help="another LiDAR, preset or scene is meant"
    )


def run(args: argparse.Namespace) -> int:
    if args.frames < 0:
        raise ValueError(f"--frames: found {args.frames}, allowed 0 or more")
    if (args.data is None) == (not args.cloud) or (args.data is not None and args.out is None):
        raise ValueError("detect: found no or two inputs, allowed --data with --out, or clouds")
    model = model_file(args.model, args.checkpoint)
    detector = load_detector(model, device=args.device)
    files = args.cloud
    if args.data is not None:
        numbers = frame_numbers(args.data, args.split)
        chosen = spread(numbers, args.frames) if args.frames else numbers
        files = [kitti.frame_file(args.data, "velodyne", k) for k in chosen]
        warn(model, args)
    if not files:
        raise ValueError(f"{args.data}: found no frame in the split, allowed one or more")
    found, times = detect(detector, files, args.out)
    if args.out is None:
        _print_boxes(files, found)
    low, high = np.percentile(times, PERCENTILES)
    print(
        f"{len(files)} frames, {sum(map(len, found))} boxes, "
        f"{low:.1f} ms a frame (median), {high:.1f} ms (95 %)",
        file=sys.stderr if args.out is None else sys.stdout,
    )
    return 0


def warn(model: Path, args: argparse.Namespace) -> None:
    """Of what makes AP lower or higher than a user may think."""
    other = transfer(model, args.data)
    if other and not args.allow_transfer:
        print(f"pyinfra: warning: {other}; --allow-transfer if this is meant", file=sys.stderr)
    if not other and not args.split and not (args.data / "ImageSets/val.txt").is_file():
        print(
            f"pyinfra: warning: {args.data} is not split, so all frames are taken, also those that "
            "were learnt from; `pyinfra split` it first, or --split all if this is meant",
            file=sys.stderr,
        )


def _print_boxes(files: Sequence[Path], found: Sequence[Detections]) -> None:
    print("file,class,x,y,z,dx,dy,dz,heading,score")
    for file, detections in zip(files, found, strict=True):
        rows = zip(detections.names, detections.boxes, detections.scores, strict=True)
        for name, box, score in rows:
            numbers = ",".join(f"{v:.3f}" for v in box)
            print(f"{file},{name},{numbers},{score:.4f}")
