"""Triangle meshes of a map's roads, footways, junctions, terrain and buildings."""

import itertools

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.formats.ply import Triangles, together
from pyinfra.scenes.maps.lane_map import MapBody, MapLane, SiteMap

TERRAIN_CELL_M = 4.0  # cell size of the terrain grid
TERRAIN_MARGIN_M = 60.0  # margin of the terrain around the lanes
TERRAIN_BELOW_M = 0.08  # depth of the terrain below the road
FILL_CELL_M = 1.0  # cell size of a junction's paving
FILL_BELOW_M = 0.01  # depth of a junction's paving below its lanes
JOIN_M = 0.02  # length by which each lane overlaps the next
SINK_M = 0.5  # depth of a building's walls below the ground
ACROSS = (0.0, 0.25, 0.5, 0.75, 1.0)  # positions across a lane, relative to its width


def strip(lane: MapLane) -> Triangles:
    """Returns the surface of a lane. A raised lane also has walls on both sides."""
    up = np.array([0, 0, lane.kerb_m])
    left, right = longer(lane.left, lane.right)
    rows = [left, left + up, right + up, right] if lane.kerb_m else [left, right]
    return together([ribbon(a, b) for a, b in itertools.pairwise(rows)])


def longer(left: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Extends borders by JOIN_M at both ends, so that no ray passes between successive lanes."""
    centre = (left + right) / 2
    ends = []
    for inner, end in ((1, 0), (-2, -1)):
        step = centre[end] - centre[inner]
        ends.append(step * (JOIN_M / max(float(np.hypot(*step[:2])), 1e-3)))
    return tuple(np.vstack([b[:1] + ends[0], b, b[-1:] + ends[1]]) for b in (left, right))  # type: ignore[return-value]


def ribbon(left: FloatArray, right: FloatArray) -> Triangles:
    """Returns triangles between two lines (n, 3), facing up if `left` is on the left."""
    n = len(left)
    i = np.arange(n - 1)
    faces = np.concatenate([np.stack([i, n + i, n + i + 1], 1), np.stack([i, n + i + 1, i + 1], 1)])
    return Triangles(np.concatenate([left, right]), faces)


def paved_points(lanes: list[MapLane]) -> FloatArray:
    """Returns points (n, 3) on the lanes, at most about a metre apart."""
    rows = []
    for lane in lanes:
        step = np.hypot(*np.diff(lane.centre[:, :2], axis=0).T)
        more = np.ceil(step).astype(int).clip(1)
        index = np.repeat(np.arange(len(step)), more)
        part = (np.arange(len(index)) - np.repeat(np.cumsum(more) - more, more)) / more[index]
        at = np.append(index + part, len(step))
        low = np.minimum(at.astype(int), len(step) - 1)
        f = (at - low)[:, None]
        left, right = (b[low] * (1 - f) + b[low + 1] * f for b in (lane.left, lane.right))
        rows += [left + (right - left) * share for share in ACROSS]
    return np.concatenate(rows)


class Sheet:
    """A grid of heights that is nowhere above the points from which it was built."""

    def __init__(self, points: FloatArray, cell_m: float, margin_m: float, below_m: float) -> None:
        self.cell_m = cell_m
        self.low = points[:, :2].min(0) - margin_m
        shape = np.ceil((points[:, :2].max(0) + margin_m - self.low) / cell_m).astype(int) + 1
        cells = np.full(shape, np.inf)
        at = ((points[:, :2] - self.low) / cell_m).astype(int)
        np.minimum.at(cells, (at[:, 0], at[:, 1]), points[:, 2])
        padded = np.pad(cells, ((1, 0), (1, 0)), constant_values=np.inf)
        corners = [padded[1:, 1:], padded[:-1, 1:], padded[1:, :-1], padded[:-1, :-1]]
        self.z = _filled(np.minimum.reduce(corners), 20 if margin_m > cell_m else 0) - below_m

    def mesh(self, wanted: BoolArray | None = None) -> Triangles:
        """Returns the mesh of all cells, or of the cells in a mask (nx - 1, ny - 1)."""
        nx, ny = self.z.shape
        x, y = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
        positions = np.stack([x, y], -1) * self.cell_m + self.low
        i, j = np.nonzero(np.ones((nx - 1, ny - 1), bool) if wanted is None else wanted)
        a, b = i * ny + j, (i + 1) * ny + j
        faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
        used, numbers = np.unique(faces, return_inverse=True)
        vertices = np.concatenate([positions, self.z[..., None]], -1).reshape(-1, 3)
        return Triangles(vertices[used], numbers.reshape(-1, 3))

    def at(self, xy: FloatArray) -> FloatArray:
        """Returns the height (n,) of the lowest corner of the cell at each position (n, 2).

        Positions outside the grid use the nearest cell.
        """
        i, j = ((xy - self.low) / self.cell_m).astype(int).T
        i, j = i.clip(0, self.z.shape[0] - 2), j.clip(0, self.z.shape[1] - 2)
        corners = [self.z[i + a, j + b] for a in (0, 1) for b in (0, 1)]
        return np.asarray(np.minimum.reduce(corners))


def _filled(z: FloatArray, rounds: int) -> FloatArray:
    """Fills unknown heights from their neighbours, and smooths the filled heights."""
    known = np.isfinite(z)
    z = np.where(known, z, 0.0)
    have = known.copy()
    while not have.all():
        around, counts = _means(z, have)
        new = ~have & (counts > 0)
        z, have = np.where(new, around, z), have | new
    for _ in range(rounds):
        around, _ = _means(z, np.ones_like(known))
        z = np.where(known, z, around)
    return z


def _means(z: FloatArray, have: BoolArray) -> tuple[FloatArray, IntArray]:
    padded, there = np.pad(z * have, 1), np.pad(have.astype(int), 1)
    views = [(slice(None, -2), slice(1, -1)), (slice(2, None), slice(1, -1))]
    views += [(slice(1, -1), slice(None, -2)), (slice(1, -1), slice(2, None))]
    counts = sum((there[v] for v in views), np.zeros(z.shape, int))
    return sum((padded[v] for v in views), np.zeros(z.shape)) / counts.clip(1), counts


def contains(outline: FloatArray, xy: FloatArray) -> BoolArray:
    """Returns whether points (n, 2) lie in an outline (m, 2), by the even-odd rule."""
    (x0, y0), (x1, y1) = outline.T, np.roll(outline, -1, axis=0).T
    x, y = xy[:, :1], xy[:, 1:]
    cut = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        east = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.asarray((cut & east).sum(1) % 2 == 1)


def to_segments(positions: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Returns the distances (n,) of positions from segments; each argument is (2,) or (n, 2)."""
    along = end - start
    part = ((positions - start) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
    away = start + part.clip(0, 1)[:, None] * along - positions
    return np.asarray(np.hypot(*away.T))


def side_of(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    """Returns a positive number where point r lies left of the line from p to q, (..., 2) each."""
    return np.asarray(
        (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
        - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
    )


def crosses_itself(outline: FloatArray) -> bool:
    """Returns whether two sides of an outline (n, 2) cross."""
    a, b = outline, np.roll(outline, -1, axis=0)
    p, q, r, s = a[:, None], b[:, None], a[None], b[None]
    across = (side_of(p, q, r) * side_of(p, q, s) < 0) & (side_of(r, s, p) * side_of(r, s, q) < 0)
    return bool(across.any())


def signed_area(outline: FloatArray) -> float:
    """Returns the area of an outline (n, 2), which is positive if it runs counter-clockwise."""
    x, y = outline.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def junction_fill(areas: list[FloatArray], points: FloatArray) -> list[Triangles]:
    """Returns paving between the lanes of each junction, slightly below the lanes."""
    meshes = []
    points = points[np.argsort(points[:, 0])]
    for outline in areas:
        low, high = outline.min(0) - 2, outline.max(0) + 2
        beside = points[slice(*np.searchsorted(points[:, 0], [low[0], high[0]]))]
        near = beside[(beside[:, 1] > low[1]) & (beside[:, 1] < high[1])]
        if not len(near) or (high - low).max() > 500:
            continue
        sheet = Sheet(near, FILL_CELL_M, 1.0, FILL_BELOW_M)
        nx, ny = sheet.z.shape
        x, y = np.meshgrid(np.arange(nx - 1) + 0.5, np.arange(ny - 1) + 0.5, indexing="ij")
        middles = np.stack([x, y], -1).reshape(-1, 2) * FILL_CELL_M + sheet.low
        wanted = contains(outline, middles).reshape(nx - 1, ny - 1)
        if wanted.any():
            meshes.append(sheet.mesh(wanted))
    return meshes


def ears(outline: FloatArray) -> IntArray:
    """Returns the triangles (n - 2, 3), counter-clockwise, of an outline (n, 2).

    The outline must not cross itself.
    """
    left = list(range(len(outline)))[:: 1 if signed_area(outline) > 0 else -1]
    triangles = []
    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            if side_of(outline[a], outline[b], outline[c]) <= 1e-9:
                continue
            corners = outline[[a, b, c]]
            others = outline[[i for i in left if i not in (a, b, c)]]
            # The ends of a cut to a hole occur twice in the outline.
            others = others[~(others[:, None] == corners).all(2).any(1)]
            # Signs (n, 3) state on which side of each triangle edge the other corners lie.
            sides = side_of(corners, np.roll(corners, -1, axis=0), others[:, None])
            if not (sides >= 0).all(1).any():
                break
        else:  # the remaining polygon has no area
            k = 0
            a, b, c = left[-1], left[0], left[1]
        triangles.append([a, b, c])
        del left[k]
    return np.array([*triangles, left])


def footway(shape: FloatArray, kerb_m: float) -> Triangles:
    """Returns the surface of a walking area with outline (n, 3), raised by `kerb_m`, with walls."""
    top = shape + np.array([0, 0, kerb_m])
    ring = np.arange(len(shape)) if signed_area(shape[:, :2]) < 0 else np.arange(len(shape))[::-1]
    ring = np.append(ring, ring[0])
    return together([Triangles(top, ears(shape[:, :2])), ribbon(top[ring], shape[ring])])


def body(thing: MapBody, terrain: Sheet) -> Triangles:
    """Returns walls and roof of a body.

    If the body has no base height, it stands at the lowest terrain below its outline.
    """
    ground = float(terrain.at(thing.outline).min())
    base = ground + thing.above_m if thing.base_m is None else thing.base_m
    outline = thing.outline if signed_area(thing.outline) > 0 else thing.outline[::-1]
    ring = np.append(np.arange(len(outline)), 0)
    heights = (base + thing.height_m, base if thing.hangs else min(base, ground) - SINK_M)
    top, bottom = (np.insert(outline, 2, z, axis=1) for z in heights)
    parts = [Triangles(top, ears(outline)), ribbon(top[ring], bottom[ring])]
    if thing.hangs:
        parts.append(Triangles(bottom, ears(outline)[:, ::-1]))
    return together(parts)


def surfaces(site_map: SiteMap, footway_kerb_m: float) -> tuple[dict[str, Triangles], Sheet]:
    """Returns the meshes of road, sidewalk, terrain and buildings by name, and the terrain grid."""
    points = paved_points(site_map.lanes)
    points = points[points[:, 2] >= site_map.covered_m]
    terrain = Sheet(points, TERRAIN_CELL_M, TERRAIN_MARGIN_M, TERRAIN_BELOW_M)
    road = [strip(lane) for lane in site_map.lanes if lane.kind == "road"]
    fill = junction_fill(
        site_map.areas, paved_points([x for x in site_map.lanes if x.kind == "road"])
    )
    walked = [strip(lane) for lane in site_map.lanes if lane.kind == "sidewalk"]
    walked += [footway(shape, footway_kerb_m) for shape in site_map.footways if len(shape) >= 3]
    meshes = {
        "road": together([*road, *fill]),
        "sidewalk": together(walked),
        "terrain": terrain.mesh(),
        "buildings": together([body(thing, terrain) for thing in site_map.bodies]),
    }
    return {name: mesh for name, mesh in meshes.items() if len(mesh.faces)}, terrain
