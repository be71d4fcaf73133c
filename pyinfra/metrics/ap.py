"""Average precision from matched detections; pure functions, numbers from 0 to 100.

Definition (AP|R40): precision at the recalls 1/40 .. 40/40, each the highest precision at that
recall or beyond, averaged. Fine AP: at 1/1000 .. 1, without the steps of 2.5 that 40 recalls
have. Recall is hits over objects, precision hits over counted predictions.
Predictions of equal score enter together: an operating point is a score, not a prediction.
Without objects AP is undefined: nan.
Sources: the KITTI object benchmark since 2019 (40 recalls); PASCAL VOC 2007 (11 recalls).

Everything takes weights of slots of time, so that a bootstrap is one call: a slot of weight 2
counts as if its frames were there twice. Weighted AP looks at 2,000 operating points at
the most, which changes it by some hundredths where there are more (tests: less than 0.05).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray

RECALLS, FINE_RECALLS = 40, 1000
KITTI_SAMPLES = 41  # recalls the devkit aims at: 0, 1/40 .. 40/40
MOST_POINTS = 2000  # of weighted AP
_CHUNK = 4_000_000  # points times draws at a time


@dataclass(frozen=True, eq=False)
class Ranking:
    """Counted predictions in order of falling score, and the objects to be found.

    An operating point is a score at which at least one object is hit; between two of them
    precision only falls, so no definition of AP needs the others.
    """

    scores: FloatArray  # (k,) of the operating points, falling
    upto: IntArray  # (k,) predictions up to and with the operating point
    hits_upto: IntArray  # (k,) those of them that hit an object
    slot: IntArray  # (n,) slot of each prediction
    hit_slot: IntArray  # (h,) slot of each hit
    objects: IntArray  # (slots,) objects in each slot


def rank(
    scores: FloatArray,
    hit: BoolArray,
    objects: int | IntArray,
    slot: IntArray | None = None,
) -> Ranking:
    """Counted predictions as a Ranking; those to be ignored are left out by the caller.

    scores, hit: (n,); objects: how many there are, or per slot (slots,); slot: (n,), all 0 if
    left out. The order of the predictions has no influence on anything that follows.
    """
    per_slot = np.atleast_1d(np.asarray(objects, dtype=np.int64))
    slot = np.zeros(len(scores), dtype=np.int64) if slot is None else slot
    order = np.argsort(-scores, kind="stable")
    scores, hit, slot = scores[order], hit[order], slot[order]
    ends = np.flatnonzero(np.append(scores[1:] != scores[:-1], True)[: len(scores)])
    hits = np.cumsum(hit)[ends]
    useful = np.diff(hits, prepend=0) > 0
    return Ranking(
        scores=scores[ends[useful]],
        upto=ends[useful] + 1,
        hits_upto=hits[useful].astype(np.int64),
        slot=slot,
        hit_slot=slot[hit],
        objects=per_slot,
    )


def average_precision(
    ranking: Ranking, recalls: int = RECALLS, weights: IntArray | None = None
) -> FloatArray:
    """AP by the definition above, (draws,); nan for a draw without objects.

    recalls: 40, 1000, or 11 for the recalls 0, 0.1 .. 1.
    weights: (draws, slots) whole numbers; left out, one draw of every slot once.
    """
    count, first = (10, 0) if recalls == 11 else (recalls, 1)
    return np.asarray(100 * precision_at_recalls(ranking, count, first, weights).mean(axis=1))


def coarse_and_fine(
    ranking: Ranking, weights: IntArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """AP at 40 and at 1,000 recalls, (draws,) each, as of `average_precision`."""
    step = FINE_RECALLS // RECALLS  # every 25th of the 1,000 recalls is one of the 40
    precision = precision_at_recalls(ranking, FINE_RECALLS, 1, weights)
    coarse = np.ascontiguousarray(precision[:, step - 1 :: step])
    return np.asarray(100 * coarse.mean(axis=1)), np.asarray(100 * precision.mean(axis=1))


def precision_at_recalls(
    ranking: Ranking, count: int, first: int = 1, weights: IntArray | None = None
) -> FloatArray:
    """Highest precision at or beyond the recalls first/count .. count/count: (draws, recalls).

    0 where the recall is not reached, nan for a draw without objects.
    """
    levels = np.arange(first, count + 1)

    def envelope(hits: FloatArray, precision: FloatArray, objects: IntArray) -> FloatArray:
        needed = -(-levels * objects[:, None] // count)
        at = np.stack([np.searchsorted(h, n) for h, n in zip(hits, needed, strict=True)])
        return _highest_from(precision, at)

    return _over_draws(ranking, weights, len(levels), envelope)


def kitti_average_precision(ranking: Ranking, weights: IntArray | None = None) -> FloatArray:
    """AP|R40 by the protocol of KITTI's devkit, (draws,); nan for a draw without objects.

    The devkit (evaluate_object.cpp, getThresholds) picks up to 41 of the hits' scores, those whose
    recall is nearest to 0, 1/40 .. 40/40, always with the last one; precision at each is raised to
    the highest that follows; AP is the mean of the 2nd to the 41st, a missing one being 0. So AP
    cannot pass (n - 1)/40 with n < 41 objects, and one recall too many is credited to a detector
    that stops short of recall 1. Hits are to be found with an IoU strictly above the threshold.
    """

    def sampled(hits: FloatArray, precision: FloatArray, objects: IntArray) -> FloatArray:
        total = hits[:, -1].astype(np.int64) if hits.size else np.zeros(len(hits), np.int64)
        nth = _kitti_hits(total, objects)
        at = np.stack([np.searchsorted(h, n) for h, n in zip(hits, nth, strict=True)])
        padded = np.pad(precision, ((0, 0), (0, 1)))
        picked = np.take_along_axis(padded, at, axis=1)
        return np.maximum.accumulate(picked[:, ::-1], axis=1)[:, ::-1]

    precision = _over_draws(ranking, weights, KITTI_SAMPLES, sampled)
    return np.asarray(100 * precision[:, 1:].mean(axis=1))


def _kitti_hits(total: IntArray, objects: IntArray) -> IntArray:
    """(draws, 41): which hits the devkit samples, counted from 1; total + 1 for none."""
    nth = np.empty((len(total), KITTI_SAMPLES), dtype=np.int64)
    last = np.zeros_like(total)
    for j in range(KITTI_SAMPLES):
        # Hit i is passed over while recall (i + 1)/n is nearer to j/40 than i/n is; 40 j/n as
        # whole numbers, where the devkit sums 1/40 in floating point.
        nearest = -((20 - j * objects) // 40)
        picked = np.minimum(np.maximum(last + 1, nearest), total)
        nth[:, j] = np.where(last >= total, total + 1, picked)
        last = np.maximum(last, picked)
    return nth


def _over_draws(
    ranking: Ranking,
    weights: IntArray | None,
    width: int,
    measure: Callable[[FloatArray, FloatArray, IntArray], FloatArray],
) -> FloatArray:
    """measure(hits (d, k), precision (d, k), objects (d,)) -> (d, width), on chunks of draws."""
    if weights is None:
        objects = ranking.objects.sum(keepdims=True)
        hits = ranking.hits_upto[None].astype(np.float64)
        result = measure(hits, hits / ranking.upto, objects)
    else:
        objects = weights @ ranking.objects
        result = np.zeros((len(weights), width))
        in_slot, counted_in_slot = _per_slot(ranking)
        for part in _chunks(len(weights), in_slot.shape[1]):
            drawn = weights[part].astype(np.float64)
            hits, counted = drawn @ in_slot, drawn @ counted_in_slot
            precision = np.divide(hits, counted, out=np.zeros_like(hits), where=counted > 0)
            result[part] = measure(hits, precision, objects[part])
    result[objects == 0] = np.nan
    return result


def _chunks(draws: int, points: int) -> Iterator[slice]:
    size = max(1, _CHUNK // max(1, points))
    for start in range(0, draws, size):
        yield slice(start, start + size)


def _per_slot(ranking: Ranking) -> tuple[FloatArray, FloatArray]:
    """Hits, and predictions, of each slot up to some operating points: (slots, points) each."""
    points = _some_points(ranking)
    hits_upto, upto = ranking.hits_upto[points], ranking.upto[points]
    slots = len(ranking.objects)

    def cumulated(slot: IntArray, upto: IntArray) -> FloatArray:
        point = np.repeat(np.arange(len(upto)), np.diff(upto, prepend=0))
        cell = slot[: len(point)] * len(upto) + point
        counts = np.bincount(cell, minlength=slots * len(upto)).reshape(slots, len(upto))
        return np.cumsum(counts, axis=1, dtype=np.float64)

    return cumulated(ranking.hit_slot, hits_upto), cumulated(ranking.slot, upto)


def _some_points(ranking: Ranking) -> IntArray:
    """All operating points, or of groups of equally many the last and the most precise."""
    k = len(ranking.upto)
    if k <= MOST_POINTS:
        return np.arange(k)
    starts = np.linspace(0, k, MOST_POINTS // 2 + 1).astype(np.int64)[:-1]
    last = np.append(starts[1:], k) - 1
    precision = ranking.hits_upto / ranking.upto
    best_precision = np.repeat(np.maximum.reduceat(precision, starts), np.diff(starts, append=k))
    best = np.flatnonzero(precision == best_precision)
    return np.union1d(last, best)


def _highest_from(precision: FloatArray, at: IntArray) -> FloatArray:
    """Highest precision from column at[d, j] of row d on: (d, k) and (d, j) to (d, j); at rises."""
    rows, points = precision.shape
    padded = np.pad(precision, ((0, 0), (0, 1)))  # column k: beyond the last point
    stops = np.pad(at, ((0, 0), (0, 1)), constant_values=points)
    flat = stops + (points + 1) * np.arange(rows)[:, None]
    between = np.maximum.reduceat(padded.ravel(), flat.ravel()).reshape(stops.shape)[:, :-1]
    return np.asarray(np.maximum.accumulate(between[:, ::-1], axis=1)[:, ::-1])
