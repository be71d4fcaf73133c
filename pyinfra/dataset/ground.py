"""Height of the road around a LiDAR as a function of x and y, in the levelled LiDAR frame.

The input points of networks have z measured from the local road. The z of predicted boxes is then
converted back to the LiDAR frame. A network trained with a 5 m pole on level ground therefore also
works with an 8 m pole and on a slope. The height that a user gives for a sensor is checked against
the road in the clouds.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.errors import Error
from pyinfra.dataset.frames import data_set_of
from pyinfra.dataset.road_plane import road_of
from pyinfra.dataset.roads import Road, read_roads
from pyinfra.dataset.world_frame import to_levelled
from pyinfra.formats import kitti
from pyinfra.formats.kitti import RoadShape, WorldPose

F = TypeVar("F", bound=np.floating[Any])  # number type, float32 for points and float64 for boxes

MOST_HEIGHT_M = 100.0  # largest height of a sensor above the road that a user may give
CELL_M = 1.0  # cell size of a relief, equal to the point spacing of road centrelines
RIM_M = 20.0  # margin of a relief around the centrelines
LEVEL_M = 0.01  # roads whose z varies by less than this are treated as level
# Ridge term of the plane fit, in m2. It has little effect if the standard deviation of vehicle
# positions is much larger than 4 m, the square root of the term.
STEADY = 16.0
FAR_M = 0.5  # vehicles farther than this from the plane may be outliers of the fit
SHAPE_REACH_M = 60.0  # a recording's road shape is quadratic up to this radius, then linear
SHAPE_END_M = 150.0  # half width of the relief that is computed from a road shape
CHECKED = 5  # number of clouds in which the height of the road is measured
# Difference between given and measured sensor height above which there is a warning. It is larger
# than the random height errors in the training of the pretrained detector v3.
HEIGHT_OFF_M = 0.2
# Tilt above which there is a warning. The pretrained detector v3 lost 3 to 9 AP at a tilt of 0.25
# degrees, and 8 to 25 AP at 0.5 degrees.
LEAN_DEG = 0.3


@dataclass(frozen=True, eq=False)
class Relief:
    """Road heights in a grid of cells of CELL_M, in the levelled LiDAR frame."""

    corner: tuple[float, float]  # lowest x and y of the grid, metres
    # Height of each cell (cells along x, cells along y), metres. Positions outside the grid have
    # the height of the nearest cell.
    heights: FloatArray

    def height(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        last = np.array(self.heights.shape) - 1
        x, y = (
            np.clip((positions[:, i] - self.corner[i]) / CELL_M, 0, last[i]).astype(np.intp)
            for i in (0, 1)
        )
        return np.asarray(self.heights[x, y], positions.dtype)


@dataclass(frozen=True, eq=False)
class Ground:
    """Height z of the road, given by the relief if there is one, else by the plane."""

    plane: tuple[float, float, float] = (0.0, 0.0, 0.0)  # coefficients a, b, c of z = a x + b y + c
    relief: Relief | None = None

    def height(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        """Returns z of the road (n,) at finite positions (n, 2 or more).

        The dtype is the dtype of the positions.
        """
        if self.relief is not None:
            return self.relief.height(positions)
        a, b, c = np.array(self.plane, positions.dtype)
        return np.asarray(a * positions[:, 0] + b * positions[:, 1] + c)

    @property
    def sensor_m(self) -> float:
        """Height of the sensor above the road directly below it."""
        return -float(self.height(np.zeros((1, 2)))[0])

    def above(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        """Returns a copy of points or boxes (n, 3 or more) with z measured from the road."""
        return self._moved(positions, -1)

    def back(self, positions: npt.NDArray[F]) -> npt.NDArray[F]:
        """Returns a copy with z measured from the sensor. This is the inverse of `above`."""
        return self._moved(positions, 1)

    def _moved(self, positions: npt.NDArray[F], sign: int) -> npt.NDArray[F]:
        moved = positions.copy()
        # Non-finite positions stay unchanged, because no detector uses them.
        known = np.isfinite(positions[:, 0]) & np.isfinite(positions[:, 1])
        rows = slice(None) if known.all() else known
        moved[rows, 2] += sign * self.height(positions[rows])
        return moved


def level_ground(z: float) -> Ground:
    return Ground((0.0, 0.0, z))


def ground_of(lidar_folder: Path) -> Ground | None:
    """Returns the ground of a LiDAR's folder, or None if it is unknown.

    The ground follows roads.csv of the data set. For a recording without roads.csv, the ground
    follows the road shape in lidar.yaml. Without a road shape, the ground is level at the sensor
    height in lidar.yaml. Raises FormatError.
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
    """Returns z (n,) of a road shape at positions (n, 2).

    Beyond the radius SHAPE_REACH_M, the surface continues linearly.
    """
    inside = np.minimum(1, SHAPE_REACH_M / np.maximum(np.hypot(*xy.T), 1e-9))
    x, y = (xy * inside[:, None]).T
    along_x = shape.slope_x + 2 * shape.bend_xx_per_m * x + shape.bend_xy_per_m * y
    along_y = shape.slope_y + shape.bend_xy_per_m * x + 2 * shape.bend_yy_per_m * y
    z = shape.level_m + (shape.slope_x + along_x) / 2 * x + (shape.slope_y + along_y) / 2 * y
    return np.asarray(z + along_x * (xy[:, 0] - x) + along_y * (xy[:, 1] - y))


def ground_of_roads(roads: Sequence[Road], pose: WorldPose) -> Ground:
    """Returns a ground that has, at each position, the height of the nearest centreline point."""
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
    """Fits a plane to the bottoms of the vehicles in all frames.

    `boxes` contains the boxes (k, 7) of each frame. If the vehicles are too close together to
    determine the slope of the plane, the slope is kept small. Raises Error if there is no vehicle.
    """
    all_boxes = np.concatenate([np.empty((0, 7)), *boxes])
    if len(all_boxes) == 0:
        raise Error("expected one or more labelled vehicles in the training frames, got none")
    xy, z = all_boxes[:, :2], all_boxes[:, 2] - all_boxes[:, 5] / 2
    off = np.abs(z - np.median(z))
    for _ in range(3):
        kept = off <= max(FAR_M, 2 * float(np.median(off)))
        plane = _plane(xy[kept], z[kept])
        off = np.abs(z - plane.height(all_boxes))
    return plane


def _plane(xy: FloatArray, z: FloatArray) -> Ground:
    middle, height = xy.mean(axis=0), z.mean()
    rest = xy - middle
    slopes = np.linalg.solve(rest.T @ rest + len(z) * STEADY * np.eye(2), rest.T @ (z - height))
    a, b = (float(v) for v in slopes)
    return Ground((a, b, float(height - slopes @ middle)))


def check_height(height_m: float) -> None:
    """Raises Error for an implausible height of a sensor above the road."""
    if not 0 < height_m <= MOST_HEIGHT_M:
        raise Error(f"height_m: expected more than 0, at most {MOST_HEIGHT_M:g}, got {height_m:g}")


def height_warnings(clouds: Sequence[Points], height_m: float) -> Iterator[str]:
    """Yields warnings if the road in the clouds contradicts the given height, or is tilted.

    Height and tilt matter because networks depend on the height of points above the road. Each
    cloud is (n, 4), in the levelled LiDAR frame. Yields nothing if the clouds show too little
    ground.
    """
    road = road_of(clouds)
    if road is None:
        return
    if abs(road.height_m - height_m) > HEIGHT_OFF_M:
        yield (
            f"`height_m` is {height_m:g} m, but the road in the clouds is {road.height_m:.2f} m "
            "below the sensor"
        )
    lean = math.degrees(math.hypot(*road.tilt))
    if lean > LEAN_DEG:
        yield (
            f"the sensor is tilted by {lean:.1f} degrees relative to the road; `pyinfra import` "
            "levels clouds"
        )
