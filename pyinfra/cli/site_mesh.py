"""`pyinfra site mesh FILE --out SITE`: adds the surface of a 3-D model to a site."""

import argparse
from pathlib import Path

from pyinfra.cli.arguments import arguments_of
from pyinfra.cli.number_option import numbers
from pyinfra.cli.parser import argument, usage
from pyinfra.formats.ply import read_ply
from pyinfra.scenes.maps.mesh_import import MATERIALS
from pyinfra.sites import import_mesh

add_arguments = usage(
    "Adds the triangles of a file (.obj, .glb, .gltf, .stl, .ply, CityJSON) to the meshes of a "
    "site.",
    "example: pyinfra site mesh station.glb --out sites/corner --offset 20,35,0",
    argument("file", type=Path, metavar="FILE", help="3-D model"),
    argument(
        "--out", dest="site", type=Path, required=True, metavar="SITE", help="folder of the site"
    ),
    argument(
        "--material", choices=MATERIALS, default="structure", help="material; default: structure"
    ),
    argument(
        "--up",
        choices=("y", "z"),
        default="",
        help="upward axis of the file; default: y for glTF, else z",
    ),
    argument("--scale", type=float, default=1.0, help="unit of the file in metres; default: 1"),
    argument(
        "--offset",
        dest="offset_m",
        type=numbers("X,Y,Z"),
        default=(0.0, 0.0, 0.0),
        metavar="X,Y,Z",
        help="shift in metres, applied after scale and rotation; default: 0,0,0",
    ),
)


def run(args: argparse.Namespace) -> int:
    made = import_mesh(**arguments_of(import_mesh, args))
    mesh = read_ply(made)
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    spans = [f"{a} {v:.1f} to {w:.1f}" for a, v, w in zip("xyz", low, high, strict=True)]
    print(made)
    print(f"{len(mesh.faces)} triangles, {', '.join(spans)} m")
    return 0
