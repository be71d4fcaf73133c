"""`pyinfra region DATA/LIDAR --out outline.yaml`: proposes an outline of the road."""

from __future__ import annotations

import argparse
from pathlib import Path

from pyinfra.dataset.frames import lidar_folder
from pyinfra.folders import propose_region
from pyinfra.models.inference.region_proposal import LEAST_S


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Proposes an outline of the area where vehicles drive, from a recording of "
        f"{LEAST_S:g} s or more without labels."
    )
    parser.epilog = "example: pyinfra region data/street/pole --out outline.yaml"
    parser.add_argument("data", type=Path, help="folder of one LiDAR that does not move")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="YAML file to write, `outline_m: [[x, y], ...]` in metres, for --region of the "
        "commands `import` and `detect`",
    )


def run(args: argparse.Namespace) -> int:
    proposal = propose_region(lidar_folder(args.data), args.out)
    print(
        f"{args.out}: {len(proposal.corners)} corners, {proposal.area_m2:.0f} m2, from "
        f"{proposal.vehicles} tracks of vehicles; inside are {100 * proposal.inside_share:.0f} % "
        f"of the vehicles' positions and {100 * proposal.moving_share:.0f} % of all moving points"
    )
    return 0
