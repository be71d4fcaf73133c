"""`pyinfra import SOURCE --out DATA/LIDAR [--from FORMAT]`."""

import argparse
import time
from pathlib import Path
from typing import get_args

from pyinfra.cli.arguments import arguments_of
from pyinfra.cli.messages import printed_findings, with_options
from pyinfra.cli.number_option import usd
from pyinfra.cli.parser import argument, usage
from pyinfra.conversion import import_recording
from pyinfra.core.errors import Error
from pyinfra.dataset.frames import frame_numbers, lidar_folder
from pyinfra.dataset.health import HEALTH_PICTURE
from pyinfra.exchange.formats import IMPORTS
from pyinfra.exchange.guess import guess_format
from pyinfra.exchange.imports import Upright, recording_folder
from pyinfra.exchange.object_types import parse_types
from pyinfra.exchange.rates import summary
from pyinfra.exchange.unread import listed
from pyinfra.formats.box_csv import NAMES, parse_columns

add_arguments = usage(
    "Imports your own recording, or frames of another tool, as a data set.",
    "example: pyinfra import recordings/junction --out data/junction/pole_1 "
    "--period-s 0.1 --price-usd 1500 1500",
    argument(
        "source",
        type=Path,
        help="folder or file of the recording, or `sample` for the recording of the package",
    ),
    argument(
        "--from",
        dest="format",
        choices=IMPORTS,
        help="format of the recording; default: guessed from the names of its files",
    ),
    argument(
        "--out",
        type=Path,
        required=True,
        help="new folder for the frames, DATA/LIDAR: a data set's folder and a LiDAR's name. With "
        "a single name DATA, the LiDAR's name is `lidar`",
    ),
    argument(
        "--scene-name", dest="scene", help="name of the site; default: the name of the folder DATA"
    ),
    argument(
        "--lidar-model", dest="model", help="model of the LiDAR; default: the name of its folder"
    ),
    argument(
        "--price-usd",
        type=usd,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="lowest and highest price of the LiDAR in US dollars; default: no price",
    ),
    argument(
        "--period-s",
        type=float,
        help="time from one frame number to the next in seconds; default: as recorded, else 0.1",
    ),
    argument(
        "--height-m",
        type=float,
        help="approximate height of the sensor above the road, in metres; default: estimated from "
        "the points or the labelled vehicles",
    ),
    argument(
        "--tilt-deg",
        type=float,
        nargs=2,
        metavar=("PITCH", "ROLL"),
        help="tilt of the sensor in degrees, where positive pitch looks down; points and boxes "
        "are levelled by this tilt",
    ),
    argument(
        "--upright",
        choices=get_args(Upright),
        default="auto",
        help="how points are levelled. road: by a plane that is fitted to the road; as-is: points "
        "are not levelled; auto: as road, unless the points should be level because of their "
        "format or because they have labels. Default: auto",
    ),
    argument(
        "--region",
        type=Path,
        metavar="FILE",
        help="YAML file with the outline of the area where vehicles can be, "
        "`outline_m: [[x, y], ...]`; it is copied to the frames",
    ),
    argument(
        "--type",
        dest="types",
        nargs="+",
        default=[],
        metavar="NAME=TYPE",
        help="class names of the source and the object types that they map to, such as Lkw=Truck",
    ),
    argument(
        "--label-folder",
        dest="labels",
        type=Path,
        help="folder of labels, or a .csv file with a column of frames; default: by the format",
    ),
    argument(
        "--label-columns",
        nargs="+",
        default=[],
        metavar="KEY=COLUMN",
        help="columns of .csv labels, such as x=cx yaw_deg=angle; plain names are recognised. "
        f"Keys: {', '.join(NAMES)}",
    ),
    argument(
        "--intensity-max",
        type=float,
        help="highest intensity of the source; default: 1, 255, 4095 or 65535, by the format "
        "or the values",
    ),
    argument(
        "--unit-m",
        type=float,
        default=1.0,
        help="unit of the coordinates in metres; default: 1, or 0.001 if the coordinates appear "
        "to be millimetres",
    ),
    argument(
        "--point-values",
        dest="columns",
        type=int,
        help="number of float32 values of a point in .bin files; default: 5 for nuscenes, else "
        "detected",
    ),
    argument(
        "--boxes-of",
        type=Path,
        metavar="DATA/LIDAR",
        help="SOURCE is a .csv file with boxes of a detector for these frames; --out is then a new "
        "or empty folder for predictions, which `evaluate`, `view` and `track` read",
    ),
    argument(
        "--skip-bad",
        action="store_true",
        help="leave out and count frames that cannot be read; default: such a frame is an error",
    ),
    argument(
        "--strict",
        action="store_true",
        help="objects that cannot be read are errors; default: they are left out and counted",
    ),
    argument(
        "--channel",
        help="which LiDAR of the recording, topic of a bag, or sequence of KITTI tracking",
    ),
)


def _import_boxes(args: argparse.Namespace) -> int:
    from pyinfra.models.inference.detections import Detections

    if args.out.is_dir() and any(args.out.iterdir()):
        raise Error(f"out: expected a new or empty folder, got {args.out}")
    columns = parse_columns(args.label_columns)
    folder = lidar_folder(args.boxes_of)
    detections = Detections.from_csv(args.source, folder, columns)
    numbers = frame_numbers(folder, "all")
    detections.save(args.out, numbers, folder)
    print(f"{args.out}: {len(detections)} boxes in {len(numbers)} frames")
    return 0


def run(args: argparse.Namespace) -> int:
    if args.boxes_of:
        return _import_boxes(args)
    since = time.perf_counter()
    source = recording_folder(args.source)
    if args.format is None and source.exists():
        args.format, reason = guess_format(source)
        print(f"guessed: format {args.format}, because of {reason}; --from sets a different format")
    args.types = parse_types(args.types)
    args.label_columns = parse_columns(args.label_columns)
    with printed_findings(args):
        imported = import_recording(**arguments_of(import_recording, args))
    args.out = imported.folder
    for line in imported.assumed:
        print(f"assumed: {with_options(line, args.options)}")
    if imported.not_read:
        print(f"not read: {listed(imported.not_read)}")
    if (args.out / HEALTH_PICTURE).is_file():
        print(args.out / HEALTH_PICTURE)
    kinds = ", ".join(f"{count} {name}" for name, count in imported.types.most_common())
    print(f"{args.out}: {summary(len(imported), args.out, since)}; {kinds or 'no label'}")
    return 0
