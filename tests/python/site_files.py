"""A small site from files: two lanes on a slope of 6 %, a connecting lane, their road, and cars."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray

SLOPE = 0.06
OUTLINE = [[-60, -20], [70, -20], [70, 0.5], [10, 0.5], [10, 20], [-60, 20]]
FAR_AWAY = np.array([[500.0, 0, 0]])
SITE = """\
name: hill
duration_s: 1
mounts: {pole: {x_m: 2, y_m: -9, z_m: 7, yaw_deg: 35}}
lanes: lanes.csv
meshes:
- {file: meshes/road.ply, material: road}
- {file: meshes/verge.ply, material: terrain}
trajectories: trajectories.csv
"""


def write_site(folder: Path, *, narrowed: bool = False, cars: FloatArray | None = None) -> Path:
    """Writes the scene file and its other files. cars: (n, 3) x y heading."""
    (folder / "meshes").mkdir(parents=True)
    text = SITE + (f"regions: [{{name: bend, outline_m: {OUTLINE}}}]\n" if narrowed else "")
    (folder / "site.yaml").write_text(text)
    (folder / "lanes.csv").write_text(lanes())
    (folder / "meshes/road.ply").write_text(slab(-180, 180, -4, 40))
    (folder / "meshes/verge.ply").write_text(slab(-180, 180, -30, -4))
    (folder / "trajectories.csv").write_text(standing(FAR_AWAY if cars is None else cars))
    return folder / "site.yaml"


def lanes() -> str:
    """Returns a lane to the east, a lane to the west, and a quarter circle of 20 m that leads from
    one of them to the north."""
    angle = np.linspace(0, np.pi / 2, 12)
    bend = np.stack([20 * np.sin(angle), 18 - 20 * np.cos(angle)], axis=1)
    ways = {
        "east": [(-170.0, -2.0), (170.0, -2.0)],
        "west": [(170.0, 2.0), (20.0, 2.0), (-170.0, 2.0)],
        "bend": bend.tolist(),
    }
    rows = [
        f"{name},{x:.3f},{y:.3f},{SLOPE * x:.5f},{3 + (name == 'east')}\n"
        for name, way in ways.items()
        for x, y in way
    ]
    return "lane,x,y,z,width\n" + "".join(rows)


def slab(west: float, east: float, south: float, north: float) -> str:
    """Returns a rectangle of the slope as an ascii .ply file."""
    corners = [(west, south), (east, south), (east, north), (west, north)]
    rows = "".join(f"{x} {y} {SLOPE * x}\n" for x, y in corners)
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    return f"ply\nformat ascii 1.0\nelement vertex 4\n{axes}{face}{rows}4 0 1 2 3\n"


def standing(cars: FloatArray) -> str:
    """Returns trajectories of cars of 4 m length that stand on the slope for a second."""
    rows = [
        f"{k / 10},{i + 1},Car,{x:.4f},{y:.4f},{SLOPE * x + 0.8:.4f},{heading:.4f},4,1.8,1.6,0\n"
        for k in range(11)
        for i, (x, y, heading) in enumerate(cars)
    ]
    return "t,id,class,x,y,z,heading,dx,dy,dz,speed\n" + "".join(rows)
