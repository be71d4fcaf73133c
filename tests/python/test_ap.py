"""Average precision and matching: cases by hand, comparison with the devkit, and independence of
the order."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.boxes import bev_iou
from pyinfra.metrics import ap, matching

scored_hits = st.lists(st.tuples(st.integers(1, 12), st.booleans()), max_size=60)


def r40(scores: object, hit: object, objects: int) -> float:
    return float(ap.average_precision(ranking(scores, hit, objects))[0])


def kitti(scores: object, hit: object, objects: int) -> float:
    return float(ap.kitti_average_precision(ranking(scores, hit, objects))[0])


def ranking(scores: object, hit: object, objects: int) -> ap.Ranking:
    return ap.rank(np.asarray(scores, np.float64), np.asarray(hit, np.bool_), objects)


def perfect(objects: int) -> tuple[FloatArray, BoolArray, int]:
    return np.linspace(0.9, 0.2, objects), np.ones(objects, np.bool_), objects


def slow_r40(scores: FloatArray, hit: BoolArray, objects: int, recalls: list[float]) -> float:
    """Computes AP directly from its definition."""
    points = []
    for threshold in np.unique(scores):
        counted = scores >= threshold
        hits = np.count_nonzero(hit & counted)
        points.append((hits / objects, hits / np.count_nonzero(counted)))
    reached = [max((p for r, p in points if r >= at - 1e-12), default=0) for at in recalls]
    return 100 * sum(reached) / len(recalls)


def devkit(scores: FloatArray, hit: BoolArray, objects: int) -> float:
    """Computes AP with loops, as the devkit does in getThresholds and in its sampling of
    precision."""
    hits = sorted(scores[hit], reverse=True)
    thresholds, current = [], 0.0
    for i, score in enumerate(hits):
        left = (i + 1) / objects
        right = (i + 2) / objects if i < len(hits) - 1 else left
        if right - current < current - left - 1e-12 and i < len(hits) - 1:
            continue
        thresholds.append(score)
        current += 1 / 40
    precision = [0.0] * 41
    for i, threshold in enumerate(thresholds):
        counted = scores >= threshold
        precision[i] = np.count_nonzero(hit & counted) / np.count_nonzero(counted)
    for i in range(41):
        precision[i] = max(precision[i:])
    return 100 * sum(precision[1:]) / 40


# --- the definition


@pytest.mark.parametrize("objects", [1, 10, 39, 40, 41, 1000])
def test_a_perfect_detector_has_100(objects: int) -> None:
    assert r40(*perfect(objects)) == 100
    assert ap.average_precision(ranking(*perfect(objects)), recalls=11) == 100


def test_four_objects_by_hand() -> None:
    """The true positives have ranks 1, 2 and 4 of 5. Precision is 1 up to recall 1/2, then 3/4 up
    to recall 3/4, then 0."""
    hit = [True, True, False, True, False]
    scores = [0.9, 0.8, 0.7, 0.6, 0.5]
    assert r40(scores, hit, 4) == pytest.approx(100 * (20 * 1 + 10 * 0.75) / 40)
    r11 = ap.average_precision(ranking(scores, hit, 4), recalls=11)[0]
    assert r11 == pytest.approx(100 * (6 * 1 + 2 * 0.75) / 11)


def test_precision_is_raised_to_the_highest_that_follows() -> None:
    assert r40([0.9, 0.8, 0.7], [False, True, True], 2) == pytest.approx(100 * 2 / 3)


def test_equal_scores_are_one_operating_point() -> None:
    """A true positive and a false positive with equal scores are counted together, in either
    order."""
    assert r40([0.5, 0.5], [True, False], 1) == 50
    assert r40([0.5, 0.5], [False, True], 1) == 50


def test_without_objects_it_is_undefined_and_without_predictions_nothing() -> None:
    assert math.isnan(r40([0.9], [False], 0))
    assert math.isnan(kitti([0.9], [False], 0))
    assert math.isnan(r40([], [], 0))
    assert r40([], [], 5) == 0
    assert kitti([], [], 5) == 0
    assert r40([0.9], [False], 5) == 0


@given(scored_hits, st.integers(0, 40))
def test_is_what_the_words_of_the_definition_say(rows: list[tuple[int, bool]], missed: int) -> None:
    scores = np.array([score / 16 for score, _ in rows])
    hit = np.array([is_hit for _, is_hit in rows], dtype=np.bool_)
    objects = np.count_nonzero(hit) + missed
    if objects > 0:
        levels = [k / 40 for k in range(1, 41)]
        assert r40(scores, hit, objects) == pytest.approx(slow_r40(scores, hit, objects, levels))
        levels = [k / 10 for k in range(11)]
        r11 = ap.average_precision(ranking(scores, hit, objects), recalls=11)[0]
        assert r11 == pytest.approx(slow_r40(scores, hit, objects, levels))


@given(scored_hits, st.randoms())
def test_order_of_predictions_has_no_influence(
    rows: list[tuple[int, bool]], random: object
) -> None:
    shuffled = list(rows)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    for measure in (r40, kitti):
        values = [measure([s for s, _ in r], [h for _, h in r], 70) for r in (rows, shuffled)]
        assert values[0] == values[1]


# --- the devkit's protocol


@pytest.mark.parametrize(
    ("objects", "expected"), [(10, 22.5), (39, 95.0), (40, 97.5), (41, 100.0), (1000, 100.0)]
)
def test_devkit_cannot_reach_100_with_fewer_than_41_objects(objects: int, expected: float) -> None:
    assert kitti(*perfect(objects)) == pytest.approx(expected, abs=0.005)


@pytest.mark.parametrize("objects", [990, 1000, 1010])
def test_devkit_credits_one_recall_too_many(objects: int) -> None:
    hits = round(0.79 * objects)
    scores, hit, _ = perfect(hits)
    assert kitti(scores, hit, objects) == pytest.approx(80.0, abs=0.005)
    assert r40(scores, hit, objects) == pytest.approx(77.5, abs=0.005)


def test_devkit_ap_can_rise_when_detections_are_dropped() -> None:
    """First 780 of 1000 objects are found without an error. Then come 780 false positives, then 10
    more true positives."""
    hit = np.repeat([True, False, True], [780, 780, 10])
    scores = np.linspace(0.9, 0.2, len(hit))
    assert kitti(scores, hit, 1000) == pytest.approx(78.75, abs=0.01)
    assert kitti(scores[:780], hit[:780], 1000) == pytest.approx(80.0)
    assert r40(scores, hit, 1000) == r40(scores[:780], hit[:780], 1000) == 77.5


@given(scored_hits, st.integers(0, 200))
@settings(max_examples=300)
def test_protocol_is_that_of_the_devkit(rows: list[tuple[int, bool]], missed: int) -> None:
    scores = np.array([score / 16 for score, _ in rows])
    hit = np.array([is_hit for _, is_hit in rows], dtype=np.bool_)
    objects = np.count_nonzero(hit) + missed
    if objects > 0:
        assert kitti(scores, hit, objects) == pytest.approx(devkit(scores, hit, objects))


@pytest.mark.parametrize("seed", range(5))
def test_protocol_is_that_of_the_devkit_with_many_objects(seed: int) -> None:
    random = np.random.default_rng(seed)
    scores, hit = random.random(1500), random.random(1500) < 0.7
    objects = int(np.count_nonzero(hit) * random.uniform(1, 1.5))
    assert kitti(scores, hit, objects) == pytest.approx(devkit(scores, hit, objects))


# --- weights of blocks


@pytest.mark.parametrize("measure", [ap.average_precision, ap.kitti_average_precision])
def test_a_block_of_weight_two_counts_as_if_it_were_there_twice(measure: object) -> None:
    random = np.random.default_rng(3)
    n, blocks = 300, 6
    scores, hit = np.round(random.random(n), 2), random.random(n) < 0.6
    block = random.integers(0, blocks, n)
    objects = np.bincount(block[hit], minlength=blocks) + 5
    weights = random.multinomial(blocks, [1 / blocks] * blocks, size=20)
    drawn = measure(ap.rank(scores, hit, objects, block), weights=weights)  # type: ignore[operator]
    for row, value in zip(weights, drawn, strict=True):
        times = row[block]
        again = ap.rank(np.repeat(scores, times), np.repeat(hit, times), int(row @ objects))
        assert value == pytest.approx(measure(again)[0])  # type: ignore[operator]


def test_weighted_ap_of_many_points_is_close() -> None:
    random = np.random.default_rng(4)
    for skill in (0.3, 1.0, 3.0):
        hit = random.random(60_000) < 0.6
        scores = random.normal(size=60_000) + skill * hit
        rank = ap.rank(scores, hit, 45_000)
        once = ap.average_precision(rank, weights=np.ones((1, 1), np.int64))
        assert abs(once - ap.average_precision(rank))[0] < 0.05


# --- matching


def boxes(*rows: tuple[float, ...]) -> FloatArray:
    """Returns cars along x from rows of x, y and, optionally, length."""
    return np.array([[x, y, 0, *(length or [4.0]), 2, 1.5, 0] for x, y, *length in rows])


def match(
    predictions: FloatArray,
    scores: list[float],
    vehicles: FloatArray,
    iou: float = 0.5,
    **how: bool,
) -> list[int]:
    zeros = (np.zeros(len(predictions), np.int64), np.zeros(len(vehicles), np.int64))
    pairs = matching.overlapping_pairs(zeros[0], predictions, zeros[1], vehicles)
    pairs = matching.in_order(pairs, np.array(scores), predictions, vehicles)
    return matching.match(pairs, len(predictions), len(vehicles), iou, **how).tolist()


def test_the_highest_score_takes_the_vehicle_and_the_other_is_a_duplicate() -> None:
    assert match(boxes((0, 0), (0.5, 0)), [0.5, 0.9], boxes((0, 0))) == [-1, 0]


def test_a_prediction_takes_what_it_overlaps_most() -> None:
    vehicles = boxes((0, 0), (1, 0))
    assert match(boxes((0.9, 0)), [0.9], vehicles) == [1]
    assert match(boxes((0.9, 0), (0.9, 0)), [0.9, 0.8], vehicles) == [1, 0]


def test_an_overlap_of_exactly_the_threshold_counts_but_not_for_the_devkit() -> None:
    """A box that is moved by a third of its length has an IoU of (2/3) / (4/3) = 1/2."""
    moved = boxes((4 / 3, 0))
    assert match(moved, [0.9], boxes((0, 0)), strict=False) == [0]
    assert match(moved, [0.9], boxes((0, 0)), strict=True) == [-1]


def test_vehicles_of_another_frame_are_not_taken() -> None:
    pairs = matching.overlapping_pairs(
        np.array([0, 1, 1]), boxes((0, 0), (0, 0), (9, 0)), np.array([1, 2]), boxes((0, 0), (0, 0))
    )
    assert (pairs.prediction.tolist(), pairs.vehicle.tolist()) == ([1], [0])


@given(
    st.lists(st.tuples(st.integers(0, 12), st.integers(0, 2), st.integers(1, 3)), max_size=9),
    st.lists(st.tuples(st.integers(0, 12), st.integers(0, 2)), max_size=6),
    st.randoms(),
)
def test_order_of_boxes_and_of_equal_scores_has_no_influence(
    detected: list[tuple[int, int, int]], truth: list[tuple[int, int]], random: object
) -> None:
    """The same boxes are true positives, not only the same number of boxes."""

    def taken(p: list[tuple[int, int, int]], v: list[tuple[int, int]]) -> list[object]:
        if not p or not v:
            return []
        predictions, vehicles = (boxes(*((r[0] / 2, r[1] / 2) for r in rows)) for rows in (p, v))
        pairs = match(predictions, [r[2] / 4 for r in p], vehicles, 0.3)
        return sorted((p[i], v[j]) for i, j in enumerate(pairs) if j >= 0)

    p, v = list(detected), list(truth)
    random.shuffle(p)  # type: ignore[attr-defined]
    random.shuffle(v)  # type: ignore[attr-defined]
    assert taken(detected, truth) == taken(p, v)


@pytest.mark.parametrize("seed", range(3))
def test_matching_is_what_a_plain_loop_finds(seed: int) -> None:
    random = np.random.default_rng(seed)
    vehicles = boxes(*random.uniform(0, 20, (12, 2)))
    predictions = boxes(*random.uniform(0, 20, (30, 2)))
    scores = random.random(30)
    iou = bev_iou(predictions, vehicles)
    expected = np.full(30, -1)
    for p in np.argsort(-scores):
        free = [v for v in range(12) if v not in expected and iou[p, v] >= 0.3]
        if free:
            expected[p] = max(free, key=lambda v: iou[p, v])
    assert match(predictions, scores.tolist(), vehicles, 0.3) == expected.tolist()
