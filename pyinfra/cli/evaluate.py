"""`pyinfra evaluate DATA/LIDAR PRED --out DIR`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from pyinfra.cli.messages import with_options
from pyinfra.cli.parser import argument, group, one_of, usage
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import OBJECT_CLASSES, SUBSETS, VEHICLE_TYPES
from pyinfra.dataset.frames import frame_range
from pyinfra.metrics.evaluate import evaluated
from pyinfra.metrics.evaluation_input import class_settings, default_settings
from pyinfra.metrics.evaluation_result import summary
from pyinfra.metrics.matching import CENTRE_M, PERSON_IOU, Metric
from pyinfra.metrics.settings import PROTOCOLS, Settings

METRICS: tuple[Metric, ...] = get_args(Metric)
DEFAULT = Settings()


add_arguments = usage(
    "Computes the average precision of predictions, by distance and area, with 95 % intervals.",
    "example: pyinfra evaluate data/highway/livox_avia runs/pillars/predictions "
    "--out out/evaluation",
    argument("gt", metavar="DATA", type=Path, help="folder of one LiDAR with labels, KITTI layout"),
    argument(
        "pred",
        metavar="PRED",
        type=Path,
        help="folder of predictions, one file per frame: NNNNNN.txt (KITTI results) or NNNNNN.csv "
        "(class,x,y,z,dx,dy,dz,heading,score in the LiDAR frame)",
    ),
    argument("--out", type=Path, required=True, help="folder for tables and figures"),
    argument(
        "--ground-truth",
        nargs="+",
        choices=SUBSETS,
        help="which vehicles of the region are evaluated. captured: vehicles with points of this "
        "LiDAR; common: visible vehicles in the field of view of every LiDAR of the data set; all: "
        "vehicles visible from the mount; present: all vehicles, visible or not (to compare "
        "mounts). Default: captured all, or captured if the folder has no objects",
    ),
    argument(
        "--class",
        dest="classes",
        nargs="+",
        metavar="NAME[=TYPE,...]",
        help="classes to evaluate, each with its KITTI types; the types may be left out for "
        "vehicle, pedestrian and cyclist; "
        f"default: vehicle={','.join(VEHICLE_TYPES)}",
    ),
    argument(
        "--iou",
        dest="ious",
        type=float,
        nargs="+",
        help=f"IoU thresholds; default: {DEFAULT.ious[0]:g}, "
        f"for pedestrians and cyclists {PERSON_IOU:g}",
    ),
    argument(
        "--metric",
        dest="metrics",
        nargs="+",
        choices=METRICS,
        help="how boxes are matched. bev: by IoU of footprints; 3d: by IoU of volumes; centre: by "
        f"centres at most {CENTRE_M:g} m apart. Default: bev for vehicles, bev and centre for "
        "pedestrians and cyclists",
    ),
    argument(
        "--protocol",
        dest="protocols",
        nargs="+",
        choices=PROTOCOLS,
        default=DEFAULT.protocols,
        help="how AP is computed. definition: AP (R1000), and in ap.csv also AP (R40); r11: AP at "
        "11 recalls; kitti: AP at 40 recalls with the sampling of the KITTI devkit, for IoU above "
        "the threshold. Default: definition",
    ),
    argument(
        "--min-score",
        type=float,
        default=DEFAULT.min_score,
        help=f"minimum score of a predicted box, from 0 to 1; default: {DEFAULT.min_score:g}",
    ),
    argument(
        "--min-points",
        type=int,
        default=DEFAULT.min_points,
        help=f"minimum number of points of a captured vehicle; default: {DEFAULT.min_points}",
    ),
    argument(
        "--min-objects",
        type=int,
        default=DEFAULT.min_objects,
        help=f"an area with fewer objects gets no quality level; default: {DEFAULT.min_objects}",
    ),
    argument(
        "--cut-first",
        action="store_true",
        help="also compute the AP of each window after boxes outside it are removed; slow",
    ),
    group(
        "bootstrap of the intervals",
        argument(
            "--replicates",
            type=int,
            default=DEFAULT.replicates,
            help=f"number of bootstrap replicates, 1 or more; default: {DEFAULT.replicates}",
        ),
        argument(
            "--block-s",
            type=float,
            help="length of a bootstrap block, in seconds; default: the time that a vehicle stays "
            "in the region",
        ),
        argument(
            "--seed",
            type=int,
            default=DEFAULT.seed,
            help=f"seed of the bootstrap; default: {DEFAULT.seed}",
        ),
    ),
    one_of(
        argument(
            "--split",
            help="which frames: the name of a list in ImageSets, such as val, or all; default: val "
            "if it exists, else all",
        ),
        argument("--frames", metavar="A:B[:STEP]", help="frame numbers from A to B, without B"),
    ),
    argument(
        "--allow-missing",
        action="store_true",
        help="treat a missing prediction file as a frame without boxes",
    ),
    argument("--no-figures", action="store_true", help="write the tables only"),
)


def run(args: argparse.Namespace) -> int:
    ground_truths = args.ground_truth or default_settings(args.gt).ground_truths
    classes = class_types(args.classes) if args.classes else Settings().classes
    default = class_settings(classes, custom_iou=bool(args.ious))
    settings = Settings(
        classes=classes,
        ground_truths=tuple(ground_truths),
        ious=tuple(args.ious or default.ious),
        protocols=tuple(args.protocols),
        metrics=tuple(args.metrics or default.metrics),
        min_score=args.min_score,
        min_points=args.min_points,
        min_objects=args.min_objects,
        cut_first=args.cut_first,
        block_s=args.block_s,
        replicates=args.replicates,
        seed=args.seed,
    )
    evaluation = evaluated(
        args.gt,
        args.pred,
        settings,
        frames=frame_range(args.frames, args.gt) if args.frames else None,
        split=args.split,
        allow_missing=args.allow_missing,
    )
    for finding in evaluation.findings:
        print(f"pyinfra: {with_options(str(finding), args.options)}", file=sys.stderr)
    has_figures = not args.no_figures and bool((evaluation.ap.objects > 0).any())
    evaluation.save(args.out)
    if has_figures:
        # The import of Matplotlib takes a second, so it is only done if figures are drawn.
        from pyinfra.viz.evaluation_plots import draw_all

        draw_all(evaluation, args.out)
    print(summary(evaluation))
    return 0


def class_types(words: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Maps the name of each class to its KITTI types.

    A word is `NAME=TYPE,...`, such as `large=Truck,Bus`, or only a name. A name without types is a
    class of OBJECT_CLASSES, such as `vehicle`, or one KITTI type, such as `Car`.

    Raises Error for a class without types.
    """
    classes = {}
    for word in words:
        name, equals, types = word.partition("=")
        listed = tuple(types.split(",")) if equals else OBJECT_CLASSES.get(name, (name,))
        if not name or not all(listed):
            raise Error(f"--class: expected NAME or NAME=TYPE,TYPE, got '{word}'")
        classes[name] = listed
    return classes
