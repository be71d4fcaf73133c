"""Plans of data sets' scenes: roads, lanes, stations, sensor and fields of view.

They can be read in black and white: the fields of view differ in the style of their lines.
"""

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

from pyinfra import kitti
from pyinfra.data import regions
from pyinfra.data.regions import Road
from pyinfra.drawing import clouds

STATION_STEP_M = 20.0
SCALE_M = 20.0
ARROW_M = 14.0
CLEAR_M = 6.0  # around a crossing road no station is written
LINES = ("-", (0, (6, 2)), (0, (1, 1.5)), (0, (6, 2, 1, 2)), (0, (3, 1, 1, 1, 1, 1)))


@dataclass(frozen=True)
class Lanes:
    """Lanes of a road, as `dataset.yaml` has them."""

    each_way: int
    width_m: float
    median_m: float

    def lines(self) -> dict[float, bool]:
        """Metres to the left of the centreline at which a line lies, and whether it is solid."""
        aside = [self.median_m / 2 + i * self.width_m for i in range(self.each_way + 1)]
        solid = [i in (0, self.each_way) for i in range(self.each_way + 1)]
        one_side = dict(zip(aside, solid, strict=True))
        return {-a: s for a, s in reversed(one_side.items())} | one_side


@dataclass(frozen=True, eq=False)
class Scene:
    """A data set without its frames."""

    name: str
    folders: tuple[Path, ...]  # one per LiDAR
    lidars: tuple[kitti.Lidar, ...]
    tilts: tuple[kitti.Tilt, ...]
    roads: tuple[Road, ...]  # the evaluation region
    lanes: dict[str, Lanes]  # by road


def read_scene(folders: Sequence[Path]) -> Scene:
    """The data set of some LiDAR folders. Raises OSError, and kitti.FormatError with the line."""
    data_set = folders[0].parent
    top = kitti.read_yaml(data_set / "dataset.yaml")
    lanes = {road.at("name").text(): road.at("lanes") for road in top.at("roads").items()}
    return Scene(
        name=top.at("name").text(),
        folders=tuple(folders),
        lidars=tuple(kitti.read_lidar(folder) for folder in folders),
        tilts=tuple(kitti.read_tilt(folder) for folder in folders),
        roads=tuple(regions.read_roads(data_set / "roads.csv")),
        lanes={
            name: Lanes(
                each_way=int(own.at("each_way").number()),
                width_m=own.at("width_m").number(),
                median_m=own.at("median_m").number(),
            )
            for name, own in lanes.items()
        },
    )


def plan(scenes: Sequence[Scene]) -> Figure:
    """Roads, lanes, stations, sensor and fields of view of scenes beside each other, to one scale.

    LiDARs that see the same area share a line.
    """
    outlines = [[clouds.strip(r.xy, r.heading, r.half_width) for r in s.roads] for s in scenes]
    windows = [clouds.window_around(rings) for rings in outlines]
    widths = [window.shape()[0] for window in windows]
    height = max(window.shape()[1] for window in windows)
    width = 8.5 * (1 + 0.45 * (len(scenes) - 1))  # leaves room for the stations
    size = (width, 0.93 * width * height / sum(widths) + 1.1)
    with mpl.rc_context(clouds.STYLE):
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(1, len(scenes), squeeze=False, width_ratios=widths)[0]
        views: dict[str, dict[str, Any]] = {}
        for axes, scene, window, rings in zip(grid, scenes, windows, outlines, strict=True):
            for ring in rings:
                axes.add_patch(Polygon(ring, color=clouds.REGION_COLOUR, zorder=0))
            for road in scene.roads:
                _draw_road(axes, road, scene)
            _draw_views(axes, scene, views)
            _draw_scale(axes, window)
            axes.set(aspect="equal", xlim=window.x, ylim=window.y, title=scene.name)
            axes.set_xlabel("x, east (m)")
        grid[0].set_ylabel("y, north (m)")
        handles = [
            Patch(color=clouds.REGION_COLOUR, label="evaluation region; s in m"),
            Line2D([], [], color="black", marker="^", linestyle="none", label="sensor, its yaw"),
            *(Line2D([], [], label=label, **style) for label, style in views.items()),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _draw_road(axes: Axes, road: Road, scene: Scene) -> None:
    """Edges, lane lines and stations, but not where another road crosses."""
    others = [other for other in scene.roads if other is not road]

    def draw(left_m: Any, **style: Any) -> None:
        line = clouds.offset_curve(road.xy, road.heading, left_m)
        line[regions.locate(line, others).inside] = np.nan
        axes.plot(line[:, 0], line[:, 1], zorder=1, **style)

    for side in (-1, 1):
        draw(side * road.half_width, linewidth=0.8, color="black")
    for left_m, solid in scene.lanes[road.name].lines().items():
        draw(left_m, linewidth=0.4, color="0.4", linestyle="-" if solid else (0, (5, 5)))
    side = -1 if _is_left(road, scene.lidars[0].T_world_levelled) else 1
    edge, end, text = (
        clouds.offset_curve(road.xy, road.heading, side * (road.half_width + aside))
        for aside in (0.0, 1.5, 5.5)
    )
    wider = [replace(other, half_width=other.half_width + CLEAR_M) for other in others]
    written = (road.s % STATION_STEP_M == 0) & ~regions.locate(text, wider).inside
    for i in np.flatnonzero(written):
        axes.plot(*np.stack([edge[i], end[i]]).T, color="black", linewidth=0.6, zorder=1)
        station = f"{road.s[i]:g}".replace("-", "\N{MINUS SIGN}")
        x, y = text[i]
        axes.text(x, y, station, fontsize=6, ha="center", va="center", zorder=4)


def _is_left(road: Road, pose: kitti.WorldPose) -> bool:
    """Whether a sensor stands on the left of a road, or over its middle."""
    nearest = np.hypot(*(road.xy - (pose.x, pose.y)).T).argmin()
    x, y = (pose.x, pose.y) - road.xy[nearest]
    heading = road.heading[nearest]
    return bool(np.cos(heading) * y - np.sin(heading) * x >= 0)


def _draw_views(axes: Axes, scene: Scene, looks: dict[str, dict[str, Any]]) -> None:
    """Sensor and fields of view; adds the look of each area, by what the legend says of it."""
    areas: dict[tuple[Any, ...], list[kitti.Lidar]] = {}
    for lidar in scene.lidars:
        units = [(u.yaw, u.azimuth, u.range_m[1]) for u in lidar.field_of_view]
        areas.setdefault((lidar.T_world_levelled, *units), []).append(lidar)
    for lidars in areas.values():
        first = lidars[0]
        pose = first.T_world_levelled
        reach = max(unit.range_m[1] for unit in first.field_of_view)
        label = f"{', '.join(lidar.model for lidar in lidars)}: to {reach:g} m"
        colour = clouds.COLOURS[len(looks) % len(clouds.COLOURS)]
        line = LINES[len(looks) % len(LINES)]
        style = looks.setdefault(label, {"color": colour, "linestyle": line, "linewidth": 1.2})
        for unit in first.field_of_view:
            axes.plot(*regions.to_world(clouds.sector(unit), pose).T, zorder=3, **style)
        tip = regions.to_world(np.array([[ARROW_M, 0.0]]), pose)[0]
        arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.0, "shrinkA": 0}
        axes.annotate("", tip, (pose.x, pose.y), arrowprops=arrow, zorder=5)
        axes.plot(pose.x, pose.y, marker="^", color="black", markersize=5, zorder=5)


def _draw_scale(axes: Axes, window: clouds.DrawnArea) -> None:
    """A bar at the lower edge, off the stations and the circles around the sensor."""
    x, y = window.x[0] + 0.3 * window.shape()[0], window.y[0] + 2.5
    axes.plot([x, x + SCALE_M], [y, y], color="black", linewidth=2.5, solid_capstyle="butt")
    axes.text(x + SCALE_M + 1.5, y, f"{SCALE_M:g} m", ha="left", va="center", fontsize=7)
