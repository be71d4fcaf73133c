"""Average precision of predictions: `pyinfra evaluate --gt DATA/LIDAR --pred DIR --out DIR`.

Any detector of any toolbox: predictions are KITTI result files or CSV in the LiDAR frame. What
counts and what is ignored stands in pyinfra.evaluation, AP in pyinfra.ap, the rest in
docs/conventions.md, "Evaluation".
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra import cli
from pyinfra.atomic import replacing
from pyinfra.data.frame_tables import read_cameras, read_predictions
from pyinfra.evaluation.ground_truth import SETS, frame_numbers, read_ground_truth
from pyinfra.evaluation.judge import PROTOCOLS, Settings
from pyinfra.evaluation.matching import Metric
from pyinfra.evaluation.prediction_checks import check_predictions, find_files
from pyinfra.evaluation.result import Evaluation, evaluate_tables
from pyinfra.evaluation.summary import summary
from pyinfra.kitti import VEHICLE_TYPES

METRICS: tuple[Metric, ...] = ("bev", "3d")


def evaluate(
    gt: Path,
    pred: Path,
    settings: Settings | None = None,
    *,
    frames: Sequence[int] | None = None,
    split: str | None = None,
    allow_missing: bool = False,
) -> Evaluation:
    """Reads a LiDAR's folder and predictions of its frames, and evaluates them.

    frames: those to evaluate; left out, those of the split (ImageSets/SPLIT.txt; by default `val`
    if there is one, else all). Raises FormatError with file and line, FileNotFoundError, and
    ValueError for settings that do not fit the folder.
    """
    known = frame_numbers(gt, "all")
    chosen = frame_numbers(gt, split) if frames is None else sorted(frames)
    settings = settings or default_settings(gt)
    found = find_files(pred, chosen, known, allow_missing=allow_missing)
    truth = read_ground_truth(gt, chosen, beyond_range="all" in settings.ground_truths)
    predictions = read_predictions(found.files, read_cameras(gt, chosen))
    types = settings.types
    of_types = truth.vehicles.select(np.isin(truth.vehicles.names, types))
    findings = [
        *found.findings,
        *check_predictions(predictions, found.files, of_types, types, settings.min_score),
    ]
    return evaluate_tables(truth, predictions, settings, findings)


def default_settings(gt: Path) -> Settings:
    """`all` can only be told with objects."""
    has_objects = (gt / "training/objects").is_dir()
    return Settings() if has_objects else Settings(ground_truths=("captured",))


def write(evaluation: Evaluation, out: Path, *, figures: bool = True) -> list[Path]:
    """Writes the tables as CSV, and their figures as SVG and PNG; returns the files."""
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for name, table in evaluation.tables().items():
        files.append(out / f"{name}.csv")
        with replacing(files[-1]) as beside:
            table.to_csv(beside, index=False, float_format="%.6g")
    if figures:
        # Plotting takes a second to import.
        from pyinfra.evaluation import figures as evaluation_figures

        files += evaluation_figures.draw_all(evaluation, out)
    return files


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Average precision, by distance and area, with 95 % intervals."
    parser.epilog = (
        "example: pyinfra evaluate --gt data/highway/livox_avia "
        "--pred runs/pillars/predictions --out out/evaluation"
    )
    parser.add_argument("--gt", type=Path, required=True, help="folder of a LiDAR, KITTI layout")
    parser.add_argument(
        "--pred",
        type=Path,
        required=True,
        help="folder of NNNNNN.txt (KITTI results) or NNNNNN.csv (class,x,y,z,dx,dy,dz,heading,"
        "score in the LiDAR frame)",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and figures")
    default = Settings()
    parser.add_argument(
        "--ground-truth",
        nargs="+",
        choices=SETS,
        help="captured: with points of this LiDAR; common: in view of every LiDAR of the data set, "
        "visible; all: visible. Default: captured all, without objects captured",
    )
    parser.add_argument(
        "--class",
        dest="classes",
        nargs="+",
        metavar="NAME[=TYPE,...]",
        help=f"KITTI types that count; default vehicle={','.join(VEHICLE_TYPES)}",
    )
    parser.add_argument("--iou", type=float, nargs="+", default=default.ious)
    parser.add_argument("--metric", nargs="+", choices=METRICS, default=default.metrics)
    parser.add_argument(
        "--protocol",
        nargs="+",
        choices=PROTOCOLS,
        default=default.protocols,
        help="definition: 40 recalls; r11: 11 recalls; kitti: the devkit's sampling, strict IoU",
    )
    parser.add_argument("--min-score", type=float, default=default.min_score)
    parser.add_argument(
        "--min-points", type=int, default=default.min_points, help="of a captured vehicle"
    )
    parser.add_argument(
        "--min-objects", type=int, default=default.min_objects, help="of an area that counts"
    )
    parser.add_argument(
        "--cut-first", action="store_true", help="also match within each window alone; slow"
    )
    parser.add_argument("--draws", type=int, default=default.draws, help="of the bootstrap")
    parser.add_argument("--seed", type=int, default=default.seed, help="of the bootstrap")
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--split", help="train, val, ... of ImageSets, or all; default val if there is one"
    )
    frames.add_argument("--frames", metavar="A:B[:STEP]", help="B excluded")
    parser.add_argument(
        "--allow-missing", action="store_true", help="a missing file means nothing found"
    )
    parser.add_argument("--no-figures", action="store_true")


def run(args: argparse.Namespace) -> int:
    default = default_settings(args.gt)
    settings = Settings(
        classes=class_types(args.classes) if args.classes else default.classes,
        ground_truths=tuple(args.ground_truth or default.ground_truths),
        ious=tuple(args.iou),
        protocols=tuple(args.protocol),
        metrics=tuple(args.metric),
        min_score=args.min_score,
        min_points=args.min_points,
        min_objects=args.min_objects,
        cut_first=args.cut_first,
        draws=args.draws,
        seed=args.seed,
    )
    evaluation = evaluate(
        args.gt,
        args.pred,
        settings,
        frames=frame_range(args.frames, args.gt) if args.frames else None,
        split=args.split,
        allow_missing=args.allow_missing,
    )
    for finding in evaluation.findings:
        print(f"pyinfra: {finding}", file=sys.stderr)
    write(evaluation, args.out, figures=not args.no_figures)
    print(summary(evaluation))
    return 0


def class_types(words: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """`vehicle`, `Car` or `large=Truck,Bus` as classes with their types.

    Raises ValueError for a class without types.
    """
    classes = {}
    for word in words:
        name, equals, types = word.partition("=")
        listed = tuple(types.split(",")) if equals else (name,)
        if name == "vehicle" and not equals:
            listed = VEHICLE_TYPES
        if not name or not all(listed):
            raise ValueError(f"--class: found '{word}', allowed NAME or NAME=TYPE,TYPE")
        classes[name] = listed
    return classes


def frame_range(word: str, gt: Path) -> list[int]:
    """The frames of a folder in A:B[:STEP]. Raises ValueError if there is none."""
    parts = word.split(":")
    if len(parts) not in (2, 3) or not all(part.isdecimal() for part in parts):
        raise ValueError(f"--frames: found '{word}', allowed A:B[:STEP]")
    wanted = range(*(int(part) for part in parts)) if "0" not in parts[2:] else range(0)
    frames = [frame for frame in frame_numbers(gt, "all") if frame in wanted]
    if not frames:
        raise ValueError(f"--frames: found '{word}', allowed a range with frames of {gt}")
    return frames


def main(words: Sequence[str] | None = None) -> int:
    """`python -m pyinfra.evaluate` is `pyinfra evaluate`."""
    return cli.main(["evaluate", *(sys.argv[1:] if words is None else words)])


if __name__ == "__main__":
    sys.exit(main())
