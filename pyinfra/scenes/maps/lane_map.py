"""A map as its lanes and what stands beside them, whatever format it came in."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error

NARROWEST_M = 1.0  # of a lane that vehicles drive in; it ends where it is narrower
SHORTEST_M = 0.2  # of a lane
FARTHEST_M = 1e6  # of a place from a map's origin
STEEP, STEEPEST = 0.5, 1.2  # grades between two points of a lane: those named, those refused


class MapError(Error):
    """A map that can't be read, or not as a site: file, place, what was found, what is allowed."""


@dataclass(frozen=True, eq=False)
class MapLane:
    """A strip of one use; rows go in the direction of travel."""

    name: str
    kind: str  # road, sidewalk
    driveable: bool
    left: FloatArray  # (n, 3), n >= 2
    right: FloatArray  # (n, 3)
    kerb_m: float = 0.0  # how much higher it lies than its z

    @property
    def centre(self) -> FloatArray:
        """(n, 3), between the borders."""
        return np.asarray((self.left + self.right) / 2)

    @property
    def width(self) -> FloatArray:
        """(n,)"""
        return np.asarray(np.hypot(*(self.left - self.right)[:, :2].T))


@dataclass(frozen=True, eq=False)
class MapBody:
    """What stands upright on an outline, from base to top."""

    outline: FloatArray  # (n, 2), counter-clockwise, n >= 3
    height_m: float
    base_m: float | None = None  # None: on the terrain
    hangs: bool = False  # with nothing below its base


@dataclass(frozen=True)
class MapTree:
    """A tree where it stands."""

    x_m: float
    y_m: float
    height_m: float
    base_m: float | None = None


@dataclass(frozen=True)
class MapFeature:
    """What is listed and drawn as what it is, and has no surface: a stop, a crossing, a signal."""

    kind: str
    source: str  # the map's own name of it
    x_m: float
    y_m: float
    tags: dict[str, str] = field(default_factory=dict)


@dataclass
class SiteMap:
    """What was read of a map, and what was made of it."""

    lanes: list[MapLane] = field(default_factory=list)
    areas: list[FloatArray] = field(default_factory=list)  # (n, 2) junctions, paved
    footways: list[FloatArray] = field(default_factory=list)  # (n, 3) paved, where people wait
    junctions: list[tuple[int, float, float]] = field(default_factory=list)  # ways through, x, y
    bodies: list[MapBody] = field(default_factory=list)
    trees: list[MapTree] = field(default_factory=list)
    features: list[MapFeature] = field(default_factory=list)
    covered_m: float = -np.inf  # what lies deeper is below the terrain
    guessed: list[str] = field(default_factory=list)
    mended: list[str] = field(default_factory=list)
    not_understood: list[str] = field(default_factory=list)


def lane_name(*words: object) -> str:
    """A name of letters, digits, `_` and `-` out of a map's own names."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", "_".join(str(word) for word in words))


def with_unique_names(lanes: Sequence[MapLane]) -> list[MapLane]:
    """The lanes; of those of one name the later ones get a number."""
    seen: dict[str, int] = {}
    named = []
    for lane in lanes:
        count = seen[lane.name] = seen.get(lane.name, 0) + 1
        named.append(lane if count == 1 else replace(lane, name=f"{lane.name}_again{count}"))
    return named


def without_folds(
    left: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Borders (n, 3) none of whose points steps back along the lane, and where one did (x y z).

    In a bend tighter than a lane is wide, its inner border turns back: such points stay where the
    border was. Rows at which the middle itself stands still or turns back are left out.
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
    """One line for each lane that is steeper than roads are."""
    notes = []
    for lane in lanes:
        steps = np.diff(lane.centre, axis=0)
        grade = np.abs(steps[:, 2]) / np.maximum(np.hypot(*steps[:, :2].T), 1e-3)
        if lane.driveable and grade.max() > STEEP + 1e-6:
            x, y, _ = lane.centre[int(grade.argmax())]
            notes.append(f"lane {lane.name}: a grade of {grade.max():.0%} at {x:.1f} {y:.1f}")
    return notes


def checked_lanes(lanes: Sequence[MapLane], source: str) -> list[MapLane]:
    """The lanes as they are. Raises MapError, with the lane's name, if one can't be."""
    for lane in lanes:
        both = np.concatenate([lane.left, lane.right])
        if not np.isfinite(both).all():
            raise MapError(f"{source}: lane {lane.name}: found a place that is not a number")
        if np.abs(both).max() > FARTHEST_M:
            most = np.abs(both).max()
            raise MapError(
                f"{source}: lane {lane.name}: found a place {most:.4g} m from the origin, "
                f"allowed up to {FARTHEST_M:g} (a wrong projection?)"
            )
        steps = np.diff(lane.centre, axis=0)
        rise = np.abs(steps[:, 2]) - STEEPEST * np.hypot(*steps[:, :2].T)
        if rise.max() > 0.1:
            x, y, z = lane.centre[int(rise.argmax())]
            raise MapError(
                f"{source}: lane {lane.name}: found a step in z at {x:.1f} {y:.1f} {z:.1f}, "
                f"allowed grades up to {STEEPEST:.0%}"
            )
    if not any(lane.driveable for lane in lanes):
        raise MapError(f"{source}: found no lane for vehicles, allowed one or more")
    return list(lanes)
