"""`pyinfra region DATA/LIDAR --out outline.yaml`: proposes an outline of the road."""

from __future__ import annotations

import argparse
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.dataset.frames import lidar_folder
from pyinfra.models.inference.region_proposal import LEAST_S, propose_of_folder, write_outline


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
    if args.out.suffix not in (".yaml", ".yml"):
        raise Error(f"--out: expected a .yaml file, got {args.out}")
    proposal = propose_of_folder(lidar_folder(args.data))
    write_outline(args.out, proposal.corners)
    print(
        f"{args.out}: {len(proposal.corners)} corners, {proposal.area_m2:.0f} m2, from "
        f"{proposal.vehicles} tracks of vehicles; inside are {100 * proposal.inside_share:.0f} % "
        f"of the vehicles' positions and {100 * proposal.moving_share:.0f} % of all moving points"
    )
    return 0
