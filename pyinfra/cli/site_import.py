"""`pyinfra site import FILE --out sites/NAME`: imports a map as a site."""

import argparse
from pathlib import Path

from pyinfra.cli.arguments import arguments_of
from pyinfra.cli.number_option import numbers
from pyinfra.cli.parser import argument, usage
from pyinfra.conversion import import_map
from pyinfra.formats.yaml_file import read_keys
from pyinfra.scenes.maps.compass import looks_to
from pyinfra.scenes.maps.map_readers import RADIUS_M
from pyinfra.scenes.maps.site_folder import MAP, yaws

add_arguments = usage(
    None,
    "example: pyinfra site import town.xodr --out sites/town --radius 400",
    argument(
        "file",
        type=Path,
        help=".xodr, .osm, .osm.xml or .net.xml; also packed, .gz or .bz2; or .osm.pbf",
    ),
    argument("--out", type=Path, required=True, help="folder of the site"),
    argument(
        "--centre",
        type=numbers("X,Y"),
        metavar="X,Y",
        help="centre of the site in map coordinates; for OSM longitude,latitude",
    ),
    argument(
        "--radius",
        dest="radius_m",
        type=float,
        default=RADIUS_M,
        help=f"radius around the centre to import, in metres; default: {RADIUS_M:g}",
    ),
    argument(
        "--mount-pose",
        dest="mount",
        type=numbers("X,Y,Z,YAW"),
        metavar="X,Y,Z,YAW",
        help="position of the sensor in the site, in metres, and its yaw in degrees; "
        "default: chosen from the map",
    ),
    argument(
        "--traffic-side",
        choices=("left", "right"),
        help="side of the road on which vehicles drive, for OSM; default: as in the map's "
        "roundabouts, else right",
    ),
)


def run(args: argparse.Namespace) -> int:
    known = (args.out / MAP).exists()  # import_map raises an error if the folder has another import
    site = import_map(**arguments_of(import_map, args), vehicles_per_hour=0)
    record = read_keys(args.out / MAP)
    print(f"{args.out}: has the same import already" if known else site)
    print(f"{record['lanes']} lanes, {record['triangles']} triangles")
    if not known:
        pole = record["pole"]
        place = " ".join(f"{pole[name]:g}" for name in ("x_m", "y_m", "z_m"))
        print(f"pole at {place} m, yaw {pole['yaw_deg']:g} degrees")
    # The mounts are read again, because the user may have changed them.
    for name, yaw_deg in yaws(args.out).items():
        print(f"{name} looks to {looks_to(yaw_deg)}")
    listed = [f"{len(rows)} {kind}" for kind, rows in record["features"].items()]
    if listed:
        print(f"features: {', '.join(listed)} (map.yaml)")
    for key in ("guessed", "mended", "not_understood", "network"):
        if record[key]:
            print(f"{key.replace('_', ' ')}: {len(record[key])} (map.yaml)")
    return 0
