"""`pyinfra import SOURCE --from FORMAT --out DATA/LIDAR`."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import get_args

from pyinfra.cli.messages import warn, with_options
from pyinfra.exchange.formats import IMPORTS
from pyinfra.exchange.imports import Upright, checked, facts_of, import_recording, warnings
from pyinfra.exchange.object_types import parse_types
from pyinfra.exchange.rates import summary
from pyinfra.exchange.recording import Options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Makes a data set of a recording of your own or of another tool's frames."
    parser.epilog = (
        "example: pyinfra import recordings/junction --from pcd --out data/junction/pole_1 "
        "--period-s 0.1 --price-usd 1500 1500"
    )
    parser.add_argument("source", type=Path, help="folder")
    parser.add_argument("--from", dest="format", choices=IMPORTS, required=True)
    parser.add_argument("--out", type=Path, required=True, help="new folder DATA/LIDAR")
    parser.add_argument("--scene", help="name of the place; default: that of DATA")
    parser.add_argument("--model", help="of the LiDAR; default: the name of its folder")
    parser.add_argument("--price-usd", type=float, nargs=2, metavar=("LOW", "HIGH"))
    parser.add_argument("--period-s", type=float, help="of a frame; default: as recorded, else 0.1")
    parser.add_argument(
        "--height-m",
        type=float,
        help="of the sensor above the road, roughly; default: found, or as vehicles stand",
    )
    parser.add_argument(
        "--tilt-deg",
        type=float,
        nargs=2,
        metavar=("PITCH", "ROLL"),
        help="how the sensor leans, pitch down positive: points and boxes are turned upright",
    )
    parser.add_argument(
        "--upright",
        choices=get_args(Upright),
        default="auto",
        help="road: turn points to the road's plane; default auto: without labels",
    )
    parser.add_argument(
        "--region",
        type=Path,
        metavar="FILE",
        help="where vehicles can be, `outline_m: [[x, y], ...]`, kept with the frames",
    )
    parser.add_argument(
        "--type",
        dest="types",
        nargs="+",
        default=[],
        metavar="NAME=TYPE",
        help="as Lkw=Truck",
    )
    parser.add_argument("--labels", type=Path, help="folder of them, in place of the usual one")
    parser.add_argument(
        "--intensity-max", type=float, help="of the source; default: 1, 255 or 65535, as they are"
    )
    parser.add_argument(
        "--unit-m",
        type=float,
        default=1.0,
        help="of a coordinate; default: 1, or 0.001 if so found",
    )
    parser.add_argument(
        "--columns", type=int, help="float32 of a .bin point; default: found, nuscenes 5"
    )
    parser.add_argument("--channel", help="which LiDAR, or sequence of KITTI's tracking")


def run(args: argparse.Namespace) -> int:
    since = time.perf_counter()
    options = Options(args.intensity_max, args.columns, args.labels, args.channel, args.unit_m)
    facts = facts_of(
        args.out,
        scene=args.scene,
        model=args.model,
        price_usd=args.price_usd,
        period_s=args.period_s,
        height_m=args.height_m,
        tilt_deg=args.tilt_deg,
        types=parse_types(args.types),
    )
    imported, labelled = import_recording(
        args.source,
        args.format,
        args.out,
        facts,
        checked(options),
        upright=args.upright,
        region=args.region,
    )
    for line in imported.assumed:
        print(f"assumed: {with_options(line, args.options)}")
    for line in warnings(imported, labelled, args.height_m):
        warn(f"{args.source}: {line}", args)
    kinds = ", ".join(f"{count} {name}" for name, count in imported.types.most_common())
    print(f"{args.out}: {summary(imported.frames, args.out, since)}; {kinds or 'no label'}")
    return 0
