"""The road's plane below a sensor that stands still, from several frames.

The largest level plane need not be the road: fields beside it are larger, and often lower. So
planes are tried at random (RANSAC, Fischler and Bolles 1981) and the best is the one that holds
most of the ground near the sensor and most of the ground over which something moved. Roads are
higher in their middle: where two slopes that fall away from a line fit much better than a plane,
the frame is levelled to stand evenly between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, IntArray, Points

MOST_POINTS = 40_000  # of a cloud
LEAST_SHARE = 0.15  # on the best plane; less is no road
REACH_M = (2.0, 60.0)  # of the points that are looked at, from the sensor
COLUMN_M = 1.0  # in which the lowest is ground, and something moves
LOW_SHARE = 0.05  # of the points of a column that may lie below the ground
LOW_M = 0.1  # and how far
MOVED_M = 0.7  # above the lowest return of a column
MOVED_SHARE = (0.03, 0.6)  # of the frames that see the column: less is noise, more stands there
MOVED_COLUMNS = 30  # fewer say nothing
MOVED_WEIGHT = 2.0  # of the ground with traffic against that near the sensor
HALF_WEIGHT_M = 20.0  # horizontally, where ground counts half
ON_M = 0.15  # of a plane
TRIES = 1500
REFINED = 10  # of them, the best, are fitted to what lies about them before one is chosen
APART_M = 4.0  # the three points of a try
MOST_TILT_DEG = 40.0
SETTLED_DEG = 5.0  # the second fit may turn it so far
HEIGHTS_M = (-2.0, 40.0)  # of the sensor above a plane
FIT_M = 40.0  # the plane is fitted to the ground up to here
NEAR_M = 0.3  # and to what is as close to it
SOFT_M = 0.1  # Cauchy's scale of the fit
CROWN = (0.005, 0.05)  # slopes to either side
CROWN_GAIN = 0.25  # of the sum of squares that a crown must save
LEAST_ROWS = 50  # columns; fewer show no crown
LEAST_SIDE = 0.2  # of the ground that either side must have


@dataclass(frozen=True)
class RoadPlane:
    """Where the road lies, in a frame whose z is up but for the tilt of its sensor."""

    normal: tuple[float, float, float]  # unit, upwards
    height_m: float  # of the origin above it
    residual_m: float  # root mean square of the road about it, or about its crown
    share: float  # of the ground near the sensor that lies on it
    moved_share: float  # of the ground over which something moved; nan if too little did
    above: float  # share of the points within reach that stand above the ground
    crown: float = 0.0  # slope to either side; 0: none was found

    @property
    def score(self) -> float:
        moved = 0.0 if math.isnan(self.moved_share) else self.moved_share
        return self.share + MOVED_WEIGHT * moved

    @property
    def tilt(self) -> tuple[float, float]:
        """Pitch and roll (rad) of the sensor that see the road level."""
        return _tilt(*self.normal)


@dataclass(frozen=True, eq=False)
class LowestPoints:
    """What lies lowest in each column of all frames, a point a column."""

    xyz: FloatArray  # (n, 3)
    near: FloatArray  # (n,) weight
    moved: BoolArray  # (n,) something moved above it
    above: float  # share of the points that stand more than MOVED_M above their column's lowest


def road_of(clouds: Sequence[Points]) -> RoadPlane | None:
    """The road of clouds with z up, but for a tilt; None if little of the ground lies on one."""
    plane = find_plane([cloud[:: 1 + len(cloud) // MOST_POINTS] for cloud in clouds])
    return None if plane is None or plane.share < LEAST_SHARE else plane


def find_plane(
    clouds: Sequence[Floats],
    heights_m: tuple[float, float] = HEIGHTS_M,
    most_tilt_deg: float = MOST_TILT_DEG,
    *,
    crowned: bool = True,
) -> RoadPlane | None:
    """The road in clouds (k, 3 or more) of one sensor, z up but for a tilt; None if there is none.

    heights_m: allowed of the sensor above the road; crowned: whether a crown is looked for. The
    same clouds give the same plane.
    """
    xyz, frame = _within_reach(clouds)
    ground = _ground(xyz, frame, len(clouds))
    planes = _tries(ground, heights_m, most_tilt_deg)
    if len(planes) == 0:
        return None
    order = np.argsort([-_score(ground, plane) for plane in planes], kind="stable")
    refined = [_fitted(ground, planes[i]) for i in order[:REFINED]]
    inside = [plane for plane in refined if _allowed(plane, heights_m, most_tilt_deg)]
    if not inside:
        return None
    best = max(inside, key=lambda plane: _score(ground, plane))
    # Again in columns that stand upright on it: those that lean hold ground of many heights.
    turn = Rotation.from_euler("ZYX", [0, *_tilt(*best[:3])]).as_matrix()
    upright = _ground(xyz @ turn.T, frame, len(clouds))
    level = _fitted(upright, np.array([0.0, 0.0, 1.0, best[3]]))
    plane = _with_crown(upright, level, crowned=crowned)
    if math.degrees(math.acos(min(plane.normal[2], 1.0))) > SETTLED_DEG:
        return None
    x, y, z = (float(v) for v in np.array(plane.normal) @ turn)
    return replace(plane, normal=(x, y, z))


def lowest_points(clouds: Sequence[Floats]) -> LowestPoints:
    """Of clouds (k, 3 or more) of one sensor, within its reach."""
    xyz, frame = _within_reach(clouds)
    return _ground(xyz, frame, len(clouds))


def _tilt(x: float, y: float, z: float) -> tuple[float, float]:
    """Pitch and roll (rad) of a sensor that sees an upward normal so."""
    return -math.asin(x), math.atan2(y, z)


def _within_reach(clouds: Sequence[Floats]) -> tuple[FloatArray, IntArray]:
    """(n, 3), and the frame of each (n,)."""
    parts = []
    for cloud in clouds:
        xyz = cloud[:, :3].astype(np.float64)
        slant = np.linalg.norm(xyz, axis=1)  # nan and inf are out of reach
        parts.append(xyz[(slant >= REACH_M[0]) & (slant <= REACH_M[1])])
    frame = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return np.concatenate([np.empty((0, 3)), *parts]), frame


def _ground(xyz: FloatArray, frame: IntArray, frames: int) -> LowestPoints:
    if len(xyz) == 0:
        return LowestPoints(np.empty((0, 3)), np.empty(0), np.empty(0, np.bool_), 0.0)
    cell = np.floor(xyz[:, :2] / COLUMN_M).astype(np.int64)
    different, column = np.unique(cell[:, 0] * 2**20 + cell[:, 1], return_inverse=True)
    columns = len(different)
    low = _low(xyz[:, 2], column, columns)
    over = xyz[:, 2] - low[column]
    on = np.flatnonzero((over >= -LOW_M) & (over <= ON_M))
    counts = np.maximum(np.bincount(column[on], minlength=columns), 1)
    mean = [np.bincount(column[on], xyz[on, i], minlength=columns) / counts for i in range(3)]
    thin = np.column_stack(mean)
    near = 1 / (1 + (np.hypot(thin[:, 0], thin[:, 1]) / HALF_WEIGHT_M) ** 2)
    moved = _moved(over, column, frame, columns, frames)
    return LowestPoints(thin, near, moved, float((over > MOVED_M).mean()))


def _low(z: FloatArray, column: IntArray, columns: int) -> FloatArray:
    """(columns,) z that a few points are below of: single ones may lie under the road."""
    order = np.lexsort((z, column))
    counts = np.bincount(column, minlength=columns)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return np.asarray(z[order][first + (LOW_SHARE * counts).astype(np.int64)])


def _moved(
    over: FloatArray, column: IntArray, frame: IntArray, columns: int, frames: int
) -> BoolArray:
    """(columns,) in which something stands in a few of the frames that see them."""
    high = np.full(columns * frames, -np.inf)
    np.maximum.at(high, column * frames + frame, over)
    top = high.reshape(columns, frames)
    share = (top > MOVED_M).sum(axis=1) / np.isfinite(top).sum(axis=1)
    return np.asarray((share >= MOVED_SHARE[0]) & (share <= MOVED_SHARE[1]))


def _tries(
    ground: LowestPoints, heights_m: tuple[float, float], most_tilt_deg: float
) -> FloatArray:
    """Planes (m, 4) n d with n x + d = 0 through three points each, n up, d the height."""
    n = len(ground.xyz)
    if n < 3:
        return np.empty((0, 4))
    draw = np.random.default_rng(0)
    chance = ground.near**1.5 * np.where(ground.moved, 3, 1)
    three = draw.choice(n, (TRIES, 3), p=chance / chance.sum())
    a, b, c = (ground.xyz[three[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    wide = np.minimum.reduce([np.linalg.norm(v, axis=1) for v in (b - a, c - a, c - b)]) > APART_M
    good = wide & (length > APART_M**2)
    normal = normal[good] / length[good, None]
    normal *= np.where(normal[:, 2:] < 0, -1, 1)
    height = -np.einsum("ij,ij->i", normal, a[good])
    upright = normal[:, 2] >= math.cos(math.radians(most_tilt_deg))
    inside = upright & (height >= heights_m[0]) & (height <= heights_m[1])
    return np.asarray(np.column_stack([normal, height])[inside])


def _allowed(plane: FloatArray, heights_m: tuple[float, float], most_tilt_deg: float) -> bool:
    upright = plane[2] >= math.cos(math.radians(most_tilt_deg))
    return bool(upright and heights_m[0] <= plane[3] <= heights_m[1])


def _score(ground: LowestPoints, plane: FloatArray) -> float:
    share, moved = _shares(ground, plane)
    return share + (0.0 if math.isnan(moved) else MOVED_WEIGHT * moved)


def _shares(ground: LowestPoints, plane: FloatArray) -> tuple[float, float]:
    on = np.abs(ground.xyz @ plane[:3] + plane[3]) <= ON_M
    near = float(ground.near[on].sum() / ground.near.sum())
    if ground.moved.sum() < MOVED_COLUMNS:
        return near, math.nan
    weight = np.sqrt(ground.near[ground.moved])  # traffic tells also far away
    return near, float(weight[on[ground.moved]].sum() / weight.sum())


def _fitted(ground: LowestPoints, plane: FloatArray) -> FloatArray:
    """The plane through what lies about it, ever closer."""
    for near in (3 * NEAR_M, 2 * NEAR_M, NEAR_M, NEAR_M, NEAR_M):
        rows, off = _near_plane(ground, plane, near)
        x, y, z = ground.xyz[rows].T
        weight = ground.near[rows] / (1 + (off / SOFT_M) ** 2)
        a = np.column_stack([x, y, np.ones(len(x))])
        if len(x) < 3 or np.linalg.matrix_rank(a) < 3:
            continue
        root = np.sqrt(weight)
        slope = np.linalg.lstsq(a * root[:, None], z * root, rcond=None)[0]
        plane = _plane_of(*slope)
    return plane


def _plane_of(along_x: float, along_y: float, level: float) -> FloatArray:
    """n d of z = along_x x + along_y y + level."""
    normal = np.array([-along_x, -along_y, 1.0])
    length = float(np.linalg.norm(normal))
    return np.array([*(normal / length), -level / length])


def _near_plane(
    ground: LowestPoints, plane: FloatArray, near: float
) -> tuple[IntArray, FloatArray]:
    """Which points of FIT_M lie so near a plane, and how far above it they are."""
    off = ground.xyz @ plane[:3] + plane[3]
    flat = np.hypot(ground.xyz[:, 0], ground.xyz[:, 1])
    rows = np.flatnonzero((np.abs(off) <= near) & (flat <= FIT_M))
    return rows, off[rows]


def _with_crown(ground: LowestPoints, plane: FloatArray, *, crowned: bool) -> RoadPlane:
    """The plane that a crown stands evenly on, or the plane itself."""
    rows, off = _near_plane(ground, plane, NEAR_M)
    weight = ground.near[rows] / (1 + (off / SOFT_M) ** 2)
    residual = math.sqrt(float(weight @ off**2) / max(float(weight.sum()), 1e-12))
    crown, fitted = 0.0, plane
    if crowned and len(rows) >= LEAST_ROWS and (roof := _roof(ground, plane)):
        crown, fitted, residual = roof
    share, moved = _shares(ground, plane)
    x, y, z, height = (float(v) for v in fitted)
    return RoadPlane((x, y, z), height, residual, share, moved, ground.above, crown)


def _roof(ground: LowestPoints, plane: FloatArray) -> tuple[float, FloatArray, float] | None:
    """Slope to either side, the plane beneath and the residual; None where a crown fits no better.

    Fitted twice, the second time to what lies about the first.
    """
    rows, off = _near_plane(ground, plane, 2 * NEAR_M)
    xy, near = ground.xyz[rows, :2], ground.near[rows]
    modelled = np.zeros(len(rows))
    fold: FloatArray = modelled
    coefficients = np.zeros(4)
    for _ in range(2):
        weight = near / (1 + ((off - modelled) / SOFT_M) ** 2)
        best = weight @ off**2 * (1 - CROWN_GAIN)
        folds = list(_folds(xy, weight))
        costs = [_slopes(xy, off, weight, candidate) for candidate in folds]
        at = min(range(len(folds)), key=lambda i: costs[i][1], default=-1)
        if at < 0 or costs[at][1] > best:
            return None
        fold, (coefficients, _) = folds[at], costs[at]
        modelled = _columns(xy, fold) @ coefficients
    if not CROWN[0] <= -coefficients[3] <= CROWN[1]:
        return None
    weight = near / (1 + ((off - modelled) / SOFT_M) ** 2)
    residual = math.sqrt(float(weight @ (off - modelled) ** 2) / float(weight.sum()))
    lifted = _lifted(plane, coefficients, float(weight @ fold / weight.sum()))
    return -float(coefficients[3]), lifted, residual


def _folds(xy: FloatArray, weight: FloatArray) -> Iterator[FloatArray]:
    """Distances (n,) of the places (n, 2) from lines that have enough of them on either side."""
    total = float(weight.sum())
    for angle in np.radians(np.arange(0, 180, 10)):
        across = xy @ np.array([-math.sin(angle), math.cos(angle)])
        for middle in np.arange(-25.0, 25.5, 1.0):
            if LEAST_SIDE <= float(weight[across > middle].sum()) / total <= 1 - LEAST_SIDE:
                yield np.abs(across - middle)


def _columns(xy: FloatArray, fold: FloatArray) -> FloatArray:
    return np.column_stack([xy, np.ones(len(xy)), fold])


def _slopes(
    xy: FloatArray, off: FloatArray, weight: FloatArray, fold: FloatArray
) -> tuple[FloatArray, float]:
    """Slopes along x and y, level, slope away from the line; and the squares that are left."""
    a = _columns(xy, fold)
    weighted = a.T * weight
    solved = np.linalg.solve(weighted @ a + 1e-9 * np.eye(4), weighted @ off)
    coefficients = np.asarray(solved, dtype=np.float64)
    return coefficients, float(weight @ (off - a @ coefficients) ** 2)


def _lifted(plane: FloatArray, coefficients: FloatArray, mean_fold: float) -> FloatArray:
    """A plane with the slopes and level that a fit of what is above it found."""
    x, y, z, d = plane
    level = -d / z + coefficients[2] + coefficients[3] * mean_fold
    return _plane_of(-x / z + coefficients[0], -y / z + coefficients[1], level)
