"""Estimates the road plane below a stationary sensor from several frames.

The largest plane need not be the road, because fields beside the road are larger and often lower.
The estimate therefore tests random planes (RANSAC, Fischler and Bolles 1981). The best plane
contains most of the ground near the sensor and most of the ground over which objects moved.

Many roads are crowned, that is, higher in their middle. A crown is modelled as two slopes that
fall away from a line. If a crown fits much better than a plane, the result is the mean plane of
its two slopes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import BoolArray, FloatArray, Floats, IntArray, Points

MOST_POINTS = 40_000  # clouds with more points are thinned
LEAST_SHARE = 0.15  # minimum share of the ground that lies on the best plane
REACH_M = (2.0, 60.0)  # minimum and maximum slant range of the points that are used
COLUMN_M = 1.0  # side of the vertical columns in which ground and motion are determined
LOW_SHARE = 0.05  # share of a column's points that may lie below its ground
LOW_M = 0.1  # points more than this below the ground of their column are ignored
MOVED_M = 0.7  # height above a column's ground from which a return is an object
# Minimum and maximum share of the frames in which a column with motion contains an object. Below
# the minimum the object is noise; above the maximum it is static.
MOVED_SHARE = (0.03, 0.6)
MOVED_COLUMNS = 30  # minimum number of columns with motion for `moved_share`
MOVED_WEIGHT = 2.0  # weight of `moved_share` relative to `share` in the score of a plane
HALF_WEIGHT_M = 20.0  # horizontal distance at which ground has half the weight of ground at 0 m
ON_M = 0.15  # ground within this distance of a plane is part of the plane
TRIES = 1500  # number of random planes
REFINED = 10  # number of best random planes that are fitted to the ground
APART_M = 4.0  # minimum distance between the three points of a random plane
MOST_TILT_DEG = 40.0
SETTLED_DEG = 5.0  # maximum rotation of the plane by the second fit
HEIGHTS_M = (-2.0, 40.0)  # allowed height of the sensor above a plane
FIT_M = 40.0  # horizontal distance up to which a plane is fitted to the ground
NEAR_M = 0.3  # a fit uses ground within this distance of the plane
SOFT_M = 0.1  # scale of the fit's Cauchy weights
CROWN = (0.005, 0.05)  # minimum and maximum slope of a road on both sides of its crown
CROWN_GAIN = 0.25  # minimum share by which a crown must reduce the sum of squared residuals
LEAST_ROWS = 50  # minimum number of columns to which a crown is fitted
LEAST_SIDE = 0.2  # minimum share of the ground that lies on each side of a crown


@dataclass(frozen=True)
class RoadPlane:
    """The road plane in the frame of a sensor, whose z axis points up apart from its tilt."""

    normal: tuple[float, float, float]  # unit normal of the plane, upwards
    height_m: float  # height of the origin above the plane
    residual_m: float  # root mean square distance of the ground from the plane or the crown
    share: float  # weighted share of the ground near the sensor that lies on the plane
    # Weighted share of the ground below moving objects that lies on the plane. NaN if there is too
    # little ground below moving objects.
    moved_share: float
    above: float  # share of the used points that are more than MOVED_M above the ground
    crown: float = 0.0  # slope on both sides of the crown; 0 without a crown

    @property
    def score(self) -> float:
        moved = 0.0 if math.isnan(self.moved_share) else self.moved_share
        return self.share + MOVED_WEIGHT * moved

    @property
    def tilt(self) -> tuple[float, float]:
        """Pitch and roll (rad) of the sensor relative to the road."""
        return _tilt(*self.normal)


@dataclass(frozen=True, eq=False)
class LowestPoints:
    """The ground point of each column, averaged over the lowest points of all frames."""

    xyz: FloatArray  # (n, 3) positions of the ground points, metres
    near: FloatArray  # (n,) weight of each point, which decreases with distance
    moved: BoolArray  # (n,) whether an object moved above the point
    above: float  # share of all points that are more than MOVED_M above their column's ground


def road_of(clouds: Sequence[Points]) -> RoadPlane | None:
    """Returns the road plane in clouds of one sensor, or None if too little ground lies on it.

    The z axis of the clouds points up, apart from the sensor's tilt.
    """
    plane = find_plane([cloud[:: 1 + len(cloud) // MOST_POINTS] for cloud in clouds])
    return None if plane is None or plane.share < LEAST_SHARE else plane


def find_plane(
    clouds: Sequence[Floats],
    heights_m: tuple[float, float] = HEIGHTS_M,
    most_tilt_deg: float = MOST_TILT_DEG,
    *,
    crowned: bool = True,
) -> RoadPlane | None:
    """Finds the road in clouds (k, 3 or more) of one sensor.

    The z axis of the clouds points up, apart from the sensor's tilt. `heights_m` is the allowed
    range of the sensor's height above the road. `crowned` states whether to search for a crown.
    Returns None if no plane is found. The same clouds always give the same plane.
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
    # Fit again with columns perpendicular to the plane, because tilted columns mix ground of many
    # heights.
    turn = Rotation.from_euler("ZYX", [0, *_tilt(*best[:3])]).as_matrix()
    upright = _ground(xyz @ turn.T, frame, len(clouds))
    level = _fitted(upright, np.array([0.0, 0.0, 1.0, best[3]]))
    plane = _with_crown(upright, level, crowned=crowned)
    if math.degrees(math.acos(min(plane.normal[2], 1.0))) > SETTLED_DEG:
        return None
    x, y, z = (float(v) for v in np.array(plane.normal) @ turn)
    return replace(plane, normal=(x, y, z))


def lowest_points(clouds: Sequence[Floats]) -> LowestPoints:
    """Returns the ground points of clouds (k, 3 or more) of one sensor, in range REACH_M."""
    xyz, frame = _within_reach(clouds)
    return _ground(xyz, frame, len(clouds))


def _tilt(x: float, y: float, z: float) -> tuple[float, float]:
    """Returns pitch and roll (rad) of a sensor in whose frame the upward normal is x, y, z."""
    return -math.asin(x), math.atan2(y, z)


def _within_reach(clouds: Sequence[Floats]) -> tuple[FloatArray, IntArray]:
    """Returns the points (n, 3) of all clouds in range REACH_M, and their frames (n,)."""
    parts = []
    for cloud in clouds:
        xyz = cloud[:, :3].astype(np.float64)
        slant = np.linalg.norm(xyz, axis=1)  # points with NaN or inf fail the test below
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
    """Returns the z (columns,) of the ground in each column.

    It is the LOW_SHARE quantile of z instead of the minimum, because stray points may lie lower.
    """
    order = np.lexsort((z, column))
    counts = np.bincount(column, minlength=columns)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return np.asarray(z[order][first + (LOW_SHARE * counts).astype(np.int64)])


def _moved(
    over: FloatArray, column: IntArray, frame: IntArray, columns: int, frames: int
) -> BoolArray:
    """Returns a mask of the columns in which objects moved, as MOVED_SHARE defines."""
    high = np.full(columns * frames, -np.inf)
    np.maximum.at(high, column * frames + frame, over)
    top = high.reshape(columns, frames)
    share = (top > MOVED_M).sum(axis=1) / np.isfinite(top).sum(axis=1)
    return np.asarray((share >= MOVED_SHARE[0]) & (share <= MOVED_SHARE[1]))


def _tries(
    ground: LowestPoints, heights_m: tuple[float, float], most_tilt_deg: float
) -> FloatArray:
    """Returns random planes (m, 4), each through three ground points.

    A row holds the upward unit normal n and the height d. Points p of the plane satisfy
    n · p + d = 0.
    """
    n = len(ground.xyz)
    if n < 3:
        return np.empty((0, 4))
    rng = np.random.default_rng(0)
    chance = ground.near**1.5 * np.where(ground.moved, 3, 1)
    three = rng.choice(n, (TRIES, 3), p=chance / chance.sum())
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
    # The square root makes the weight of ground under traffic decrease more slowly with distance.
    weight = np.sqrt(ground.near[ground.moved])
    return near, float(weight[on[ground.moved]].sum() / weight.sum())


def _fitted(ground: LowestPoints, plane: FloatArray) -> FloatArray:
    """Refits a plane several times to the ground near it, with a decreasing distance limit."""
    for near in (3 * NEAR_M, 2 * NEAR_M, NEAR_M, NEAR_M, NEAR_M):
        rows, off = _near_plane(ground, plane, near)
        x, y, z = ground.xyz[rows].T
        weight = ground.near[rows] / (1 + (off / SOFT_M) ** 2)
        a = np.column_stack([x, y, np.ones(len(x))])
        if len(x) < 3 or np.linalg.matrix_rank(a) < 3:
            continue
        root = np.sqrt(weight)
        plane = _plane_of(*np.linalg.lstsq(a * root[:, None], z * root, rcond=None)[0])
    return plane


def _plane_of(along_x: float, along_y: float, level: float) -> FloatArray:
    """Returns unit normal and height (4,) of the plane z = along_x x + along_y y + level."""
    normal = np.array([-along_x, -along_y, 1.0])
    length = float(np.linalg.norm(normal))
    return np.array([*(normal / length), -level / length])


def _near_plane(
    ground: LowestPoints, plane: FloatArray, near: float
) -> tuple[IntArray, FloatArray]:
    """Returns the indices of ground points near a plane, and their heights above it."""
    off = ground.xyz @ plane[:3] + plane[3]
    flat = np.hypot(ground.xyz[:, 0], ground.xyz[:, 1])
    rows = np.flatnonzero((np.abs(off) <= near) & (flat <= FIT_M))
    return rows, off[rows]


def _with_crown(ground: LowestPoints, plane: FloatArray, *, crowned: bool) -> RoadPlane:
    """Returns the mean plane of a crown, or the plane itself if there is no crown."""
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
    """Fits a crown to the ground near a plane. Returns slope, mean plane and residual of the crown.

    Returns None if a crown does not fit much better than the plane. The function fits twice. The
    weights of the second fit depend on the distances of the points from the first fit.
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
    """Yields the distances (n,) of points (n, 2) from each possible middle line of a crown.

    Each line has at least LEAST_SIDE of the points' total weight on each side.
    """
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
    """Fits slopes along x and y, a level, and a slope away from a line.

    Returns these four coefficients and the weighted sum of squared residuals.
    """
    a = _columns(xy, fold)
    weighted = a.T * weight
    solved = np.linalg.solve(weighted @ a + 1e-9 * np.eye(4), weighted @ off)
    coefficients = np.asarray(solved, dtype=np.float64)
    return coefficients, float(weight @ (off - a @ coefficients) ** 2)


def _lifted(plane: FloatArray, coefficients: FloatArray, mean_fold: float) -> FloatArray:
    """Returns the mean plane of a crown that was fitted to the heights above a plane."""
    x, y, z, d = plane
    level = -d / z + coefficients[2] + coefficients[3] * mean_fold
    return _plane_of(-x / z + coefficients[0], -y / z + coefficients[1], level)
