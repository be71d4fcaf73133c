"""Claims about detection from made-up tables with known answers."""

import pandas as pd
import pytest
from benchmark_data import PRICES, cells, key_of, values

from pyinfra.benchmark.detection_claims import Measured, claims_table, slope
from pyinfra.benchmark.paper import paper_table
from pyinfra.data.paper_tables import paper_ap


def windows(ground_truth: str, qualities: dict[str, list[str]]) -> pd.DataFrame:
    """Of LiDARs with PointPillars: an AP of 90 where the quality is high, of 86 if undecided."""
    ap = {"high": 90.0, "undecided": 86.0, "low": 40.0, "few": 90.0}
    rows = [
        key_of(lidar, "pointpillars") | {"s": 10.0 * i, "ap": ap[quality], "quality": quality}
        for lidar, own in qualities.items()
        for i, quality in enumerate(own)
    ]
    table = pd.DataFrame(rows).assign(ground_truth=ground_truth, road="a")
    return table.assign(ap_low=table.ap - 3, ap_high=table.ap + 3)


def verdicts(tables: dict[str, pd.DataFrame], claim: str) -> dict[str, str]:
    """Of a claim's rows, by the first word of the statement and what it is about."""
    rows = claims_table(tables)
    rows = rows[rows.claim == claim]
    return dict(zip(rows.statement, rows.verdict, strict=True))


def test_a_run_too_short_for_areas_claims_nothing_of_them() -> None:
    short = windows("captured", dict.fromkeys(PRICES, ["few"] * 3))
    assert verdicts({"cells": cells(), "distance": short}, "areas") == {}


def test_areas_count_from_the_decided_to_the_undecided_ones() -> None:
    own = {"ruby_plus": ["high"] * 8 + ["low"] * 2, "livox_avia": ["high"] * 3 + ["undecided"] * 4}
    found = verdicts({"cells": cells(), "distance": windows("captured", own)}, "areas")
    # 8 of 10 against 3 (+ 4) of 7: 80 against 43 to 100 in 100; 8 against 3 to 7.
    assert list(found.values()) == ["undecided", "holds"]
    more = own | {"ruby_plus": ["high"] * 7 + ["low"] * 3}
    found = verdicts({"cells": cells(), "distance": windows("captured", more)}, "areas")
    assert list(found.values()) == ["undecided", "undecided"]


def test_a_difference_has_the_rooted_squares_of_both_ends() -> None:
    found = Measured(10, 7, 11).less(Measured(2, 1, 6))
    assert (found.value, found.low, found.high) == (8, 8 - 5, pytest.approx(8 + 2**0.5))


def test_a_ratio_of_equal_figures_is_one_and_holds_its_value() -> None:
    found = Measured(4, 2, 8).over(Measured(4, 4, 4))
    assert (found.value, found.low, found.high) == pytest.approx((1, 0.5, 2))


def test_comparable_is_about_three_points_either_way() -> None:
    found = verdicts({"cells": cells()}, "comparable")
    # Differences of 1, 0 and -4, give or take 1.41.
    assert list(found.values()) == ["holds", "holds", "undecided"]
    assert list(verdicts({"cells": cells(0.1)}, "comparable").values())[-1] == "fails"


def test_of_a_seed_that_failed_the_next_one_stands_in() -> None:
    failed = cells().assign(ap=float("nan"), ap_low=float("nan"), ap_high=float("nan"))
    both = pd.concat([failed, cells().assign(seed=2)])
    assert verdicts({"cells": both}, "comparable") == verdicts({"cells": cells()}, "comparable")


def test_the_64_lines_are_below_both() -> None:
    found = verdicts({"cells": cells()}, "64-below")
    assert list(found.values()) == ["holds", "holds", "undecided"]


def test_algorithms_are_compared_with_the_best() -> None:
    found = verdicts({"cells": cells()}, "algorithms")
    best = "ruby_plus: AP of the best (pv-rcnn) less that of"
    assert found[f"{best} PointRCNN 20 or more"] == "holds"
    assert found[f"{best} pointpillars 5 or less"] == "holds"
    # 94 - 70 = 24 for the Avia; 62 - 30 = 32 for the 16 lines. None for the best less itself.
    assert len(found) == 2 * 4


def test_a_straight_line_has_its_slope() -> None:
    windows = pd.DataFrame({"s": range(0, 50, 10), "ap": [90.0, 88, 86, 84, 82]})
    found = slope(windows.assign(ap_low=windows.ap - 1.96, ap_high=windows.ap + 1.96))
    assert found.value == pytest.approx(-2)
    # Sigma 1, overlap 4, and squares of x about the middle that sum to 10.
    assert found.high - found.value == pytest.approx(1.96 * (4 / 10) ** 0.5)


def test_the_road_ahead_is_the_first_one() -> None:
    """AP falls by 2 in 10 m along the first road, for the Avia by 1; on the second it rises."""
    ahead = windows("captured", dict.fromkeys(PRICES, ["high"] * 11))
    ahead = ahead.assign(
        ap=95 - ahead.s / ahead.lidar.map(lambda x: 10 if x == "livox_avia" else 5)
    )
    side = ahead.assign(road="side", ap=50 + ahead.s / 2)
    table = pd.concat([ahead, side])
    table = table.assign(ap_low=table.ap - 1, ap_high=table.ap + 1)
    rows = claims_table({"cells": cells(), "distance": table})
    found = rows[rows.claim == "gentle"]
    assert found.value.to_list() == pytest.approx([1.0])
    assert found.verdict.to_list() == ["holds"]


def test_value_is_per_dollar_against_the_best_of_the_others() -> None:
    areas = windows("all", dict.fromkeys(PRICES, ["high"] * 8 + ["undecided"] * 4))
    found = verdicts({"cells": cells(), "value": values(), "distance": areas}, "value")
    # 94 AP for 2,000 against 60 for 1,000; 8 to 12 areas for 2,000 against as many for 1,000.
    own = "pointpillars: {} per dollar of the Avia over the best of the others (helios_16) above 1"
    assert found[own.format("AP")] == "fails"
    assert found[own.format("high-quality areas")] == "fails"
    areas = windows("all", dict.fromkeys(PRICES, ["high"] * 4 + ["undecided"] * 12))
    unsure = {"cells": cells(), "value": values(), "distance": areas}
    assert verdicts(unsure, "value")[own.format("high-quality areas")] == "undecided"


def test_tilt_takes_the_best_angle_against_none() -> None:
    dials = {"none": ["0"], "tilt": ["5", "10", "20", "30"], "unseen_lidar": ["pandar_64"]}
    curve = pd.DataFrame([{"stressor": s, "dial": d} for s, own in dials.items() for d in own])
    curve = curve.assign(ap=[80.0, 81, 84, 70, 99, 99])
    curve = curve.assign(lidar="livox_avia", scene="road", preset="paper", detector="dsvt")
    curve = curve.assign(run="a", frames=9, seed=1, version="1", ap_low=curve.ap, ap_high=curve.ap)
    row = claims_table({"cells": cells(), "stress": curve}).iloc[-1]
    assert (row.claim, row.value, row.verdict) == ("tilt", 4, "fails")
    worse = curve.assign(preset="equal", ap=curve.ap - 30)
    both = claims_table({"cells": cells(), "stress": pd.concat([curve, worse])})
    found = both[both.claim == "tilt"].set_index("preset").value
    assert found.to_dict() == {"paper": 4, "equal": 4}


def test_of_four_cells_the_papers_order_comes_by_chance_in_two_of_24() -> None:
    own = paper_ap().assign(preset="paper", tier="quick", seed=1)
    four = own[(own.scene == "curve") & (own.detector == "pointpillars")]
    assert paper_table(four).p_value.to_list() == pytest.approx([2 / 24] * 2)


def test_the_order_of_the_papers_ap_is_a_correlation_of_one() -> None:
    own = paper_ap().assign(preset="paper", tier="quick", seed=1)
    found = paper_table(own.assign(ap=own.ap / 2)).set_index("scene")
    assert list(found.cells) == [16, 16, 16, 48]
    assert found.p_value.max() < 0.001
    assert found.rank_correlation.to_list() == pytest.approx([1] * 4)
    # The paper's mean over the curve's 16 cells is 70.6.
    assert found.mean_difference["curve"] == pytest.approx(-70.6 / 2, abs=0.05)
    turned = paper_table(own.assign(ap=100 - own.ap))
    assert turned.rank_correlation.to_list() == pytest.approx([-1] * 4)
