"""`pyinfra count tracks.csv DATA/LIDAR --out DIR`."""

import argparse
from pathlib import Path

import pandas as pd

from pyinfra.cli.arguments import arguments_of
from pyinfra.cli.messages import printed_findings
from pyinfra.cli.parser import argument, usage
from pyinfra.tracking.counts import Counts, count
from pyinfra.viz.traffic_page import write_page

add_arguments = usage(
    "Counts tracks at lines and by movement, with speeds, headways, gaps, occupancy, queues "
    "and travel times. Writes CSV files and a page with a map of the flows.",
    "example: pyinfra count out/tracks.csv data/minute/ruby_plus --out out/counts",
    argument("tracks", metavar="TRACKS", type=Path, help="file of `pyinfra track`"),
    argument(
        "site",
        metavar="SITE",
        type=Path,
        help="folder of a LiDAR, whose roads get lines, or a YAML file with "
        "`lines_m: {name: [[x, y], [x, y]]}` in the levelled LiDAR frame",
    ),
    argument("--out", type=Path, required=True, help="folder for tables and page"),
    argument(
        "--interval-s",
        type=float,
        default=900.0,
        help="length of the intervals in seconds; default: 900",
    ),
    argument(
        "--start-s",
        type=float,
        help="start of the recording, in the time of the tracks; default: the start of SITE's "
        "frames if SITE is a folder that has the frames of all tracks, else the first track",
    ),
    argument("--end-s", type=float, help="end of the recording; default: as for --start-s"),
    argument("--no-page", action="store_true", help="write the tables only"),
)


def run(args: argparse.Namespace) -> int:
    with printed_findings(args):
        counts = count(**arguments_of(count, args))
    counts.save(args.out)
    if not args.no_page:
        write_page(counts, args.out / "counts.html", title=args.tracks.stem)
    print(table_text(counts))
    return 0


def table_text(counts: Counts) -> str:
    """Returns the counts by movement and by line as text."""
    moved = counts.movements.groupby("movement")["count"].sum().sort_values(ascending=False)
    lines = [f"{len(counts.passages)} passages in {counts.seconds:.0f} s"]
    lines += _aligned("movement", {name: str(n) for name, n in moved.items()})
    groups = counts.passages.groupby(["line", "direction"])
    lines += _aligned(
        "line",
        {f"{line} {direction}": _speeds(part.speed_km_h) for (line, direction), part in groups},
    )
    return "\n".join(lines)


def _speeds(speeds: pd.Series) -> str:
    """Returns the number of passages and their speeds; passages without boxes have no speed."""
    if not (with_speed := speeds.count()):
        return f"{len(speeds)}, none with a speed"
    few = "" if with_speed == len(speeds) else f" ({with_speed} with a speed)"
    return (
        f"{len(speeds)}{few} at {speeds.mean():.0f} km/h, "
        f"85 % below {speeds.quantile(0.85):.0f} km/h"
    )


def _aligned(title: str, rows: dict[str, str]) -> list[str]:
    if not rows:
        return []
    wide = max(map(len, [title, *rows]))
    return [f"{title}:", *(f"  {name:<{wide}}  {text}" for name, text in rows.items())]
