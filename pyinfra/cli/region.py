"""`pyinfra region DATA/LIDAR --out outline.yaml`: proposes an outline of the road."""

import argparse
import warnings
from pathlib import Path

from pyinfra.cli.messages import warn
from pyinfra.cli.parser import argument, usage
from pyinfra.dataset.frames import lidar_folder
from pyinfra.folders import propose_region
from pyinfra.models.inference.region_proposal import LEAST_S

add_arguments = usage(
    "Proposes an outline of the area where vehicles drive, from a recording of "
    f"{LEAST_S:g} s or more without labels.",
    "example: pyinfra region data/street/pole --out outline.yaml",
    argument("data", type=Path, help="folder of one LiDAR that does not move"),
    argument(
        "--out",
        type=Path,
        required=True,
        help="YAML file to write, `outline_m: [[x, y], ...]` in metres, or several `outlines_m` "
        "and `holes_m`, for --region of the commands `import` and `detect`",
    ),
)


def run(args: argparse.Namespace) -> int:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        proposal = propose_region(lidar_folder(args.data), args.out)
    for warning in caught:
        warn(str(warning.message), args)
    drawn = proposal.drawn
    rings = len(drawn.outlines), len(drawn.holes)
    parts = f"{rings[0]} outlines and {rings[1]} holes with " if rings != (1, 0) else ""
    count = sum(map(len, (*drawn.outlines, *drawn.holes)))
    print(
        f"{args.out}: {parts}{count} corners, {proposal.area_m2:.0f} m2, from "
        f"{proposal.vehicles} tracks of vehicles; inside are {100 * proposal.inside_share:.0f} % "
        f"of the vehicles' positions and {100 * proposal.moving_share:.0f} % of all moving points"
    )
    return 0
