"""How far to believe a detector on frames that nobody labelled.

A second opinion comes from what moves before the background of a fixed sensor. It knows nothing of
vehicles that stand, and takes leaves for what moves; so no figure is an error by itself, and all of
them change with the score at which boxes are cut.

- A box is *confirmed* if POINTS points in it move.
- A cluster of what moves *travels* if it is seen in TRACK frames in a row or more, and gets
  TRAVELLED_M away from where it was first, by a path that is no longer than that / STRAIGHT; leaves
  do not. It is *found* if a box overlaps it, or has its centre within NEAR_M.
- A box *flickers* if it has no partner in the frame before nor in the one after.
- A box *stands* if boxes are there in HALF of all frames or more and few of them are confirmed:
  hedges, rails, and what is parked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.boxes import bev_overlap

CUTS = (0.1, 0.2, 0.3, 0.5, 0.7)
POINTS = 3
TRACK = 4
TRAVELLED_M = 3.0
STRAIGHT = 0.7
STEP_M = 0.3  # of a path; less is jitter
NEAR_M = 2.0
HERE_M = 1.0  # boxes as close stand in the same place
HALF = 0.5
FASTEST_M_S = 45.0
SLACK_M = 1.0  # by which a box jumps though its vehicle does not
LEAST_FRAMES = 5  # in a row or at all, for what needs neighbours or a place


@dataclass(frozen=True, eq=False)
class BoxSeries:
    """Boxes of consecutive or spread frames, by frame."""

    frame: IntArray  # (n,) number of the frame, ascending
    boxes: FloatArray  # (n, 7) levelled LiDAR frame
    scores: FloatArray  # (n,)

    def __len__(self) -> int:
        return len(self.frame)

    def select(self, keep: BoolArray) -> BoxSeries:
        return BoxSeries(self.frame[keep], self.boxes[keep], self.scores[keep])


@dataclass(frozen=True)
class Trust:
    """A row of `trust.csv`: the boxes from a score on; shares are nan where there is nothing."""

    score: float
    frames: int
    boxes_per_frame: float
    confirmed_share: float  # of the boxes, in which something moves
    found_share: float  # of the travelling clusters, that have a box
    travelling_per_frame: float  # clusters
    off_region_share: float  # of the boxes, whose centre is off the region; nan: none is known
    flicker_share: float  # of the boxes in frames with both neighbours
    standing_share: float  # of the boxes


COLUMNS = tuple(field.name for field in fields(Trust))


def trust(
    frames: Sequence[int],
    period_s: float,
    detections: BoxSeries,
    moving: IntArray,
    off_region: BoolArray | None,
    clusters: BoxSeries,
    cuts: Sequence[float] = CUTS,
) -> list[Trust]:
    """A row for each cut. frames: the numbers of all that were looked at, ascending.

    moving: (n,) points that move in each found box; off_region: (n,), None if no region is known;
    clusters: what moves, in the region.
    """
    numbers = np.asarray(frames)
    travelling = clusters.select(travels(clusters, period_s))
    rows = []
    for cut in cuts:
        keep = detections.scores >= cut
        confident = detections.select(keep)
        confirmed = moving[keep] >= POINTS
        rows.append(
            Trust(
                score=cut,
                frames=len(numbers),
                boxes_per_frame=len(confident) / max(len(numbers), 1),
                confirmed_share=_share(confirmed),
                found_share=_share(_has_box(travelling, confident)),
                travelling_per_frame=len(travelling) / max(len(numbers), 1),
                off_region_share=np.nan if off_region is None else _share(off_region[keep]),
                flicker_share=_flicker(confident, numbers, period_s),
                standing_share=_share(stands(confident, confirmed, len(numbers))),
            )
        )
    return rows


def links(seen: BoxSeries, period_s: float) -> IntArray:
    """(n,) the box of the next frame that each is again, -1: none.

    Nearest to each other of both frames, within SLACK_M and what FASTEST_M_S allows.
    """
    after = np.full(len(seen), -1)
    numbers, start = np.unique(seen.frame, return_index=True)
    ends = np.append(start[1:], len(seen))
    reach = SLACK_M + FASTEST_M_S * period_s
    moved = np.zeros((len(seen), 2))  # since the frame before
    for i in range(len(numbers) - 1):
        if numbers[i + 1] != numbers[i] + 1:
            continue
        here, there = np.arange(start[i], ends[i]), np.arange(start[i + 1], ends[i + 1])
        expected = seen.boxes[here, :2] + moved[here]
        gap = np.linalg.norm(expected[:, None] - seen.boxes[None, there, :2], axis=2)
        best, back = gap.argmin(axis=1), gap.argmin(axis=0)
        rows = np.arange(len(here))
        paired = (back[best] == rows) & (gap[rows, best] <= reach)
        after[here[paired]] = there[best[paired]]
        step = seen.boxes[there[best], :2] - seen.boxes[here, :2]
        moved[there[best[paired]]] = step[paired]
    return after


def travels(seen: BoxSeries, period_s: float) -> BoolArray:
    """(n,) boxes of tracks that are long enough and get away."""
    after = links(seen, period_s)
    track = tracks(after)
    count = np.bincount(track)
    first = np.unique(track, return_index=True)[1]
    away = np.linalg.norm(seen.boxes[:, :2] - seen.boxes[first[track], :2], axis=1)
    farthest = np.zeros(len(count))
    np.maximum.at(farthest, track, away)
    goes_on = np.flatnonzero(after >= 0)
    step = seen.boxes[after[goes_on], :2] - seen.boxes[goes_on, :2]
    length = np.linalg.norm(step, axis=1)
    path = np.bincount(track[goes_on], length * (length > STEP_M), minlength=len(count))
    away_enough = (farthest >= TRAVELLED_M) & (farthest >= STRAIGHT * path)
    return np.asarray((count >= TRACK) & away_enough)[track]


def tracks(after: IntArray) -> IntArray:
    """(n,) number of the track of each box, from `links`; a track begins at its first box."""
    track = np.full(len(after), -1)
    count = 0
    for i, following in enumerate(after):
        if track[i] < 0:
            track[i] = count
            count += 1
        if following >= 0:
            track[following] = track[i]
    return track


def stands(seen: BoxSeries, confirmed: BoolArray, frames: int) -> BoolArray:
    """(n,) boxes where boxes are in HALF of the frames or more, most of them not confirmed."""
    out = np.zeros(len(seen), np.bool_)
    if len(seen) == 0 or frames < LEAST_FRAMES:
        return out
    near = cKDTree(seen.boxes[:, :2]).query_ball_point(seen.boxes[:, :2], HERE_M)
    for i, neighbours in enumerate(near):
        present = len(np.unique(seen.frame[neighbours]))
        out[i] = present >= HALF * frames and confirmed[neighbours].mean() < HALF
    return out


def _has_box(clusters: BoxSeries, detections: BoxSeries) -> BoolArray:
    """(c,) clusters that a box of their frame overlaps, or whose centre is near one's."""
    out = np.zeros(len(clusters), np.bool_)
    for number in np.unique(clusters.frame):
        here = np.flatnonzero(clusters.frame == number)
        boxes = detections.boxes[detections.frame == number]
        if len(boxes) == 0:
            continue
        targets = clusters.boxes[here]
        gap = np.linalg.norm(targets[:, None, :2] - boxes[None, :, :2], axis=2)
        out[here] = ((gap <= NEAR_M) | (bev_overlap(targets, boxes) > 0)).any(axis=1)
    return out


def _flicker(detections: BoxSeries, numbers: IntArray, period_s: float) -> float:
    """Share of the boxes without a partner, of those in frames that have both neighbours."""
    inner = np.isin(numbers - 1, numbers) & np.isin(numbers + 1, numbers)
    if inner.sum() < LEAST_FRAMES - 2:
        return float("nan")
    after = links(detections, period_s)
    before = np.zeros(len(detections), np.bool_)
    before[after[after >= 0]] = True
    counted = np.isin(detections.frame, numbers[inner])
    return _share((~before & (after < 0))[counted])


def _share(which: BoolArray) -> float:
    return float(which.mean()) if len(which) > 0 else float("nan")
