"""`pyinfra pictures DATA... --out DIR`."""

import argparse
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.dataset.frames import lidar_folders
from pyinfra.formats import kitti
from pyinfra.viz import clouds
from pyinfra.viz.frame_pictures import draw_scenes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Bird's-eye views of one frame, a picture of each LiDAR and a sheet; the plan of each "
        "scene; and the same vehicles as each LiDAR sees them."
    )
    parser.epilog = "example: pyinfra pictures data/highway data/curve --frame 0 --out out/pictures"
    parser.add_argument("data", nargs="+", type=Path, help="data sets of `infrasim run`")
    parser.add_argument("--frame", type=int, default=0, help="frame to draw")
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")


def run(args: argparse.Namespace) -> int:
    data_sets = [lidar_folders(data) for data in args.data]
    for folders in data_sets:
        there = kitti.frames(folders[0])
        if args.frame not in there:
            problem = f"{folders[0]}: --frame: found {args.frame}"
            raise Error(f"{problem}, allowed {kitti.extent(there)}")
    files = clouds.draw_frames(data_sets, args.frame, args.out)
    files += draw_scenes(data_sets, args.frame, args.out)
    for file in files:
        print(file)
    return 0
