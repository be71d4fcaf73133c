"""Overlap of rotated boxes, compared with shapely and with clipping in rational arithmetic."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pyinfra.core.arrays import FloatArray
from pyinfra.core.boxes import (
    bev_iou,
    bev_overlap,
    pair_bev_iou,
    pair_iou_3d,
    points_in_box,
    points_in_boxes,
)

CAR = [10.0, 2.0, -5.0, 4.0, 2.0, 1.5, 0.3]


def row(*values: float) -> FloatArray:
    return np.array([values], dtype=np.float64)


def corners(boxes: FloatArray) -> FloatArray:
    ahead = np.array([0.5, 0.5, -0.5, -0.5]) * boxes[:, 3, None]
    left = np.array([-0.5, 0.5, 0.5, -0.5]) * boxes[:, 4, None]
    cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
    x, y = cos * ahead - sin * left, sin * ahead + cos * left
    return np.stack([boxes[:, 0, None] + x, boxes[:, 1, None] + y], axis=2)


def exact_iou(a: FloatArray, b: FloatArray) -> float:
    """Returns the IoU of two boxes (7,). It clips their corners without rounding."""
    one, two = (
        [(Fraction(float(x)), Fraction(float(y))) for x, y in corners(box[None])[0]]
        for box in (a, b)
    )
    clipped = one
    for (ax, ay), (bx, by) in pairwise([*two, two[0]]):
        side = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in clipped]
        kept = []
        for k, (x, y) in enumerate(clipped):
            if (side[k - 1] >= 0) != (side[k] >= 0):
                t = side[k - 1] / (side[k - 1] - side[k])
                px, py = clipped[k - 1]
                kept.append((px + t * (x - px), py + t * (y - py)))
            if side[k] >= 0:
                kept.append((x, y))
        clipped = kept
    shared, first, second = (area(polygon) for polygon in (clipped, one, two))
    return float(shared / (first + second - shared))


def area(polygon: list[tuple[Fraction, Fraction]]) -> Fraction:
    twice = [polygon[k - 1][0] * y - x * polygon[k - 1][1] for k, (x, y) in enumerate(polygon)]
    return sum(twice, Fraction(0)) / 2


def random_boxes(n: int, seed: int) -> FloatArray:
    low, high = [-4, -4, -1, 0.5, 0.5, 1, -7], [4, 4, 1, 12, 3, 4, 7]
    return np.random.default_rng(seed).uniform(low, high, (n, 7))


def moved_along(boxes: FloatArray, ahead: float, left: float, quarters: int = 0) -> FloatArray:
    """Moves boxes by shares of their own length and width, and rotates them by multiples of 90
    degrees."""
    result = boxes.copy()
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    u, v = ahead * boxes[:, 3], left * boxes[:, 4]
    result[:, 0] += cos * u - sin * v
    result[:, 1] += sin * u + cos * v
    result[:, 6] += quarters * math.pi / 2
    return result


def test_a_box_overlaps_itself_entirely_whichever_way_it_points() -> None:
    boxes = random_boxes(1000, 0)
    assert (pair_bev_iou(boxes, boxes) == 1).all()
    assert np.abs(pair_bev_iou(boxes, moved_along(boxes, 0, 0, 2)) - 1).max() < 1e-14
    assert np.abs(pair_iou_3d(boxes, boxes) - 1).max() < 1e-14


@pytest.mark.parametrize("quarters", [0, 1, 2, 3, 4])
@pytest.mark.parametrize(
    ("ahead", "left", "expected"),
    [(1, 0, 0), (0, 1, 0), (1, 1, 0), (0.5, 0, 1 / 3), (1 / 3, 0, 0.5)],
)
def test_squares_moved_along_an_edge(
    ahead: float, left: float, expected: float, quarters: int
) -> None:
    squares = random_boxes(500, 1)
    squares[:, 4] = squares[:, 3]
    iou = pair_bev_iou(squares, moved_along(squares, ahead, left, quarters))
    assert np.abs(iou - expected).max() < 1e-14
    if expected == 0:
        assert (iou < 1e-15).all()


def test_boxes_apart_overlap_by_exactly_nothing() -> None:
    boxes = random_boxes(2000, 2)
    for ahead, left in [(1.01, 0), (0, -1.01), (5, 5)]:
        apart = moved_along(boxes, ahead, left)
        assert (pair_bev_iou(boxes, apart) == 0).all()
        assert (pair_iou_3d(boxes, apart) == 0).all()


def test_a_cross_of_two_boxes() -> None:
    assert bev_iou(row(0, 0, 0, 4, 2, 1, 0), row(0, 0, 0, 4, 2, 1, math.pi / 2)) == pytest.approx(
        4 / 12, abs=1e-15
    )
    assert bev_overlap(row(0, 0, 0, 2, 2, 1, 0), row(0, 0, 0, 2, 2, 1, math.pi / 4)) == (
        pytest.approx(8 * (math.sqrt(2) - 1), abs=1e-14)
    )


def test_volume_overlap_is_that_of_footprint_times_height() -> None:
    low, high = row(0, 0, 0, 4, 2, 2, 0), row(2, 0, 1, 4, 2, 2, 0)
    assert pair_iou_3d(low, high) == pytest.approx(4 / (16 + 16 - 4), abs=1e-15)
    assert pair_iou_3d(low, row(0, 0, 2, 4, 2, 2, 0)) == 0


def test_matrix_has_a_row_per_first_and_a_column_per_second_box() -> None:
    a, b = random_boxes(7, 3), random_boxes(5, 4)
    matrix = bev_iou(a, b)
    assert matrix.shape == (7, 5)
    assert matrix[3, 2] == pair_bev_iou(a[3:4], b[2:3])[0]
    assert bev_iou(a[:0], b).shape == (0, 5)


def test_agrees_with_shapely_on_random_boxes() -> None:
    a, b = random_boxes(20_000, 5), random_boxes(20_000, 6)
    one, two = shapely.polygons(corners(a)), shapely.polygons(corners(b))
    shared = shapely.area(shapely.intersection(one, two))
    expected = shared / (shapely.area(one) + shapely.area(two) - shared)
    assert np.abs(pair_bev_iou(a, b) - expected).max() < 1e-12


@pytest.mark.parametrize("exponent", range(-16, -2))
def test_nearly_equal_boxes_are_exact(exponent: int) -> None:
    """Edges of these boxes nearly coincide. Shapely itself is wrong for some of them."""
    a = random_boxes(60, 7)
    b = a + np.random.default_rng(8).uniform(-1, 1, a.shape) * 10.0**exponent
    expected = [exact_iou(*pair) for pair in zip(a, b, strict=True)]
    assert np.abs(pair_bev_iou(a, b) - expected).max() < 1e-13


nasty = st.sampled_from([0.0, 0.5, 1.0, 2.0, -1.0, 1e-9, 1 / 3, -2.5, 1e-3])
sizes = st.sampled_from([0.5, 1.0, 2.0, 4.0, 12.0, 1e-3])
turns = st.sampled_from([k * math.pi / 4 for k in range(-8, 9)] + [1e-9, 1e-12, 1.0])
boxes_on_a_grid = st.tuples(nasty, nasty, nasty, sizes, sizes, sizes, turns)


@given(boxes_on_a_grid, boxes_on_a_grid)
def test_degenerate_pairs_are_exact_and_symmetric(
    a: tuple[float, ...], b: tuple[float, ...]
) -> None:
    one, two = row(*a), row(*b)
    iou = pair_bev_iou(one, two)[0]
    assert iou == pytest.approx(exact_iou(one[0], two[0]), abs=1e-12)
    assert iou == pytest.approx(pair_bev_iou(two, one)[0], abs=1e-13)
    assert 0 <= iou <= 1


@given(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), st.floats(-20, 20))
def test_moving_both_boxes_changes_nothing(x: float, y: float, turn: float) -> None:
    a, b = random_boxes(50, 9), random_boxes(50, 10)
    expected = pair_bev_iou(a, b)
    cos, sin = math.cos(turn), math.sin(turn)
    for boxes in (a, b):
        boxes[:, :2] = boxes[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
        boxes[:, 6] += turn
    assert np.abs(pair_bev_iou(a, b) - expected).max() < 1e-9


def test_a_box_without_size_overlaps_nothing() -> None:
    assert bev_iou(row(0, 0, 0, 0, 0, 0, 0), row(0, 0, 0, 0, 0, 0, 0)) == 0
    assert pair_iou_3d(row(0, 0, 0, 0, 0, 0, 0), row(0, 0, 0, 4, 2, 1, 0)) == 0


@pytest.mark.parametrize(
    "wrong", [row(*CAR[:6]), row(*CAR[:6], math.nan), row(*CAR[:3], -4, *CAR[4:]), np.zeros(7)]
)
def test_wrong_boxes_are_an_error(wrong: FloatArray) -> None:
    with pytest.raises(ValueError, match=r"boxes: .*expected"):
        bev_iou(wrong, row(*CAR))


def test_points_of_a_vehicle_by_hand() -> None:
    """A box is rotated by 90 degrees. It is 4 m long, 2 m wide and 2 m high, and stands on z =
    0."""
    box = np.array([10.0, 5.0, 1.0, 4.0, 2.0, 2.0, np.pi / 2])
    inside = [[10, 5, 1], [10, 7.04, 1], [8.96, 5, 1], [10, 5, 2.04], [10, 5, 0.06]]
    outside = [[10, 7.06, 1], [8.94, 5, 1], [10, 5, 2.06], [10, 5, 0.04], [12, 5, 1]]
    points = np.array([*inside, *outside], dtype=np.float32)
    assert points_in_box(points, box).tolist() == [True] * 5 + [False] * 5
    far = box + np.array([50, 0, 0, 0, 0, 0, 0])
    assert points_in_boxes(points, np.stack([box, far])).tolist() == [5, 0]
    at_the_side = points_in_box(points, box, 0)  # includes points of the road
    assert np.flatnonzero(at_the_side).tolist() == [0, 4, 8]
