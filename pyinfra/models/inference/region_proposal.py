"""Proposes an outline of the road from the positions of moving vehicles in a recording.

The steps are:

1. The static background of the recording is learnt. The other points are clustered.
2. Clusters are linked over frames. A track that moves far and smoothly is a vehicle. Leaves do not
   move far, and pedestrians are too slow.
3. The footprints of the vehicles are marked in a grid. Gaps between lanes are closed.
4. The boundary of each connected area, and of each large hole in it, becomes a polygon with few
   corners. Areas that are near each other are joined.

A lane on which no vehicle drives during the recording is not part of the outline.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from pyinfra.core.arrays import BoolArray, FloatArray, Points, concatenated
from pyinfra.core.errors import Error
from pyinfra.core.files import check_output, write
from pyinfra.core.present import Presented
from pyinfra.core.progress import track
from pyinfra.dataset.frames import frame_numbers, period_of, usual_step
from pyinfra.dataset.ground import Ground, ground_of
from pyinfra.dataset.outlines import Drawn, area, in_outline
from pyinfra.metrics.label_free_quality import BoxSeries, links, tracks
from pyinfra.models.detectors.background import Background, background_of
from pyinfra.models.inference.path_area import area_of
from pyinfra.models.training.sources import read_frame

SHORT_S = 30.0  # in a shorter recording, some lanes may have no vehicle
LEAST_S = 10.0  # minimum duration of the recording
LEAST_VEHICLES = 5  # minimum number of tracks of vehicles
MOST_SPACING_S = 0.25  # maximum time between frames; with more, boxes on leaves form tracks
SPACING_S = 0.2  # time between the frames that are used, if the recording has enough frames
# Maximum number of frames that are used, and number of windows of consecutive frames among them.
MOST_FRAMES = 600
WINDOWS = 20
LEAST_SCORE = 0.2  # clusters with a lower score have too few points, or are too large
# A vehicle is faster than SLOWEST_M_S, unlike a pedestrian. Over a time of WINDOW_S, the boxes of a
# vehicle are at most UNIFORM_M away from a uniform motion.
SLOWEST_M_S = 2.5
WINDOW_S = 1.2
UNIFORM_M = 1.0
LEAST_SHARE = 0.05  # minimum share of boxes of vehicles among the boxes near a position
NEAR_M = 2.0  # standard deviation of the Gaussian that weights boxes near a position


@dataclass(frozen=True, eq=False, repr=False)
class Proposal(Presented):
    """A proposed outline, and how well it fits the recording."""

    drawn: Drawn  # proposed area in the levelled LiDAR frame, metres
    area_m2: float
    seconds: float  # duration of the recording
    vehicles: int  # number of vehicle tracks; a vehicle may have several tracks
    inside_share: float  # share of the vehicles' boxes whose centre is inside the area
    moving_share: float  # share of moving points inside the area; leaves beside the road also move

    @property
    def corners(self) -> FloatArray:
        """The corners (m, 2) of the largest outline."""
        return max(self.drawn.outlines, key=area)

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        """The area for shapely and for `detect`: a MultiPolygon, with the holes in each outline."""
        polygons = []
        for outline in self.drawn.outlines:
            inside = [h for h in self.drawn.holes if in_outline(outline, h[:1], 0)[0]]
            polygons.append([ring.tolist() for ring in (outline, *inside)])
        return {"type": "MultiPolygon", "coordinates": polygons}

    def facts(self) -> dict[str, object]:
        shares = {"inside_share": f"{self.inside_share:.2f}"}
        return {"corners": len(self.corners), "area_m2": f"{self.area_m2:.0f}"} | shares


def propose_of_folder(lidar_folder: Path) -> Proposal:
    """Proposes an outline for the frames of a LiDAR's folder.

    Raises the errors of `propose_outline`, and FormatError for an invalid frame.
    """
    numbers, period_s = frame_numbers(lidar_folder, "all"), period_of(lidar_folder)
    road = ground_of(lidar_folder) if (lidar_folder / "lidar.yaml").is_file() else None
    try:
        return propose_outline(partial(read_frame, lidar_folder), numbers, period_s, road)
    except Error as error:
        raise Error(f"{lidar_folder}: {error}") from None


def write_outline(file: Path, drawn: Drawn) -> None:
    """Writes an area as an outline file, which `read_outline` reads."""
    check_output(file, b"outline")
    file.parent.mkdir(parents=True, exist_ok=True)
    if len(drawn.outlines) == 1:
        text = f"outline_m: {_pairs(drawn.outlines[0])}\n"
    else:
        text = f"outlines_m:\n{_rings(drawn.outlines)}"
    write(file, text + (f"holes_m:\n{_rings(drawn.holes)}" if drawn.holes else ""))


def _rings(rings: Sequence[FloatArray]) -> str:
    return "".join(f"- {_pairs(ring)}\n" for ring in rings)


def _pairs(corners: FloatArray) -> str:
    return f"[{', '.join(f'[{x:g}, {y:g}]' for x, y in np.round(corners, 1))}]"


def propose_outline(
    cloud_of: Callable[[int], Points],
    numbers: Sequence[int],
    period_s: float,
    road: Ground | None = None,
) -> Proposal:
    """Proposes an outline for the frames of a fixed sensor.

    cloud_of: maps a frame number to points (n, 4) in the levelled LiDAR frame. numbers: frame
    numbers, ascending. road: height of the road, if it has a relief. Raises Error if the recording
    is shorter than LEAST_S, has less than four frames per second, or has fewer than LEAST_VEHICLES
    tracks of vehicles.
    """
    # The duration includes one period after the start of the last frame. It is rounded, because
    # 0.1 s has no exact binary representation.
    span = numbers[-1] - numbers[0] + usual_step(numbers) if len(numbers) > 0 else 0
    seconds = round(span * period_s, 6)
    if seconds < LEAST_S:
        raise Error(f"expected a recording of {LEAST_S:g} s or more, got {seconds:g} s")
    gap = round(float(np.median(np.diff(numbers))))  # for example 2 if every second frame exists
    if gap * period_s > MOST_SPACING_S:
        raise Error(
            f"expected {MOST_SPACING_S:g} s or less between frames, got {gap * period_s:g} s"
        )
    stride = gap * max(1, round(SPACING_S / (gap * period_s)))
    chosen = in_windows(spaced(numbers, stride))
    background = background_of([partial(cloud_of, k) for k in chosen], None, road)
    seen, moving = _clusters(background, cloud_of, chosen, stride)
    driven, paths = vehicle_paths(seen, period_s * stride)
    count = len(np.unique(tracks(links(seen, period_s * stride))[driven]))
    if count < LEAST_VEHICLES:
        raise Error(
            f"expected {LEAST_VEHICLES} or more tracks of vehicles, got {count} in {seconds:g} s, "
            f"with {stride * period_s:g} s between frames"
        )
    drawn = area_of(paths, has_holes=seconds >= SHORT_S)
    return Proposal(
        drawn,
        drawn.area_m2,
        seconds,
        count,
        float(drawn.holds(seen.boxes[driven]).mean()),
        float(drawn.holds(moving).mean()),
    )


def _clusters(
    background: Background, cloud_of: Callable[[int], Points], chosen: Sequence[int], stride: int
) -> tuple[BoxSeries, FloatArray]:
    """Returns the clusters of all chosen frames, and x, y of all moving points (k, 2).

    The frames of the clusters are counted in strides. A larger gap counts as two strides or more,
    so that no track continues over it.
    """
    parts, moving = [], []
    strides = np.cumsum(np.ceil(np.diff(chosen, prepend=chosen[:1]) / stride)).astype(int)
    for number, at in zip(track(chosen, "frame"), strides, strict=True):
        points = cloud_of(number)
        clusters = background.predict(points)
        clusters = clusters.select(clusters.scores >= LEAST_SCORE)
        parts.append(BoxSeries(np.full(len(clusters), at), clusters.boxes, clusters.scores))
        moving.append(background.moving(points)[:, :2].astype(np.float64))
    return concatenated(parts), np.concatenate(moving)


def spaced(numbers: Sequence[int], stride: int) -> list[int]:
    """Selects some of the ascending numbers, each a stride or more above the previous one."""
    kept: list[int] = []
    for number in numbers:
        if not kept or number - kept[-1] >= stride:
            kept.append(number)
    return kept


def in_windows(numbers: Sequence[int]) -> list[int]:
    """Returns at most MOST_FRAMES of the numbers, in windows that are evenly distributed."""
    if len(numbers) <= MOST_FRAMES:
        return list(numbers)
    length = MOST_FRAMES // WINDOWS
    starts = np.linspace(0, len(numbers) - length, WINDOWS).astype(int)
    return sorted({numbers[i] for start in starts for i in range(start, start + length)})


def vehicle_paths(seen: BoxSeries, period_s: float) -> tuple[BoolArray, FloatArray]:
    """Returns which boxes belong to moving vehicles (n,), and the vehicles' paths (p, 2, 2).

    A vehicle moves nearly uniformly for WINDOW_S. Its path is the start x, y and the end x, y of
    this motion. Boxes on leaves move uniformly only by chance, so that they are a small share of
    the boxes at their position.
    """
    after = links(seen, period_s)
    count = round(WINDOW_S / period_s)
    chain = [np.arange(len(seen))]
    uniform = np.ones(len(seen), np.bool_)
    for _ in range(count):
        uniform &= after[chain[-1]] >= 0
        chain.append(np.where(uniform, after[chain[-1]], chain[-1]))
    xy = seen.boxes[:, :2]
    gone = xy[chain[-1]] - xy
    uniform &= np.linalg.norm(gone, axis=1) >= SLOWEST_M_S * count * period_s
    for i, rows in enumerate(chain):
        off_m = np.linalg.norm(xy[rows] - xy - i / count * gone, axis=1)
        uniform &= off_m <= UNIFORM_M
    driven = np.zeros(len(seen), np.bool_)
    for rows in chain:
        driven[rows[uniform]] = True
    common = _share_near(xy, driven) >= LEAST_SHARE
    starts = np.flatnonzero(uniform & common)
    return driven & common, np.stack([xy[starts], xy[chain[-1][starts]]], axis=1)


def _share_near(xy: FloatArray, chosen: BoolArray) -> FloatArray:
    """Returns, for each position, the share of chosen ones among the positions near it: (n,)."""
    cell = np.floor(xy - xy.min(axis=0, initial=0)).astype(int)
    size = cell.max(axis=0, initial=0) + 1
    counts = [np.zeros(size), np.zeros(size)]
    np.add.at(counts[0], tuple(cell[chosen].T), 1)
    np.add.at(counts[1], tuple(cell.T), 1)
    some, total = (gaussian_filter(grid, NEAR_M)[tuple(cell.T)] for grid in counts)
    return np.asarray(some / total)
