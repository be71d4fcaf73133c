"""`pyinfra track DATA/LIDAR [PRED] --out tracks.csv`."""

import argparse
import io
import sys
from functools import partial
from pathlib import Path

import pandas as pd

from pyinfra.cli.messages import printed_findings, warn
from pyinfra.cli.parser import argument, usage
from pyinfra.conversion import TRACK_FILES, export_tracks
from pyinfra.core.errors import Error, check_exists
from pyinfra.dataset.frame_sequence import RecordedFrames
from pyinfra.dataset.frames import (
    frame_numbers,
    frame_range,
    has_labels,
    lidar_folder,
    recorded_s,
)
from pyinfra.dataset.prediction_files import prediction_table
from pyinfra.models.inference.boxes_table import detect, load_detector
from pyinfra.tracking.evaluation import UnknownIds, evaluate_tracks
from pyinfra.tracking.live import boxes_of_line, live_lines, new_lines
from pyinfra.tracking.tracker import Tracker, TrackSettings
from pyinfra.tracking.tracks import track

DEFAULT = TrackSettings()


add_arguments = usage(
    "Joins the boxes of a fixed LiDAR's frames into tracks: identity, speed, acceleration and "
    "covariance of each object in each frame.",
    "example: pyinfra track data/minute/ruby_plus --out out/tracks.csv",
    argument(
        "data",
        metavar="DATA",
        type=Path,
        help="folder of one LiDAR; or -, to read a JSON line per frame from standard input and "
        'print one: {"t_s": 1.5, "boxes": [{"type": "vehicle", "x": ..., "score": 0.9}]}',
    ),
    argument(
        "pred",
        metavar="PRED",
        type=Path,
        nargs="?",
        help="folder of predictions, as for `pyinfra evaluate`; default: run the detector",
    ),
    argument(
        "--out",
        type=Path,
        help=f"file to write: {', '.join(f'{end} ({what})' for end, what in TRACK_FILES.items())}",
    ),
    argument(
        "--model", default="generalist", help="detector to run without PRED; default: generalist"
    ),
    argument(
        "--frames", metavar="A:B[:STEP]", help="frame numbers from A to B, without B; default: all"
    ),
    argument(
        "--min-score",
        type=float,
        default=DEFAULT.min_score,
        help=f"minimum score of a box that is used, 0 to 1; default: {DEFAULT.min_score:g}",
    ),
    argument(
        "--birth-score",
        type=float,
        default=DEFAULT.birth_score,
        help="minimum score of a box that may begin a track, 0 to 1; "
        f"default: {DEFAULT.birth_score:g}",
    ),
    argument(
        "--missed-s",
        type=float,
        default=DEFAULT.missed_s,
        help="seconds without a box after which a track in view ends; "
        f"default: {DEFAULT.missed_s:g}",
    ),
    argument(
        "--hidden-s",
        type=float,
        default=DEFAULT.hidden_s,
        help=f"as --missed-s, for a track that is hidden or stands; default: {DEFAULT.hidden_s:g}",
    ),
    argument(
        "--live",
        action="store_true",
        help="use only the boxes up to each frame, as a running system would",
    ),
    argument(
        "--keep-all",
        action="store_true",
        help="for -: read each line; by default, lines are dropped while the machine is too slow",
    ),
    argument(
        "--within-m",
        type=float,
        default=80.0,
        help="largest distance of the vehicles in the printed measures, in metres; default: 80",
    ),
)


def run(args: argparse.Namespace) -> int:
    names = ("min_score", "birth_score", "missed_s", "hidden_s")
    settings = TrackSettings(**{name: getattr(args, name) for name in names})
    if str(args.data) == "-":
        return _live(args, Tracker(settings))
    if args.out is None or args.out.suffix not in TRACK_FILES:
        ends = ", ".join(TRACK_FILES)
        got = "none" if args.out is None else f"'{args.out}'"
        raise Error(f"out: expected a file name that ends in {ends}; got {got}")
    folder = lidar_folder(args.data)
    everything = args.frames is None
    numbers = frame_numbers(folder, "all") if everything else frame_range(args.frames, folder)
    frames = RecordedFrames(folder, tuple(numbers))
    boxes = _boxes(args, frames)
    tracks = track(boxes, frames, settings=settings, smooth=not args.live)
    export_tracks(tracks, args.out, lidar=frames.name, frames=frames)
    print(_summary(tracks, frames))
    if not len(tracks):
        warn(
            "no track was found; check that the frames have boxes, and that the frame period is "
            "right",
            args,
        )
    elif has_labels(folder) and (folder / "training/objects").is_dir():
        print(_quality(tracks, frames, args.within_m))
    return 0


def _quality(tracks: pd.DataFrame, frames: RecordedFrames, within_m: float) -> str:
    """Returns a line with the quality of the tracks, or with the reason why it is not known."""
    try:
        m = evaluate_tracks(frames, tracks, within_m=within_m, lines=[]).measures
    except UnknownIds as error:
        return f"quality of the tracks: not known; {error}"
    if not m.objects:
        return f"quality of the tracks: not known; no vehicle within {within_m:g} m is visible"
    return (
        f"visible vehicles within {within_m:g} m: HOTA {m.hota:.1f}, MOTA {m.mota:.1f}, "
        f"{m.switches:.0f} switches, {m.false_tracks:.0f} false tracks, speed error "
        f"{m.speed_error_km_h:.2f} km/h (median)"
    )


def _live(args: argparse.Namespace, tracker: Tracker) -> int:
    """Prints a JSON line of tracks for each JSON line of boxes."""
    if args.out is not None or args.pred is not None:
        given = "--out" if args.pred is None else "PRED"
        raise Error(f"{given}: expected no value if DATA is `-`, got {args.out or args.pred}")
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")  # a line that is not UTF-8 is reported as invalid
    arrivals = new_lines(sys.stdin, drop=not args.keep_all)
    with printed_findings(args):
        for line in live_lines(arrivals, boxes_of_line, tracker):
            print(line, flush=True)
    return 0


def _boxes(args: argparse.Namespace, frames: RecordedFrames) -> pd.DataFrame:
    if args.pred is None:
        return detect(load_detector(args.model), frames)
    check_exists(args.pred)
    if not args.pred.is_dir():
        raise Error(f"PRED: expected a folder of predictions, got '{args.pred}'")
    return prediction_table(frames, args.pred, partial(warn, args=args))


def _summary(tracks: pd.DataFrame, frames: RecordedFrames) -> str:
    count = tracks.groupby("type").id.nunique() if len(tracks) else {}
    listed = ", ".join(f"{n} {name}" for name, n in count.items()) or "none"
    seconds = recorded_s(frames.numbers, frames.period_s)
    return (
        f"tracks: {listed}; {len(frames.numbers)} frames of {frames.period_s:g} s ({seconds:g} s)"
    )
