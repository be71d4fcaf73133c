"""Pictures of data sets: `pyinfra pictures DATA...`."""

import argparse
import errno
from collections.abc import Sequence
from pathlib import Path

from pyinfra import kitti
from pyinfra.drawing import clouds
from pyinfra.drawing import cutouts as cutout_figures
from pyinfra.drawing import scene as scene_figures


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
            found = f"{folders[0]}: --frame: found {args.frame}"
            raise ValueError(f"{found}, allowed {kitti.extent(there)}")
    files = clouds.draw_frames(data_sets, args.frame, args.out)
    files += draw_scenes(data_sets, args.frame, args.out)
    for file in files:
        print(file)
    return 0


def draw_scenes(data_sets: Sequence[Sequence[Path]], frame: int, out: Path) -> list[Path]:
    """Writes the plan and the cut-outs of each data set; returns the files.

    data_sets: the LiDAR folders of each data set. Raises OSError and kitti.FormatError.
    """
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for folders in data_sets:
        scene = scene_figures.read_scene(folders)
        name = folders[0].parent.name
        files += [out / f"plan_{name}.png", out / f"cutouts_{name}.png"]
        clouds.save(scene_figures.plan([scene]), files[-2])
        clouds.save(cutout_figures.cutouts(scene, frame), files[-1])
    return files


def lidar_folders(data_set: Path) -> list[Path]:
    """The LiDAR folders of a data set, by name. Raises FileNotFoundError if there is none."""
    folders = sorted(file.parent for file in data_set.glob("*/lidar.yaml"))
    if not folders:
        raise FileNotFoundError(
            errno.ENOENT, "found no LiDAR folder with a lidar.yaml", str(data_set)
        )
    return folders
