"""Draws cut-outs: the points of the same vehicles from each LiDAR of a data set."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyinfra.core.arrays import FloatArray, Floats
from pyinfra.dataset.data_set import field_of_view_mask, read_owners
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.formats import kitti
from pyinfra.viz.picture_style import COLOURS, STYLE
from pyinfra.viz.scene_pictures import Scene

DISTANCES_M = (20.0, 40.0, 60.0, 80.0, 100.0)
NEAR_M = 8.0  # maximum difference between a vehicle's distance and its value of DISTANCES_M
CLASS, LEAST_VISIBILITY = "Car", 0.8
# Margin around a vehicle's box. In a frame without a `fields` file, points in the margin are also
# taken as points of the vehicle.
MARGIN_M = 0.3
ROAD_M = 0.1  # height above the bottom of a box below which points belong to the road
# Viewing angles of a cut-out, seen from behind and from the right of the vehicle.
AROUND, ABOVE = np.radians([40.0, 30.0])
EDGE_M = 0.25  # margin around a cut-out
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1]
_HIDDEN = 0b011  # index of the hidden corner, at the front, left and bottom of the box


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A vehicle in one frame."""

    frame: int
    id: int
    box: FloatArray  # (7,) box of the vehicle in the levelled LiDAR frame
    distance: float  # horizontal distance from the sensor to the box centre
    # for each LiDAR: whether the box centre is inside its field of view and range
    in_view: tuple[bool, ...]

    @property
    def common(self) -> bool:
        return all(self.in_view)


def cutouts(scene: Scene, frame: int) -> Figure:
    """Draws the points of one vehicle per distance (columns) for each LiDAR (rows).

    All pictures of a column show one vehicle in one frame. Its heading points to the upper right.
    """
    vehicles = choose_vehicles(scene, frame)
    points = [
        [np.empty((0, 3)) if v is None else vehicle_points(folder, v) for v in vehicles]
        for folder in scene.folders
    ]
    boxes = [_corners(v.box) for v in vehicles if v is not None]
    drawn = np.concatenate([np.eye(3), *boxes, *(cloud for row in points for cloud in row)])
    half = np.abs(_flat(drawn)).max(axis=0) + EDGE_M
    rows, columns = len(scene.lidars), len(vehicles)
    width = 8.5 / columns
    with mpl.rc_context(STYLE):
        size = (8.5, rows * (width * half[1] / half[0] + 0.2) + 0.7)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, vehicle, distance in zip(grid[0], vehicles, DISTANCES_M, strict=True):
            axes.set_title(_column_title(vehicle, distance, frame), fontsize=8)
        for i, lidar in enumerate(scene.lidars):
            grid[i, 0].set_ylabel(lidar.model)
            for axes, vehicle, cloud in zip(grid[i], vehicles, points[i], strict=True):
                axes.set(aspect="equal", xlim=(-half[0], half[0]), ylim=(-half[1], half[1]))
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set_visible(False)
                if vehicle is not None:
                    _draw_cutout(axes, vehicle.box, cloud)
                    # A vehicle can have points although its centre is outside the view.
                    is_in_view = vehicle.in_view[i] or len(cloud) > 0
                    caption = f"{len(cloud):,} points, {vehicle.distance:.0f} m"
                    axes.set_xlabel(
                        caption if is_in_view else f"{caption}, out of view", labelpad=1
                    )
        title = f"{scene.name}: the same {CLASS.lower()} in each column, front at the upper right"
        figure.suptitle(title, fontsize=9)
    return figure


def choose_vehicles(scene: Scene, frame: int) -> list[Vehicle | None]:
    """Returns for each of DISTANCES_M a vehicle whose distance differs by at most NEAR_M, or None.

    Only vehicles of CLASS with LEAST_VISIBILITY are candidates. The order of preference is:

    1. in the field of view of all LiDARs, in `frame`
    2. in the field of view of all LiDARs, in any frame that all LiDARs have
    3. in `frame`
    4. in any frame that all LiDARs have

    Among these, the vehicle that is nearest to the distance is chosen.
    """
    frames = set.intersection(*(set(kitti.frames(folder)) for folder in scene.folders))
    here = _vehicles(scene, [frame])
    anywhere: list[Vehicle] | None = None
    chosen = []
    for distance in DISTANCES_M:
        vehicle = _nearest([v for v in here if v.common], distance)
        if vehicle is None:
            anywhere = _vehicles(scene, sorted(frames)) if anywhere is None else anywhere
            for group in ([v for v in anywhere if v.common], here, anywhere):
                vehicle = vehicle or _nearest(group, distance)
        chosen.append(vehicle)
    return chosen


def vehicle_points(lidar_folder: Path, vehicle: Vehicle) -> FloatArray:
    """Returns a vehicle's points (n, 3), relative to the centre of its box, x forward.

    These are the points with the vehicle's object_id. If the frame has no `fields` file, or the
    vehicle's id is unknown, these are the points above the road that are inside the box with a
    margin of MARGIN_M.
    """
    velodyne = kitti.frame_file(lidar_folder, "velodyne", vehicle.frame)
    xyz = kitti.read_points(velodyne)[:, :3].astype(np.float64)
    cos, sin = np.cos(vehicle.box[6]), np.sin(vehicle.box[6])
    local = (xyz - vehicle.box[:3]) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    if vehicle.id >= 0 and kitti.frame_file(lidar_folder, "fields", vehicle.frame).is_file():
        return np.asarray(local[read_owners(lidar_folder, vehicle.frame, len(xyz)) == vehicle.id])
    high = vehicle.box[3:6] / 2 + MARGIN_M
    low = -high
    low[2] = -vehicle.box[5] / 2 + ROAD_M
    return np.asarray(local[((local >= low) & (local <= high)).all(axis=1)])


def _vehicles(scene: Scene, frames: Sequence[int]) -> list[Vehicle]:
    """Returns the vehicles of CLASS with LEAST_VISIBILITY that any LiDAR lists in `frames`."""
    by_id: dict[tuple[int, int], Vehicle] = {}
    for folder in scene.folders:
        table = read_vehicles(folder, frames)
        wanted = (table.names == CLASS) & (table.visibility >= LEAST_VISIBILITY)
        table = table.select(wanted)
        views = [
            field_of_view_mask(lidar, tilt, table.mid_frame[:, :3])[1]
            for lidar, tilt in zip(scene.lidars, scene.tilts, strict=True)
        ]
        in_view = np.stack(views, axis=1)
        for i, box in enumerate(table.mid_frame):  # the boxes are the same for all LiDARs
            number = int(table.ids[i])
            key = (frames[table.frame[i]], number if number >= 0 else -1 - i)
            by_id[key] = Vehicle(*key, box, float(np.hypot(box[0], box[1])), tuple(in_view[i]))
    return list(by_id.values())


def _nearest(vehicles: Sequence[Vehicle], distance: float) -> Vehicle | None:
    best = min(vehicles, key=lambda v: abs(v.distance - distance), default=None)
    return best if best is not None and abs(best.distance - distance) <= NEAR_M else None


def _column_title(vehicle: Vehicle | None, distance: float, frame: int) -> str:
    if vehicle is None:
        return f"about {distance:g} m:\nno {CLASS.lower()}"
    when = "" if vehicle.frame == frame else f", frame {vehicle.frame}"
    name = f" {vehicle.id}" if vehicle.id >= 0 else ""
    return f"about {distance:g} m:\n{CLASS.lower()}{name}{when}"


def _draw_cutout(axes: Axes, box: FloatArray, points: FloatArray) -> None:
    """Draws the edges of a box and the vehicle's points. Hidden edges are dotted."""
    corners = _flat(_corners(box))
    for edge in _EDGES:
        style: dict[str, Any] = {"linestyle": ":" if _HIDDEN in edge else "-", "linewidth": 0.7}
        axes.plot(*corners[list(edge)].T, color=COLOURS[0], zorder=1, **style)
    size = 1.2 if len(points) > 200 else 2.2
    axes.plot(*_flat(points).T, "o", color="black", markersize=size, markeredgewidth=0, zorder=2)


def _corners(box: FloatArray) -> FloatArray:
    """Returns the corners (8, 3) relative to the box centre.

    Bits of a corner's index that are 1 stand for front, left and top.
    """
    bits = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    return np.asarray((bits - 0.5) * box[3:6])


def _flat(points: Floats) -> FloatArray:
    """Returns a parallel projection (n, 2) of points (n, 3), which are relative to the box centre.

    x of the points is forward.
    """
    across = np.cos(AROUND) * points[:, 0] - np.sin(AROUND) * points[:, 1]
    away = np.sin(AROUND) * points[:, 0] + np.cos(AROUND) * points[:, 1]
    return np.stack([across, np.sin(ABOVE) * away + np.cos(ABOVE) * points[:, 2]], axis=1)
