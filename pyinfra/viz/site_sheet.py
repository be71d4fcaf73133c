"""Draws plans of generated sites side by side for visual inspection."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from pyinfra.core.arrays import FloatArray
from pyinfra.core.boxes import footprints
from pyinfra.core.files import replacing, write
from pyinfra.core.progress import track
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.layout import Keys, PlannedRoad
from pyinfra.viz.picture_style import STYLE

SHEET = "sheet.png"
MOST_ON_A_SHEET = 48
DPI = 130
HALF_M = 110.0  # half the side of the drawn square around the sensor
COLUMNS = 6
PANEL_INCHES = 2.3
GROUND, FOOTWAY, SURFACE, LEAVES, HOUSE = "#F1EDE4", "#D0D0D0", "#8C8C8C", "#009E73", "#B08050"
PARKED, RAIL, SENSOR, LINE = "#0072B2", "#000000", "#D55E00", "#FFFFFF"
PEOPLE = {"Pedestrian": "#CC79A7", "Cyclist": "#F0E442"}
WALK_HALF_M = 0.5
# half the depth of a row of parked vehicles: True for parallel parking, False for angled parking
ROW_HALF_M = {True: 1.0, False: 2.3}


def write_sites(out: Path, count: int, seed: int) -> list[Path]:
    """Writes generated sites as scene files, and a sheet of the first sites; returns the files."""
    out.mkdir(parents=True, exist_ok=True)
    sites = [make_site(number) for number in track(range(seed, seed + count), "site")]
    files = [out / f"{site['name']}.yaml" for site in sites]
    for file, site in zip(files, sites, strict=True):
        write(file, yaml.safe_dump(site, sort_keys=False, default_flow_style=None, width=100))
    with replacing(out / SHEET) as beside:
        sheet(sites[:MOST_ON_A_SHEET]).savefig(beside, format="png", dpi=DPI)
    return [*files, out / SHEET]


def sheet(sites: Sequence[Keys]) -> Figure:
    """Draws a plan around each site's sensor, with the sensor's viewing direction."""
    rows = -(-len(sites) // COLUMNS)
    columns = min(COLUMNS, len(sites))
    size = (PANEL_INCHES * columns, (PANEL_INCHES + 0.25) * rows)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False).flat
        for axes, site in zip(grid, sites, strict=False):
            _draw(axes, site)
        for axes in list(grid)[len(sites) :] or figure.axes[len(sites) :]:
            axes.set_axis_off()
    return figure


def _draw(axes: Axes, site: Keys) -> None:
    roads = {keys["name"]: PlannedRoad(keys) for keys in site["roads"]}
    axes.set_facecolor(GROUND)
    for half, colour in (("outer_half_m", FOOTWAY), ("carriageway_half_m", SURFACE)):
        for road in roads.values():
            _strip(axes, road, 0.0, getattr(road, half), colour, 1)
    for road in roads.values():
        for left_m in _lane_lines(road):
            axes.plot(*road.beside(left_m).T, color=LINE, linewidth=0.3, zorder=2)
    for junction in site.get("junctions", []):
        if "roundabout" in junction:
            _draw_ring(axes, junction["roundabout"])
    _draw_rows(axes, site, roads)
    for plant in site.get("vegetation", []):
        _draw_plants(axes, plant, roads)
    for gantry in site.get("gantries", []):
        road = roads[gantry["road"]]
        reach = road.carriageway_half_m + 0.7
        ends = [road.pose_at(gantry["s_m"], left_m)[:2] for left_m in (-reach, reach)]
        axes.plot(*np.transpose(ends), color=RAIL, linewidth=2, zorder=4)
    boxes = [
        [b["x_m"], b["y_m"], 0, b["length_m"], b["width_m"], 1, np.radians(b["heading_deg"])]
        for b in site.get("buildings", [])
    ]
    for corners in footprints(np.array(boxes).reshape(-1, 7)):
        axes.add_patch(Polygon(corners, facecolor=HOUSE, edgecolor=RAIL, linewidth=0.3, zorder=3))
    _frame(axes, site)


def _draw_ring(axes: Axes, ring: Keys) -> None:
    """Draws the roundabout at the origin, where generated roads meet."""
    half_m = ring["width_m"] / 2
    for radius_m, colour in ((half_m, SURFACE), (-half_m, GROUND)):
        axes.add_patch(Circle((0, 0), ring["radius_m"] + radius_m, color=colour, zorder=2.2))


def _draw_rows(axes: Axes, site: Keys, roads: dict[str, PlannedRoad]) -> None:
    for row in site.get("parked", []):
        half = ROW_HALF_M[row.get("turn_deg", 0) == 0]
        _strip(axes, roads[row["road"]], row["offset_m"], half, PARKED, 2.5, _stretch(row))
    for row in site.get("barriers", []):
        half = max(row["width_m"] / 2, 0.4)
        _strip(axes, roads[row["road"]], row["offset_m"], half, RAIL, 4, _stretch(row))
    for row in site.get("people", []):
        colour, road = PEOPLE[row["class"]], roads[row["road"]]
        _strip(axes, road, row["offset_m"], WALK_HALF_M, colour, 2.8, _stretch(row))


def _draw_plants(axes: Axes, plant: Keys, roads: dict[str, PlannedRoad]) -> None:
    ((kind, row),) = plant.items()
    if kind == "hedge":
        box = [row["x_m"], row["y_m"], 0, row["length_m"], row["width_m"], 1]
        (corners,) = footprints(np.array([[*box, np.radians(row["heading_deg"])]]))
        axes.add_patch(Polygon(corners, color=LEAVES, linewidth=0, zorder=3))
        return None
    if kind == "tree":
        return _draw_crown(axes, row["x_m"], row["y_m"], row)
    road = roads[row["road"]]
    if kind == "hedge_along":
        half = row["width_m"] / 2
        return _strip(axes, road, row["offset_m"], half, LEAVES, 3, _stretch(row))
    for s in np.arange(row["from_m"], row["to_m"] + 1e-9, row["every_m"]):
        x, y, _ = road.pose_at(s, row["offset_m"])
        _draw_crown(axes, x, y, row)
    return None


def _draw_crown(axes: Axes, x: float, y: float, row: Keys) -> None:
    crown = Circle((x, y), row["crown_m"] / 2, color=LEAVES, alpha=0.6, linewidth=0, zorder=3.5)
    axes.add_patch(crown)


def _frame(axes: Axes, site: Keys) -> None:
    """Draws the sensor and its viewing direction, and sets the title."""
    mount = site["mounts"]["pole"]
    x, y, yaw = mount["x_m"], mount["y_m"], np.radians(mount["yaw_deg"])
    tip = (x + 22 * np.cos(yaw), y + 22 * np.sin(yaw))
    arrow = {"arrowstyle": "-|>", "color": SENSOR, "linewidth": 1.2, "shrinkA": 0}
    axes.annotate("", tip, (x, y), arrowprops=arrow, zorder=6)
    axes.plot(x, y, marker="^", color=SENSOR, markersize=4, zorder=6)
    lanes = site["roads"][0]["lanes"]["each_way"]
    title = f"{site['name']}: {mount['z_m']:g} m, 2 x {lanes}"
    axes.set(aspect="equal", xlim=(x - HALF_M, x + HALF_M), ylim=(y - HALF_M, y + HALF_M))
    axes.set(xticks=[], yticks=[])
    axes.set_title(title, fontsize=6)


def _stretch(row: Keys) -> tuple[float, float]:
    return row["from_m"], row["to_m"]


def _lane_lines(road: PlannedRoad) -> list[float]:
    lanes = road.keys["lanes"]
    borders = [i * lanes["width_m"] for i in range(lanes["each_way"] + 1)]
    if lanes.get("one_way"):
        return [border - borders[-1] / 2 for border in borders]
    aside = [lanes["median_m"] / 2 + border for border in borders]
    return [*aside, *(-a for a in aside)]


def _strip(
    axes: Axes,
    road: PlannedRoad,
    left_m: float,
    half_m: float,
    colour: str,
    zorder: float,
    stretch: tuple[float, float] = (-np.inf, np.inf),
) -> None:
    s = road.stations[:, 0]
    inside = (s >= stretch[0]) & (s <= stretch[1])
    sides: list[FloatArray] = [road.beside(left_m + side)[inside] for side in (-half_m, half_m)]
    outline = np.concatenate([sides[0], sides[1][::-1]])
    axes.add_patch(Polygon(outline, color=colour, linewidth=0, zorder=zorder))
