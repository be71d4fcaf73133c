"""`pyinfra plan SITE --budget 9000 --find 0.9 --within 60 --out DIR`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from pyinfra.cli.messages import note, with_options
from pyinfra.cli.number_option import usd
from pyinfra.core.vocabulary import PRESETS
from pyinfra.experiments.planner.candidates import PoseGrid
from pyinfra.experiments.planner.plan import plan
from pyinfra.experiments.planner.request import Request


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Chooses where LiDARs stand at a site, how high, how many and which, within a budget. "
        "Predicts the share of vehicles that a detector finds, and simulates the best options in "
        "full. Writes options.csv, candidates.csv and answer.txt. Run it again to resume."
    )
    parser.epilog = (
        "example: pyinfra plan crossroad --budget 9000 --find 0.9 --within 60 --out out/plan"
    )
    parser.add_argument("scene", metavar="SITE", help="scene: a name, a file or a site folder")
    parser.add_argument(
        "--budget",
        dest="budget_usd",
        type=usd,
        required=True,
        help="highest price over the years, in US dollars: LiDARs, poles, installation, computer, "
        "power and upkeep",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument(
        "--find",
        type=float,
        default=Request.find,
        help=f"share of the vehicles to be found in a frame, 0 to 1; default: {Request.find:g}",
    )
    parser.add_argument(
        "--within",
        dest="within_m",
        type=float,
        default=Request.within_m,
        help="distance in metres from the centre within which vehicles count; "
        f"default: {Request.within_m:g}",
    )
    parser.add_argument(
        "--centre",
        dest="centre_m",
        nargs=2,
        type=float,
        metavar=("X", "Y"),
        help="the centre, world frame, metres; default: the middle of the first junction",
    )
    parser.add_argument(
        "--false-per-minute",
        type=float,
        default=math.inf,
        help="most false boxes a minute; default: boxes of score 0.5 or more count",
    )
    parser.add_argument("--poles", type=int, default=Request.poles, help="most poles; default: 1")
    parser.add_argument(
        "--lidars-per-pole",
        type=int,
        default=Request.lidars_per_pole,
        help="most LiDARs on one pole; default: 1",
    )
    parser.add_argument(
        "--lidar", dest="lidars", nargs="+", default=[], help="LiDARs; default: the catalogue"
    )
    parser.add_argument(
        "--detector",
        default=Request.detector,
        help="generalist (the pretrained detector) or background; default: generalist",
    )
    parser.add_argument(
        "--poses",
        type=Path,
        metavar="FILE",
        help="CSV file of poses: x_m, y_m, and z_m, yaw_deg, pitch_deg, existing (yes, no); "
        "default: along kerbs, medians and walls",
    )
    parser.add_argument(
        "--every",
        dest="every_m",
        type=float,
        default=PoseGrid.every_m,
        help=f"metres between poles that are made; default: {PoseGrid.every_m:g}",
    )
    parser.add_argument(
        "--heights",
        dest="heights_m",
        nargs="+",
        type=float,
        default=list(PoseGrid.heights_m),
        help="heights above the road in metres; default: 4 6 8",
    )
    parser.add_argument(
        "--pitches",
        dest="pitches_deg",
        nargs="+",
        type=float,
        default=list(PoseGrid.pitches_deg),
        help="pitches in degrees, positive looks down; default: 0 10",
    )
    parser.add_argument(
        "--people",
        type=float,
        default=Request.people,
        help="weight of a person relative to a vehicle in the choice; default: 0",
    )
    parser.add_argument(
        "--areas",
        type=Path,
        metavar="FILE",
        help="CSV file of areas with other weights, such as crossings: name, x_m, y_m, radius_m, "
        "and weight and class (vehicle, person, any)",
    )
    parser.add_argument(
        "--costs",
        type=Path,
        metavar="FILE",
        help="CSV file of costs (item, per, low, high, source); default: configs/planner/costs.csv",
    )
    parser.add_argument(
        "--years", type=float, default=Request.years, help="years of use; default: 5"
    )
    parser.add_argument(
        "--preset", choices=PRESETS, default=Request.preset, help="default: datasheet"
    )
    parser.add_argument("--seed", type=int, help="seed of the traffic; default: the scene's")
    parser.add_argument(
        "--max-frames",
        dest="frames",
        type=int,
        default=Request.frames,
        help="most frames of a pose; default: 96",
    )
    parser.add_argument(
        "--check-frames",
        type=int,
        default=30,
        help="frames in which the best options are simulated in full; 0: none; default: 30",
    )
    parser.add_argument("--jobs", type=int, default=1, help="number of threads; default: 1")


def run(args: argparse.Namespace) -> int:
    grid = PoseGrid(
        every_m=args.every_m,
        heights_m=tuple(args.heights_m),
        pitches_deg=tuple(args.pitches_deg),
    )
    result = plan(
        args.scene,
        args.budget_usd,
        find=args.find,
        within_m=args.within_m,
        false_per_minute=args.false_per_minute,
        poles=args.poles,
        lidars_per_pole=args.lidars_per_pole,
        lidars=args.lidars,
        detector=args.detector,
        poses=args.poses,
        grid=grid,
        people=args.people,
        areas=args.areas,
        centre_m=None if args.centre_m is None else tuple(args.centre_m),
        costs=args.costs,
        years=args.years,
        preset=args.preset,
        seed=args.seed,
        frames=args.frames,
        check_frames=args.check_frames,
        out=args.out,
        jobs=args.jobs,
        progress=lambda line: note(line, args),
    )
    for line in result.answer.lines:
        print(with_options(line, args.options))
    return 0
