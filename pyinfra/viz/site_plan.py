"""Draws the plan of a site: surfaces, buildings, lanes with directions, trees, poles and views."""

import csv
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from pyinfra.core.arrays import FloatArray
from pyinfra.core.files import check_output, replacing
from pyinfra.formats.ply import read_ply
from pyinfra.formats.yaml_file import read_keys
from pyinfra.scenes.maps import site_folder
from pyinfra.scenes.maps.lane_map import MapError
from pyinfra.viz.picture_style import STYLE, draw_north, draw_scale, legend_below

COLOURS = {
    "terrain": "#F4F4EE",
    "road": "#D9D9D9",
    "sidewalk": "#BFC8D2",
    "structure": "#8C7B6B",
    "vegetation": "#9CBF94",
    "glass": "#B9D7E8",
}
MARKERS = {
    "bus_stop": ("s", "#0057A8"),
    "platform": ("s", "#6FA8DC"),
    "stop_position": ("D", "#6FA8DC"),
    "crossing": ("$=$", "#222222"),
    "level_crossing": ("X", "#222222"),
    "traffic_signals": ("o", "#E69F00"),
    "traffic_sign": ("v", "#CC79A7"),
    "stop": ("8", "#B00000"),
    "give_way": ("v", "#B00000"),
    "separate_sidewalk": ("_", "#4F6D8A"),
}
# First bytes of a plan's files, by suffix. A file that begins differently is not replaced.
BEGINS = {".svg": b"<?xml", ".png": b"\x89PNG", ".pdf": b"%PDF"}
ARROW_EVERY_M = 25.0
ARROW_M = 20.0
SIZE_IN = 8.0
SCALES_M = (10, 20, 50, 100, 200, 500, 1000)


def read_lanes(file: Path) -> dict[str, FloatArray]:
    """Reads x, y, z, width (n, 4) of each lane of lanes.csv. Raises MapError with the line."""
    lanes: dict[str, list[list[float]]] = defaultdict(list)
    with file.open(encoding="utf-8-sig", newline="") as stream:
        rows = csv.reader(stream)
        if (head := next(rows, [])) != ["lane", "x", "y", "z", "width"]:
            got = ",".join(head)[:100]
            raise MapError(f"{file}:1: expected the columns lane,x,y,z,width, got '{got}'")
        for number, row in enumerate(rows, start=2):
            try:
                name, x, y, z, width = row
                lanes[name].append([float(v) for v in (x, y, z, width)])
            except ValueError as error:
                raise MapError(
                    f"{file}:{number}: expected a name and 4 numbers, got {row}"
                ) from error
    return {name: np.array(rows_) for name, rows_ in lanes.items()}


def read_scene(folder: Path) -> dict[str, Any]:
    """Returns the raw content of site.yaml. Raises Error and OSError."""
    file = folder / site_folder.SCENE
    scene = read_keys(file)
    if "lanes" not in scene:
        raise MapError(
            f"{file}: expected the key lanes of a site of `pyinfra site import`, got none"
        )
    return scene


def save_plan(folder: Path, out: Path, radius_m: float | None = None) -> None:
    """Writes the plan to a file. Raises MapError, FormatError and OSError."""
    check_output(out, BEGINS.get(out.suffix, BEGINS[".svg"]))
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as beside:
        plan(folder, radius_m).savefig(beside, format=out.suffix.lstrip(".") or "svg", dpi=150)


def plan(folder: Path, radius_m: float | None = None) -> Figure:
    """Draws the lanes and 20 m around them, or a square of ±radius_m around the first mount."""
    scene = read_scene(folder)
    lanes = read_lanes(folder / scene["lanes"])
    points = np.concatenate(list(lanes.values()))[:, :2]
    low, high = points.min(0) - 20, points.max(0) + 20
    if radius_m is not None:
        mount = next(iter(scene["mounts"].values()))
        foot = np.array([mount["x_m"], mount["y_m"]])
        low, high = foot - radius_m, foot + radius_m
    width, height = high - low
    with mpl.rc_context(STYLE):
        size = SIZE_IN / max(width, height)
        figure = Figure(
            figsize=(max(4.0, width * size), max(3.0, height * size) + 0.8), layout="constrained"
        )
        axes = figure.subplots()
        used = [_draw_mesh(axes, folder, mesh) for mesh in scene.get("meshes", [])]
        _draw_lanes(axes, lanes)
        for tree in (row["tree"] for row in scene.get("vegetation", []) if "tree" in row):
            axes.add_patch(
                Circle((tree["x_m"], tree["y_m"]), 2.5, color=COLOURS["vegetation"], zorder=4)
            )
        features = site_folder.features(folder)
        for kind, xy in features.items():
            axes.plot(*xy.T, linestyle="none", zorder=5, **_look(kind))
        for name, mount in scene["mounts"].items():
            _draw_pole(axes, name, mount)
        metres = max((s for s in SCALES_M if s < width / 4), default=SCALES_M[0])
        draw_scale(axes, float(low[0]) + 5, float(low[1]) + 5, metres)
        draw_north(axes)
        axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set(title=scene["name"], xlabel="x, east (m)", ylabel="y, north (m)")
        handles = [Patch(color=COLOURS[m], label=m) for m in dict.fromkeys(used) if m != "terrain"]
        marks = [
            Line2D([], [], linestyle="none", label=kind.replace("_", " "), **_look(kind))
            for kind in features
        ]
        legend_below(figure, [*handles, *marks])
    return figure


def _draw_mesh(axes: Axes, folder: Path, mesh: dict[str, str]) -> str:
    """Draws the triangles of a mesh from above, except for terrain. Returns the material."""
    material = mesh["material"]
    if material != "terrain":
        triangles = read_ply(folder / mesh["file"])
        corners = triangles.vertices[triangles.faces][..., :2]
        (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        colour = COLOURS[material]
        flat = corners[np.abs(ax * by - ay * bx) > 1e-3]
        above = {"road": 1, "sidewalk": 2}.get(material, 3)
        styles: dict[str, Any] = {"facecolor": colour, "edgecolor": colour, "linewidth": 0.1}
        axes.add_collection(PolyCollection(list(flat), rasterized=True, zorder=above, **styles))
    return material


def _draw_lanes(axes: Axes, lanes: dict[str, FloatArray]) -> None:
    lines = [lane[:, :2] for lane in lanes.values()]
    axes.add_collection(LineCollection(lines, colors="0.35", linewidths=0.3, zorder=3))
    starts, ways = [], []
    for line in lines:
        s = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        at = np.arange(ARROW_EVERY_M / 2, s[-1], ARROW_EVERY_M)
        i = np.searchsorted(s, at).clip(1) - 1
        step = line[i + 1] - line[i]
        starts.append(line[i])
        ways.append(step / np.hypot(*step.T)[:, None])
    xy, uv = np.concatenate(starts), np.concatenate(ways)
    axes.quiver(
        *xy.T, *uv.T, angles="xy", scale_units="xy", scale=0.3, width=0.001, color="0.2", zorder=4
    )


def _look(kind: str) -> dict[str, Any]:
    marker, colour = MARKERS.get(kind, (".", "#555555"))
    return {"marker": marker, "color": colour, "markersize": 4, "markeredgewidth": 0.8}


def _draw_pole(axes: Axes, name: str, mount: dict[str, float]) -> None:
    x, y, yaw = mount["x_m"], mount["y_m"], math.radians(mount.get("yaw_deg", 0))
    tip = (x + ARROW_M * math.cos(yaw), y + ARROW_M * math.sin(yaw))
    arrow = {"arrowstyle": "-|>", "color": "#C00000", "linewidth": 1.2, "shrinkA": 0}
    axes.annotate("", tip, (x, y), arrowprops=arrow, zorder=6)
    axes.plot(x, y, marker="^", color="#C00000", markersize=5, zorder=6)
    axes.annotate(name, (x, y), (5, -9), textcoords="offset points", fontsize=7, zorder=6)
