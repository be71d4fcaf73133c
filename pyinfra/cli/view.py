"""`pyinfra view DATA --frames 0:50:5 --out view.html`: shows frames in 3-D."""

import argparse
from pathlib import Path

from pyinfra.cli.number_option import one_frame
from pyinfra.cli.parser import argument, one_of, usage
from pyinfra.viz.viewer.views import write_view

add_arguments = usage(
    "Writes an interactive 3-D view of one or more frames as one HTML file that needs no "
    "internet connection. It can show several LiDARs of the same data set.",
    "example: pyinfra view data/highway --frames 0:50:5 --out out/view.html",
    argument(
        "data",
        nargs="+",
        type=Path,
        help="data set written by `infrasim run`, or folder of one LiDAR",
    ),
    argument("--lidar", nargs="+", metavar="NAME", help="show only these LiDARs"),
    one_of(
        argument(
            "--frame",
            type=one_frame,
            help="number of the frame; default: the first frame, or with --pred the first frame "
            "that has predictions",
        ),
        argument(
            "--frames",
            metavar="A:B[:STEP]",
            help="frame numbers from A to B, without B; missing frames are skipped",
        ),
    ),
    argument(
        "--pred",
        nargs="+",
        default=[],
        metavar="DIR",
        help="folder of predictions, NNNNNN.txt or NNNNNN.csv, or a tracks.csv; if there are "
        "several LiDARs, LIDAR=DIR for each",
    ),
    argument(
        "--max-points",
        dest="most_points",
        type=int,
        metavar="N",
        help="maximum number of points per frame; larger frames are thinned, as the page states",
    ),
    argument(
        "--rerun",
        action="store_true",
        help="write a recording (.rrd) for Rerun instead and open it (needs the extra `rerun`); "
        "Rerun sends usage data to its makers unless you run `rerun analytics disable`",
    ),
    argument("--out", type=Path, required=True, help="file to write, .html or .rrd"),
)


def run(args: argparse.Namespace) -> int:
    frames = args.frames if args.frame is None else str(args.frame)
    shown = write_view(
        *(args.data, args.out, args.lidar, frames, args.pred, args.most_points),
        rerun=args.rerun,
    )
    counts = [
        f"{count} {name}{'s'[: count > 1]}"
        for count, name in ((shown.lidars, "LiDAR"), (shown.frames, "frame"))
    ]
    print(f"{args.out}: {shown.size / 1e6:.2f} MB, {', '.join(counts)}")
    if args.rerun:
        from pyinfra.viz.viewer.recording import open_viewer

        open_viewer(args.out)
    return 0
