"""`pyinfra site import FILE --out sites/NAME`: imports a map as a site."""

import argparse
from pathlib import Path

from pyinfra.cli.number_option import numbers
from pyinfra.core.errors import Error
from pyinfra.scenes.maps.compass import looks_to
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.map_readers import RADIUS_M, ImportOptions
from pyinfra.scenes.maps.site_folder import yaws


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = "example: pyinfra site import town.xodr --out sites/town --radius 400"
    kinds = ".xodr, .osm, .osm.xml or .net.xml; also packed, .gz or .bz2; or .osm.pbf"
    parser.add_argument("file", type=Path, help=kinds)
    parser.add_argument("--out", type=Path, required=True, help="folder of the site")
    parser.add_argument(
        "--centre",
        type=numbers("X,Y"),
        metavar="X,Y",
        help="centre of the site in map coordinates; for OSM longitude,latitude",
    )
    parser.add_argument(
        "--radius",
        dest="radius_m",
        type=float,
        default=RADIUS_M,
        help=f"radius around the centre to import, in metres; default: {RADIUS_M:g}",
    )
    parser.add_argument(
        "--mount-pose",
        dest="mount",
        type=numbers("X,Y,Z,YAW"),
        metavar="X,Y,Z,YAW",
        help="position of the sensor in the site, in metres, and its yaw in degrees; "
        "default: chosen from the map",
    )
    parser.add_argument(
        "--traffic-side",
        choices=("left", "right"),
        help="side of the road on which vehicles drive, for OSM; default: as in the map's "
        "roundabouts, else right",
    )


def run(args: argparse.Namespace) -> int:
    if not 10 <= args.radius_m <= 100_000:
        raise Error(f"radius_m: expected 10 to 100000, got {args.radius_m:g}")
    options = ImportOptions(
        centre=args.centre,
        radius_m=args.radius_m,
        mount=args.mount,
        traffic_side=args.traffic_side,
    )
    made = import_map(args.file, args.out, options)
    pole = made.pole
    print(args.out / "site.yaml" if made.anew else f"{args.out}: has the same import already")
    print(f"{made.lanes} lanes, {made.triangles} triangles")
    if made.anew:
        print(f"pole at {pole.x_m:g} {pole.y_m:g} {pole.z_m:g} m, yaw {pole.yaw_deg:g} degrees")
    for name, yaw_deg in yaws(args.out).items():  # the user may have changed the mounts
        print(f"{name} looks to {looks_to(yaw_deg)}")
    listed = [f"{len(rows)} {kind}" for kind, rows in made.record["features"].items()]
    if listed:
        print(f"features: {', '.join(listed)} (map.yaml)")
    for key in ("guessed", "mended", "not_understood", "network"):
        if made.record[key]:
            print(f"{key.replace('_', ' ')}: {len(made.record[key])} (map.yaml)")
    return 0
