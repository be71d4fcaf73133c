"""Draws the map of a plan's site as SVG: roads, lane lines, trees, houses, crossings, stops, areas.

North is up. The unit is the metre. y is mirrored, because the y axis of SVG points down. The page
adds cells and poles to empty groups.
"""

import html
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.boxes import footprints
from pyinfra.dataset.surroundings import Lanes, Surroundings, pieces, road_lines, thinned
from pyinfra.experiments.planner.request import Area
from pyinfra.experiments.planner.site import PlanSite, junction_middle
from pyinfra.formats.ply import read_ply
from pyinfra.scenes.generator.layout import PlannedRoad
from pyinfra.scenes.maps import site_folder

MARGIN_M = 12.0
LINE_STEP = 4  # every fourth point of a road line is drawn
CROWN_M = 5.0  # default diameter of the crown of a tree
CROSSING_M = 1.5
STOPS, STOP_M = ("bus_stop", "platform"), 3.0
MOST_TRIANGLES = 20_000  # maximum number of triangles of meshes; further triangles are left out
SCALES_M = (10, 20, 50, 100)
SURFACES = {"road": "road", "sidewalk": "walk"}  # CSS class by material of a mesh
STANDING = {"structure": "house", "vegetation": "tree"}


@dataclass(frozen=True)
class Window:
    """The drawn rectangle, world frame."""

    low: FloatArray  # (2,) smallest x and y
    high: FloatArray  # (2,) largest x and y

    @property
    def size(self) -> FloatArray:
        return self.high - self.low

    def holds(self, xy: FloatArray, margin_m: float = 30.0) -> BoolArray:
        inside = (xy >= self.low - margin_m) & (xy <= self.high + margin_m)
        return np.asarray(inside.all(axis=-1))


def window_of(xy: FloatArray) -> Window:
    """Returns the rectangle around points (n, 2), in whole metres."""
    return Window(np.floor(xy.min(0) - MARGIN_M), np.ceil(xy.max(0) + MARGIN_M))


def site_map(
    site: PlanSite, window: Window, candidates: pd.DataFrame, areas: Iterable[Area]
) -> str:
    """Returns the svg element of the site. candidates: table of the plan."""
    (x, y), (width, height) = window.low, window.size
    roads = [PlannedRoad(keys) for keys in site.keys.get("roads") or [] if "centreline" in keys]
    parts = [
        f'<rect class="m-ground" x="{x:g}" y="{-y - height:g}" width="{width:g}" '
        f'height="{height:g}"/>',
        *_meshes(site, window, SURFACES),
        *_roads(site, roads, window),
        '<g id="map-cells"></g>',
        *_lines(site, window),
        *_houses(site),
        *_meshes(site, window, STANDING),
        *_plants(site, roads, window),
        *_features(site.file.parent),
        *_places(candidates),
        *(_area(area) for area in areas),
        '<g id="map-within"></g><g id="map-poles"></g>',
        *_scale(window),
    ]
    return (
        f'<svg id="map" viewBox="{x:g} {-y - height:g} {width:g} {height:g}" role="img" '
        f'aria-labelledby="map-title map-text">{"".join(parts)}</svg>'
    )


def path(lines: Iterable[FloatArray], kind: str, *, closed: bool) -> str:
    """Returns lines (n, 2) as one path of the CSS class m-`kind`; empty if there are no lines."""
    drawn = "".join(
        "M" + "L".join(f"{x:.1f} {-y:.1f}" for x, y in line) + ("z" if closed else "")
        for line in lines
        if len(line) > 1
    )
    return f'<path class="m-{kind}" d="{drawn}"/>' if drawn else ""


def _roads(site: PlanSite, roads: Sequence[PlannedRoad], window: Window) -> Iterator[str]:
    if not roads:
        yield path([thinned(road.outline, LINE_STEP) for road in site.roads], "road", closed=True)
    for kind, half in (("walk", "outer_half_m"), ("road", "carriageway_half_m")):
        for road in roads:
            near = np.flatnonzero(window.holds(road.stations[:, 1:3]))
            if not len(near):
                continue
            part = slice(near[0], near[-1] + 1)
            sides = [
                thinned(road.beside(way * getattr(road, half))[part], LINE_STEP) for way in (1, -1)
            ]
            yield path([np.concatenate([sides[0], sides[1][::-1]])], kind, closed=True)
    for junction in site.keys.get("junctions") or []:
        ring, middle = junction.get("roundabout"), junction_middle(junction, site.roads)
        if ring and middle is not None:
            x, y = middle
            for kind, half in (("road", ring["width_m"] / 2), ("ground", -ring["width_m"] / 2)):
                radius = ring["radius_m"] + half
                yield f'<circle class="m-{kind}" cx="{x:.1f}" cy="{-y:.1f}" r="{radius:.1f}"/>'


def _lines(site: PlanSite, window: Window) -> Iterator[str]:
    """Yields the lane lines, except where roads cross."""
    lanes = {
        str(road["name"]): Lanes(
            each_way=int(road["lanes"]["each_way"]),
            width_m=float(road["lanes"]["width_m"]),
            median_m=float(road["lanes"].get("median_m", 0)),
            one_way=bool(road["lanes"].get("one_way", False)),
        )
        for road in site.keys.get("roads") or []
        if "lanes" in road
    }
    around = Surroundings(site.roads, lanes, np.zeros((0, 7)), np.zeros((0, 3)))
    lines = [line for line in road_lines(around) if line.kind != "edge"]
    for kind in ("solid", "dashed"):
        parts = [part for line in lines if line.kind == kind for part in _pieces(line.xyz, window)]
        yield path(parts, kind, closed=False)


def _pieces(xyz: FloatArray, window: Window) -> Iterator[FloatArray]:
    """Returns the pieces of a line between rows of NaN and within the window."""
    xy = xyz[:, :2]
    return pieces(xy, ~np.isnan(xy[:, 0]) & window.holds(np.nan_to_num(xy)), LINE_STEP)


def _houses(site: PlanSite) -> Iterator[str]:
    boxes = [
        [b["x_m"], b["y_m"], 0, b["length_m"], b["width_m"], 1, np.radians(b.get("heading_deg", 0))]
        for b in site.keys.get("buildings") or []
    ]
    yield path(list(footprints(np.array(boxes, float).reshape(-1, 7))), "house", closed=True)


def _meshes(site: PlanSite, window: Window, kinds: Mapping[str, str]) -> Iterator[str]:
    """Yields the meshes of an imported site from above. kinds: CSS class of each drawn material."""
    for mesh in site.keys.get("meshes") or []:
        kind, file = kinds.get(mesh.get("material", "")), site.file.parent / mesh["file"]
        if kind is None or not file.is_file():
            continue
        triangles = read_ply(file)
        corners = triangles.vertices[triangles.faces][..., :2]
        (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        flat = (np.abs(ax * by - ay * bx) > 0.1) & window.holds(corners, 0.0).any(axis=1)
        yield path(list(corners[flat][:MOST_TRIANGLES]), kind, closed=True)


def _plants(site: PlanSite, roads: Sequence[PlannedRoad], window: Window) -> Iterator[str]:
    by_name = {road.name: road for road in roads}
    for plant in site.keys.get("vegetation") or []:
        ((kind, row),) = plant.items()
        if kind == "hedge":
            box = [row["x_m"], row["y_m"], 0, row["length_m"], row["width_m"], 1]
            outline = footprints(np.array([[*box, np.radians(row.get("heading_deg", 0))]], float))
            yield path(list(outline), "tree", closed=True)
        for x, y in _trunks(kind, row, by_name):
            if window.holds(np.array([x, y]), 0.0):
                radius = row.get("crown_m", CROWN_M) / 2
                yield f'<circle class="m-tree" cx="{x:.1f}" cy="{-y:.1f}" r="{radius:.1f}"/>'


def _trunks(
    kind: str, row: dict[str, Any], roads: dict[str, PlannedRoad]
) -> Iterator[tuple[float, float]]:
    if kind == "tree":
        yield float(row["x_m"]), float(row["y_m"])
    elif kind == "trees_along" and row["road"] in roads:
        for s in np.arange(row["from_m"], row["to_m"] + 1e-9, row["every_m"]):
            yield roads[row["road"]].pose_at(float(s), float(row["offset_m"]))[:2]


def _features(folder: Path) -> Iterator[str]:
    """Yields the crossings, and the stops of buses and trams."""
    features = site_folder.features(folder)
    for x, y in features.get("crossing", ()):
        half = CROSSING_M
        lines = [np.array([[x - half, y + k], [x + half, y + k]]) for k in (-half, 0, half)]
        yield path(lines, "crossing", closed=False)
    for kind in STOPS:
        for x, y in features.get(kind, ()):
            square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * STOP_M / 2
            yield path([square + np.array([x, y])], "stop", closed=True)


def _places(candidates: pd.DataFrame) -> Iterator[str]:
    """Yields the candidate positions: a ring where a pose is possible, else a cross."""
    possible = candidates[candidates.lidar != ""].drop_duplicates(["x_m", "y_m"])
    for one in possible.itertuples():
        yield f'<circle class="m-place" cx="{one.x_m:.1f}" cy="{-one.y_m:.1f}" r="1"/>'
    kept = set(zip(possible.x_m, possible.y_m, strict=True))
    others = candidates.drop_duplicates(["x_m", "y_m"])
    for x, y in zip(others.x_m, others.y_m, strict=True):
        if (x, y) not in kept:
            lines = [np.array([[x - 1, y - way], [x + 1, y + way]]) for way in (1, -1)]
            yield path(lines, "no-place", closed=False)


def _area(area: Area) -> str:
    name = html.escape(area.name)
    circle = f'<circle class="m-area" cx="{area.x_m:g}" cy="{-area.y_m:g}" r="{area.radius_m:g}">'
    return f"{circle}<title>{name}</title></circle>"


def _scale(window: Window) -> Iterator[str]:
    """Yields a scale bar in the lower left corner, and an arrow to the north in the upper left."""
    width = float(window.size[0])
    length = max((s for s in SCALES_M if s < width / 3), default=SCALES_M[0])
    x, y = float(window.low[0]) + 5, -float(window.low[1]) - 5
    top, big = -float(window.high[1]) + 5, width / 45
    yield path([np.array([[x, -y], [x + length, -y]])], "scale", closed=False)
    yield f'<text class="m-text" x="{x:g}" y="{y - 2:g}" font-size="{big:.1f}">{length} m</text>'
    yield (
        f'<path class="m-north" d="M{x + 3:g} {top:g}l3 9l-3 -2l-3 2z"/><text class="m-text" '
        f'x="{x + 8:g}" y="{top + 8:g}" font-size="{big:.1f}">north</text>'
    )
