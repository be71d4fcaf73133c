"""Draws plans of data sets' scenes: roads, lanes, stations, buildings, sensor, fields of view.

The plans are legible in black and white, because the fields of view differ in line style.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from pyinfra.core.boxes import footprints
from pyinfra.dataset.roads import Road, locate, offset_curve
from pyinfra.dataset.surroundings import Surroundings, read_surroundings, road_lines
from pyinfra.dataset.world_frame import to_world
from pyinfra.formats import kitti
from pyinfra.viz import clouds
from pyinfra.viz.picture_style import (
    COLOURS,
    REGION_COLOUR,
    STYLE,
    draw_north,
    draw_scale,
    legend_below,
    window_around,
)

STATION_STEP_M = 20.0
SCALE_M = 20.0
LABEL_LETTERS = 60  # maximum number of letters in a line of the legend
ARROW_M = 14.0
CLEAR_M = 6.0  # margin around a crossing road in which no station is written
BUILDING: dict[str, Any] = {"facecolor": "#D0D0D0", "edgecolor": "0.35"}
ROAD_LINES: dict[str, dict[str, Any]] = {
    "edge": {"linewidth": 0.8, "color": "black"},
    "solid": {"linewidth": 0.4, "color": "0.4"},
    "dashed": {"linewidth": 0.4, "color": "0.4", "linestyle": (0, (5, 5))},
}
LINES = ("-", (0, (6, 2)), (0, (1, 1.5)), (0, (6, 2, 1, 2)), (0, (3, 1, 1, 1, 1, 1)))


@dataclass(frozen=True, eq=False)
class Scene:
    """A data set without its frames."""

    name: str
    folders: tuple[Path, ...]  # folder of each LiDAR in the data set
    lidars: tuple[kitti.Lidar, ...]
    tilts: tuple[kitti.Tilt, ...]
    around: Surroundings
    is_imported: bool  # whether the scene is from a map, with x to the east and y to the north


def read_scene(folders: Sequence[Path]) -> Scene:
    """Reads the scene of some LiDAR folders. Raises OSError, and FormatError with the line."""
    data_set = folders[0].parent
    top = kitti.read_yaml(data_set / "dataset.yaml")
    is_imported = top.maybe("lanes") is not None
    if not is_imported:
        top.at("roads").items()  # raises an error without roads
    return Scene(
        name=top.at("name").text(),
        folders=tuple(folders),
        lidars=tuple(kitti.read_lidar(folder) for folder in folders),
        tilts=tuple(kitti.read_tilt(folder) for folder in folders),
        around=read_surroundings(data_set),
        is_imported=is_imported,
    )


def plan(scene: Scene) -> Figure:
    """Draws roads, stations, buildings, sensor and fields of view of a scene.

    The axes are those of the world frame. North is up in a scene that was imported from a map.

    LiDARs with the same field of view share a line.
    """
    window = window_around([road.outline for road in scene.around.roads])
    width, height = window.shape()
    with mpl.rc_context(STYLE):
        size = (8.5, 0.93 * 8.5 * height / width + 1.1)  # inches, with space for stations
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots()
        views: dict[str, dict[str, Any]] = {}
        draw_surroundings(axes, scene.around)
        for road in scene.around.roads:
            _draw_stations(axes, road, scene)
        _draw_views(axes, scene, views)
        # The scale bar overlaps neither stations nor circles.
        draw_scale(axes, window.x[0] + 0.3 * width, window.y[0] + 2.5, SCALE_M)
        axes.set(aspect="equal", xlim=window.x, ylim=window.y, title=scene.name)
        axes.set(xlabel="x (m)", ylabel="y (m)")
        if scene.is_imported:
            axes.set(xlabel="x, east (m)", ylabel="y, north (m)")
            draw_north(axes)
        handles = [
            Patch(color=REGION_COLOUR, label="evaluation region; s in m"),
            *([Patch(**BUILDING, label="building")] if len(scene.around.buildings) else []),
            Line2D([], [], color="black", marker="^", linestyle="none", label="sensor, its yaw"),
            *(Line2D([], [], label=label, **style) for label, style in views.items()),
        ]
        legend_below(figure, handles)
    return figure


def draw_surroundings(axes: Axes, around: Surroundings) -> None:
    """Draws the evaluation region, buildings, and edges and lane lines of the roads."""
    for road in around.roads:
        axes.add_patch(Polygon(road.outline, color=REGION_COLOUR, zorder=0))
    for corners in footprints(around.buildings):
        axes.add_patch(Polygon(corners, **BUILDING, linewidth=0.6, zorder=0.5))
    for line in road_lines(around):
        axes.plot(line.xyz[:, 0], line.xyz[:, 1], zorder=1, **ROAD_LINES[line.kind])


def _draw_stations(axes: Axes, road: Road, scene: Scene) -> None:
    """Writes the stations (m) beside a road, except where another road crosses."""
    others = [other for other in scene.around.roads if other is not road]
    side = -1 if _is_left(road, scene.lidars[0].T_world_levelled) else 1
    edge, end, text = (
        offset_curve(road.xy, road.heading, side * (road.half_width + aside))
        for aside in (0.0, 1.5, 5.5)
    )
    wider = [replace(other, half_width=other.half_width + CLEAR_M) for other in others]
    written = (road.s % STATION_STEP_M == 0) & ~locate(text, wider).inside
    for i in np.flatnonzero(written):
        axes.plot(*np.stack([edge[i], end[i]]).T, color="black", linewidth=0.6, zorder=1)
        station = f"{road.s[i]:g}".replace("-", "\N{MINUS SIGN}")
        x, y = text[i]
        axes.text(x, y, station, fontsize=6, ha="center", va="center", zorder=4)


def _is_left(road: Road, pose: kitti.WorldPose) -> bool:
    """Returns whether a sensor stands on the left of a road, or over its middle."""
    nearest = np.hypot(*(road.xy - (pose.x, pose.y)).T).argmin()
    x, y = (pose.x, pose.y) - road.xy[nearest]
    heading = road.heading[nearest]
    return bool(np.cos(heading) * y - np.sin(heading) * x >= 0)


def _draw_views(axes: Axes, scene: Scene, styles: dict[str, dict[str, Any]]) -> None:
    """Draws sensors and fields of view, and adds the style of each view to `styles` by label."""
    areas: dict[tuple[Any, ...], list[kitti.Lidar]] = {}
    for lidar in scene.lidars:
        units = [(u.at, u.yaw, u.azimuth, u.range_m[1]) for u in lidar.field_of_view]
        areas.setdefault((lidar.T_world_levelled, *units), []).append(lidar)
    for lidars in areas.values():
        first = lidars[0]
        pose = first.T_world_levelled
        reach = max(unit.range_m[1] for unit in first.field_of_view)
        models = f"{', '.join(lidar.model for lidar in lidars)}: to {reach:g} m"
        label = textwrap.fill(models, LABEL_LETTERS)
        colour = COLOURS[len(styles) % len(COLOURS)]
        line = LINES[len(styles) % len(LINES)]
        style = styles.setdefault(label, {"color": colour, "linestyle": line, "linewidth": 1.2})
        for unit in first.field_of_view:
            axes.plot(*to_world(clouds.sector(unit), pose).T, zorder=3, **style)
        for at in first.sensors:
            x, y = at.x + ARROW_M * np.cos(at.yaw), at.y + ARROW_M * np.sin(at.yaw)
            foot, tip = to_world(np.array([(at.x, at.y), (x, y)]), pose)
            arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.0, "shrinkA": 0}
            axes.annotate("", tip, foot, arrowprops=arrow, zorder=5)
            axes.plot(*foot, marker="^", color="black", markersize=5, zorder=5)
