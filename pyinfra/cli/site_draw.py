"""`pyinfra site draw sites/NAME --out plan.svg`: draws the plan of a site."""

import argparse
from pathlib import Path

from pyinfra.cli.parser import argument, usage
from pyinfra.core.errors import Error

add_arguments = usage(
    None,
    "example: pyinfra site draw sites/town --out plan.svg",
    argument("site", type=Path, help="folder of the site"),
    argument("--out", type=Path, required=True, help=".svg, .png or .pdf file"),
    argument(
        "--radius",
        dest="radius_m",
        type=float,
        help="maximum distance of drawn objects from the pole, in metres; default: no limit",
    ),
)


def run(args: argparse.Namespace) -> int:
    from pyinfra.scenes.maps.compass import looks_to
    from pyinfra.scenes.maps.site_folder import yaws
    from pyinfra.viz.site_plan import save_plan

    if args.radius_m is not None and not 10 <= args.radius_m <= 100_000:
        raise Error(f"radius_m: expected 10 to 100000, got {args.radius_m:g}")
    save_plan(args.site, args.out, args.radius_m)
    print(args.out)
    for name, yaw_deg in yaws(args.site).items():
        print(f"mount {name} looks to {looks_to(yaw_deg)}")
    return 0
