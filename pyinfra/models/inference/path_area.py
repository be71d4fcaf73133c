"""Computes the area of roads from the paths of vehicles, and simplifies its outlines and holes."""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import binary_fill_holes, distance_transform_edt, label

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.dataset.outlines import Drawn, first_crossing

CELL_M = 0.5
AHEAD_M = 15.0  # length by which a path is extended straight at both ends
HALF_WIDTH_M = 1.3  # half the width of a vehicle's path
CLOSED_M = 8.0  # radius of the morphological closing that fills gaps between lanes
LEAST_PART = 0.01  # minimum size of a part of the area, as a share of the marked cells
MOST_GAP_M = 20.0  # parts of the area with a larger gap between them become separate outlines
STRIP_M = 3.0  # half the width of the strips that join the parts of the area
LEAST_HOLE_M2 = 300.0  # smaller holes are filled; in a short recording, all holes are filled
MARGIN_M = 1.0  # margin around the closed area
MOST_CORNERS = 20


def area_of(paths: FloatArray, *, has_holes: bool = True) -> Drawn:
    """Returns the area of paths (p, 2, 2) with a start and an end x, y.

    has_holes: whether large holes are kept; else they are filled.
    """
    cells, low = path_cells(paths)
    marked = _within(cells, HALF_WIDTH_M)
    least = round(LEAST_PART * marked.sum())
    whole = _within(joined(closed(marked, CLOSED_M), least), MARGIN_M)
    filled = binary_fill_holes(whole)
    empty = LEAST_HOLE_M2 / CELL_M**2 if has_holes else np.inf
    outlines = [simplified(low + CELL_M * boundary(part)) for part in _parts(filled, least)]
    holes = [simplified(low + CELL_M * boundary(part)) for part in _parts(filled & ~whole, empty)]
    return Drawn(tuple(outlines), tuple(holes))


def _parts(marked: BoolArray, least_cells: float) -> Iterator[BoolArray]:
    """Yields the connected areas of `least_cells` cells or more, the largest first.

    Cells that only touch at a corner are not connected. An area has no holes.
    """
    parts, count = label(marked)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
    for i in np.argsort(-sizes, kind="stable"):
        if sizes[i] >= least_cells:
            yield binary_fill_holes(parts == i + 1)


def path_cells(paths: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Returns the cells (rows along x) on paths, and x, y of the grid's low corner.

    Each path is extended by AHEAD_M at both ends. The grid has a margin for the later steps.
    """
    along = paths[:, 1] - paths[:, 0]
    along = AHEAD_M * along / np.linalg.norm(along, axis=1, keepdims=True)
    start, end = paths[:, 0] - along, paths[:, 1] + along
    count = int(np.ceil(2 * np.linalg.norm(end - start, axis=1).max() / CELL_M))
    share = np.linspace(0, 1, count)[:, None, None]
    xy = (start + share * (end - start)).reshape(-1, 2)
    pad_m = CLOSED_M + HALF_WIDTH_M + MARGIN_M + STRIP_M
    low = xy.min(axis=0) - pad_m
    cell = ((xy - low) / CELL_M).astype(int)
    cells = np.zeros(cell.max(axis=0) + 2 + int(pad_m / CELL_M), np.bool_)
    cells[tuple(cell.T)] = True
    return cells, low


def closed(marked: BoolArray, radius_m: float) -> BoolArray:
    """Returns the cells after a morphological closing with a disc."""
    return np.asarray(marked | ~_within(~_within(marked, radius_m), radius_m))


def joined(marked: BoolArray, least_cells: int) -> BoolArray:
    """Returns the parts of least_cells cells or more, joined by straight strips over small gaps."""
    parts, count = label(marked)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    rest = [i for i in range(1, count + 1) if sizes[i] >= least_cells]
    whole: BoolArray = parts == 1 + np.argmax(sizes[1:])
    while rest:
        away, nearest = distance_transform_edt(~whole, return_indices=True)
        gaps = [np.where(parts == i, away, np.inf) for i in rest]
        best = int(np.argmin([gap.min() for gap in gaps]))
        if gaps[best].min() * CELL_M > MOST_GAP_M:
            whole |= parts == rest.pop(best)
            continue
        end = np.array(np.unravel_index(np.argmin(gaps[best]), marked.shape))
        start = nearest[:, *end]
        length = int(np.abs(end - start).max())
        strip = np.zeros_like(marked)
        strip[tuple(np.linspace(start, end, 2 * length + 1).round().astype(int).T)] = True
        whole |= (parts == rest.pop(best)) | _within(strip, STRIP_M)
    return whole


def _within(area: BoolArray, distance_m: float) -> BoolArray:
    """Returns the cells within a distance of an area."""
    return np.asarray(distance_transform_edt(~area) * CELL_M <= distance_m)


def boundary(area: BoolArray) -> FloatArray:
    """Returns the corners (k, 2) around a connected area without holes, in cells.

    The area does not touch the edge of the grid.
    """
    following: dict[tuple[int, int], list[tuple[int, int]]] = {}
    # Each side of a cell is directed so that the area is on its left. (di, dj) is the step to the
    # cell beyond the side.
    for (di, dj), start, end in (
        ((0, -1), (0, 0), (1, 0)),
        ((1, 0), (1, 0), (1, 1)),
        ((0, 1), (1, 1), (0, 1)),
        ((-1, 0), (0, 1), (0, 0)),
    ):
        for i, j in np.argwhere(area & ~np.roll(area, (-di, -dj), axis=(0, 1))).tolist():
            corner = (i + start[0], j + start[1])
            following.setdefault(corner, []).append((i + end[0], j + end[1]))
    at = min(following)
    loop, last = [at], (0, 0)
    while True:
        # Where two cells only touch at a corner, the path turns left and stays at its cell.
        ends = following[at]
        ends.sort(key=lambda e: last[0] * (e[1] - at[1]) - last[1] * (e[0] - at[0]))
        end = ends.pop()
        last, at = (end[0] - at[0], end[1] - at[1]), end
        if at == loop[0]:
            return np.array(loop, np.float64)
        loop.append(at)


def simplified(corners: FloatArray) -> FloatArray:
    """Returns an outline with at most MOST_CORNERS corners whose sides do not cross: (m, 2).

    The method is that of Douglas and Peucker, with the smallest tolerance that suffices.
    """
    tolerance_m = CELL_M
    while True:
        kept = _kept(corners, tolerance_m)
        if len(kept) <= MOST_CORNERS and first_crossing(kept) is None:
            return kept
        tolerance_m *= 1.2


def _kept(corners: FloatArray, tolerance_m: float) -> FloatArray:
    """Returns the corners (k, 2) whose removal would move the outline by more than a tolerance."""
    far = int(np.linalg.norm(corners - corners[0], axis=1).argmax())
    ring = np.concatenate([corners, corners[:1]])
    keep = {0, far}
    parts = [(0, far), (far, len(corners))]
    while parts:
        a, b = parts.pop()
        if b - a < 2:
            continue
        along = ring[b] - ring[a]
        off = ring[a + 1 : b] - ring[a]
        share = np.clip(off @ along / max(float(along @ along), 1e-12), 0, 1)
        away = np.linalg.norm(off - share[:, None] * along, axis=1)
        if away.max() > tolerance_m:
            middle = a + 1 + int(away.argmax())
            keep.add(middle)
            parts += [(a, middle), (middle, b)]
    return np.asarray(corners[sorted(keep)])
