"""`pyinfra evaluate --gt DATA/LIDAR --pred DIR --out DIR`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from pyinfra.cli.messages import with_options
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import OBJECT_CLASSES, SUBSETS, VEHICLE_TYPES
from pyinfra.dataset.frames import frame_range
from pyinfra.metrics.evaluate import class_settings, default_settings, evaluate, write
from pyinfra.metrics.evaluation_summary import summary
from pyinfra.metrics.match_results import PROTOCOLS, Settings
from pyinfra.metrics.matching import CENTRE_M, PERSON_IOU, Metric

METRICS: tuple[Metric, ...] = get_args(Metric)


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
        choices=SUBSETS,
        help="captured: with points of this LiDAR; common: in view of every LiDAR of the data set, "
        "visible; all: visible from the mount; present: every one in the region, seen or not, to "
        "compare mounts. Default: captured all, without objects captured",
    )
    parser.add_argument(
        "--class",
        dest="classes",
        nargs="+",
        metavar="NAME[=TYPE,...]",
        help=f"KITTI types that count; default vehicle={','.join(VEHICLE_TYPES)}; also pedestrian, "
        "cyclist",
    )
    add_measures(parser, default)
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
    add_bootstrap(parser, default)
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--split", help="train, val, ... of ImageSets, or all; default val if there is one"
    )
    frames.add_argument("--frames", metavar="A:B[:STEP]", help="B excluded")
    parser.add_argument(
        "--allow-missing", action="store_true", help="a missing file means nothing found"
    )
    parser.add_argument("--no-figures", action="store_true")


def add_measures(parser: argparse.ArgumentParser, default: Settings) -> None:
    parser.add_argument(
        "--iou",
        type=float,
        nargs="+",
        help=f"default {default.ious[0]:g}, of people {PERSON_IOU:g}",
    )
    parser.add_argument(
        "--metric",
        nargs="+",
        choices=METRICS,
        help=f"bev: IoU of footprints; 3d; centre: up to {CENTRE_M:g} m between centres. "
        "Default bev, of people bev centre",
    )
    parser.add_argument(
        "--protocol",
        nargs="+",
        choices=PROTOCOLS,
        default=default.protocols,
        help="definition: AP (R1000), in ap.csv also AP (R40); r11: 11 recalls; kitti: the "
        "devkit's 40 recalls and sampling, strict IoU",
    )


def add_bootstrap(parser: argparse.ArgumentParser, default: Settings) -> None:
    bootstrap = parser.add_argument_group("bootstrap of the intervals")
    bootstrap.add_argument("--draws", type=int, default=default.draws)
    bootstrap.add_argument(
        "--block-s", type=float, help="length of a block; default as long as a vehicle stays"
    )
    bootstrap.add_argument("--seed", type=int, default=default.seed)


def run(args: argparse.Namespace) -> int:
    ground_truths = args.ground_truth or default_settings(args.gt).ground_truths
    classes = class_types(args.classes) if args.classes else Settings().classes
    default = class_settings(classes, custom_iou=bool(args.iou))
    settings = Settings(
        classes=classes,
        ground_truths=tuple(ground_truths),
        ious=tuple(args.iou or default.ious),
        protocols=tuple(args.protocol),
        metrics=tuple(args.metric or default.metrics),
        min_score=args.min_score,
        min_points=args.min_points,
        min_objects=args.min_objects,
        cut_first=args.cut_first,
        block_s=args.block_s,
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
        print(f"pyinfra: {with_options(str(finding), args.options)}", file=sys.stderr)
    drawn = not args.no_figures and bool((evaluation.ap.objects > 0).any())
    write(evaluation, args.out)
    if drawn:
        from pyinfra.viz.evaluation_plots import draw_all  # plotting takes a second to import

        draw_all(evaluation, args.out)
    print(summary(evaluation))
    return 0


def class_types(words: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """`vehicle`, `pedestrian`, `Car` or `large=Truck,Bus` as classes with their types.

    Raises Error for a class without types.
    """
    classes = {}
    for word in words:
        name, equals, types = word.partition("=")
        listed = tuple(types.split(",")) if equals else (name,)
        if not equals:
            listed = OBJECT_CLASSES.get(name, listed)
        if not name or not all(listed):
            raise Error(f"--class: found '{word}', allowed NAME or NAME=TYPE,TYPE")
        classes[name] = listed
    return classes
