"""Draws the points and boxes of frames from above, in the levelled LiDAR frame."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from pyinfra.core.arrays import BoolArray, FloatArray, Points
from pyinfra.core.boxes import footprints
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset import regions
from pyinfra.dataset.data_set import FULL_CIRCLE_DEG
from pyinfra.dataset.outlines import Drawn
from pyinfra.dataset.roads import read_roads
from pyinfra.dataset.world_frame import to_levelled
from pyinfra.formats import kitti
from pyinfra.viz.picture_style import (
    PEOPLE,
    QUALITIES,
    REGION_COLOUR,
    STYLE,
    VIEW_LINE,
    DrawnArea,
    Quality,
    legend_below,
    save,
    window_around,
)

DARKEST_M = 3.0
# Corners of the area that is drawn if the region is unknown, in metres.
NEAR = np.array([[-60.0, -40.0], [60.0, 40.0]])


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The drawn content of one frame of one LiDAR, in its levelled frame."""

    scene: str  # name of the data set's folder
    lidar: kitti.Lidar
    points: Points  # (n, 4) x, y, z, intensity
    objects: kitti.Objects
    region: tuple[FloatArray, ...]  # outlines (n, 2) of the evaluation region; empty if unknown
    holes: tuple[FloatArray, ...]  # outlines (n, 2) of holes in the region
    road_z: float  # z of the road in the levelled LiDAR frame

    def counts(self) -> str:
        if self.lidar.preset == kitti.RECORDED and len(self.objects.names) == 0:
            return f"{len(self.points):,} points"
        on_vehicles = self.objects.points[~self.are_people].sum()
        return f"{len(self.points):,} points, {on_vehicles:,} on vehicles"

    @property
    def are_people(self) -> BoolArray:
        """Returns a (k,) mask of the objects that are pedestrians or cyclists."""
        return np.isin(self.objects.names, PERSON_TYPES)


def read_snapshot(lidar_folder: Path, frame: int) -> Snapshot:
    """Reads a frame. Raises OSError, and the exceptions of the readers in pyinfra.formats.kitti."""
    lidar = kitti.read_lidar(lidar_folder)
    region, road_z = _region(lidar_folder, lidar)
    return Snapshot(
        scene=lidar_folder.parent.name,
        lidar=lidar,
        points=kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", frame)),
        objects=kitti.read_objects(kitti.frame_file(lidar_folder, "objects", frame)),
        region=region.outlines,
        holes=region.holes,
        road_z=road_z,
    )


def _region(lidar_folder: Path, lidar: kitti.Lidar) -> tuple[Drawn, float]:
    """Returns the outlines of the roads, or of a recording's region file, and the z of the road."""
    outline = lidar_folder / regions.REGION_FILE
    if lidar.preset != kitti.RECORDED or (lidar_folder.parent / "roads.csv").is_file():
        pose = lidar.T_world_levelled
        roads = read_roads(lidar_folder.parent / "roads.csv")
        outlines = [to_levelled(road.outline, pose) for road in roads]
        road_z = float(np.concatenate([road.z for road in roads]).mean() - pose.z)
        return Drawn(tuple(outlines)), road_z
    drawn = regions.read_outline(outline) if outline.is_file() else Drawn(())
    return drawn, -lidar.T_world_levelled.z


def draw_frames(data_sets: Sequence[Sequence[Path]], frame: int, out: Path) -> list[Path]:
    """Writes a sheet of all data sets and LiDARs, and one picture of each LiDAR.

    Returns the files.

    data_sets: for each data set, its LiDAR folders. Raises the exceptions of read_snapshot().
    """
    out.mkdir(parents=True, exist_ok=True)
    views = [[read_snapshot(folder, frame) for folder in folders] for folders in data_sets]
    files = [out / "sheet.png"]
    save(sheet(views), files[0])
    for view in (view for row in views for view in row):
        files.append(out / f"{view.scene}_{view.lidar.name}.png")
        save(picture(view), files[-1])
    return files


def picture(view: Snapshot) -> Figure:
    """Returns a bird's-eye view of one frame of one LiDAR."""
    window = region_window(view)
    width, height = window.shape()
    low, high = view.lidar.price_usd
    price = f", US$ {low:,.0f}" + (f" to {high:,.0f}" if low != high else "")
    known = "" if math.isnan(low) else price
    title = f"{view.lidar.model}{known}, preset {view.lidar.preset}: {view.scene}"
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.5, 8.5 * height / width + 1.0), layout="constrained")
        axes = figure.subplots()
        bird_view(axes, view, window, point_size=0.75, headings=True)
        axes.set_title(f"{title}\n{view.counts()}", loc="left")
        axes.set_xlabel("x, along the sensor's view (m)")
        axes.set_ylabel("y (m)")
        legend_below(figure, legend_handles([view]))
    return figure


def sheet(views: Sequence[Sequence[Snapshot]]) -> Figure:
    """Returns a figure with a row per data set and a column per LiDAR.

    All pictures of a row show the same area.
    """
    windows = [region_window(row[0]) for row in views]
    columns = max(len(row) for row in views)
    width = 3.0
    heights = [width * w.shape()[1] / w.shape()[0] + 0.35 for w in windows]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width * columns + 0.5, sum(heights) + 0.6), layout="constrained")
        grid = figure.subplots(
            len(views), columns, squeeze=False, gridspec_kw={"height_ratios": heights}
        )
        for axes in grid.flat:
            axes.set_visible(False)
        for i, (row, window) in enumerate(zip(views, windows, strict=True)):
            for axes, view in zip(grid[i], row, strict=False):
                axes.set_visible(True)
                bird_view(axes, view, window, point_size=0.4, headings=False)
                model = f"{view.lidar.model}\n" if i == 0 else ""
                axes.set_title(f"{model}{view.counts()}", fontsize=8)
                axes.tick_params(labelsize=6, length=2, labelleft=axes is grid[i, 0])
            grid[i, 0].set_ylabel(f"{row[0].scene}\ny (m)")
        for axes in grid[-1]:
            axes.set_xlabel("x (m)")
        legend_below(figure, legend_handles([view for row in views for view in row]))
    return figure


def bird_view(
    axes: Axes, view: Snapshot, window: DrawnArea, *, point_size: float, headings: bool
) -> None:
    """Draws points, boxes, evaluation region and field of view in the levelled LiDAR frame.

    Points at road level are light grey. Higher points are darker, and black from DARKEST_M on.
    """
    for outline in view.region:
        axes.add_patch(Polygon(outline, color=REGION_COLOUR, zorder=0))
    for hole in view.holes:
        axes.add_patch(Polygon(hole, color="white", zorder=0))
    points = view.points[window.holds(view.points[:, :2])]
    height = points[:, 2] - view.road_z
    grey = np.clip(np.round(0.65 - 0.65 * height / DARKEST_M, 1), 0.0, 0.65)
    for level in np.unique(grey)[::-1]:  # high points are drawn last, on top of low points
        here = points[grey == level]
        style: dict[str, Any] = {"linestyle": "none", "marker": "o", "markeredgewidth": 0}
        axes.plot(
            here[:, 0], here[:, 1], markersize=point_size, color=str(level), zorder=2, **style
        )
    classes = np.searchsorted([q.most for q in QUALITIES], view.objects.points)
    boxes = view.objects.label_boxes(view.lidar.label_time)
    people = view.are_people
    for i, look in enumerate(QUALITIES):
        _draw_boxes(axes, boxes[(classes == i) & ~people], look, headings=headings)
    _draw_boxes(axes, boxes[people], PEOPLE, headings=False)
    for unit in view.lidar.field_of_view:
        axes.plot(*sector(unit).T, zorder=1, **VIEW_LINE)
    for at in view.lidar.sensors:
        axes.plot(at.x, at.y, marker="^", color="black", markersize=5, zorder=5)
    axes.set_aspect("equal")
    axes.set_xlim(*window.x)
    axes.set_ylim(*window.y)


def region_window(view: Snapshot) -> DrawnArea:
    """Returns the area around the region, or around NEAR if it is unknown; levelled frame."""
    return window_around(view.region or [NEAR])


def qualities(views: Iterable[Snapshot]) -> list[Quality]:
    """Returns the box styles: QUALITIES, and PEOPLE if a view has pedestrians or cyclists."""
    return [*QUALITIES, *([PEOPLE] if any(view.are_people.any() for view in views) else [])]


def legend_handles(views: Sequence[Snapshot]) -> list[Artist]:
    """Returns legend entries for the box styles of some views and for the other drawn items."""
    labelled = any(len(view.objects.names) > 0 for view in views)
    handles: list[Artist] = [
        Line2D(
            [],
            [],
            color=q.colour,
            linestyle=q.line,
            linewidth=q.width * 1.3,
            marker="x" if q.most == 0 else None,
            label=q.name,
        )
        for q in (qualities(views) if labelled else [])
    ]
    sensor = Line2D([], [], color="black", marker="^", linestyle="none", label="LiDAR")
    view = Line2D([], [], **VIEW_LINE, label="field of view, range")
    region = Patch(color=REGION_COLOUR, label="evaluation region")
    return [*handles, sensor, view, *([region] if any(v.region for v in views) else [])]


def sector(unit: kitti.FieldOfView) -> FloatArray:
    """Returns the outline of a unit's view from above, to its maximum range.

    The result is (n, 2) in the levelled LiDAR frame: a circle, or an arc and the two sides that
    join its ends to the sensor.
    """
    first, last = (unit.yaw + a for a in unit.azimuth)
    angle = np.linspace(first, last, 361)
    arc = unit.range_m[1] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    circle = last - first >= np.radians(FULL_CIRCLE_DEG)
    outline = arc if circle else np.concatenate([np.zeros((1, 2)), arc, np.zeros((1, 2))])
    if at := unit.at:
        c, s = np.cos(at.yaw), np.sin(at.yaw)
        outline = outline @ np.array([[c, s], [-s, c]]) + (at.x, at.y)
    return np.asarray(outline)


def _draw_boxes(axes: Axes, boxes: FloatArray, look: Quality, *, headings: bool) -> None:
    """Draws footprints and crosses out vehicles without points.

    headings: whether to draw a line from the centre to the front.
    """
    corners = footprints(boxes)
    style: dict[str, Any] = {"linewidths": look.width, "linestyles": [look.line], "zorder": 3}
    axes.add_collection(
        PolyCollection(list(corners), facecolors="none", edgecolors=look.colour, **style)
    )
    lines = [*corners[:, ::2], *corners[:, 1::2]] if look.most == 0 else []
    if headings:
        lines += [*np.stack([boxes[:, :2], corners[:, :2].mean(axis=1)], axis=1)]
    axes.add_collection(LineCollection(lines, colors=look.colour, linewidths=0.7, zorder=3))
