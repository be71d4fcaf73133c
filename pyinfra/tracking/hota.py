"""HOTA, its parts, and the CLEAR MOT measures of tracks.

J. Luiten et al., HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking, IJCV 2021;
K. Bernardin and R. Stiefelhagen, Evaluating Multiple Object Tracking Performance, 2008. The
similarity of two objects is 1 - d / 2 m, for centres that are d apart.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from pyinfra.core.arrays import FloatArray, IntArray

ZERO_M = 2.0  # distance between two centres at which the similarity becomes 0
ALPHAS = np.arange(1, 20) * 0.05
_EPS = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Sightings:
    """The n objects of all frames, ordered by frame."""

    frame: IntArray  # (n,) frame numbers, ascending
    ids: IntArray  # (n,) ids of the objects
    xy: FloatArray  # (n, 2) centres, metres

    def at(self, frame: int) -> slice:
        start, end = np.searchsorted(self.frame, [frame, frame + 1])
        return slice(int(start), int(end))


@dataclass(frozen=True)
class Hota:
    """HOTA and its parts, in percent, averaged over the similarity thresholds."""

    hota: float
    det_a: float
    ass_a: float
    loc_a: float


@dataclass(frozen=True, eq=False)
class Clear:
    """CLEAR MOT measures at a centre distance of at most 2 m.

    `pairs` are rows of the truth and of the tracks that are matched (k, 2).
    """

    mota: float  # MOTA in percent
    switches: int
    pairs: IntArray


def hota(truth: Sightings, tracks: Sightings) -> Hota:
    """Computes HOTA. It is NaN if there is neither truth nor a track."""
    true_ids, true_row = np.unique(truth.ids, return_inverse=True)
    ids, row = np.unique(tracks.ids, return_inverse=True)
    rows = [(truth.at(f), tracks.at(f)) for f in np.union1d(truth.frame, tracks.frame)]
    alike = [
        (a, b, np.clip(1 - distances(truth.xy[a], tracks.xy[b]) / ZERO_M, 0, 1)) for a, b in rows
    ]
    # Similarity of each true object and track, summed over the frames. The sum weights the matches
    # of each frame.
    potential = np.zeros((len(true_ids), len(ids)))
    for a, b, values in alike:
        total = values.sum(0)[None] + values.sum(1)[:, None] - values
        share = np.divide(values, total, out=np.zeros_like(values), where=total > _EPS)
        potential[np.ix_(true_row[a], row[b])] += share
    true_count, count = np.bincount(true_row), np.bincount(row)
    aligned = potential / np.maximum(true_count[:, None] + count - potential, 1)
    matches = np.zeros((len(ALPHAS), len(true_ids), len(ids)))
    near = np.zeros(len(ALPHAS))
    for a, b, values in alike:
        if values.size == 0:
            continue
        i, j = linear_sum_assignment(-aligned[np.ix_(true_row[a], row[b])] * values)
        for k, alpha in enumerate(ALPHAS):
            ok = values[i, j] >= alpha - _EPS
            near[k] += values[i, j][ok].sum()
            matches[k, true_row[a][i[ok]], row[b][j[ok]]] += 1
    found = matches.sum((1, 2))
    all_boxes = len(truth.ids) + len(tracks.ids)
    if all_boxes == 0:
        return Hota(*[float("nan")] * 4)
    det = found / np.maximum(1, all_boxes - found)
    associated = matches / np.maximum(1, true_count[:, None] + count - matches)
    ass = (matches * associated).sum((1, 2)) / np.maximum(1, found)
    loc = np.maximum(1e-10, near) / np.maximum(1e-10, found)
    return Hota(*(100 * float(part.mean()) for part in (np.sqrt(det * ass), det, ass, loc)))


def clear(truth: Sightings, tracks: Sightings) -> Clear:
    """Matches tracks with the truth by frame; matches of the previous frame have priority."""
    last: dict[int, int] = {}  # latest track id of each true object id
    before: dict[int, int] = {}  # track id of each true object id in the previous frame
    pairs, switches = [np.empty((0, 2), np.int64)], 0
    for frame in np.union1d(truth.frame, tracks.frame):
        a, b = truth.at(frame), tracks.at(frame)
        apart = distances(truth.xy[a], tracks.xy[b])
        kept = np.array([before.get(i, -1) for i in truth.ids[a]])[:, None] == tracks.ids[b]
        value = np.where(apart <= ZERO_M, 1000.0 * kept + 10 - apart, 0)
        i, j = linear_sum_assignment(-value)
        ok = value[i, j] > 0
        matched = np.column_stack([i[ok] + a.start, j[ok] + b.start])
        before = {}
        for true_id, track_id in zip(
            truth.ids[matched[:, 0]].tolist(), tracks.ids[matched[:, 1]].tolist(), strict=True
        ):
            switches += last.get(true_id, track_id) != track_id
            last[true_id] = before[true_id] = track_id
        pairs.append(matched)
    all_pairs = np.concatenate(pairs)
    objects = len(truth.ids)
    wrong = objects + len(tracks.ids) - 2 * len(all_pairs) + switches
    return Clear(100 * (1 - wrong / objects) if objects else float("nan"), switches, all_pairs)


def distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the distances (n, m) of points (n, 2) and (m, 2)."""
    return np.asarray(np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1)))
