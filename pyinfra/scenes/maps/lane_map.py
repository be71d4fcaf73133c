"""The representation of imported maps that all readers return: lanes and roadside objects."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error

NARROWEST_M = 1.0  # minimum width of a driveable lane; narrower parts of a lane are left out
SHORTEST_M = 0.2  # minimum length of a lane
FARTHEST_M = 1e6  # maximum distance of a position from a site's origin
# Maximum coordinate of a map before its offset is subtracted: UTM and Web Mercator reach 2e7 m.
FARTHEST_IN_MAP_M = 2.1e7
# Lanes with a grade above STEEP are reported. Lanes with a grade above STEEPEST are refused.
STEEP, STEEPEST = 0.5, 1.2


class MapError(Error):
    """The map cannot be read or used as a site. The message names file and location."""


@dataclass(frozen=True, eq=False)
class MapLane:
    """A lane or sidewalk between two borders, whose points follow the direction of travel."""

    name: str
    kind: str  # kind of surface: road or sidewalk
    driveable: bool
    left: FloatArray  # left border (n, 3), n >= 2
    right: FloatArray  # right border (n, 3)
    kerb_m: float = 0.0  # height of the surface above z of the borders

    @property
    def centre(self) -> FloatArray:
        """Centreline (n, 3) between the borders."""
        return np.asarray((self.left + self.right) / 2)

    @property
    def width(self) -> FloatArray:
        """Horizontal width (n,)."""
        return np.asarray(np.hypot(*(self.left - self.right)[:, :2].T))


@dataclass(frozen=True, eq=False)
class MapBody:
    """A vertical prism on an outline, such as a building, a wall or a post."""

    outline: FloatArray  # corners (n, 2), counter-clockwise, n >= 3
    height_m: float
    base_m: float | None = None  # z of the base; None if the body stands on the terrain
    hangs: bool = False  # whether the space below the body is open
    above_m: float = 0.0  # height of the base above the terrain, if base_m is None
    name: str = ""  # name of the body in the map


@dataclass(frozen=True)
class MapTree:
    """A tree: its position and height."""

    x_m: float
    y_m: float
    height_m: float
    base_m: float | None = None  # z of the base; None if the tree stands on the terrain


@dataclass(frozen=True)
class MapFeature:
    """A stop, crossing or signal. It is listed and drawn in plans, but has no surface."""

    kind: str
    source: str  # name of the feature in the map
    x_m: float
    y_m: float
    tags: dict[str, str] = field(default_factory=dict)


@dataclass
class SiteMap:
    """The content of a map, and the assumptions and repairs of its import."""

    lanes: list[MapLane] = field(default_factory=list)
    areas: list[FloatArray] = field(default_factory=list)  # (n, 2) outlines of junctions
    footways: list[FloatArray] = field(default_factory=list)  # (n, 3) outlines of walking areas
    # Number of connections between lanes, x and y of each junction.
    junctions: list[tuple[int, float, float]] = field(default_factory=list)
    bodies: list[MapBody] = field(default_factory=list)
    trees: list[MapTree] = field(default_factory=list)
    features: list[MapFeature] = field(default_factory=list)
    covered_m: float = -np.inf  # lanes below this z are under the terrain
    guessed: list[str] = field(default_factory=list)  # texts about assumptions
    mended: list[str] = field(default_factory=list)  # texts about repaired lanes
    not_understood: list[str] = field(default_factory=list)  # texts about ignored content


def number_or_nan(text: str | None) -> float:
    """Returns the number of an attribute; NaN if it is missing or no number."""
    try:
        return float(text or "")
    except ValueError:
        return np.nan


def lane_name(*words: object) -> str:
    """Joins words to a name that contains only letters, digits, `_` and `-`."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", "_".join(str(word) for word in words))


def with_unique_names(lanes: Sequence[MapLane]) -> list[MapLane]:
    """Returns the lanes with unique names. A number is added to repeated names."""
    counts: dict[str, int] = {}
    named = []
    for lane in lanes:
        count = counts[lane.name] = counts.get(lane.name, 0) + 1
        named.append(lane if count == 1 else replace(lane, name=f"{lane.name}_again{count}"))
    return named


def without_folds(
    left: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Removes backward steps of the borders of a lane.

    In a bend tighter than the lane's width, the inner border runs backwards. The function moves
    each point of this part of the border to the previous point. It removes rows at which the
    centreline stops or runs backwards. Returns both borders, and the left point (x y z) at which
    the centreline first runs backwards, or None.
    """
    folded = None
    for _ in range(len(left)):
        centre = (left + right)[:, :2] / 2
        steps = np.diff(centre, axis=0)
        back = np.flatnonzero((steps[1:] * steps[:-1]).sum(1) < 0) + 1
        still = np.flatnonzero(np.hypot(*steps.T) < 1e-3) + 1
        if len(back) and folded is None:
            folded = left[back[0]]
        gone = np.union1d(back, still)
        if not len(gone) or len(left) - len(gone) < 2:
            break
        left, right = np.delete(left, gone, 0), np.delete(right, gone, 0)
    left, right = left.copy(), right.copy()
    ahead = np.diff((left + right)[:, :2], axis=0)
    for border in (left, right):
        if ((np.diff(border[:, :2], axis=0) * ahead).sum(1) >= 0).all():
            continue
        for i, direction in enumerate(ahead, start=1):
            if (border[i] - border[i - 1])[:2] @ direction < 0:
                border[i] = [*border[i - 1][:2], border[i][2]]
    return left, right, folded


def steep_lanes(lanes: Sequence[MapLane]) -> list[str]:
    """Returns a text for each driveable lane that is implausibly steep."""
    notes = []
    for lane in lanes:
        steps = np.diff(lane.centre, axis=0)
        grade = np.abs(steps[:, 2]) / np.maximum(np.hypot(*steps[:, :2].T), 1e-3)
        if lane.driveable and grade.max() > STEEP + 1e-6:
            x, y, _ = lane.centre[int(grade.argmax())]
            notes.append(f"lane {lane.name}: a grade of {grade.max():.0%} at {x:.1f} {y:.1f}")
    return notes


def checked_lanes(
    lanes: Sequence[MapLane], source: str, farthest_m: float = FARTHEST_M
) -> list[MapLane]:
    """Returns the lanes unchanged.

    Raises MapError, which names the lane, for impossible coordinates or grades. Also raises
    MapError if there is no lane for vehicles.
    """
    for lane in lanes:
        borders = np.concatenate([lane.left, lane.right])
        if not np.isfinite(borders).all():
            wrong = borders[~np.isfinite(borders).all(axis=1)][0].tolist()
            raise MapError(f"{source}: lane {lane.name}: expected finite coordinates, got {wrong}")
        if np.abs(borders).max() > farthest_m:
            most = np.abs(borders).max()
            raise MapError(
                f"{source}: lane {lane.name}: expected coordinates up to {farthest_m:g} m, got "
                f"{most:.4g} m; the projection may be wrong"
            )
        steps = np.diff(lane.centre, axis=0)
        rise = np.abs(steps[:, 2]) - STEEPEST * np.hypot(*steps[:, :2].T)
        if rise.max() > 0.1:
            at = int(rise.argmax())
            x, y, _ = lane.centre[at]
            raise MapError(
                f"{source}: lane {lane.name}: expected grades up to {STEEPEST:.0%}, got a step of "
                f"{abs(steps[at, 2]):.1f} m in height at x = {x:.1f} m, y = {y:.1f} m"
            )
    if not any(lane.driveable for lane in lanes):
        raise MapError(f"{source}: expected one or more lanes for vehicles, got none")
    return list(lanes)
