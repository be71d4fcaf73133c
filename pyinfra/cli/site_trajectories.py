"""`pyinfra site trajectories FILE --out SITE`: imports trajectories as the traffic of a site."""

import argparse
from pathlib import Path

from pyinfra.cli.parser import argument, usage


def run(args: argparse.Namespace) -> int:
    from pyinfra.scenes.maps.trajectory_folder import write_recorded

    lines = write_recorded(
        args.file,
        args.out,
        columns=args.columns,
        classes=args.class_of,
        rate_hz=args.rate_hz,
        in_world=args.world,
        degrees=args.degrees,
    )
    print(*lines, sep="\n")
    return 0


def _classes(text: str) -> dict[str, str]:
    """Parses `a=Car,b=Bus` to a mapping from class names in the file to names in CLASSES.

    A class name of the file may be empty, and may contain `=`.
    """
    from pyinfra.scenes.maps.tracks import CLASSES

    pairs = dict(part.rpartition("=")[::2] for part in text.split(",") if "=" in part)
    wrong = sorted(set(pairs.values()) - set(CLASSES))
    if wrong or len(pairs) != len(text.split(",")):
        got = wrong[0] if wrong else text
        raise argparse.ArgumentTypeError(
            f"expected NAME=CLASS,... with CLASS one of {', '.join(CLASSES)}; got '{got[:60]}'"
        )
    return pairs


def _pairs(text: str) -> dict[str, str]:
    """Parses `a=b,c=d` to a mapping."""
    pairs = [part.split("=") for part in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise argparse.ArgumentTypeError(f"expected NAME=COLUMN,..., got '{text[:60]}'")
    return {pair[0]: pair[1] for pair in pairs}


add_arguments = usage(
    "Imports trajectories as the traffic of a site. FILE is SUMO's floating car data (.xml, "
    ".gz), a .csv file of boxes, or a LiDAR's folder with labels. Trajectories are resampled "
    "to 10 Hz, gaps of up to 1 s are filled, and jumps are smoothed. Boxes without ids are "
    "linked to tracks. Floating car data in longitude and latitude are projected like the "
    "map of the site. Sets duration_s of the scene to the length of the trajectories.",
    "example: pyinfra site trajectories tracks.csv --columns x=center_x,y=center_y "
    "--rate-hz 25 --degrees --out sites/corner",
    argument(
        "file",
        type=Path,
        metavar="FILE",
        help=".csv, .xml or .gz file of trajectories, or a LiDAR's folder with labels",
    ),
    argument("--out", type=Path, required=True, metavar="SITE", help="folder of the site"),
    argument(
        "--columns",
        type=_pairs,
        default={},
        metavar="x=NAME,...",
        help="column names in the CSV file, such as x=center_x; default: x, y, z, heading, dx, dy, "
        "dz, class, t or frame, and id",
    ),
    argument(
        "--class-of",
        type=_classes,
        default={},
        metavar="NAME=Car,...",
        help="class for each class name in the file; =Car applies to objects without a class name; "
        "default: the same name",
    ),
    argument(
        "--rate-hz",
        type=float,
        help="frames per second; time is then computed from the column `frame` of the CSV file",
    ),
    argument(
        "--world",
        action="store_true",
        help="positions are in the site's frame; default: in the coordinates of the site's map",
    ),
    argument("--degrees", action="store_true", help="headings of the CSV file are in degrees"),
)
