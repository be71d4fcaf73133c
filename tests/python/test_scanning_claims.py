"""`python -m reproduction claims`: verdicts by the rules of docs/verdict_rules.md."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pyinfra.metrics.intervals import Blocks, time_blocks
from pyinfra.metrics.observations import Observations
from reproduction import __main__ as reproduction
from reproduction.claims import scanning

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
    rows = scanning.claims(scene(as_in_the_paper), blocks())
    expected = ["far-range", "far-range", "near-range", "ratio", "ratio", "gentle"]
    assert verdicts(rows)[:6] == [(name, "holds") for name in expected]
    assert [row.claim for row in rows[6:]] == ["only-one", "only-one"]
    assert "livox_avia 1.00, helios_16 2.00" in rows[5].statement


def test_equal_points_make_them_fail() -> None:
    rows = scanning.claims(scene(lambda d: [round(1e6 / d)] * 4), blocks())
    assert {row.verdict for row in rows} == {"fails"}


def test_far_range_takes_the_best_of_the_others() -> None:
    rows = scanning.claims(scene(lambda d: [60, 90, 50, 40]), blocks())
    assert rows[0].value == 1.5
    assert "here helios_16" in rows[0].statement


def test_far_range_on_common_ends_with_the_shortest_range() -> None:
    def to_100_m(distance: float) -> list[int]:
        return [10, 20, 10, 10] if distance < 100 else [0, 20, 0, 0]

    common, view = scanning.claims(scene(to_100_m, reach_m=100), blocks())[:2]
    assert (common.value, common.verdict) == (2, "holds")
    assert "common, 90 to 120 m, 200 vehicles at 92.5 to 97.5 m" in common.statement
    assert (view.value, view.verdict) == (6, "fails")


def test_no_vehicles_leave_a_claim_undecided() -> None:
    rows = scanning.claims(scene(as_in_the_paper, reach_m=60), blocks())
    assert rows[0].verdict == "undecided"
    assert math.isnan(rows[0].value)
    assert "no vehicles" in rows[0].statement


def test_only_one_counts_both_ways() -> None:
    def points(distance: float) -> list[int]:
        if distance > 110:
            return [0, 3, 0, 0]
        return [0, 0, 0, 1] if distance < 95 else [1, 1, 1, 1]

    row = scanning.claims(scene(points), blocks())[6]
    # Of 6 bins beyond 90 m, only the Avia has points in 2, and only one other LiDAR has points in
    # 1.
    assert row.value == pytest.approx(100 / 6)
    assert row.verdict == "holds"
    assert "alone (200)" in row.statement
    assert "not by it (100)" in row.statement


def test_deskew_is_the_change_of_the_points_in_the_box() -> None:
    instant = scene(lambda d: [100, 100, 100, 100])
    kept = np.tile([98, 80, 94, 120], (len(instant), 1))
    exact = scene(lambda d: [100, 100, 100, 100], points_in_box=kept)
    rows = scanning.claims(exact, blocks(), instant)[6:10]
    assert [row.value for row in rows] == pytest.approx([-2, -20, -6, 20])
    assert [row.verdict for row in rows] == ["fails", "holds", "holds", "holds"]
    with pytest.raises(ValueError, match="expected the same frames in both data sets"):
        scanning.deskew(instant.select(instant.frame > 0), exact, blocks())


def test_other_lidars_are_an_error() -> None:
    vehicles = scene(as_in_the_paper, lidars=("a", "b", "c", "d"))
    with pytest.raises(ValueError, match="got a, b, c, d"):
        scanning.claims(vehicles, blocks())


@pytest.mark.slow
def test_a_real_run_gives_the_table(infrasim: Callable[..., Any], tmp_path: Path) -> None:
    folders = [tmp_path / "exact", tmp_path / "instant"]
    for folder in folders:
        result = infrasim(
            *("run", "configs/scenes/highway.yaml", "--preset", "paper", "--frames", "0:600:50"),
            *("--set", "duration_s=60", "--set", "traffic.warm_up_s=50"),
            *("--lidar", *(f"configs/lidars/{name}.yaml" for name in LIDARS)),
            *("--aggregation", folder.name, "--out", folder),
        )
        assert result.returncode == 0, result.stderr
    out = tmp_path / "claims.csv"
    assert reproduction.main(["claims", *map(str, folders), "--out", str(out)]) == 0
    table = pd.read_csv(out)
    assert list(table.columns) == scanning.COLUMNS
    assert len(table) == 12
    assert set(table.preset) == {"paper"}
    assert set(table.verdict) <= {"holds", "fails", "undecided"}
    assert table[table.claim == "near-range"].value.item() > 1
    with pytest.raises(ValueError, match=r"expected an exact data set .*, got none"):
        scanning.claims_table(folders[1:])
