"""`pyinfra plan SITE --budget 9000 --find 0.9 --within 60 --out DIR`."""

import argparse
from pathlib import Path

from pyinfra.cli.arguments import arguments_of
from pyinfra.cli.messages import note, with_options
from pyinfra.cli.number_option import usd
from pyinfra.cli.parser import argument, usage
from pyinfra.core.vocabulary import PRESETS
from pyinfra.experiments.planner.candidates import PoseGrid
from pyinfra.experiments.planner.plan import plan
from pyinfra.experiments.planner.request import Effort, Request
from pyinfra.viz.plan_page.page import write_plan_page

add_arguments = usage(
    "Chooses the positions, heights, number and models of LiDARs at a site, within a budget. "
    "Predicts the share of vehicles that a detector detects, and simulates the best options in "
    "full. Writes plan.html, view.html, answer.txt, notes.txt and the tables options.csv, "
    "front.csv, candidates.csv and sensitivity.csv. Run the same command again to resume.",
    "example: pyinfra plan crossroad --budget 9000 --find 0.9 --within 60 --out out/plan",
    argument("scene", metavar="SITE", help="scene: a name, a file or a site folder"),
    argument(
        "--budget",
        dest="budget_usd",
        type=usd,
        required=True,
        help="highest cost over the years of use, in US dollars: LiDARs, poles, installation, "
        "computer, power and upkeep",
    ),
    argument("--out", type=Path, required=True, help="folder of the results"),
    argument(
        "--find",
        type=float,
        default=Request.find,
        help="required share of the vehicles of a frame that are detected, 0 to 1; "
        f"default: {Request.find:g}",
    ),
    argument(
        "--within",
        dest="within_m",
        type=float,
        default=Request.within_m,
        help="distance in metres from the centre, within which vehicles are included; "
        f"default: {Request.within_m:g}",
    ),
    argument(
        "--centre",
        dest="centre_m",
        nargs=2,
        type=float,
        metavar=("X", "Y"),
        help="centre for --within, world frame, metres; default: the middle of the first "
        "junction, or of the largest one near the mount of an imported map",
    ),
    argument(
        "--false-per-minute",
        type=float,
        default=Request.false_per_minute,
        help="maximum number of false boxes per minute, which sets the minimum score; default: no "
        "maximum, and a minimum score of 0.5",
    ),
    argument(
        "--poles", type=int, default=Request.poles, help="maximum number of poles; default: 1"
    ),
    argument(
        "--lidars-per-pole",
        type=int,
        default=Request.lidars_per_pole,
        help="maximum number of LiDARs on a pole; default: 1",
    ),
    argument(
        "--lidar",
        dest="lidars",
        nargs="+",
        default=[],
        help="LiDARs to choose from, files or names; default: all LiDARs of the catalogue",
    ),
    argument(
        "--detector",
        default=Request.detector,
        help="generalist (the pretrained detector) or background; default: generalist",
    ),
    argument(
        "--poses",
        type=Path,
        metavar="FILE",
        help="CSV file of candidate poses with the columns x_m, y_m and optionally z_m, yaw_deg, "
        "pitch_deg, existing (yes or no), arm_m and bearing_deg (compass) of an arm of the mast; "
        "default: poses along kerbs, medians and walls",
    ),
    argument(
        "--every",
        dest="every_m",
        type=float,
        default=PoseGrid.every_m,
        help="distance between candidate poles, in metres, without --poses; "
        f"default: {PoseGrid.every_m:g}",
    ),
    argument(
        "--heights",
        dest="heights_m",
        nargs="+",
        type=float,
        default=list(PoseGrid.heights_m),
        help="heights of candidates above the road, in metres; default: 4 6 8",
    ),
    argument(
        "--pitches",
        dest="pitches_deg",
        nargs="+",
        type=float,
        default=list(PoseGrid.pitches_deg),
        help="pitches of candidates in degrees, positive looks down; default: 0 10",
    ),
    argument(
        "--people",
        type=float,
        default=Request.people,
        help="weight of a pedestrian relative to a vehicle in the choice; default: 0",
    ),
    argument(
        "--areas",
        type=Path,
        metavar="FILE",
        help="CSV file of areas with other weights, such as crossings, with the columns name, x_m, "
        "y_m, radius_m and optionally weight and class (vehicle, person, any)",
    ),
    argument(
        "--costs",
        type=Path,
        metavar="FILE",
        help="CSV file of costs (item, per, low, high, source); default: configs/planner/costs.csv",
    ),
    argument("--years", type=float, default=Request.years, help="years of use; default: 5"),
    argument("--preset", choices=PRESETS, default=Request.preset, help="default: datasheet"),
    argument("--seed", type=int, help="seed of the traffic; default: the scene's"),
    argument(
        "--max-frames",
        dest="frames",
        type=int,
        default=Request.frames,
        help="maximum number of frames in which a pose is evaluated; default: 96",
    ),
    argument(
        "--check-frames",
        type=int,
        default=Effort.check_frames,
        help="number of frames in which the best options are simulated in full; 0: no simulation; "
        "default: 30",
    ),
    argument(
        "--what-if",
        action="store_true",
        help="also simulate option 1 with a mast 2 m further or 0.5 m lower, half a degree of "
        "pitch or yaw, a lorry in a lane, twice the traffic, rain, night and a lost LiDAR, in the "
        "same frames",
    ),
    argument(
        "--count",
        type=float,
        metavar="SHARE",
        help="also simulate 30 s of option 1 without gaps, track its vehicles and count their "
        "passages; the answer says whether this share of the passages is counted, 0 to 1",
    ),
    argument("--jobs", type=int, default=Effort.jobs, help="number of threads; default: 1"),
)


def run(args: argparse.Namespace) -> int:
    grid = PoseGrid(
        every_m=args.every_m,
        heights_m=tuple(args.heights_m),
        pitches_deg=tuple(args.pitches_deg),
    )
    asked = arguments_of(plan, args)
    result = plan(**asked, grid=grid, progress=lambda line: note(line, args))
    note(f"page: {write_plan_page(result, args.out)}", args)
    for line in result.answer.lines:
        print(with_options(line, args.options))
    return 0
