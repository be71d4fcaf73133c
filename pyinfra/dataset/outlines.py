"""Point-in-polygon tests, and the polygon outlines that restrict the region of a data set.

`regions.csv` lists the corners of each outline in order, in the world frame. The last corner is
joined to the first. Without the file, the region covers all roads or lanes.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.formats.text_table import between, lines_of, rows_by_name

OUTLINE_COLUMNS = ["region", "x", "y"]
OUTLINES_FILE = "regions.csv"
_RULES = (between(["x", "y"], -1e6, 1e6),)


def read_outlines(data_set: Path) -> tuple[FloatArray, ...]:
    """Reads the outlines of a data set, each (m, 2) in the world frame.

    Returns an empty tuple if there is no file. Raises FormatError with file and line.
    """
    file = data_set / OUTLINES_FILE
    if not file.is_file():
        return ()
    outlines = rows_by_name(lines_of(file, whole=True), file, OUTLINE_COLUMNS, _RULES)
    for name, corners in outlines.items():
        if len(corners) < 3:
            raise FormatError(
                f"{file}: region {name}: expected 3 or more corners, got {len(corners)}"
            )
    return tuple(outlines.values())


def outlines_of(scene: Mapping[str, Any]) -> tuple[FloatArray, ...]:
    """Returns the outlines in a scene's keys, each (m, 2) in the world frame."""
    return tuple(np.array(region["outline_m"], np.float64) for region in scene.get("regions", ()))


def first_crossing(outline: FloatArray) -> tuple[int, int] | None:
    """Returns two sides of an outline (m, 2) that cross, or None. Side i begins at corner i."""

    def left_of(i: int, k: int) -> float:
        """Returns a positive number if corner k lies to the left of the line through side i."""
        along, to = outline[(i + 1) % len(outline)] - outline[i], outline[k] - outline[i]
        return float(along[0] * to[1] - along[1] * to[0])

    for a, b in itertools.combinations(range(len(outline)), 2):
        ahead = (a + 1) % len(outline), (b + 1) % len(outline)
        if left_of(a, b) * left_of(a, ahead[1]) < 0 and left_of(b, a) * left_of(b, ahead[0]) < 0:
            return a, b
    return None


def in_any(outlines: Sequence[FloatArray], points: FloatArray, margin_m: float) -> BoolArray:
    """Returns which points (n, 2 or more) lie in at least one outline or its margin.

    If there are no outlines, the result is True for all points.
    """
    inside = np.full(len(points), len(outlines) == 0)
    for outline in outlines:
        inside |= in_outline(outline, points, margin_m)
    return inside


def in_outline(outline: FloatArray, points: FloatArray, margin_m: float) -> BoolArray:
    """Returns which points (n, 2 or more) lie in an outline (m, 2) or within `margin_m` of it.

    Uses the even-odd rule.
    """
    inside, near = _inside_and_near(outline, points, margin_m)
    return inside | near


@dataclass(frozen=True, eq=False)
class Drawn:
    """An area that a user drew: outlines, each (m, 2), without holes, each (k, 2)."""

    outlines: tuple[FloatArray, ...]
    holes: tuple[FloatArray, ...] = ()

    def holds(self, points: FloatArray, margin_m: float = 0.0) -> BoolArray:
        """Returns which points (n, 2 or more) lie in the area or within `margin_m` of it.

        A margin makes holes smaller. Outlines may overlap. A hole is a hole in all of them.
        """
        held = in_any(self.outlines, points, margin_m)
        for hole in self.holes:
            inside, near = _inside_and_near(hole, points, margin_m)
            held &= ~inside | near
        return held

    @property
    def corners(self) -> FloatArray:
        """All corners of the outlines, (n, 2)."""
        return np.concatenate(self.outlines)

    @property
    def area_m2(self) -> float:
        """The area of the outlines minus that of the holes."""
        return sum(map(area, self.outlines)) - sum(map(area, self.holes))


def area(outline: FloatArray) -> float:
    """Returns the area of an outline (m, 2) whose sides do not cross."""
    x, y = outline.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def _inside_and_near(
    outline: FloatArray, points: FloatArray, margin_m: float
) -> tuple[BoolArray, BoolArray]:
    """Returns which points lie in an outline, and which are within `margin_m` of its sides."""
    inside = np.zeros(len(points), np.bool_)
    near = np.zeros(len(points), np.bool_)
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        (x, y), (ahead, up) = (points[:, :2] - start).T, end - start
        crosses = (y < 0) != (y < up)
        if up != 0:  # the test ray is parallel to x, so it crosses no side that is parallel to x
            inside ^= crosses & (x < y / up * ahead)
        along = np.clip((x * ahead + y * up) / max(ahead**2 + up**2, 1e-12), 0, 1)
        near |= np.hypot(x - along * ahead, y - along * up) <= margin_m
    return inside, near
