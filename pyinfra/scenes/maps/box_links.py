"""Links boxes of successive frames to tracks, by the predicted positions of the tracks."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from pyinfra.core.arrays import FloatArray, IntArray, NameArray

# Maximum distance of a box from the predicted position, if the velocity of the track is known.
_REACH_M = 3.0
_FIRST_REACH_M_S = 40.0  # maximum speed from the first box of a track to the second box
# A track has ended if its last box is more than _LOST_S and more than _LOST_STEPS frames ago.
_LOST_S, _LOST_STEPS = 0.35, 3.5
_FAR = 1e6  # cost of a track and a box that cannot belong to it


def link(times: FloatArray, boxes: FloatArray, classes: NameArray, step_s: float = 0.1) -> IntArray:
    """Returns track numbers (n,) for boxes (n, 7) at times (n,), assuming constant velocity.

    All boxes of a track have the same class and different times. step_s: usual time between frames.
    """
    lost_s = max(_LOST_S, _LOST_STEPS * step_s)
    out = np.full(len(times), -1)
    last: list[int] = []  # latest row of each track
    speed: list[FloatArray | None] = []
    for t in np.unique(times):
        rows = np.flatnonzero(times == t)
        live = [k for k, row in enumerate(last) if t - times[row] <= lost_s]
        for k, row in _matched(live, rows, last, speed, times, boxes, classes):
            speed[k] = (boxes[row, :2] - boxes[last[k], :2]) / (t - times[last[k]])
            last[k] = row
            out[row] = k
        for row in rows[out[rows] < 0]:
            out[row] = len(last)
            last.append(int(row))
            speed.append(None)
    return out


def _matched(
    live: list[int],
    rows: IntArray,
    last: list[int],
    speed: list[FloatArray | None],
    times: FloatArray,
    boxes: FloatArray,
    classes: NameArray,
) -> list[tuple[int, int]]:
    """Returns the pairs of tracks and rows with the smallest sum of distances."""
    cost = np.full((len(live), len(rows)), _FAR)
    for i, k in enumerate(live):
        before = last[k]
        gone_s = times[rows[0]] - times[before]
        velocity = speed[k]
        predicted = boxes[before, :2] + (0.0 if velocity is None else velocity * gone_s)
        reach = _FIRST_REACH_M_S * gone_s if velocity is None else _REACH_M
        apart = np.linalg.norm(boxes[rows, :2] - predicted, axis=1)
        fits = (apart <= reach) & (classes[rows] == classes[before])
        cost[i, fits] = apart[fits]
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [(live[i], int(rows[j])) for i, j in pairs if cost[i, j] < _FAR]
