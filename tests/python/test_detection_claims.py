"""Claims about detection for artificial tables with known verdicts."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import report_data
from benchmark_data import PRICES, experiments, key_of, replicates_of, values

from pyinfra.metrics.comparison import Bootstrapped, over_replicates
from pyinfra.metrics.replicates import difference, slope
from reproduction import __main__ as reproduction
from reproduction.claims.agreement import paper_table
from reproduction.claims.detection import claims_table
from reproduction.paper_tables import paper_ap


def tables(half: float = 1.0) -> dict[str, pd.DataFrame]:
    """Returns experiments and the replicates of their AP. `captured` and `common` have equal
    values."""
    rows = experiments(half)
    both = [replicates_of(rows, "ap", half, truth) for truth in ("captured", "common")]
    return {"experiments": rows, "replicates": pd.concat(both)}


def figure(measure: str, truth: str, half: float, **of: float) -> pd.DataFrame:
    """Returns the replicates of a measure of PointPillars, by LiDAR."""
    rows = pd.DataFrame([key_of(lidar, "pointpillars") | {"x": x} for lidar, x in of.items()])
    return replicates_of(rows, "x", half, truth, measure=measure)


def verdicts(tables: dict[str, pd.DataFrame], claim: str) -> dict[str, str]:
    """Returns the verdicts of a claim by statement."""
    rows = claims_table(tables)
    rows = rows[rows.claim == claim]
    return dict(zip(rows.statement, rows.verdict, strict=True))


def test_experiments_without_replicates_claim_nothing() -> None:
    assert claims_table({"experiments": experiments()}).empty


def test_areas_are_compared_by_share() -> None:
    share = figure("p_hqda", "captured", 5, ruby_plus=80, livox_avia=75)
    outcome = verdicts({"experiments": experiments(), "replicates": share}, "areas")
    # The half-widths of 5 combine to 7 for the difference of -5, so the verdict for the range of 10
    # is undecided.
    assert list(outcome.values()) == ["undecided"]


def test_the_replicates_of_a_difference_go_in_pairs() -> None:
    common = np.sin(np.arange(200))
    a, b = Bootstrapped(90, 90 + common, 1e6), Bootstrapped(88, 88 + common, 1e6)
    interval = a.less(b).measured()
    assert (interval.value, interval.low, interval.high) == pytest.approx((2, 2, 2))
    assert interval.is_significant
    assert a.less(Bootstrapped(90, 90 - common, 1e6)).measured().low < -2
    assert a.over(b).value == pytest.approx(90 / 88)
    assert a.times(2).replicates == pytest.approx(2 * a.replicates)


def test_figures_without_replicates_do_not_differ() -> None:
    interval = Bootstrapped(90, np.empty(0), 2).less(Bootstrapped(10, np.empty(0), 2)).measured()
    assert not interval.is_known
    assert not interval.is_significant


@pytest.mark.parametrize(
    "column", ["vehicles_digest", "version", "label_time", "block_s", "replicates_seed"]
)
def test_replicates_of_other_blocks_are_not_compared(column: str) -> None:
    rows = replicates_of(experiments(), "ap", 1)
    other = rows.iloc[1].copy()
    other[column] = "another"
    with pytest.raises(ValueError, match=f"{column}: expected the same .*, got .* and another"):
        difference(rows.iloc[0], other)


def test_a_figure_over_seeds_has_students_interval() -> None:
    interval = over_replicates([1.0, 2.0, 3.0])
    assert interval.value == 2
    assert interval.high - interval.value == pytest.approx(4.3027 / 3**0.5, rel=1e-3)
    assert not over_replicates([1.0]).is_known


def test_comparable_is_about_three_points_either_way() -> None:
    outcome = verdicts(tables(), "comparable")
    # The differences are 1, 0 and -4, each with a half-width of 1.41, for both ground truths.
    assert list(outcome.values()) == ["holds"] * 4 + ["undecided"] * 2
    assert list(verdicts(tables(0.1), "comparable").values())[-1] == "fails"


def test_of_a_seed_that_failed_the_next_one_stands_in() -> None:
    data = tables()
    failed = data["experiments"].assign(ap=float("nan"))
    second = {name: rows.assign(seed=2) for name, rows in data.items()}
    both = {
        "experiments": pd.concat([failed, second["experiments"]]),
        "replicates": second["replicates"],
    }
    assert verdicts(both, "comparable") == verdicts(data, "comparable")


def test_the_64_lines_are_below_both() -> None:
    outcome = verdicts(tables(), "64-below")
    assert list(outcome.values()) == ["holds"] * 4 + ["undecided"] * 2


def test_algorithms_are_compared_with_the_best() -> None:
    outcome = verdicts(tables(), "algorithms")
    best = "ruby_plus: AP of the best (pv-rcnn) minus that of"
    assert outcome[f"{best} PointRCNN 20 or more"] == "holds"
    # 94 - 70 = 24 for the Avia; 62 - 30 = 32 for the 16 lines.
    assert len(outcome) == 2 * 4
    lower = (
        "ruby_plus: AP of pointpillars, the lower one of PV-RCNN and PointPillars, minus that of"
    )
    assert outcome[f"{lower} dsvt above 0"] == "holds"


def test_a_straight_line_has_its_slope_in_every_replicate() -> None:
    s = np.arange(0.0, 60, 10)
    aps = 90 + np.outer(np.arange(6), [-2.0, -1.0, -3.0])
    aps[1, 1] = np.nan
    assert slope(s, aps) == pytest.approx([-2, -1, -3])
    aps[2, 1] = np.nan
    assert np.isnan(slope(s, aps)).tolist() == [False, True, False]


def test_gentle_is_the_avia_against_the_gentlest_of_the_others() -> None:
    slopes = figure(
        "ap_slope", "captured", 0.2, ruby_plus=-2, livox_avia=-1, pandar_64=-3, helios_16=-4
    )
    rows = claims_table({"experiments": experiments(), "replicates": slopes})
    selected = rows[rows.claim == "gentle"]
    assert selected.value.to_list() == pytest.approx([1.0])
    assert selected.verdict.to_list() == ["holds"]


def test_value_is_per_dollar_against_the_best_of_the_others() -> None:
    areas = figure("n_hqda", "all", 1, **dict.fromkeys(PRICES, 10.0))
    data = tables()
    data = data | {"value": values(), "replicates": pd.concat([data["replicates"], areas])}
    outcome = verdicts(data, "value")
    # The Avia has 94 AP for 2,000 dollars, the other LiDAR 60 AP for 1,000. Both have 10 areas.
    text = "pointpillars: {} per dollar of the Avia over the best of the others (helios_16) above 1"
    assert outcome[text.format("AP")] == "fails"
    assert outcome[text.format("high-quality areas")] == "fails"
    unsure = figure("n_hqda", "all", 9, **dict.fromkeys(PRICES, 10.0))
    outcome = verdicts(data | {"replicates": pd.concat([tables()["replicates"], unsure])}, "value")
    assert outcome[text.format("high-quality areas")] == "undecided"


def test_tilt_takes_the_best_angle_against_none() -> None:
    severities = {"none": ["0"], "tilt": ["5", "10", "20", "30"], "unseen_lidar": ["pandar_64"]}
    curve = pd.DataFrame(
        [{"stressor": s, "severity": d} for s, levels in severities.items() for d in levels]
    )
    curve = curve.assign(x=[80.0, 81, 84, 70, 99, 99], tier="quick", seed=1)
    curve = curve.assign(lidar="livox_avia", scene="road", preset="paper", detector="dsvt")
    more = curve[["stressor", "severity"]].assign(run="a")
    stressed = pd.concat([replicates_of(curve, "x", 0.1).drop(columns="tier"), more], axis=1)
    row = claims_table({"experiments": experiments(), "stress_replicates": stressed}).iloc[-1]
    assert (row.claim, row.value, row.verdict) == ("tilt", 4, "fails")
    worse = stressed.assign(preset="equal", value=stressed.value - 30)
    both = claims_table(
        {"experiments": experiments(), "stress_replicates": pd.concat([stressed, worse])}
    )
    by_preset = both[both.claim == "tilt"].set_index("preset").value
    assert by_preset.to_dict() == {"paper": 4, "equal": 4}


def test_of_four_experiments_the_papers_order_comes_by_chance_in_two_of_24() -> None:
    published = paper_ap().assign(preset="paper", tier="quick", seed=1)
    four = published[(published.scene == "curve") & (published.detector == "pointpillars")]
    assert paper_table(four).p_value.to_list() == pytest.approx([2 / 24] * 2)


def test_the_order_of_the_papers_ap_is_a_correlation_of_one() -> None:
    published = paper_ap().assign(preset="paper", tier="quick", seed=1)
    agreement = paper_table(published.assign(ap=published.ap / 2)).set_index("scene")
    assert list(agreement.experiments) == [16, 16, 16, 48]
    assert agreement.p_value.max() < 0.001
    assert agreement.rank_correlation.to_list() == pytest.approx([1] * 4)
    # The paper's mean AP over the 16 experiments of the curve is 70.6.
    assert agreement.mean_difference["curve"] == pytest.approx(-70.6 / 2, abs=0.05)
    turned = paper_table(published.assign(ap=100 - published.ap))
    assert turned.rank_correlation.to_list() == pytest.approx([-1] * 4)


def test_the_command_writes_claims_and_agreement_beside_the_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    experiments = report_data.experiments()
    value = report_data.value()
    report_data.write(tmp_path, {"quick.csv": experiments, "quick_value.csv": value})
    report_data.write(tmp_path, {"quick_replicates.csv": report_data.experiment_replicates()})
    assert reproduction.main(["claims", str(tmp_path)]) == 0
    table = pd.read_csv(tmp_path / "quick_claims.csv")
    assert list(table.claim) == ["comparable"]
    assert "comparable" in capsys.readouterr().out


def test_the_smoke_tier_tests_no_claim(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report_data.write(tmp_path, {"smoke.csv": report_data.experiments().assign(tier="smoke")})
    assert reproduction.main(["claims", str(tmp_path)]) == 2
    assert "expected quick or full, got smoke" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["smoke.csv"]
