"""`pyinfra pictures DATA... --out DIR`."""

import argparse
from pathlib import Path

from pyinfra.cli.number_option import one_frame
from pyinfra.core.errors import Error
from pyinfra.dataset.frames import lidar_folders
from pyinfra.formats import kitti
from pyinfra.viz import clouds
from pyinfra.viz.frame_pictures import draw_scenes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Draws one frame from above, as one picture for each LiDAR and a sheet of all. Also draws "
        "the plan of each scene, and close-ups of the same vehicles in the points of each LiDAR."
    )
    parser.epilog = "example: pyinfra pictures data/highway data/curve --frame 0 --out out/pictures"
    parser.add_argument("data", nargs="+", type=Path, help="data sets written by `infrasim run`")
    parser.add_argument("--frame", type=one_frame, help="number of the frame; default: the first")
    parser.add_argument("--out", type=Path, required=True, help="folder for the pictures")


def run(args: argparse.Namespace) -> int:
    data_sets = [lidar_folders(data) for data in args.data]
    frame = args.frame
    for folders in data_sets:
        existing = kitti.frames(folders[0])
        if frame is None:
            frame = next(iter(existing), 0)
        if frame not in existing:
            problem = f"{folders[0]}: --frame: expected {kitti.extent(existing)}"
            raise Error(f"{problem}, got {frame}")
    files = clouds.draw_frames(data_sets, frame, args.out)
    files += draw_scenes(data_sets, frame, args.out)
    for file in files:
        print(file)
    return 0
