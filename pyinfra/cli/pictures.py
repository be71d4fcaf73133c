"""`pyinfra pictures DATA... --out DIR`."""

import argparse
from pathlib import Path

from pyinfra.cli.number_option import one_frame
from pyinfra.cli.parser import argument, usage
from pyinfra.viz.frame_pictures import draw_pictures

add_arguments = usage(
    "Draws one frame from above, as one picture for each LiDAR and a sheet of all. Also draws "
    "the plan of each scene, and close-ups of the same vehicles in the points of each LiDAR.",
    "example: pyinfra pictures data/highway data/curve --frame 0 --out out/pictures",
    argument("data", nargs="+", type=Path, help="data sets written by `infrasim run`"),
    argument("--frame", type=one_frame, help="number of the frame; default: the first"),
    argument("--out", type=Path, required=True, help="folder for the pictures"),
)


def run(args: argparse.Namespace) -> int:
    for file in draw_pictures(args.data, args.frame, args.out):
        print(file)
    return 0
