"""Average precision (AP) from matched predictions, 0 to 100.

AP (R40) is the mean precision at the recalls 1/40 .. 40/40, where the precision at a recall is the
highest precision at this or any higher recall. AP (R1000) uses the recalls 1/1000 .. 1, which
avoids the steps of 2.5 of AP (R40). Recall is true positives over objects. Precision is true
positives over counted predictions. Each operating point is a score threshold, so predictions of
equal score are counted together. If there are no objects, AP is undefined (NaN).
Sources: the KITTI object benchmark since 2019 (40 recalls); PASCAL VOC 2007 (11 recalls).

The functions take weights of time slots: a slot with weight 2 counts as if its frames existed
twice. With one row of weights per bootstrap replicate, one call computes all replicates. Weighted
AP uses at most about 2,000 operating points. In the tests, this limit changes AP by less than 0.05.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray

RECALLS, R1000_RECALLS = 40, 1000
KITTI_SAMPLES = 41  # number of recalls that KITTI's devkit samples: 0, 1/40, ..., 40/40
MOST_POINTS = 2000  # maximum number of operating points of the weighted AP
_CHUNK = 4_000_000  # maximum number of operating points times replicates in one chunk


@dataclass(frozen=True, eq=False)
class Ranking:
    """Counted predictions in order of descending score, and the number of objects in each slot.

    Only a score of at least one true positive is an operating point. Between two operating points
    precision only falls, so AP does not depend on the other scores.
    """

    scores: FloatArray  # (k,) scores of the operating points, descending
    upto: IntArray  # (k,) number of predictions with at least this score
    true_positives_upto: IntArray  # (k,) number of true positives with at least this score
    slot: IntArray  # (n,) time slot of each prediction
    true_positive_slot: IntArray  # (h,) time slot of each true positive
    objects: IntArray  # (slots,) number of objects in each time slot


def rank(
    scores: FloatArray,
    true_positive: BoolArray,
    objects: int | IntArray,
    slot: IntArray | None = None,
) -> Ranking:
    """Returns counted predictions as a Ranking. The caller leaves out ignored predictions.

    scores: (n,). true_positive: (n,) whether a prediction is a true positive. objects: the number
    of objects, or the number in each slot (slots,). slot: (n,) slot of each prediction, by default
    all 0. The result does not depend on the order of the predictions.
    """
    per_slot = np.atleast_1d(np.asarray(objects, dtype=np.int64))
    slot = np.zeros(len(scores), dtype=np.int64) if slot is None else slot
    order = np.argsort(-scores, kind="stable")
    scores, true_positive, slot = scores[order], true_positive[order], slot[order]
    ends = np.flatnonzero(np.append(scores[1:] != scores[:-1], True)[: len(scores)])
    true_positives = np.cumsum(true_positive)[ends]
    useful = np.diff(true_positives, prepend=0) > 0
    return Ranking(
        scores=scores[ends[useful]],
        upto=ends[useful] + 1,
        true_positives_upto=true_positives[useful].astype(np.int64),
        slot=slot,
        true_positive_slot=slot[true_positive],
        objects=per_slot,
    )


def average_precision(
    ranking: Ranking, recalls: int = RECALLS, weights: IntArray | None = None
) -> FloatArray:
    """Returns AP as this module defines it: (replicates,), NaN for a replicate without objects.

    recalls: 40, 1000, or 11 for the recalls 0, 0.1 .. 1. weights: (replicates, slots) whole
    numbers; by default one replicate in which each slot counts once.
    """
    count, first = (10, 0) if recalls == 11 else (recalls, 1)
    return np.asarray(100 * precision_at_recalls(ranking, count, first, weights).mean(axis=1))


def r40_and_r1000(
    ranking: Ranking, weights: IntArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Returns AP (R40) and AP (R1000), (replicates,) each, as `average_precision` does."""
    step = R1000_RECALLS // RECALLS  # every 25th of the 1,000 recalls is one of the 40
    precision = precision_at_recalls(ranking, R1000_RECALLS, 1, weights)
    coarse = np.ascontiguousarray(precision[:, step - 1 :: step])
    return np.asarray(100 * coarse.mean(axis=1)), np.asarray(100 * precision.mean(axis=1))


def precision_at_recalls(
    ranking: Ranking, count: int, first: int = 1, weights: IntArray | None = None
) -> FloatArray:
    """Returns the highest precision at or above the recalls first/count .. count/count.

    The shape is (replicates, recalls). The value is 0 for a recall that is not reached, and NaN for
    a replicate without objects.
    """
    levels = np.arange(first, count + 1)

    def envelope(
        true_positives: FloatArray, precision: FloatArray, objects: IntArray
    ) -> FloatArray:
        needed = -(-levels * objects[:, None] // count)
        at = np.stack([np.searchsorted(h, n) for h, n in zip(true_positives, needed, strict=True)])
        return _highest_from(precision, at)

    return _over_replicates(ranking, weights, len(levels), envelope)


def kitti_average_precision(ranking: Ranking, weights: IntArray | None = None) -> FloatArray:
    """Returns AP (R40) as KITTI's devkit computes it, (replicates,); NaN without objects.

    The devkit (evaluate_object.cpp, getThresholds) samples up to 41 scores of true positives. Their
    recalls are nearest to 0, 1/40 .. 40/40, and the last score is always sampled. The precision at
    each sample is raised to the highest precision at any later sample. AP is the mean of the 2nd to
    the 41st sample. A missing sample counts as 0, so AP cannot exceed (n - 1)/40 of 100 with n < 41
    objects. A detector that does not reach recall 1 is credited with one recall too many. True
    positives must have been matched with an IoU strictly above the threshold.
    """

    def sampled(true_positives: FloatArray, precision: FloatArray, objects: IntArray) -> FloatArray:
        total = (
            true_positives[:, -1].astype(np.int64)
            if true_positives.size
            else np.zeros(len(true_positives), np.int64)
        )
        nth = _kitti_true_positives(total, objects)
        at = np.stack([np.searchsorted(h, n) for h, n in zip(true_positives, nth, strict=True)])
        padded = np.pad(precision, ((0, 0), (0, 1)))
        picked = np.take_along_axis(padded, at, axis=1)
        return np.maximum.accumulate(picked[:, ::-1], axis=1)[:, ::-1]

    precision = _over_replicates(ranking, weights, KITTI_SAMPLES, sampled)
    return np.asarray(100 * precision[:, 1:].mean(axis=1))


def _kitti_true_positives(total: IntArray, objects: IntArray) -> IntArray:
    """Returns the numbers, from 1, of the true positives that the devkit samples: (replicates, 41).

    True positives are numbered by descending score. A missing sample has the number total + 1.
    """
    nth = np.empty((len(total), KITTI_SAMPLES), dtype=np.int64)
    last = np.zeros_like(total)
    for j in range(KITTI_SAMPLES):
        # The devkit skips true positive i while recall (i + 1)/n is nearer to j/40 than i/n is.
        # The devkit sums 1/40 in floating point. This code compares whole numbers instead.
        nearest = -((20 - j * objects) // 40)
        picked = np.minimum(np.maximum(last + 1, nearest), total)
        nth[:, j] = np.where(last >= total, total + 1, picked)
        last = np.maximum(last, picked)
    return nth


def _over_replicates(
    ranking: Ranking,
    weights: IntArray | None,
    width: int,
    measure: Callable[[FloatArray, FloatArray, IntArray], FloatArray],
) -> FloatArray:
    """Returns the values of `measure` for all replicates: (replicates, width).

    measure: maps true positives (d, k), precision (d, k) and objects (d,) of d replicates to
    (d, width). It is called once for each chunk of replicates.
    """
    if weights is None:
        objects = ranking.objects.sum(keepdims=True)
        true_positives = ranking.true_positives_upto[None].astype(np.float64)
        result = measure(true_positives, true_positives / ranking.upto, objects)
    else:
        objects = weights @ ranking.objects
        result = np.zeros((len(weights), width))
        in_slot, counted_in_slot = _per_slot(ranking)
        size = max(1, _CHUNK // max(1, in_slot.shape[1]))
        for start in range(0, len(weights), size):
            part = slice(start, start + size)
            drawn = weights[part].astype(np.float64)
            true_positives, counted = drawn @ in_slot, drawn @ counted_in_slot
            precision = np.divide(
                true_positives, counted, out=np.zeros_like(true_positives), where=counted > 0
            )
            result[part] = measure(true_positives, precision, objects[part])
    result[objects == 0] = np.nan
    return result


def _per_slot(ranking: Ranking) -> tuple[FloatArray, FloatArray]:
    """Returns cumulative numbers of true positives and predictions, (slots, points) each.

    An entry counts one slot, from the highest score to one operating point of `_some_points`.
    """
    points = _some_points(ranking)
    true_positives_upto, upto = ranking.true_positives_upto[points], ranking.upto[points]
    slots = len(ranking.objects)

    def cumulated(slot: IntArray, upto: IntArray) -> FloatArray:
        point = np.repeat(np.arange(len(upto)), np.diff(upto, prepend=0))
        slot_and_point = slot[: len(point)] * len(upto) + point
        counts = np.bincount(slot_and_point, minlength=slots * len(upto)).reshape(slots, len(upto))
        return np.cumsum(counts, axis=1, dtype=np.float64)

    return cumulated(ranking.true_positive_slot, true_positives_upto), cumulated(ranking.slot, upto)


def _some_points(ranking: Ranking) -> IntArray:
    """Returns the indices of all operating points, or of at most about MOST_POINTS of them.

    If there are more points, they are divided into groups of equal size. The result has the last
    and the most precise point of each group.
    """
    k = len(ranking.upto)
    if k <= MOST_POINTS:
        return np.arange(k)
    starts = np.linspace(0, k, MOST_POINTS // 2 + 1).astype(np.int64)[:-1]
    last = np.append(starts[1:], k) - 1
    precision = ranking.true_positives_upto / ranking.upto
    best_precision = np.repeat(np.maximum.reduceat(precision, starts), np.diff(starts, append=k))
    best = np.flatnonzero(precision == best_precision)
    return np.union1d(last, best)


def _highest_from(precision: FloatArray, at: IntArray) -> FloatArray:
    """Returns, for each column number in `at`, the highest precision from there to the row's end.

    precision: (d, k). at: (d, r), ascending in each row. The result has the shape of `at`.
    """
    rows, points = precision.shape
    padded = np.pad(precision, ((0, 0), (0, 1)))  # the added column is for recalls not reached
    stops = np.pad(at, ((0, 0), (0, 1)), constant_values=points)
    flat = stops + (points + 1) * np.arange(rows)[:, None]
    between = np.maximum.reduceat(padded.ravel(), flat.ravel()).reshape(stops.shape)[:, :-1]
    return np.asarray(np.maximum.accumulate(between[:, ::-1], axis=1)[:, ::-1])
