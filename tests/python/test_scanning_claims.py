"""The claims about scanning of one traffic seed: verdicts by the rules of docs/verdict_rules.md."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pyinfra.metrics.intervals import Blocks, time_blocks
from pyinfra.metrics.observations import Observations
from reproduction.claims import scanning
from reproduction.commands.scanning import rows_of_seed

LIDARS = (
    scanning.LINES_16,
    scanning.AVIA,
    scanning.LINES_64,
    scanning.LINES_128,
)
FRAMES = 100
DISTANCES = np.arange(32.5, 120, 5)


def blocks() -> Blocks:
    return time_blocks(np.arange(FRAMES), 0.1, block_s=0.5)


def scene(
    points: Callable[[float], list[int]], reach_m: float = 200, **columns: Any
) -> Observations:
    """Returns one vehicle in the middle of each bin in each frame. points: number of points of each
    LiDAR at a distance."""
    n = FRAMES * len(DISTANCES)
    distance = np.tile(DISTANCES, FRAMES)
    counts = np.array([points(d) for d in DISTANCES], dtype=np.int64)
    ones = np.ones((n, 4), dtype=np.bool_)
    known: dict[str, Any] = {
        "lidars": LIDARS,
        "frame": np.repeat(np.arange(FRAMES), len(DISTANCES)),
        "ids": np.tile(np.arange(len(DISTANCES)), FRAMES),
        "centre": np.stack([distance, 0 * distance, 0 * distance], axis=1),
        "distance": distance,
        "speed": np.full(n, 15.0),
        "visibility": np.ones(n),
        "points": np.tile(counts, (FRAMES, 1)),
        "points_in_box": np.tile(counts, (FRAMES, 1)),
        "in_angles": ones,
        "in_range": ones & (distance < reach_m)[:, None],
    }
    return Observations(**{**known, **columns})


def as_in_the_paper(distance: float) -> list[int]:
    """Returns the points of 16 lines, Avia, 64 and 128 lines. The ratio of the lines is 1 : 4 : 8.
    The Avia has twice the points of 128 lines far away, and fewer nearby."""
    lines = round(1e7 / distance**2)
    return [lines // 8, round(2.2e5 / distance), lines // 2, lines]


def claims(vehicles: Observations) -> list[scanning.Row]:
    """Returns the claims of vehicles whose points do not depend on the aggregation."""
    return scanning.claims(vehicles, vehicles, blocks())


def verdicts(rows: list[scanning.Row]) -> list[tuple[str, str]]:
    return [(row.claim, row.verdict) for row in rows]


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (1.5, 2.5, "holds"),
        (1.49, 2.0, "undecided"),
        (2.0, 2.51, "undecided"),
        (1.0, 1.49, "fails"),
        (2.51, 3.0, "fails"),
        (1.0, 3.0, "undecided"),
        (math.nan, math.nan, "undecided"),
    ],
)
def test_verdict_of_an_interval(low: float, high: float, expected: str) -> None:
    assert scanning.verdict(low, high, (1.5, 2.5)) == expected


@pytest.mark.parametrize(
    ("low", "high", "expected"), [(0, 1, "undecided"), (0.1, 1, "holds"), (-1, 0, "fails")]
)
def test_above_0_is_without_0(low: float, high: float, expected: str) -> None:
    assert scanning.verdict(low, high, scanning.ABOVE_0) == expected


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (5, 9, "holds"),
        (-9, -5, "holds"),
        (-4, 4, "fails"),
        (4, 6, "undecided"),
        (-6, 6, "undecided"),
    ],
)
def test_change_counts_either_way(low: float, high: float, expected: str) -> None:
    assert scanning.verdict_of_change(low, high, 5) == expected


def test_points_as_the_paper_tells_them_make_its_claims_hold() -> None:
    rows = claims(scene(as_in_the_paper))
    expected = ["far-range", "far-range", "near-range", "ratio", "ratio", "gentle"]
    assert verdicts(rows)[:6] == [(name, "holds") for name in expected]
    assert [row.claim for row in rows[6:]] == [*["deskew"] * 4, "only-one", "only-one"]


def test_equal_points_make_them_fail() -> None:
    rows = claims(scene(lambda d: [round(1e6 / d)] * 4))
    assert {row.verdict for row in rows} == {"fails"}


def test_far_range_takes_the_best_of_the_others() -> None:
    rows = claims(scene(lambda d: [60, 90, 50, 40]))
    assert rows[0].value == 1.5


def test_far_range_on_common_ends_with_the_shortest_range() -> None:
    def to_100_m(distance: float) -> list[int]:
        return [10, 20, 10, 10] if distance < 100 else [0, 20, 0, 0]

    common, view = claims(scene(to_100_m, reach_m=100))[:2]
    assert (common.value, common.verdict) == (2, "holds")
    assert common.statement.endswith("; common, 90 to 120 m")
    assert (view.value, view.verdict) == (6, "fails")


def test_no_vehicles_leave_a_claim_undecided() -> None:
    rows = claims(scene(as_in_the_paper, reach_m=60))
    assert rows[0].verdict == "undecided"
    assert math.isnan(rows[0].value)


def test_only_one_counts_both_ways() -> None:
    def points(distance: float) -> list[int]:
        if distance > 110:
            return [0, 3, 0, 0]
        return [0, 0, 0, 1] if distance < 95 else [1, 1, 1, 1]

    row = claims(scene(points))[10]
    # Of 6 bins beyond 90 m, only the Avia has points in 2, and only one other LiDAR has points in
    # 1.
    assert row.value == pytest.approx(100 / 6)
    assert row.verdict == "holds"


def test_deskew_is_the_change_of_the_points_in_the_box() -> None:
    instant = scene(lambda d: [100, 100, 100, 100])
    kept = np.tile([98, 80, 94, 120], (len(instant), 1))
    exact = scene(lambda d: [100, 100, 100, 100], points_in_box=kept)
    rows = scanning.claims(exact, instant, blocks())[6:10]
    assert [row.value for row in rows] == pytest.approx([-2, -20, -6, 20])
    assert [row.verdict for row in rows] == ["fails", "holds", "holds", "holds"]


@pytest.mark.slow
def test_a_real_run_gives_the_claims(tmp_path: Path) -> None:
    rows = rows_of_seed("paper", 1, "0:600:50", tmp_path)
    assert len(rows) == 12
    assert {row.verdict for row in rows} <= {"holds", "fails", "undecided"}
    (near,) = (row.value for row in rows if row.claim == "near-range")
    assert near > 1
    assert list(tmp_path.iterdir()) == []
