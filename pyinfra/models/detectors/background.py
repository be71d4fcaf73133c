"""Background subtraction for a fixed sensor: detects vehicles without labels.

The detector uses the usual steps of roadside LiDAR. The background consists of voxels that have
points in most frames. The other points are clustered. Each cluster gets a rectangle by the L-shape
search of Zhang et al., "Efficient L-Shape Fitting for Vehicle Detection Using Laser Scanners" (IV
2017). Deviations from the paper:

- in the closeness score, all points within 0.1 m of a side count as on the side
- the heading is biased towards the directions of known roads and of vehicles at this position in
  training, because few points do not determine a heading
- all clusters and headings of a frame are searched together
- clusters may have larger gaps along the road than across it
- a rectangle that is shorter than its class is extended away from the sensor, where it is hidden
- moving points beside the roads, such as leaves, are left out if the roads are known

Limitations:

- the front and the rear of a vehicle are not distinguished, so a heading may be wrong by half a
  turn
- a vehicle that stands in most frames is background
- vehicles that touch are merged
- the height of ground that is hidden in all frames is taken from neighbouring cells or from the
  plane of the road; if no region is known, plants beside the road may raise this plane
- if no roads are known, distant vehicles side by side may be merged into a single vehicle

The detector needs neither PyTorch nor the extension.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pyinfra.core.arrays import (
    BoolArray,
    FloatArray,
    Floats,
    Int32Array,
    IntArray,
    Points,
    Rows,
    concatenated,
)
from pyinfra.core.boxes import bev_overlap
from pyinfra.core.config import ruled
from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.dataset.frames import spread
from pyinfra.dataset.ground import Ground
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors import Detections

CLASSES = ("Car", "Motorcycle", "Truck", "Bus", "Pedestrian", "Cyclist")
# Length, width and height of car, motorcycle, truck and bus, in metres.
_VEHICLE_SIZES = [[4.5, 1.9, 1.6], [2.2, 0.8, 1.4], [8.5, 2.5, 3.2], [12, 2.55, 3.2]]
SIZES = np.array([*_VEHICLE_SIZES, [0.73, 0.67, 1.77], [1.67, 0.7, 1.67]])
_CAR, _MOTORCYCLE, _TRUCK, _BUS, _PEDESTRIAN, _CYCLIST = range(6)
_LEAST_ALONE = 5  # minimum number of points of a pedestrian or cyclist

_ROAD_CELL_M = 5.0  # cell size of the grid of road directions
_KNOWN_ROAD = 1.0  # weight of a known road in the grid of directions; a vehicle has about 0.07
_THIN_M = 0.4  # cell size in which points are merged before clustering
# Headings that are tried for a rectangle, relative to the road.
_OFFSETS = np.radians(np.arange(-90, 90, 4)).astype(np.float32)
_BONNET_M = 1.2  # length of the low front or rear of a car
_ON_SIDE_M = 0.1  # points that are closer to a side of a rectangle count as on the side
_NEIGHBOUR_M = 10.0  # largest distance from which the height of hidden ground is taken
_OVERHEAD_M = 2.0  # permanent points higher than this above a road are trees, gantries or signs
_SHARED = 0.1  # two boxes are one vehicle if they share more than this part of the smaller box
_MOST = 1000  # maximum number of boxes in a frame; limits the time in heavy rain

# Exceptions of NumPy for a file that is not an .npz file, is incomplete or has other arrays.
_UNREADABLE = (ValueError, TypeError, KeyError, EOFError, ArithmeticError, BadZipFile, zlib.error)


@dataclass(frozen=True)
class Config:
    """Settings of the background subtraction and of the clustering."""

    range_m: float = ruled(120.0, 1, 1000)  # points with a larger absolute x, y or z are ignored
    cell_m: float = ruled(1.0, 0.1, 20)  # cell size of the grid of the ground
    clearance_m: float = ruled(0.15, 0, 5)  # points lower than this above ground are ground points
    ceiling_m: float = ruled(5.0, 0.1, 50)  # points higher than this above the ground are ignored
    # a voxel is background if it has points in more than this share of the frames
    permanent_share: float = ruled(0.7, 0, 1)
    # largest gap between points of a vehicle across the road; the gap grows with distance
    gap_m: float = ruled(0.8, 0.05, 10)
    # largest gap between points of a vehicle along the road; the gap grows with distance
    gap_along_m: float = ruled(1.2, 0.05, 10)
    within_region: bool = True  # whether boxes outside the roads or the outline are left out
    region_margin_m: float = ruled(1.0, 0, 20)  # margin around roads or outline for inexact boxes
    # whether small clusters become Pedestrian or Cyclist; region_margin_m must cover the footways
    people: bool = False

    def __post_init__(self) -> None:
        if self.clearance_m >= self.ceiling_m:
            clearance, top = f"{self.clearance_m:g}", f"{self.ceiling_m:g}"
            raise Error(f"clearance_m: expected less than ceiling_m ({top}), got {clearance}")


DEFAULT = Config()
MOST_FRAMES = 100  # largest number of frames from which `background_of` learns


@dataclass(frozen=True, eq=False)
class Background:
    """A detector for one site, with its ground, its permanent objects and its traffic.

    Grids are square and centred on the sensor; the first index is along x.
    """

    settings: Config
    ground: Floats  # (n, n) z of the ground, metres
    permanent: BoolArray  # (n, n, layers of 1 m above the ground) voxels of permanent objects
    region: BoolArray  # (n, n) cells in which vehicles can be; all cells if unknown
    road: Floats  # (m, m, 2) mean cos, sin of twice the heading; a shorter vector is less certain
    # (2,) coefficients of the expected number n of points of a vehicle:
    # ln n = expected[0] + expected[1] * ln distance
    expected: Floats

    @classmethod
    def learn(
        cls,
        frames: Sequence[Points],
        settings: Config = DEFAULT,
        region: Region | None = None,
        road: Ground | None = None,
    ) -> Background:
        """Learns the background of a site.

        frames: clouds (k, 4) of one fixed sensor, taken over several minutes. The ground of a cell
        must be visible in at least one frame.
        region: where vehicles can be; by default everywhere. It is ignored if the setting
        `within_region` is false. Known roads in the region influence the directions of traffic.
        road: height of the road. It is only used if it has a relief; otherwise the height is
        estimated from the frames.
        Raises Error if no frame has a point within `range_m`.
        """
        clouds = [_usable(frame, settings) for frame in frames]
        if sum(map(len, clouds)) == 0:
            raise Error(f"frames: expected points within range_m, got none in {len(clouds)} frames")
        if not settings.within_region:
            region = None
        ground = _ground(clouds, settings, road, _inside_region(region, settings, 0))
        permanent = _permanent(clouds, ground, settings)
        roads = _known_roads(region, settings)
        inside = _inside_region(region, settings, settings.region_margin_m)
        no_expected = np.zeros(2, np.float32)
        background = cls(settings, ground, permanent, inside, _mean_direction(roads), no_expected)
        for _ in range(2):  # the second pass uses learnt directions, which separate clusters better
            rectangles = concatenated([background._rectangles(cloud) for cloud in clouds])
            background = replace(
                background, road=_road(rectangles, roads), expected=_expected(rectangles)
            )
        return background

    def predict(self, points: Points) -> Detections:
        """Returns the boxes in a cloud, as `Detector.predict` does."""
        rectangles = self._rectangles(_usable(points, self.settings))
        kinds = _kinds(rectangles, self.settings)
        boxes = _boxes(rectangles, kinds)
        scores = _scores(rectangles, kinds, self.expected)
        keep = _without_overlap(boxes, scores)
        return Detections(boxes[keep], scores[keep], np.array(CLASSES)[kinds[keep]])

    def moving(self, points: Points) -> Floats:
        """Returns the points that are not background, inside and outside the region: (m, 3).

        points: as in `predict`.
        """
        cloud = _usable(points, self.settings)
        return cloud[self._moving(cloud)[0]]

    def save(self, file: Path, frames_version: str = "") -> None:
        """Writes the arrays as a .npz file of NumPy.

        frames_version: that of the training frames; empty if the frames were recorded.
        """
        with replacing(file) as beside, beside.open("wb") as stream:
            np.savez_compressed(
                stream,
                settings=_numbers(self.settings),
                ground=self.ground,
                permanent=self.permanent,
                region=self.region,
                road=self.road,
                expected=self.expected,
                frames_version=np.array(frames_version),
            )

    @classmethod
    def load(cls, file: Path) -> Background:
        """Reads a file that `save` wrote. Raises Error if it is not a background model."""
        try:
            with file.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
                contents = [data[f.name] for f in fields(cls)]
            background = cls(_settings(contents[0]), *contents[1:])
            background._check()
        except _UNREADABLE as error:
            raise Error(
                f"{file}: expected a background model, got a file that cannot be read as one: "
                f"{error}"
            ) from error
        return background

    def _check(self) -> None:
        """Raises Error if the shapes or types of the arrays differ from those of `learn`."""
        s = self.settings
        n, m = _cells(s), _road_cells(s)
        allowed = {
            "ground": ((n, n), np.float32),
            "permanent": ((n, n, _layers(s)), np.bool_),
            "region": ((n, n), np.bool_),
            "road": ((m, m, 2), np.float32),
            "expected": ((2,), np.float32),
        }
        for name, (shape, kind) in allowed.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype != kind:
                raise Error(
                    f"{name}: expected an array of shape {shape} and type {np.dtype(kind)}, got "
                    f"shape {array.shape} and type {array.dtype}"
                )
            if not np.isfinite(array).all():
                raise Error(f"{name}: expected finite values, got NaN or inf")

    def _moving(self, cloud: Floats) -> tuple[IntArray, Floats]:
        """Returns the indices of points (k, 3) that are not background.

        The second result is the height of each point above the ground: (k,).
        """
        s = self.settings
        cell = _cell(cloud, s)
        height = cloud[:, 2] - self.ground.reshape(-1).take(cell)
        high = np.flatnonzero((height > s.clearance_m) & (height < s.ceiling_m))
        layer = height[high].astype(np.int32)
        moves = ~self.permanent.reshape(-1).take(cell[high] * _layers(s) + layer)
        return high[moves], height

    def _rectangles(self, cloud: Floats) -> _Rectangles:
        """Returns the clusters in the region; cloud: (k, 3) usable points."""
        s = self.settings
        high, height = self._moving(cloud)
        rectangles = _fit(cloud.take(high, axis=0), height.take(high), self.road, s)
        centre = _boxes(rectangles, _kinds(rectangles, s))[:, :2]
        return rectangles.select(self.region.reshape(-1).take(_cell(centre, s)))


def background_of(
    clouds: Sequence[Callable[[], Points]],
    region: Region | None,
    ground: Ground | None,
    settings: Config = DEFAULT,
) -> Background:
    """Learns the background of a site from at most MOST_FRAMES of its clouds, evenly spread.

    clouds: functions that each read a cloud (k, 4). Other arguments and errors: see
    `Background.learn`.
    """
    chosen = spread(range(len(clouds)), MOST_FRAMES)
    return Background.learn([clouds[i]() for i in chosen], settings, region, ground)


@dataclass(frozen=True, eq=False)
class _Rectangles(Rows):
    """Clusters with the rectangles around their points, in axes turned by the heading."""

    heading: Floats  # (c,) heading of each rectangle
    low: Floats  # (c, 2) minimum coordinates ahead and to the left
    high: Floats  # (c, 2) maximum coordinates ahead and to the left
    bottom: Floats  # (c,) z of the ground below the cluster
    lowest: Floats  # (c,) height of the lowest point above the ground
    height: Floats  # (c,) height of the highest point above the ground
    count: Floats  # (c,) number of points of the cluster

    @property
    def size(self) -> Floats:
        """(c, 2) length and width of the visible part."""
        return np.asarray(self.high - self.low)

    @property
    def centre(self) -> Floats:
        """(c, 2) x y in the levelled LiDAR frame, metres."""
        return _turned((self.low + self.high) / 2, self.heading)

    @property
    def distance(self) -> Floats:
        """(c,) horizontal distance from the sensor, at least 1 m."""
        ahead, left = ((self.low + self.high) / 2).T
        return np.asarray(np.maximum(np.hypot(ahead, left), 1))


def _usable(points: Points, s: Config) -> Floats:
    """Returns x y z of the points (n, 4) that are finite and in range: (k, 3).

    Raises Error for an array of another shape.
    """
    if points.ndim != 2 or points.shape[1] != 4:
        raise Error(f"points: expected (n, 4), got {points.shape}")
    x, y, z = (np.abs(points[:, axis]) < s.range_m for axis in range(3))  # NaN gives False
    good = x & y & z
    return points[:, :3].take(np.flatnonzero(good), axis=0).astype(np.float32, copy=False)


def _cells(s: Config) -> int:
    return int(np.ceil(2 * s.range_m / s.cell_m))


def _layers(s: Config) -> int:
    return int(np.ceil(s.ceiling_m))


def _road_cells(s: Config) -> int:
    return int(np.ceil(2 * s.range_m / _ROAD_CELL_M))


def _numbers(settings: Config) -> FloatArray:
    """Returns the settings as numbers for the .npz file.

    If `people` is false, its number is left out, so that the file is the same as in earlier
    versions.
    """
    numbers = np.array(astuple(settings))
    return numbers if settings.people else numbers[:-1]


def _settings(values: FloatArray) -> Config:
    most = len(fields(Config))
    if values.shape not in ((most,), (most - 1,)):
        raise Error(f"settings: expected {most - 1} or {most} numbers, got shape {values.shape}")
    pairs = zip(fields(Config), values, strict=False)
    return Config(**{f.name: type(getattr(DEFAULT, f.name))(value) for f, value in pairs})


def _cell(cloud: Floats, s: Config) -> Int32Array:
    """Returns the index of each point's cell in the grid of the ground, row by row: (k,).

    Points outside the grid get the nearest cell at the edge of the grid.
    """
    index = ((cloud[:, :2] + np.float32(s.range_m)) * np.float32(1 / s.cell_m)).astype(np.int32)
    np.clip(index, 0, _cells(s) - 1, out=index)
    return index[:, 0] * np.int32(_cells(s)) + index[:, 1]


def _centres(s: Config) -> tuple[Floats, Floats]:
    """Returns x (n, 1) and y (1, n) of the centres of the ground's cells."""
    centres = ((np.arange(_cells(s)) + 0.5) * s.cell_m - s.range_m).astype(np.float32)
    return centres[:, None], centres[None]


def _cell_positions(s: Config) -> FloatArray:
    """Returns x, y of the centres of the ground's cells, row by row: (n * n, 2)."""
    n = _cells(s)
    x, y = (np.broadcast_to(a, (n, n)).ravel() for a in _centres(s))
    return np.column_stack([x, y]).astype(np.float64)


def _inside_region(region: Region | None, s: Config, margin_m: float) -> BoolArray:
    """Returns which cells have their centre in the region or its margin: (n, n)."""
    n = _cells(s)
    if region is None:
        return np.ones((n, n), np.bool_)
    return region.holds(_cell_positions(s), margin_m).reshape(n, n)


def _ground(clouds: Sequence[Floats], s: Config, road: Ground | None, inside: BoolArray) -> Floats:
    """Returns z of the ground in each cell: (n, n).

    z is that of the lowest return of a cell, if this return is from the ground. A return is not
    from the ground if it is well above the road and the cell has no return in most frames. Inside
    the region, permanent returns far above the road are not from the ground either. A cell without
    a ground return gets z of a neighbour or of the road. The height of the road is the relief of
    `road` if it is known, else a fitted plane. inside: (n, n) cells in the region; all cells if the
    region is unknown.
    """
    n = _cells(s)
    lowest = np.full(n * n, np.inf, np.float32)
    frames_with_return = np.zeros(n * n, np.int32)
    for cloud in clouds:
        cell = _cell(cloud, s)
        np.minimum.at(lowest, cell, cloud[:, 2])
        frames_with_return += np.bincount(cell, minlength=n * n) > 0
    z = lowest.reshape(n, n)
    share = (frames_with_return / len(clouds)).reshape(n, n)
    if road is not None and road.relief is not None:
        plane = road.height(_cell_positions(s)).reshape(n, n).astype(np.float32)
    else:
        # Plants and slopes beside the road have returns in all frames, and distant lanes in few
        # frames. Therefore cells outside the region are left out of the fit.
        trusted = inside & (frames_with_return > 0).reshape(n, n)
        plane = _plane(z, np.where(trusted, share, 0) if trusted.any() else share, s)
    stays = share > s.permanent_share
    if not inside.all():
        stays &= ~inside | (z < plane + _OVERHEAD_M)
    real = stays | (z < plane + s.clearance_m) | (z == z.min())
    # Permanent objects beside the road, such as tree crowns, must not affect the ground of the
    # road.
    return np.where(inside, _filled(z, real & inside, plane, s), _filled(z, real, plane, s))


def _filled(z: Floats, real: BoolArray, plane: Floats, s: Config) -> Floats:
    """Returns z of the nearest cell in `real`, or of the plane if no such cell is near: (n, n)."""
    if not real.any():
        return plane
    apart, (i, j) = distance_transform_edt(~real, s.cell_m, return_indices=True)
    return np.where(apart <= _NEIGHBOUR_M, z[i, j], plane).astype(np.float32)


def _plane(lowest: Floats, share: Floats, s: Config) -> Floats:
    """Returns z of a plane, fitted robustly to the lowest returns of cells: (n, n).

    share: (n, n) share of the frames with a return in a cell, used as the weight of the cell.
    Returns above the plane, such as returns from vehicles, have less weight.
    """
    x, y = (np.broadcast_to(a, lowest.shape) for a in _centres(s))
    has_return = share > 0
    distance = np.hypot(x, y)[has_return]
    a = np.stack([x[has_return], y[has_return], np.ones(has_return.sum())], axis=1).astype(
        np.float64
    )
    z, trust = lowest[has_return].astype(np.float64), share[has_return].astype(np.float64) ** 2
    near = distance <= max(45, distance.min())
    order = np.argsort(z[near])
    total = np.cumsum(trust[near][order])
    fit = np.array([0, 0, z[near][order][np.searchsorted(total, total[-1] / 2)]])
    for reach in np.minimum(s.range_m * 1.5, [45, 45, 45, 45, 80, 80, 200, 200]):
        above = z - a @ fit
        # The fit uses Cauchy weights and a weak prior for level ground. The prior only matters if
        # few cells are known.
        weight = trust * (distance <= reach) / (1 + (above / 0.2) ** 2)
        weight *= np.where(above > 0, 0.2, 1)
        normal = a.T @ (a * weight[:, None]) + np.diag([1.0, 1.0, 1e-6])
        fit = np.linalg.solve(normal, a.T @ (z * weight) + [0, 0, 1e-6 * fit[2]])
    return np.asarray(fit[0] * x + fit[1] * y + fit[2], dtype=np.float32)


def _permanent(clouds: Sequence[Floats], ground: Floats, s: Config) -> BoolArray:
    """Returns which voxels have a return in most frames: (n, n, layers)."""
    n, layers = _cells(s), _layers(s)
    frames_with_return = np.zeros(n * n * layers, np.int32)
    for cloud in clouds:
        cell = _cell(cloud, s)
        height = cloud[:, 2] - ground.reshape(-1).take(cell)
        high = (height > s.clearance_m) & (height < s.ceiling_m)
        voxel = cell[high] * layers + height[high].astype(np.int32)
        frames_with_return[np.unique(voxel)] += 1
    return np.asarray(frames_with_return > s.permanent_share * len(clouds)).reshape(n, n, layers)


def _known_roads(region: Region | None, s: Config) -> FloatArray:
    """Returns the directions of the region's roads as votes (m, m, 3), for `_road`.

    A vote is a weight times (cos, sin of twice the heading, 1). The weight is almost 0 where no
    road is known and where several roads cross.
    """
    cells = _road_cells(s)
    votes = np.full((cells, cells, 3), 1e-6) * [0, 0, 1]
    if region is not None and region.axes is not None:
        centres = (np.arange(cells) - cells // 2 + 0.5) * _ROAD_CELL_M
        positions = np.stack(np.meshgrid(centres, centres, indexing="ij"), axis=-1)
        sin, cos = region.axes(positions.reshape(-1, 2)).T.reshape(2, cells, cells)
        votes += _KNOWN_ROAD * np.stack([cos, sin, np.hypot(cos, sin)], axis=-1)
    return votes


def _mean_direction(votes: FloatArray) -> Floats:
    """Returns the mean direction (m, m, 2) of votes (m, m, 3)."""
    return (votes[..., :2] / votes[..., 2:]).astype(np.float32)


def _road(rectangles: _Rectangles, roads: FloatArray) -> Floats:
    """Returns the mean cos, sin of twice the heading of roads and long clusters: (m, m, 2).

    The vector is shorter where headings differ. roads: (m, m, 3) votes of known roads. A small
    number of votes is not reliable at large distances. There, a cluster is usually only the rear of
    a vehicle, or two vehicles side by side.
    """
    cells = len(roads)
    length, width = rectangles.size.T
    sure = (length > 3) & (width < 3) & (length > 1.4 * width) & (rectangles.count >= 8)
    i, j = _road_cell(rectangles.centre[sure], cells)
    votes = np.zeros((cells, cells, 3))
    turn = 2 * rectangles.heading[sure]
    vote = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=1)
    np.add.at(votes, (i, j), vote)
    # Many votes are smoothed over a small area, few votes over a large area.
    smooth = roads.copy()
    for share, cells_wide in [(1, 1.5), (0.02, 4), (1e-4, 10)]:
        smooth += share * gaussian_filter(votes, (cells_wide, cells_wide, 0), mode="constant")
    return _mean_direction(smooth)


def _road_cell(xy: Floats, cells: int) -> tuple[IntArray, IntArray]:
    index = np.floor(xy / _ROAD_CELL_M).astype(np.int64) + cells // 2
    i, j = np.clip(index, 0, cells - 1).T
    return i, j


def _expected(rectangles: _Rectangles) -> Floats:
    """Returns intercept and slope of a line: ln points over ln distance of the clusters, (2,).

    A weak prior pulls the slope towards -1.5. The prior only matters if there are few clusters, or
    if all clusters are at one distance.
    """
    good = rectangles.count >= 2
    x, y = np.log(rectangles.distance[good]), np.log(rectangles.count[good])
    if len(x) == 0:
        return np.array([np.log(2e4), -1.5], np.float32)
    slope = (np.sum((x - x.mean()) * (y - y.mean())) - 1.5) / (np.sum((x - x.mean()) ** 2) + 1)
    return np.array([y.mean() - slope * x.mean(), slope], np.float32)


def _fit(cloud: Floats, height: Floats, road: Floats, s: Config) -> _Rectangles:
    """Returns the clusters of a cloud (k, 3). height: (k,) heights above the ground, metres."""
    if len(cloud) == 0:
        none = np.empty(0, np.float32)
        pair = np.empty((0, 2), np.float32)
        return _Rectangles(none, pair, pair, none, none, none, none)
    thin, thin_of = _thinned(cloud)
    label = _clusters(thin, road, s)
    order = np.argsort(label, kind="stable")
    heading = _headings(thin[order], label[order], road)
    label = label[thin_of]
    order = np.argsort(label, kind="stable")
    start = np.flatnonzero(np.diff(label[order], prepend=-1))
    in_axes = _turned(cloud[order, :2], -heading[label[order]])
    height = height[order]
    return _Rectangles(
        heading=heading,
        low=np.minimum.reduceat(in_axes, start),
        high=np.maximum.reduceat(in_axes, start),
        bottom=np.minimum.reduceat(cloud[order, 2] - height, start),
        lowest=np.minimum.reduceat(height, start),
        height=np.maximum.reduceat(height, start),
        count=np.diff(start, append=len(cloud)).astype(np.float32),
    )


def _thinned(cloud: Floats) -> tuple[Floats, IntArray]:
    """Merges the points in each cell of _THIN_M.

    Returns the mean x, y of each cell (t, 2), and the index of each point's cell (k,).
    """
    cell = np.floor(cloud[:, :2] / np.float32(_THIN_M)).astype(np.int64)
    _, owner, count = np.unique(
        cell[:, 0] * 1_000_000 + cell[:, 1], return_inverse=True, return_counts=True
    )
    mean = [np.bincount(owner, cloud[:, axis]) / count for axis in (0, 1)]
    return np.stack(mean, axis=1).astype(np.float32), owner


def _clusters(xy: Floats, road: Floats, s: Config) -> Int32Array:
    """Returns the cluster of each point, numbered from 0: (t,).

    Two points are in one cluster if one point lies in an ellipse around the other. The ellipse is
    elongated along the road. It grows with the distance from the sensor, because the gaps between
    rays grow. If the direction of the road is unknown, the ellipse is a circle.
    """
    distance = np.hypot(xy[:, 0], xy[:, 1])
    grow = 1 + distance / np.float32(100)
    reach = max(s.gap_along_m, s.gap_m) * float(grow.max())
    i, j = cKDTree(xy).query_pairs(reach, output_type="ndarray").T
    x, y = (xy[i] - xy[j]).T
    cos, sin = road[_road_cell(xy, len(road))].T
    squared = x * x + y * y
    # `along` and `across` are the components of the step between two points, relative to the road.
    # `tilt` is along^2 - across^2, multiplied by the certainty of the road's direction.
    tilt = (x * x - y * y) * cos[i] + 2 * x * y * sin[i]
    size = (squared + tilt) / (2 * s.gap_along_m**2) + (squared - tilt) / (2 * s.gap_m**2)
    near = size < grow[i] ** 2
    shape = (len(xy), len(xy))
    graph = coo_array((np.ones(near.sum(), np.int8), (i[near], j[near])), shape)
    labels: Int32Array = connected_components(graph, directed=False)[1]
    return labels


def _headings(xy: Floats, label: Int32Array, road: Floats) -> Floats:
    """Returns the best heading of each cluster: (c,). xy (t, 2) is ordered by label (t,)."""
    start = np.flatnonzero(np.diff(label, prepend=-1))
    count = np.diff(start, append=len(xy))
    mean = np.add.reduceat(xy, start) / count[:, None].astype(np.float32)
    along = road[_road_cell(mean, len(road))]
    heading = np.arctan2(along[:, 1], along[:, 0])[:, None] / 2 + _OFFSETS  # headings (c, h)
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = (xy - mean[label]).T[..., None]
    ahead = x * cos[label] + y * sin[label]  # coordinates (t, h)
    left = y * cos[label] - x * sin[label]
    inside_ahead, _ = _inside(ahead, start, label)
    inside_left, width = _inside(left, start, label)
    off = np.maximum(np.minimum(inside_ahead, inside_left), np.float32(_ON_SIDE_M))
    close = np.add.reduceat(np.float32(_ON_SIDE_M) / off, start) / (count[:, None] + 5)
    usual = along[:, :1] * np.cos(2 * heading) + along[:, 1:] * np.sin(2 * heading)
    score = close + usual - 0.03 * width - 0.2 * np.maximum(width - 3, 0)
    best: Floats = np.take_along_axis(heading, score.argmax(1)[:, None], axis=1)[:, 0]
    return best


def _inside(at: Floats, start: IntArray, label: Int32Array) -> tuple[Floats, Floats]:
    """Returns the distance of each point from the nearer end of its cluster, and cluster extents.

    Distances (t, h) and extents (c, h) are measured along one axis, for h headings. at: (t, h)
    coordinates of the points along this axis.
    """
    low, high = np.minimum.reduceat(at, start), np.maximum.reduceat(at, start)
    return np.minimum(at - low[label], high[label] - at), high - low


def _turned(xy: Floats, heading: Floats) -> Floats:
    """Returns points (n, 2), turned about the sensor by the headings (n,) in radians."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack([cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]], axis=1)


def _kinds(rectangles: _Rectangles, s: Config) -> IntArray:
    """Returns the index in CLASSES of each cluster: (c,)."""
    length, width = rectangles.size.T
    kinds = np.full(len(length), _CAR)
    kinds[(width < 1.1) & (length < 3.2) & (rectangles.count >= 8)] = _MOTORCYCLE
    if s.people:
        upright = (
            (rectangles.count >= _LEAST_ALONE)
            & (rectangles.height > 0.9)
            & (rectangles.height < 2.2)
        )
        kinds[upright & (width < 1.1) & (length < 2.1)] = _CYCLIST
        kinds[upright & (width < 1) & (length < 1)] = _PEDESTRIAN
    kinds[(rectangles.height > 2.4) | (length > 7)] = _TRUCK
    kinds[length > 9.5] = _BUS
    return kinds


def _boxes(rectangles: _Rectangles, kinds: IntArray) -> FloatArray:
    """Returns the boxes of clusters: (c, 7).

    Rectangles are extended to the size of their class on the side away from the sensor.
    """
    missing = np.maximum(SIZES[kinds, :2] - rectangles.size, 0)
    # If the sensor is beside a vehicle, front and rear are equally far and are both extended.
    away = np.clip((rectangles.low + rectangles.high) / 2 / SIZES[kinds, :2], -1, 1)
    # If only the cabin has points, the rays passed above the bonnet, which is nearer to the sensor.
    over = np.where(kinds == _CAR, np.clip(2 * rectangles.lowest - 1, 0, 1), 0)
    nearer = np.minimum(over[:, None] * [_BONNET_M, 0], missing)
    middle = (rectangles.low + rectangles.high) / 2 + away * (missing / 2 - nearer)
    centre = _turned(middle, rectangles.heading)
    tall = np.maximum(rectangles.height, SIZES[kinds, 2])
    heading = (rectangles.heading + np.pi) % (2 * np.pi) - np.pi
    z = rectangles.bottom + tall / 2
    return np.column_stack([centre, z, rectangles.size + missing, tall, heading]).astype(np.float64)


def _scores(rectangles: _Rectangles, kinds: IntArray, expected: Floats) -> FloatArray:
    """Returns scores in [0.1, 1]: (c,).

    A score rises with the ratio of the number of points to the expected number. It falls if the
    cluster is much longer or wider than its class. expected: as in `Background`.
    """
    ratio = rectangles.count / np.exp(expected[0] + expected[1] * np.log(rectangles.distance))
    excess = np.maximum(rectangles.size - SIZES[kinds, :2] - [1.5, 0.5], 0).sum(1)
    return np.asarray(0.1 + 0.9 * ratio / (ratio + 0.3) * np.exp(-excess), dtype=np.float64)


def _without_overlap(boxes: FloatArray, scores: FloatArray) -> IntArray:
    """Returns the indices of at most _MOST boxes, best first.

    Boxes are removed if they overlap a remaining box of a higher score by more than _SHARED.
    """
    order = np.argsort(-scores, kind="stable")[:_MOST]
    best = boxes[order]
    area = best[:, 3] * best[:, 4]
    overlap = bev_overlap(best, best) > _SHARED * np.minimum(area[:, None], area)
    keep = np.ones(len(order), bool)
    for k, over in enumerate(overlap):
        if keep[k]:
            keep[k + 1 :] &= ~over[k + 1 :]
    return order[keep]
