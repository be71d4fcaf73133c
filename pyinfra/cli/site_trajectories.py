"""`pyinfra site trajectories FILE --out SITE`: imports trajectories as the traffic of a site."""

import argparse
from pathlib import Path

from pyinfra.core.errors import Error


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Imports trajectories as the traffic of a site. FILE is SUMO's floating car data (.xml, "
        ".gz), a .csv file of boxes, or a LiDAR's folder with labels. Trajectories are resampled "
        "to 10 Hz, gaps of up to 1 s are filled, and jumps are smoothed. Boxes without ids are "
        "linked to tracks. Floating car data in longitude and latitude are projected like the "
        "map of the site. Sets duration_s of the scene to the length of the trajectories."
    )
    parser.epilog = (
        "example: pyinfra site trajectories tracks.csv --columns x=center_x,y=center_y "
        "--rate-hz 25 --degrees --out sites/corner"
    )
    parser.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help=".csv, .xml or .gz file of trajectories, or a LiDAR's folder with labels",
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="SITE", help="folder of the site")
    add(
        "--columns",
        type=_pairs,
        default={},
        metavar="x=NAME,...",
        help="column names in the CSV file, such as x=center_x; default: x, y, z, heading, dx, dy, "
        "dz, class, t or frame, and id",
    )
    add(
        "--class-of",
        type=_classes,
        default={},
        metavar="NAME=Car,...",
        help="class for each class name in the file; =Car applies to objects without a class name; "
        "default: the same name",
    )
    add(
        "--rate-hz",
        type=float,
        help="frames per second; time is then computed from the column `frame` of the CSV file",
    )
    add(
        "--world",
        action="store_true",
        help="positions are in the site's frame; default: in the coordinates of the site's map",
    )
    add("--degrees", action="store_true", help="headings of the CSV file are in degrees")


def run(args: argparse.Namespace) -> int:
    import numpy as np

    from pyinfra.core.errors import FormatError
    from pyinfra.scenes.maps import fcd, recorded_boxes, site_folder
    from pyinfra.scenes.maps.lane_heights import height_notes, on_lanes
    from pyinfra.scenes.maps.site_traffic import RECORD
    from pyinfra.scenes.maps.tracks import lasts_s
    from pyinfra.scenes.maps.traffic_figures import report_lines
    from pyinfra.scenes.maps.trajectory_file import NAME, write_trajectories
    from pyinfra.scenes.maps.trajectory_import import import_boxes, import_fcd

    if args.rate_hz is not None and not 0.1 <= args.rate_hz <= 10_000:
        raise Error(f"--rate-hz: expected 0.1 to 10000, got {args.rate_hz:g}")
    if not args.out.is_dir():
        raise FileNotFoundError(f"{args.out}: expected an existing site folder, got no such folder")
    offset = np.zeros(3) if args.world else site_folder.offset(args.out)
    has_scene = (args.out / site_folder.SCENE).exists()
    try:
        notes: list[str] = []
        if args.file.suffix.lower() in (".xml", ".gz") or fcd.is_fcd_csv(args.file):
            projection = site_folder.projection(args.out)
            recorded = fcd.read_fcd(args.file)
            imported = import_fcd(recorded, args.class_of, offset, projection, has_site=has_scene)
        elif args.file.is_dir():
            imported = import_boxes(recorded_boxes.read_frames(args.file), np.zeros(3))
        else:
            how = recorded_boxes.BoxColumns(args.columns, args.class_of, args.rate_hz, args.degrees)
            boxes, notes = on_lanes(args.out, recorded_boxes.read_boxes(args.file, how), offset)
            imported = import_boxes(boxes, offset)
    except FormatError as error:
        text = str(error)
        named = text if text.startswith(str(args.file)) else f"{args.file}: {text}"
        raise FormatError(named) from error
    write_trajectories(args.out / NAME, imported.tracks)
    (args.out / RECORD).unlink(missing_ok=True)
    if has_scene:
        site_folder.set_duration(args.out, lasts_s(imported.tracks))
    feet = site_folder.feet(args.out) if has_scene else np.zeros((1, 2))
    notes += [*height_notes(args.out, imported.tracks), *imported.notes]
    print(*report_lines(args.out / NAME, imported.tracks, feet, notes), sep="\n")
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
            f"expected NAME=CLASS,... with CLASS of {', '.join(CLASSES)}, got '{got[:60]}'"
        )
    return pairs


def _pairs(text: str) -> dict[str, str]:
    """Parses `a=b,c=d` to a mapping."""
    pairs = [part.split("=") for part in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise argparse.ArgumentTypeError(f"expected NAME=OTHER,.., got '{text[:60]}'.")
    return {pair[0]: pair[1] for pair in pairs}
