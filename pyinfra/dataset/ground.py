"""How high the road lies where a LiDAR stands: a function of the place, levelled LiDAR frame.

Networks are given points above the local road (z = 0 on it), and their boxes come back: what they
learnt below a pole of 5 m on level ground holds below one of 8 m, and on a slope.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.dataset.frames import data_set_of
from pyinfra.dataset.regions import Road, read_roads, to_levelled
from pyinfra.formats import kitti
from pyinfra.formats.kitti import RoadShape, WorldPose

F = TypeVar("F", bound=np.floating[Any])  # float32 of points, float64 of boxes

MOST_HEIGHT_M = 100.0  # of a sensor above the road, as a user says it
CELL_M = 1.0  # of a relief: as the points of a road's centreline
RIM_M = 20.0  # of a relief, around the centrelines
LEVEL_M = 0.01  # roads that rise by less are level
STEADY = 16.0  # m2: slopes rest on vehicles spread by some metres more than the root of this
FAR_M = 0.5  # off the plane: no vehicle on this road
SHAPE_REACH_M = 60.0  # of a recording's road around its sensor: as far as it is looked at
SHAPE_END_M = 150.0  # and how far it is followed straight on


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights in cells."""

    corner: tuple[float, float]  # x y of the first cell's
    heights: FloatArray  # (columns along x, rows along y); a place beyond has that of the rim

    def height(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        last = np.array(self.heights.shape) - 1
        x, y = (
            np.clip((positions[:, i] - self.corner[i]) / CELL_M, 0, last[i]).astype(np.intp)
            for i in (0, 1)
        )
        return np.asarray(self.heights[x, y], positions.dtype)


@dataclass(frozen=True, eq=False)
class Ground:
    """z of the road: that of the relief, else of the plane."""

    plane: tuple[float, float, float] = (0.0, 0.0, 0.0)  # z = a x + b y + c
    relief: Relief | None = None

    def height(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        """(n,) z of the road at places (n, 2 or more), of their type; finite places alone."""
        if self.relief is not None:
            return self.relief.height(positions)
        a, b, c = np.array(self.plane, positions.dtype)
        return np.asarray(a * positions[:, 0] + b * positions[:, 1] + c)

    @property
    def sensor_m(self) -> float:
        """How high the sensor is above the road at its foot."""
        return -float(self.height(np.zeros((1, 2)))[0])

    def above(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        """Points or boxes (n, 3 or more) with z from the road; a copy."""
        return self._moved(positions, -1)

    def back(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        """The same with z from the sensor again."""
        return self._moved(positions, 1)

    def _moved(self, positions: npt.NDArray[F], sign: int) -> npt.NDArray[F]:
        moved = positions.copy()
        # Others stay as they are: no detector looks at them.
        known = np.isfinite(positions[:, 0]) & np.isfinite(positions[:, 1])
        rows = slice(None) if known.all() else known
        moved[rows, 2] += sign * self.height(positions[rows])
        return moved


def level_ground(z: float) -> Ground:
    return Ground((0.0, 0.0, z))


def ground_of(lidar_folder: Path) -> Ground | None:
    """That of the data set's roads; without them, as high as an imported LiDAR says.

    None if neither is known. Raises FormatError.
    """
    roads = data_set_of(lidar_folder) / "roads.csv"
    lidar = kitti.read_lidar(lidar_folder)
    if roads.is_file():
        return ground_of_roads(read_roads(roads), lidar.T_world_levelled)
    if lidar.preset != kitti.RECORDED:
        return None
    if shape := kitti.read_road_shape(lidar_folder):
        return ground_of_shape(shape)
    height = lidar.T_world_levelled.z
    return level_ground(-height) if height > 0 else None


def ground_of_shape(shape: RoadShape) -> Ground:
    centres = np.arange(-SHAPE_END_M, SHAPE_END_M, CELL_M) + CELL_M / 2
    cells = np.stack(np.meshgrid(centres, centres, indexing="ij"), axis=-1)
    heights = shape_heights(shape, cells.reshape(-1, 2)).reshape(cells.shape[:2])
    return Ground(relief=Relief((-SHAPE_END_M, -SHAPE_END_M), heights))


def shape_heights(shape: RoadShape, xy: FloatArray) -> FloatArray:
    """(n,) z of a recording's road at places (n, 2); straight on from SHAPE_REACH_M on."""
    inside = np.minimum(1, SHAPE_REACH_M / np.maximum(np.hypot(*xy.T), 1e-9))
    x, y = (xy * inside[:, None]).T
    along_x = shape.slope_x + 2 * shape.bend_xx_per_m * x + shape.bend_xy_per_m * y
    along_y = shape.slope_y + shape.bend_xy_per_m * x + 2 * shape.bend_yy_per_m * y
    z = shape.level_m + (shape.slope_x + along_x) / 2 * x + (shape.slope_y + along_y) / 2 * y
    return np.asarray(z + along_x * (xy[:, 0] - x) + along_y * (xy[:, 1] - y))


def ground_of_roads(roads: Sequence[Road], pose: WorldPose) -> Ground:
    """At each place as high as the nearest point of a centreline."""
    xy = to_levelled(np.concatenate([road.xy for road in roads]), pose)
    z = np.concatenate([road.z for road in roads]) - pose.z
    if np.ptp(z) < LEVEL_M:
        return level_ground(float(np.median(z)))
    low, high = xy.min(axis=0) - RIM_M, xy.max(axis=0) + RIM_M
    x, y = (np.arange(low[i], high[i], CELL_M) + CELL_M / 2 for i in (0, 1))
    cells = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    _, nearest = cKDTree(xy).query(cells)
    return Ground(relief=Relief((float(low[0]), float(low[1])), z[nearest]))


def ground_of_boxes(boxes: Iterable[FloatArray]) -> Ground:
    """The plane on which vehicles (k, 7) stand, no steeper than their spread can tell.

    Raises Error if there is none.
    """
    every = np.concatenate([np.empty((0, 7)), *boxes])
    if len(every) == 0:
        raise Error("found no vehicle in the training frames, allowed one or more")
    xy, z = every[:, :2], every[:, 2] - every[:, 5] / 2
    off = np.abs(z - np.median(z))
    for _ in range(3):
        kept = off <= max(FAR_M, 2 * float(np.median(off)))
        plane = _plane(xy[kept], z[kept])
        off = np.abs(z - plane.height(every))
    return plane


def _plane(xy: FloatArray, z: FloatArray) -> Ground:
    middle, height = xy.mean(axis=0), z.mean()
    rest = xy - middle
    slopes = np.linalg.solve(rest.T @ rest + len(z) * STEADY * np.eye(2), rest.T @ (z - height))
    a, b = (float(v) for v in slopes)
    return Ground((a, b, float(height - slopes @ middle)))
