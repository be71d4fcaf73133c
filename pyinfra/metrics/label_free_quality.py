"""Quality measures of a detector on frames without labels.

Predictions are compared with moving points: the points that remain when the static background of a
fixed sensor is subtracted. Standing vehicles have no moving points, but moving leaves have some.
Therefore no measure is an error rate by itself. All measures depend on the minimum score of the
boxes.

- A box is *confirmed* if it contains at least POINTS moving points.
- A cluster of moving points *travels* if it meets three conditions. It is tracked over TRACK
  consecutive frames or more. It moves at least TRAVELLED_M away from its first position. Its path
  is not longer than the largest distance from that position divided by STRAIGHT. Moving leaves do
  not meet these conditions.
- A cluster is *found* if a box overlaps it, or if the centre of a box is within NEAR_M.
- A box *flickers* if neither the previous nor the next frame has a box of the same object.
- A frame with a fault of the sensor (dataset/health.py) counts with the worst value of a share.
  Otherwise a fault could raise a measure, because a damaged cloud has fewer clusters to find.
- A box *stands* if boxes are at its position in at least HALF of all frames and less than HALF of
  these boxes are confirmed. Hedges, rails and parked vehicles cause standing boxes.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, Rows
from pyinfra.core.boxes import bev_overlap

CUTS = (0.1, 0.2, 0.3, 0.5, 0.7)
POINTS = 3
TRACK = 4
TRAVELLED_M = 3.0
STRAIGHT = 0.7
STEP_M = 0.3  # steps up to this length are position noise and do not add to the path
NEAR_M = 2.0
HERE_M = 1.0  # boxes whose centres are at most this far apart are at the same position
HALF = 0.5
FASTEST_M_S = 45.0
SLACK_M = 1.0  # tolerance for the position error of a box
LEAST_FRAMES = 5  # minimum number of frames for `flicker_share` and `standing_share`
# The measures are only computed for recordings within these limits: duration in seconds, share of
# consecutive frames, share of frames with a fault.
LEAST_S = 10.0
LEAST_CONSECUTIVE = 0.8
MOST_FAULTY = 0.5


@dataclass(frozen=True, eq=False)
class BoxSeries(Rows):
    """Boxes of several frames, ordered by frame."""

    frame: IntArray  # (n,) number of the frame, ascending
    boxes: FloatArray  # (n, 7) boxes in the levelled LiDAR frame
    scores: FloatArray  # (n,) scores of the boxes


@dataclass(frozen=True)
class Trust:
    """A row of `trust.csv`: the measures of all boxes with a score of `score` or more.

    Shares are 0 to 1. A share is NaN if its denominator is 0.
    """

    score: float
    frames: int
    faulty_frames: int  # number of frames with a fault of the sensor
    boxes_per_frame: float  # mean number of boxes in frames without a fault
    confirmed_share: float  # share of boxes with moving points
    recall: float  # share of travelling clusters that lie in a box
    travelling_per_frame: float  # mean number of travelling clusters in frames without a fault
    off_region_share: float  # share of boxes outside the region; NaN if no region is known
    flicker_share: float  # share of boxes that flicker, in frames with a previous and a next frame
    standing_share: float  # share of boxes that do not move, such as boxes on hedges


COLUMNS = tuple(field.name for field in fields(Trust))


def trust(
    frames: Sequence[int],
    period_s: float,
    detections: BoxSeries,
    moving: IntArray,
    off_region: BoolArray | None,
    clusters: BoxSeries,
    cuts: Sequence[float] = CUTS,
    faulty: Collection[int] = (),
) -> list[Trust]:
    """Returns a row for each minimum score in `cuts`.

    frames: numbers of all frames, ascending. moving: (n,) number of moving points in each detected
    box. off_region: (n,) whether a box is outside the region; None if no region is known. clusters:
    boxes of clusters of moving points in the region. faulty: numbers of frames with a fault.
    """
    numbers = np.setdiff1d(frames, list(faulty))
    share = len(numbers) / max(len(frames), 1)  # share of frames without a fault
    kept = np.isin(detections.frame, numbers)
    detections, moving = detections.select(kept), moving[kept]
    off_region = None if off_region is None else off_region[kept]
    clusters = clusters.select(np.isin(clusters.frame, numbers))
    travelling = clusters.select(travels(clusters, period_s))
    rows = []
    for cut in cuts:
        keep = detections.scores >= cut
        confident = detections.select(keep)
        confirmed = moving[keep] >= POINTS
        rows.append(
            Trust(
                score=cut,
                frames=len(frames),
                faulty_frames=len(frames) - len(numbers),
                boxes_per_frame=len(confident) / max(len(numbers), 1),
                confirmed_share=share * _share(confirmed),
                recall=share * _share(_has_box(travelling, confident)),
                travelling_per_frame=len(travelling) / max(len(numbers), 1),
                off_region_share=(
                    np.nan if off_region is None else 1 - share * (1 - _share(off_region[keep]))
                ),
                flicker_share=1 - share * (1 - _flicker(confident, numbers, period_s)),
                standing_share=(
                    1 - share * (1 - _share(stands(confident, confirmed, len(numbers))))
                ),
            )
        )
    return rows


def refusal(
    frames: Sequence[int], period_s: float, faulty: Collection[int], *, has_region: bool
) -> str:
    """Returns why the measures would be meaningless for these frames, else an empty text."""
    seconds = (frames[-1] - frames[0] + 1) * period_s if frames else 0.0
    if seconds < LEAST_S:
        return f"expected a recording of {LEAST_S:g} s or more, got {seconds:.3g} s"
    consecutive = float((np.diff(frames) == 1).mean())
    if consecutive < LEAST_CONSECUTIVE:
        return (
            f"expected {100 * LEAST_CONSECUTIVE:g} % or more of the frames to follow the frame "
            f"before them, got {100 * consecutive:.0f} %"
        )
    if len(faulty) > MOST_FAULTY * len(frames):
        return (
            f"expected a fault in at most {100 * MOST_FAULTY:g} % of the frames, got "
            f"{len(faulty)} of {len(frames)}"
        )
    if not has_region:
        return (
            "expected an outline of the road, got none: `pyinfra region` proposes one, and "
            "`region` of `pyinfra import` takes it"
        )
    return ""


def links(seen: BoxSeries, period_s: float) -> IntArray:
    """Returns the index of the box in the next frame that each box is linked to: (n,), -1 for none.

    The last step of a box predicts its next position. A box is linked to the box that is nearest to
    its predicted position, if no other prediction is nearer to that box. The distance must be at
    most SLACK_M plus the distance that an object of speed FASTEST_M_S covers in one period.
    """
    after = np.full(len(seen), -1)
    numbers, start = np.unique(seen.frame, return_index=True)
    ends = np.append(start[1:], len(seen))
    reach = SLACK_M + FASTEST_M_S * period_s
    moved = np.zeros((len(seen), 2))  # step of each box since the previous frame
    for i in range(len(numbers) - 1):
        if numbers[i + 1] != numbers[i] + 1:
            continue
        current, following = np.arange(start[i], ends[i]), np.arange(start[i + 1], ends[i + 1])
        expected = seen.boxes[current, :2] + moved[current]
        gap = np.linalg.norm(expected[:, None] - seen.boxes[None, following, :2], axis=2)
        best, back = gap.argmin(axis=1), gap.argmin(axis=0)
        rows = np.arange(len(current))
        paired = (back[best] == rows) & (gap[rows, best] <= reach)
        after[current[paired]] = following[best[paired]]
        step = seen.boxes[following[best], :2] - seen.boxes[current, :2]
        moved[following[best[paired]]] = step[paired]
    return after


def travels(seen: BoxSeries, period_s: float) -> BoolArray:
    """Returns which boxes belong to a track that travels: (n,) bool."""
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
    """Returns the track number of each box: (n,). after: the result of `links`."""
    linked = np.flatnonzero(after >= 0)
    graph = coo_array((np.ones(len(linked)), (linked, after[linked])), shape=(len(after),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1])


def stands(seen: BoxSeries, confirmed: BoolArray, frames: int) -> BoolArray:
    """Returns which boxes stand: (n,) bool. confirmed: (n,). frames: number of all frames."""
    out = np.zeros(len(seen), np.bool_)
    if len(seen) == 0 or frames < LEAST_FRAMES:
        return out
    near = cKDTree(seen.boxes[:, :2]).query_ball_point(seen.boxes[:, :2], HERE_M)
    for i, neighbours in enumerate(near):
        present = len(np.unique(seen.frame[neighbours]))
        out[i] = present >= HALF * frames and confirmed[neighbours].mean() < HALF
    return out


def _has_box(clusters: BoxSeries, detections: BoxSeries) -> BoolArray:
    """Returns which clusters are found by a box of their frame: (c,) bool."""
    out = np.zeros(len(clusters), np.bool_)
    for number in np.unique(clusters.frame):
        in_frame = np.flatnonzero(clusters.frame == number)
        boxes = detections.boxes[detections.frame == number]
        if len(boxes) == 0:
            continue
        targets = clusters.boxes[in_frame]
        gap = np.linalg.norm(targets[:, None, :2] - boxes[None, :, :2], axis=2)
        out[in_frame] = ((gap <= NEAR_M) | (bev_overlap(targets, boxes) > 0)).any(axis=1)
    return out


def _flicker(detections: BoxSeries, numbers: IntArray, period_s: float) -> float:
    """Returns the share of boxes that flicker, in frames with a previous and a next frame.

    numbers: numbers of all frames, ascending. The share is NaN if there are too few such frames.
    """
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
