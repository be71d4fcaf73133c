"""`pyinfra view DATA --frames 0:50:5 --out view.html`: shows frames in 3-D."""

from __future__ import annotations

import argparse
from pathlib import Path

from pyinfra.cli.number_option import one_frame
from pyinfra.core.errors import Error
from pyinfra.core.files import resolved
from pyinfra.dataset.surroundings import read_surroundings
from pyinfra.viz.page_file import check_file
from pyinfra.viz.viewer.page import check_size, write_page
from pyinfra.viz.viewer.selection import (
    chosen_folders,
    chosen_frames,
    prediction_folders,
    read_views,
    title_of,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Writes an interactive 3-D view of one or more frames as one HTML file that needs no "
        "internet connection. It can show several LiDARs of the same data set."
    )
    parser.epilog = "example: pyinfra view data/highway --frames 0:50:5 --out out/view.html"
    parser.add_argument(
        "data",
        nargs="+",
        type=Path,
        help="data set written by `infrasim run`, or folder of one LiDAR",
    )
    parser.add_argument("--lidar", nargs="+", metavar="NAME", help="show only these LiDARs")
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--frame",
        type=one_frame,
        help="number of the frame; default: the first frame, or with --pred the first frame that "
        "has predictions",
    )
    frames.add_argument(
        "--frames",
        metavar="A:B[:STEP]",
        help="frame numbers from A to B, without B; missing frames are skipped",
    )
    parser.add_argument(
        "--pred",
        nargs="+",
        default=[],
        metavar="DIR",
        help="folder of predictions, NNNNNN.txt or NNNNNN.csv; if there are several LiDARs, "
        "LIDAR=DIR for each",
    )
    parser.add_argument(
        "--max-points",
        dest="most_points",
        type=int,
        metavar="N",
        help="maximum number of points per frame; larger frames are thinned, as the page states",
    )
    parser.add_argument(
        "--rerun",
        action="store_true",
        help="write a recording (.rrd) for Rerun instead and open it (needs the extra `rerun`); "
        "Rerun sends usage data to its makers unless you run `rerun analytics disable`",
    )
    parser.add_argument("--out", type=Path, required=True, help="file to write, .html or .rrd")


def run(args: argparse.Namespace) -> int:
    if args.most_points is not None and args.most_points < 1:
        raise Error(f"--max-points: expected 1 or more, got {args.most_points}")
    check_file(args.out, *[b"RRF"] * args.rerun)
    folders = chosen_folders(args.data, args.lidar)
    predictions = prediction_folders(args.pred, folders)
    words = str(args.frame) if args.frame is not None else args.frames
    frames = chosen_frames(folders[0], words, predictions.get(folders[0]))
    if not args.rerun:
        check_size(folders, frames, args.most_points)
    views = read_views(folders, frames, predictions)
    if args.rerun:
        from pyinfra.viz.viewer import recording

        size = recording.write(views, args.out)
    else:
        around = read_surroundings(resolved(folders[0]).parent)
        title = title_of(folders, frames)
        size = write_page(views, title, args.out, args.most_points, around)
    count = (
        f"{len(views)} LiDAR{'s'[: len(views) > 1]}, {len(frames)} frame{'s'[: len(frames) > 1]}"
    )
    print(f"{args.out}: {size / 1e6:.2f} MB, {count}")
    if args.rerun:
        recording.open_viewer(args.out)
    return 0
