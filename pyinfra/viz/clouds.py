"""Draws pictures of frames on disk and of scan patterns.

The pictures work in black and white and for colour-blind readers. The more points a vehicle has,
the darker, thicker and more solid its box is. The colours follow Okabe and Ito.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle
from PIL import Image

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, Points
from pyinfra.core.boxes import footprints
from pyinfra.core.files import replacing
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset import regions
from pyinfra.dataset.data_set import FULL_CIRCLE_DEG
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.roads import offset_curve
from pyinfra.formats import kitti

STYLE: Any = {"font.size": 8, "axes.titlesize": 9, "axes.linewidth": 0.6}
DPI = 150
REGION_COLOUR = "#F1EDE4"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # one per LiDAR
VIEW_LINE: dict[str, Any] = {"color": "black", "linewidth": 0.6, "linestyle": (0, (6, 3))}
MARGIN_M = 12.0
DARKEST_M = 3.0
HALF_HEIGHT_M = 32.0  # minimum half-height of a picture, above and below its middle
CAR_AT_M = 60.0
# Azimuth and elevation (rad) of a car's rear, 1.8 m wide and 1.5 m high. The sensor is 6 m higher
# than the car's bottom edge.
CAR = np.arctan(np.array([[-0.9, -6.0], [0.9, -4.5]]) / CAR_AT_M)


@dataclass(frozen=True)
class Quality:
    """A class of vehicles, by number of points (up to `most`), and the style of their boxes."""

    name: str
    most: float
    colour: str
    line: Any
    width: float


QUALITIES = (
    Quality("missed: 0 points", 0, "#D55E00", (0, (1, 1)), 0.7),
    Quality("low: 1 to 4", 4, "#E69F00", (0, (3, 1)), 1.2),
    Quality("medium: 5 to 20", 20, "#0090C8", "-", 1.1),
    Quality("high: more than 20", np.inf, "#00205B", "-", 1.6),
)
PEOPLE = Quality("people", np.inf, "#009E73", "-", 1.1)


@dataclass(frozen=True)
class DrawnArea:
    """The drawn part of a plane."""

    x: tuple[float, float]
    y: tuple[float, float]

    def shape(self) -> tuple[float, float]:
        return self.x[1] - self.x[0], self.y[1] - self.y[0]


FIELD = DrawnArea((-40, 40), (-40, 40))  # degrees
NEAR = np.array([[-60.0, -40.0], [60.0, 40.0]])  # corners, metres
CLOSE_UP = DrawnArea((-3, 3), (-8, -2))


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The drawn content of one frame of one LiDAR, in its levelled frame."""

    scene: str  # name of the data set's folder
    lidar: kitti.Lidar
    points: Points  # (n, 4)
    objects: kitti.Objects
    region: tuple[FloatArray, ...]  # outlines (n, 2) of the evaluation region, if known
    road_z: float  # z of the road

    def counts(self) -> str:
        on_vehicles = self.objects.points[~self.are_people].sum()
        return f"{len(self.points):,} points, {on_vehicles:,} on vehicles"

    @property
    def are_people(self) -> BoolArray:
        """Returns a (k,) mask of the objects that are pedestrians or cyclists."""
        return np.isin(self.objects.names, PERSON_TYPES)


def read_snapshot(lidar_folder: Path, frame: int) -> Snapshot:
    """Reads a frame. Raises OSError, and the exceptions of the readers in pyinfra.formats.kitti."""
    lidar = kitti.read_lidar(lidar_folder)
    outlines, road_z = _region(lidar_folder, lidar)
    return Snapshot(
        scene=lidar_folder.parent.name,
        lidar=lidar,
        points=kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", frame)),
        objects=kitti.read_objects(kitti.frame_file(lidar_folder, "objects", frame)),
        region=outlines,
        road_z=road_z,
    )


def draw_frames(data_sets: Sequence[Sequence[Path]], frame: int, out: Path) -> list[Path]:
    """Writes a sheet of data sets x LiDARs and one picture of each LiDAR; returns the files.

    data_sets: the LiDAR folders of each data set. Raises the exceptions of read_snapshot().
    """
    out.mkdir(parents=True, exist_ok=True)
    views = [[read_snapshot(folder, frame) for folder in folders] for folders in data_sets]
    files = [out / "sheet.png"]
    save(sheet(views), files[0])
    for view in (view for row in views for view in row):
        files.append(out / f"{view.scene}_{view.lidar.name}.png")
        save(picture(view), files[-1])
    return files


def draw_patterns(patterns: Mapping[str, FloatArray], file: Path) -> Path:
    """Writes the figure of pattern_picture() to `file` and returns `file`."""
    file.parent.mkdir(parents=True, exist_ok=True)
    save(pattern_picture(patterns), file)
    return file


def save(figure: Figure, file: Path, dpi: int = DPI) -> None:
    """Writes a PNG with the fixed palette of these pictures, which keeps the file small."""
    with mpl.rc_context(STYLE), io.BytesIO() as png:
        figure.savefig(png, format="png", dpi=dpi)
        with Image.open(png) as image:
            few = image.convert("RGB").quantize(palette=_palette(), dither=Image.Dither.NONE)
    with replacing(file) as beside:
        few.save(beside, format="png", optimize=True)


def picture(view: Snapshot) -> Figure:
    """Returns a bird's-eye view of one frame of one LiDAR."""
    window = region_window(view)
    width, height = window.shape()
    low, high = view.lidar.price_usd
    price = f"{low:,.0f}" if low == high else f"{low:,.0f} to {high:,.0f}"
    title = f"{view.lidar.model}, US$ {price}, preset {view.lidar.preset}: {view.scene}"
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
    """Returns a figure with a row per data set and a column per LiDAR; a row shares one window."""
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

    Points at road level are light grey. They get darker with height and are black from DARKEST_M
    on.
    """
    for outline in view.region:
        axes.add_patch(Polygon(outline, color=REGION_COLOUR, zorder=0))
    points = view.points[_inside(view.points[:, :2], window)]
    height = points[:, 2] - view.road_z
    grey = np.clip(np.round(0.65 - 0.65 * height / DARKEST_M, 1), 0.0, 0.65)
    for level in np.unique(grey)[::-1]:  # high points last, on top
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
    """Returns the area around the region, or around NEAR if none is known; levelled frame."""
    return window_around(view.region or [NEAR])


def window_around(outlines: Sequence[FloatArray]) -> DrawnArea:
    """Returns an area around road outlines (n, 2), with a margin and a minimum height."""
    x, y = np.concatenate(outlines).T
    middle = (y.min() + y.max()) / 2
    half = max((y.max() - y.min()) / 2 + MARGIN_M, HALF_HEIGHT_M)
    return DrawnArea(
        (float(x.min() - MARGIN_M), float(x.max() + MARGIN_M)),
        (float(middle - half), float(middle + half)),
    )


def qualities(views: Iterable[Snapshot]) -> list[Quality]:
    """Returns the box styles of vehicles, and PEOPLE if a view has pedestrians or cyclists."""
    return [*QUALITIES, *([PEOPLE] if any(view.are_people.any() for view in views) else [])]


def legend_handles(views: Iterable[Snapshot]) -> list[Artist]:
    """Returns legend entries for the box styles of some views and for the other drawn items."""
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
        for q in qualities(views)
    ]
    sensor = Line2D([], [], color="black", marker="^", linestyle="none", label="LiDAR")
    view = Line2D([], [], **VIEW_LINE, label="field of view, range")
    return [*handles, sensor, view, Patch(color=REGION_COLOUR, label="evaluation region")]


def pattern_picture(patterns: Mapping[str, FloatArray]) -> Figure:
    """Draws where the rays of each LiDAR go: the whole field, and a car's rear 60 m ahead.

    patterns: by name, (n, 3) azimuth, elevation (rad) and time (s), from 0 s on. The rays of the
    first 0.1 s are drawn. All rays count for the mean number of rays on the car.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.5 * len(patterns) + 0.3, 5.3), layout="constrained")
        grid = figure.subplots(2, len(patterns), squeeze=False, sharey="row")
        for column, (name, rays) in enumerate(patterns.items()):
            field, close = grid[:, column]
            frame = np.degrees(rays[rays[:, 2] < PERIOD_S, :2])
            _draw_rays(field, frame, FIELD, 0.35)
            _draw_rays(close, frame, CLOSE_UP, 2.3)
            low, high = np.degrees(CAR)
            size = high - low
            car = Rectangle(low, *size, fill=False, edgecolor="#D55E00", linewidth=1.6)
            close.add_patch(car)
            on_car = ((rays[:, :2] > CAR[0]) & (rays[:, :2] < CAR[1])).all(axis=1)
            frames = max(1, round(float(rays[:, 2].max()) / PERIOD_S))
            field.set_title(f"{name}\n{len(frame):,} rays in {PERIOD_S:g} s")
            close.set_title(
                f"on a car's rear at {CAR_AT_M:g} m:\n{on_car.sum() / frames:.0f} rays on average"
            )
            close.set_xlabel("azimuth (°)")
        for axes in grid[:, 0]:
            axes.set_ylabel("elevation (°)")
    return figure


def _palette() -> Image.Image:
    """Returns greys, the region's colour, and each box and line colour in steps towards white."""
    greys = np.repeat(np.linspace(0, 1, 32)[:, None], 3, axis=1)
    lines = np.array([to_rgb(c) for c in (*(look.colour for look in QUALITIES), *COLOURS)])
    steps = [1 - share * (1 - lines) for share in (1.0, 0.8, 0.6, 0.4)]
    colours = np.concatenate([greys, [to_rgb(REGION_COLOUR)], *steps])
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.rint(255 * colours).astype(np.uint8).tobytes())
    return palette


def _region(lidar_folder: Path, lidar: kitti.Lidar) -> tuple[tuple[FloatArray, ...], float]:
    """Returns the outlines of the roads, or of a recording's region file, and the z of the road."""
    outline = lidar_folder / regions.REGION_FILE
    if lidar.preset != kitti.RECORDED or (lidar_folder.parent / "roads.csv").is_file():
        roads = _roads(lidar_folder.parent, lidar.T_world_levelled)
        outlines = [_outline(road) for _, road in roads.groupby("road", sort=False)]
        return tuple(outlines), float(roads["z"].mean())
    drawn = (regions.read_outline(outline),) if outline.is_file() else ()
    return drawn, -lidar.T_world_levelled.z


def _roads(data_set: Path, pose: kitti.WorldPose) -> pd.DataFrame:
    """Returns the rows of roads.csv in the levelled LiDAR frame."""
    roads = pd.read_csv(data_set / "roads.csv")
    x, y = roads["x"] - pose.x, roads["y"] - pose.y
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    return roads.assign(
        x=cos * x + sin * y,
        y=cos * y - sin * x,
        z=roads["z"] - pose.z,
        heading=roads["heading"] - pose.yaw,
    )


def _outline(road: pd.DataFrame) -> FloatArray:
    heading, half_width = road["heading"].to_numpy(), road["half_width"].to_numpy()
    return strip(road[["x", "y"]].to_numpy(), heading, half_width)


def legend_below(figure: Figure, handles: Sequence[Artist]) -> None:
    """Adds a legend under the axes, with as many columns as fit into the figure's width."""
    style: Any = {"handles": handles, "loc": "outside lower center", "frameon": False}
    empty = Figure(figsize=(figure.get_figwidth(), figure.get_figheight()))
    for columns in range(len(handles), 0, -1):
        tried = empty.legend(ncols=columns, **style)
        if columns == 1 or tried.get_window_extent().width <= empty.bbox.width:
            break
    figure.legend(ncols=columns, **style)


def strip(centre: FloatArray, heading: FloatArray, half_width: FloatArray) -> FloatArray:
    """Returns both edges of a road with centreline (n, 2) as one ring, (2 n, 2)."""
    left = offset_curve(centre, heading, half_width)
    return np.concatenate([left, offset_curve(centre, heading, -half_width)[::-1]])


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


def _inside(xy: Floats, window: DrawnArea) -> BoolArray:
    low = (window.x[0], window.y[0])
    high = (window.x[1], window.y[1])
    return np.asarray(((xy >= low) & (xy <= high)).all(axis=1))


def _draw_boxes(axes: Axes, boxes: FloatArray, look: Quality, *, headings: bool) -> None:
    """Draws footprints, with lines to the fronts; crosses out vehicles without points."""
    corners = footprints(boxes)
    style: dict[str, Any] = {"linewidths": look.width, "linestyles": [look.line], "zorder": 3}
    axes.add_collection(
        PolyCollection(list(corners), facecolors="none", edgecolors=look.colour, **style)
    )
    lines = [*corners[:, ::2], *corners[:, 1::2]] if look.most == 0 else []
    if headings:
        lines += [*np.stack([boxes[:, :2], corners[:, :2].mean(axis=1)], axis=1)]
    axes.add_collection(LineCollection(lines, colors=look.colour, linewidths=0.7, zorder=3))


def _draw_rays(axes: Axes, degrees: FloatArray, window: DrawnArea, size: float) -> None:
    seen = degrees[_inside(degrees, window)]
    axes.plot(
        seen[:, 0],
        seen[:, 1],
        linestyle="none",
        marker="o",
        markersize=size,
        color="black",
        markeredgewidth=0,
    )
    axes.set_aspect("equal")
    axes.set_xlim(*reversed(window.x))  # azimuth grows to the left, as seen from the sensor
    axes.set_ylim(*window.y)
