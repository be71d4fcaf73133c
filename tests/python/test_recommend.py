"""Recommendations from artificial tables with known answers."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmark_data import (
    PRICES,
    experiments,
    r1000_name,
    replicates_of,
    values,
    with_r1000,
)

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.machine_load import OtherLoad
from pyinfra.experiments.benchmark import measure
from pyinfra.experiments.benchmark.measure import latency_columns
from pyinfra.experiments.fairness import caveat, caveat_of_results, measured_gains
from pyinfra.experiments.requirements import unlike
from pyinfra.experiments.result_tables import AS_THEY_COME, hardly_learnt
from pyinfra.experiments.value import KEY
from pyinfra.metrics.row_selection import preset_of_answers
from pyinfra.models.training.recipe import read_recipe
from pyinfra.viz.report import contents
from pyinfra.viz.report.report_data import read_material
from reproduction.detectability.check import fine_tuning_ap
from reproduction.tables.common import results as table_of


def along_the_road() -> pd.DataFrame:
    """Returns windows from -100 to 100. AP is significantly above 85 at 0; at 50 and -50 the
    interval includes 85."""
    table = pd.DataFrame({"s": [5.0 * i for i in range(-20, 21)]})
    table = table.assign(ap=50.0, ap_low=45.0, ap_high=55.0).set_index("s")
    table.loc[0.0] = (90.0, 86.0, 92.0)
    table.loc[50.0] = (90.0, 80.0, 92.0)
    table.loc[-50.0] = (80.0, 75.0, 87.0)
    return with_r1000(table.reset_index()).assign(
        ground_truth="all", road="a", objects=30, predictions=30
    )


def prices_of_lidars(**ends: tuple[float, float]) -> pd.DataFrame:
    """Returns the table of LiDARs. `ends` sets low and high prices; otherwise both are the
    price."""
    both = [ends.get(name, (price, price)) for name, price in PRICES.items()]
    table = pd.DataFrame(both, columns=["price_low_usd", "price_high_usd"])
    table = table.assign(lidar=list(PRICES), preset="paper", units=1)
    return table.assign(price_source="made up", price_date="2026")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """Writes the tables of a benchmark with the prices of the time of the benchmark."""
    columns = {
        "command": "x",
        "ap_common": 1,
        "objects": 9,
        "train_seconds": 1,
        "latency_p95_ms": 60,
    }
    bought = ("ap", "ap_all", "ap_per_1000_usd", "usd_per_hq_area", "usd_per_m_road")
    value = values().assign(pareto=True, dominated_by="", points_per_1000_usd=1, site_usd=0)
    distance = experiments()[KEY].merge(along_the_road().assign(quality="low"), how="cross")
    experiments().assign(**columns).to_csv(tmp_path / "quick.csv", index=False)
    replicates_of(experiments(), "ap_all", 1, "all").to_csv(
        tmp_path / "quick_replicates.csv", index=False
    )
    value.assign(**dict.fromkeys(bought, 1)).to_csv(tmp_path / "quick_value.csv", index=False)
    distance.to_csv(tmp_path / "quick_distance.csv", index=False)
    return tmp_path


def change(file: Path, rows: str, **columns: object) -> None:
    """Changes values in the rows that a query selects. AP (R1000) changes with AP (R1000)."""
    table = pd.read_csv(file)
    index = table.query(rows).index
    table = table.astype({name: object for name in columns if name in table})
    for name, new in columns.items():
        table.loc[index, name] = new
        if r1000_name(name):
            table.loc[index, r1000_name(name)] = new
    table.to_csv(file, index=False)


def output_lines(capsys: pytest.CaptureFixture[str], *words: object) -> list[str]:
    assert main.main(["recommend", *map(str, words)]) == 0
    return capsys.readouterr().out.splitlines()


def test_the_highest_ap_of_all_vehicles_comes_first(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 85)
    assert lines[0] == (
        "road, preset paper, quick tier: at most 8,000 USD, AP 85 of all visible vehicles in the "
        "whole region, 100 ms a frame."
    )
    assert lines[1] == (
        "1. livox_avia with pointpillars: AP (R1000) of all visible vehicles 94.0 [93.0, 95.0], of "
        "the vehicles it captures 94.0 [93.0, 95.0]; 2,000 USD; AP above 85 of all visible "
        "vehicles on 40 [20 to 60] of 200 m of road; 50 ms a frame"
    )
    assert lines[3].startswith("3. pandar_64 with pv-rcnn")
    pair = "livox_avia with pointpillars does not differ significantly from that of livox_avia"
    equal = f"The AP of {pair} with pv-rcnn (the 95 % intervals include 0); each"
    assert f"{equal} costs 2,000 USD." in lines
    assert "Left out: ruby_plus with pv-rcnn: costs 24,000 USD." in lines


def test_a_notebook_has_the_answer_as_a_table(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The table has the options that meet the requirements in the order of the command. The other
    options have the command's reasons."""
    table = pi.recommend(results, budget_usd=8000, min_ap=85)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 85)
    names = [f"{row.lidar} with {row.detector}" for row in table.itertuples()]
    good = table[table.meets]
    assert list(good.index) == list(range(len(good)))
    for place, name in enumerate(names[: len(good)], 1):
        assert lines[place].startswith(f"{place}. {name}: ")
    for name, row in list(zip(names, table.itertuples(), strict=True))[len(good) :]:
        assert any(f"{name}: " in line for line in lines)
        if row.meets_latency:
            assert f"Left out: {name}: {row.reason}." in lines
    assert (table.ap_r1000_low <= table.ap_r1000).all()
    assert table.difference[0] == 0


@pytest.mark.nightly
def test_boxes_off_the_region_are_in_the_table_and_unknown_in_old_ones(results: Path) -> None:
    assert pi.recommend(results, budget_usd=9000, min_ap=30).off_region_per_min.isna().all()
    change(results / "quick.csv", "lidar == 'livox_avia'", off_region_per_min=3.5)
    table = pi.recommend(results, budget_usd=9000, min_ap=30).set_index("lidar")
    assert (table.off_region_per_min.loc[["livox_avia"]] == 3.5).all()
    change(results / "quick.csv", "lidar == 'livox_avia'", off_region_per_min=-1)
    with pytest.raises(pi.Error, match=r"quick.csv:\d+: off_region_per_min: expected 0 or more"):
        pi.recommend(results)


def test_no_option_is_needed_to_meet_requirements(results: Path) -> None:
    table = pi.recommend(results, budget_usd=1, min_ap=99)
    assert not table.meets.any()
    assert table.reason.str.contains("costs").all()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"min_ap": 0.8}, "min_ap: .*not a share"),
        ({"budget_usd": float("nan")}, "budget_usd: "),
        ({"range_m": -5}, "range_m: "),
        ({"scene": "raod"}, "scene: .*'raod'"),
        ({"tier": "fast"}, "tier: expected one of"),
    ],
)
def test_a_wrong_requirement_is_named(
    results: Path, words: dict[str, object], message: str
) -> None:
    with pytest.raises(pi.Error, match=message):
        pi.recommend(results, **words)


def test_a_folder_without_results_is_named(tmp_path: Path) -> None:
    with pytest.raises(pi.Error, match="results: "):
        pi.recommend(tmp_path)


def test_a_lidar_that_looks_one_way_does_not_win_by_what_it_captures(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "lidar == 'livox_avia'", ap_all=40.0)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 85)
    assert lines[1].startswith("1. pandar_64 with pv-rcnn: AP (R1000) of all visible vehicles 90.0")
    assert "Left out: livox_avia with pv-rcnn: AP 40.0 of all visible vehicles." in lines
    wide = output_lines(capsys, results, "--budget", 8000, "--min-ap", 39)
    assert [line for line in wide if line[0].isdigit()][-1].startswith("5. helios_16")


@pytest.mark.parametrize(
    ("detector", "lidars", "warned"),
    [
        ("generalist-as-is", ("ruby_plus", "livox_avia"), True),
        ("generalist-as-is", ("ruby_plus",), False),
        ("generalist", ("ruby_plus", "livox_avia"), False),
    ],
)
def test_rankings_by_the_pretrained_detector_are_warned_of(
    detector: str, lidars: tuple[str, ...], warned: bool
) -> None:
    assert bool(caveat_of_results((lidar, detector) for lidar in lidars)) == warned


def test_the_first_line_says_by_how_much_the_pretrained_detector_is_unfair(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in results.glob("quick*.csv"):
        file.write_text(file.read_text().replace("pv-rcnn", "generalist-as-is"))
    first = output_lines(capsys, results, "--budget", 8000)[0]
    gain = measured_gains()["livox_avia"]
    assert "fine-tuning adds more AP to LiDARs with few lines or a narrow view" in first
    assert f"{gain:g} for livox_avia" in first


def test_the_caveat_has_the_gains_of_the_tables() -> None:
    gains = fine_tuning_ap(*(table_of(name) for name in ("fairness", "experiments")))
    assert measured_gains() == gains
    narrow_or_few_lines = {"livox_avia", "bundle_5_livox_avia", "livox_horizon", "helios_16"}
    least = min(gains[name] for name in narrow_or_few_lines)
    assert least > max(gain for name, gain in gains.items() if name not in narrow_or_few_lines)
    assert caveat(["own"], gains).endswith("; not measured for own.")


def test_real_time_is_asked_unless_another_latency_is(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "detector == 'pv-rcnn'", latency_p50_ms=544.0)
    change(results / "quick.csv", "detector == 'dsvt'", latency_p50_ms=None)
    change(results / "quick.csv", "detector == 'pointpillars'", latency_p95_ms=101.0)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 75)
    assert "Left out: pandar_64 with pv-rcnn: 544 ms a frame." in lines
    assert "Left out: livox_avia with dsvt: no latency was measured." in lines
    late = (
        "livox_avia with pointpillars, pandar_64 with pointpillars. Their median latency is lower."
    )
    assert f"Above 100 ms in more than 5 % of the frames: {late}" in lines
    slow = output_lines(capsys, results, "--budget", 8000, "--min-ap", 75, "--latency", 600)
    assert any(line.startswith("2. livox_avia with pv-rcnn") for line in slow)
    assert not any(line.startswith("Above") for line in slow)


def test_the_machine_of_the_latency_is_named(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "seed == 1", latency_machine="2 x A")
    lines = output_lines(capsys, results, "--budget", 8000)
    where, hint = (
        "Latencies were measured on one core of 2 x A",
        "To measure them on your computer, repeat the benchmark for the latency only.",
    )
    assert f"{where} (the load of the machine was not recorded). {hint}" in lines


def test_what_a_price_holds_is_named_item_by_item_or_reported_missing(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = "Prices include LiDARs only, without computer, pole, installation, energy "
    assert f"{alone}(`costs` of the benchmark adds them)." in output_lines(
        capsys, results, "--budget", 8000
    )
    value = results / "quick_value.csv"
    change(value, "seed == 1", site_usd=900.0)
    old = "Every price includes 900 USD for the site; these results do not list its items."
    assert old in output_lines(capsys, results, "--budget", 8000)
    change(value, "seed == 1", computer_usd=800, pole_usd=100, installation_usd=0, energy_usd=0)
    lines = output_lines(capsys, results, "--budget", 8000)
    assert "; 2,000 USD (LiDAR 1,100); AP above" in lines[1]
    items = "computer 800, pole 100; not included: installation, energy (`costs` of the benchmark)."
    assert f"Every price includes 900 USD for the site: {items}" in lines


def test_an_answer_names_the_lidars_whose_price_is_unconfirmed(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not [
        line for line in output_lines(capsys, results, "--budget", 8000) if "nconfirmed" in line
    ]
    prices_of_lidars().assign(
        price_source=["nominal, unconfirmed", *["a quotation"] * (len(PRICES) - 1)]
    ).to_csv(results / "lidars.csv", index=False)
    (line,) = (
        text for text in output_lines(capsys, results, "--budget", 8000) if "nconfirmed" in text
    )
    assert line.startswith(f"Unconfirmed prices: {next(iter(PRICES))}. Enter a quotation")


def test_if_none_meets_the_requirements_the_nearest_three_say_what_to_relax(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "lidar == 'livox_avia'", latency_p50_ms=120.5)
    lines = output_lines(capsys, results, "--budget", 1500, "--min-ap", 85)
    assert lines[1] == (
        "No option meets the requirements. The nearest options, each with the requirement to relax:"
    )
    near = [line for line in lines if line[0].isdigit()]
    assert [line.split(":")[0] for line in near] == [
        "1. helios_16 with pv-rcnn",
        "2. helios_16 with pointpillars",
        "3. livox_avia with pointpillars",  # the excess price decides, not the latency
    ]
    assert near[0].endswith("; 50 ms a frame; meets the requirements with a minimum AP of 62")
    assert near[2].endswith(
        "; meets the requirements with a budget of 2000 USD and a latency of 121 ms"
    )
    far = "costs 2,000 USD, 120 ms a frame."
    assert f"Left out: livox_avia with pv-rcnn: {far}" in lines
    assert not any(line.startswith("Left out: helios_16 with pv-rcnn") for line in lines)


def test_a_reason_is_not_rounded_to_the_requirement(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert [unlike(*of) for of in ((79.96, 80, 1), (70, 80, 1), (2000.4, 2000, 0))] == [
        "79.96",
        "70.0",
        "2,000.4",
    ]
    change(results / "quick.csv", "lidar == 'livox_avia'", latency_p50_ms=50.3)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 85, "--latency", 50)
    slow = [line for line in lines if line.startswith("More accurate, but too slow: livox_avia")]
    assert len(slow) == 2
    assert all("; 50.3 ms a frame; meets" in line for line in slow)


def test_what_is_to_be_relaxed_is_enough(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change(results / "quick.csv", "lidar == 'livox_avia'", latency_p50_ms=120.4, ap_all=83.96)
    change(results / "quick_value.csv", "lidar == 'livox_avia'", price_usd=2000.7)
    (line,) = [x for x in output_lines(capsys, results, "--budget", 1900) if x.startswith("1.")]
    assert line.endswith("a budget of 2001 USD and a minimum AP of 83.9 and a latency of 121 ms")
    words = ["--budget", 2001, "--min-ap", 83.9, "--latency", 121]
    assert output_lines(capsys, results, *words)[1].startswith("1. livox_avia")


def test_an_ap_that_is_not_known_is_never_near(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "lidar == 'helios_16'", ap_all=None)
    lines = output_lines(capsys, results, "--budget", 1500)
    assert not any(line[0].isdigit() and "helios_16" in line for line in lines)
    assert "Left out: helios_16 with dsvt: no AP of all visible vehicles." in lines


def test_a_latency_that_is_not_known_is_asked_for_after_ap_and_budget(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "seed == 1", latency_p50_ms=None)
    lines = output_lines(capsys, results, "--budget", 8000)
    assert lines[1] == (
        "No option meets the requirements. The nearest options, each with the requirement to relax:"
    )
    assert lines[2].startswith("1. livox_avia with pointpillars")
    measured = (
        "no latency was measured; meets the requirements with a measured latency of 100 ms or less"
    )
    assert lines[2].endswith(measured)
    assert "These results have no latency; repeat the benchmark for the latency only." in lines


def test_the_best_by_ap_is_named_with_the_latency_that_it_misses(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "detector != 'pointrcnn'", latency_p50_ms=383.0)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 60)
    assert lines[1].startswith(
        "1. livox_avia with pointrcnn: AP (R1000) of all visible vehicles 70.0"
    )
    best = next(line for line in lines if line.startswith("More accurate, but too slow: "))
    assert "livox_avia with pointpillars: AP (R1000) of all visible vehicles 94.0" in best
    assert best.endswith("383 ms a frame; meets the requirements with a latency of 383 ms.")
    # If no option meets the requirements, AP and budget are considered first.
    none = output_lines(capsys, results, "--budget", 8000, "--min-ap", 80)
    assert none[2].startswith("1. livox_avia with pointpillars")
    assert none[2].endswith("; meets the requirements with a latency of 383 ms")


@pytest.mark.parametrize("latency", [None, 50.0, 101.0, 383.0])
def test_latency_never_puts_a_worse_option_before_a_better_one(
    latency: float | None, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "lidar == 'livox_avia'", latency_p50_ms=latency)
    for least in (96, 93, 85, 60):
        lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", least)
        shown = [line for line in lines if line.startswith(("1. ", "More accurate"))]
        assert any("livox_avia with pointpillars: AP (R1000) of all" in line for line in shown), (
            least
        )


def test_the_load_under_which_latency_was_measured_is_reported(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "seed == 1", latency_other_cores=0.04)
    change(results / "quick.csv", "detector == 'dsvt'", latency_other_cores=1.62)
    where, hint = (
        "Latencies were measured on one core",
        "To measure them on your computer, repeat the benchmark for the latency only.",
    )
    line = f"{where} (other processes used 0.0 to 1.6 cores). {hint}"
    assert line in output_lines(capsys, results, "--budget", 8000)


def test_options_after_the_fifth_are_named_in_a_line(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 75)
    assert lines[5].startswith("5. livox_avia with dsvt")
    assert lines[6] == "Further options that meet the requirements: pandar_64 with dsvt."


def test_road_that_tells_options_apart_makes_no_doubt(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "lidar == 'pandar_64' and detector == 'pv-rcnn'"
    change(results / "quick.csv", rows, ap_all=95.0)
    change(results / "quick_distance.csv", rows, ap=90.0, ap_low=88.0, ap_high=92.0)
    # Every metre lies in four windows, so a single undecided window changes no coverage.
    change(results / "quick_distance.csv", f"{rows} and s == 0", ap_low=80.0)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 85)
    assert lines[1].startswith("1. pandar_64 with pv-rcnn")
    assert "on 200 [200 to 200] of 200 m" in lines[1]
    assert not any(line.startswith("The road covered") for line in lines)
    assert not any("cover the whole" in line for line in lines)


def test_a_window_without_an_interval_may_be_covered_and_may_not(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick_distance.csv", "s == -50 or s == 50", ap_low=None, ap_high=None)
    assert "on 40 [20 to 60] of 200 m" in output_lines(capsys, results, "--budget", 8000)[1]


def test_road_is_what_was_evaluated_within_the_range(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pd.read_csv(results / "quick_distance.csv")
    side = table[table.s.between(-20, 5)].assign(road="side")
    both = pd.concat([table[table.s.between(-60, 55)], side])
    both.to_csv(results / "quick_distance.csv", index=False)
    # The road covers -60 to 55, and the side road -20 to 5. Windows above the AP: -10 to 10 and 40
    # to 55 of the road, and -10 to 5 of the side road.
    assert "on 50 [35 to 70] of 140 m" in output_lines(capsys, results, "--budget", 8000)[1]
    near = output_lines(capsys, results, "--budget", 8000, "--range", 12)[1]
    assert "on 35 [35 to 35] of 41 m" in near


def test_an_ap_without_an_interval_is_reported_as_such(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "lidar == 'livox_avia' and detector == 'pointpillars'"
    change(results / "quick.csv", rows, ap_all_low=None, ap_all_high=None)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 89)
    first, other = "livox_avia with pointpillars", "livox_avia with pv-rcnn"
    assert (
        "AP (R1000) of all visible vehicles 94.0 (no interval), of the vehicles it captures 94.0 "
        in lines[1]
    )
    assert (
        f"May have less than AP 89 of all visible vehicles: {first} (no interval is available)."
        in lines
    )
    equal = f"The AP of {first} does not differ significantly from that of {other} "
    assert any(line.startswith(equal) for line in lines)


def test_what_keeps_no_replicates_is_not_compared(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / "quick_replicates.csv").unlink()
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 85)
    others = "livox_avia with pv-rcnn, pandar_64 with pv-rcnn, pandar_64 with pointpillars"
    doubts = [line for line in lines if "the difference has no interval" in line]
    assert doubts[0].startswith(
        f"It is not known whether livox_avia with pointpillars is better than {others}"
    )
    assert not any("does not tell" in line for line in lines)


def test_replicates_of_other_vehicles_are_an_error(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick_replicates.csv", "detector == 'pv-rcnn'", vehicles_digest="another")
    assert main.main(["recommend", str(results), "--budget", "8000"]) == 2
    rows = "quick_replicates.csv, row 2 and quick_replicates.csv, row 6"
    assert (
        f"{rows}: vehicles_digest: expected the same value in both rows, got w and another"
        in capsys.readouterr().err
    )


def test_tables_of_earlier_versions_have_no_interval_of_all_vehicles(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pd.read_csv(results / "quick.csv")
    ends = ["ap_all_r1000_low", "ap_all_r1000_high"]
    table.drop(columns=ends).to_csv(results / "quick.csv", index=False)
    assert (
        "AP (R1000) of all visible vehicles 94.0 (no interval)"
        in output_lines(capsys, results, "--budget", 8000)[1]
    )


def test_a_range_of_prices_is_reported_and_doubted(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ends = {"livox_avia": (1000, 3000), "pandar_64": (2000, 10000)}
    prices_of_lidars(**ends).to_csv(results / "lidars.csv", index=False)
    rows = "lidar == 'livox_avia' or lidar == 'pandar_64'"
    change(results / "quick_value.csv", "lidar == 'livox_avia'", price_usd=2300.0)
    change(results / "quick_value.csv", "lidar == 'pandar_64'", price_usd=6300.0)
    change(results / "quick_value.csv", rows, site_usd=300.0)
    lines = output_lines(capsys, results, "--budget", 2500, "--min-ap", 85)
    assert "; 2,300 USD (1,300 to 3,300; LiDAR 2,000); AP above" in lines[1]
    both = "livox_avia with pointpillars, livox_avia with pv-rcnn"
    assert f"{both} may cost more than the budget: 1,300 to 3,300 USD." in lines
    may = "costs 6,300 USD (2,300 to 10,300: may be within the budget; LiDAR 6,000)."
    assert f"Left out: pandar_64 with pv-rcnn: {may}" in lines
    assert "Left out: ruby_plus with pv-rcnn: costs 24,000 USD." in lines
    enough = output_lines(capsys, results, "--budget", 3300, "--min-ap", 85)
    assert not any("may cost more" in line for line in enough)
    short = output_lines(capsys, results, "--budget", 99, "--min-ap", 85)
    cost = "costs 6,300 USD (2,300 to 10,300; LiDAR 6,000)."
    assert f"Left out: pandar_64 with pv-rcnn: {cost}" in short


def test_the_preset_is_that_of_the_reports_answers(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = pd.DataFrame({"preset": ["paper", "paper", "equal", "equal"], "lidar": list("abcd")})
    rows["detector"] = ["x", "y"] * 2
    assert preset_of_answers(rows) == "equal"
    assert preset_of_answers(rows.assign(detector=["x", "y", "x", "x"])) == "paper"
    assert preset_of_answers(rows.assign(detector="x")) == "equal"
    assert preset_of_answers(rows.assign(lidar=["a", "b", "c", "c"])) == "paper"
    assert preset_of_answers(rows.assign(lidar="a")) == "paper"
    for file in ("quick", "quick_value", "quick_distance"):
        table = pd.read_csv(results / f"{file}.csv")
        one = table[table.lidar == "livox_avia"].assign(preset="datasheet")
        pd.concat([table, one]).to_csv(results / f"{file}.csv", index=False)
    assert output_lines(capsys, results, "--budget", 8000)[0].startswith(
        "road, preset paper, quick tier"
    )
    asked = output_lines(capsys, results, "--budget", 8000, "--preset", "datasheet")
    assert asked[0].startswith("road, preset datasheet")


def of_the_smoke_tier(results: Path, **columns: object) -> None:
    """Converts the results to the tier `smoke`."""
    for file in sorted(results.glob("quick*.csv")):
        table = pd.read_csv(file).assign(tier="smoke")
        if file.name == "quick.csv":
            table = table.assign(**columns)
        table.to_csv(results / file.name.replace("quick", "smoke"), index=False)


def test_nothing_follows_from_networks_of_the_smoke_tier(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_the_smoke_tier(results)
    names = ", ".join(sorted(set(pd.read_csv(results / "quick.csv").detector) - {"background"}))
    line = f"The smoke tier trains networks too little; do not use the AP of {names}."
    assert output_lines(capsys, results, "--budget", 8000, "--tier", "smoke")[1] == line
    assert line not in output_lines(capsys, results, "--budget", 8000)


@pytest.mark.usefixtures("undrawn")
def test_what_did_not_learn_in_the_smoke_tier_has_no_warning_of_it(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_the_smoke_tier(results, train_steps=0)
    assert not any(
        "learnt" in line
        for line in output_lines(capsys, results, "--budget", 8000, "--tier", "smoke")
    )
    material = read_material(results, [], [], "smoke")
    assert "learnt" not in contents.page(material).subtitle
    of_the_smoke_tier(
        results, train_steps=[0, *[9] * (len(pd.read_csv(results / "quick.csv")) - 1)]
    )
    assert (
        "trains networks too little"
        in contents.page(read_material(results, [], [], "smoke")).subtitle
    )


@pytest.mark.parametrize(
    ("detector", "steps", "taught"),
    [
        ("background", None, False),
        ("generalist-as-is", None, False),
        ("pointpillars", None, True),
        ("pointpillars", 0, False),
        ("own", 9, True),
    ],
)
def test_rows_say_who_learnt_in_the_smoke_tier(
    detector: str, steps: int | None, taught: bool
) -> None:
    row = pd.DataFrame({"detector": [detector], "tier": "smoke"})
    rows = row if steps is None else row.assign(train_steps=float(steps))
    assert hardly_learnt(rows).tolist() == [taught]
    assert hardly_learnt(row.assign(train_steps=np.nan)).tolist() == [taught or steps == 0]
    assert not hardly_learnt(rows.assign(tier="quick")).any()


def test_recipes_say_how_many_steps_they_learn() -> None:
    folder = Path("configs/detectors")
    steps = {f.stem: measure.steps_of(read_recipe(f, "smoke")) for f in folder.glob("*.yaml")}
    assert sorted(name for name, of in steps.items() if of == 0) == sorted(AS_THEY_COME)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("quick.csv", "", "quick.csv:1: expected .*, got an empty file"),
        ("quick.csv", "1,2,3\n4,5,6\n", "quick.csv:1: expected .*; the column scene is missing"),
        (
            "quick_value.csv",
            "scene,lidar\n",
            "quick_value.csv:1: expected .*; the column preset is missing",
        ),
        ("quick_distance.csv", "", "quick_distance.csv:1: expected .*, got an empty file"),
        (
            "lidars.csv",
            "lidar\nruby_plus\n",
            "lidars.csv:1: expected .*; the column price_source is missing",
        ),
    ],
)
def test_a_damaged_table_is_named(
    file: str, text: str, message: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / file).write_text(text)
    assert main.main(["recommend", str(results), "--budget", "8000"]) == 2
    assert re.search(f"{results}/{message}", capsys.readouterr().err)


@pytest.mark.parametrize("file", ["quick", "quick_value", "quick_distance"])
def test_a_table_without_its_rows_is_named(
    file: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = (results / f"{file}.csv").read_text().splitlines()[0]
    (results / f"{file}.csv").write_text(f"{header}\n")
    assert main.main(["recommend", str(results), "--budget", "8000"]) == 2
    problem = "one or more finished experiments, got none"
    if file != "quick":
        problem = "rows of all 16 experiments, got rows of 0; "
    assert f"{results}/{file}.csv: expected {problem}" in capsys.readouterr().err


def test_experiments_that_all_failed_and_prices_without_a_preset_are_reported(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prices_of_lidars().drop(columns="preset").to_csv(results / "lidars.csv", index=False)
    assert main.main(["recommend", str(results), "--budget", "8000"]) == 2
    assert (
        "lidars.csv:1: expected the column preset of a table of `pyinfra benchmark`, got none"
        in capsys.readouterr().err
    )
    (results / "lidars.csv").unlink()
    change(results / "quick.csv", "seed == 1", ap=None)
    assert main.main(["recommend", str(results), "--budget", "8000"]) == 2
    assert (
        "quick.csv: expected one or more finished experiments, got none" in capsys.readouterr().err
    )


def test_help_says_of_which_vehicles_the_ap_is(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main.main(["recommend", "--help"])
    assert "minimum AP of all vehicles, 0 to 100" in " ".join(capsys.readouterr().out.split())


def test_an_answer_needs_neither_plots_nor_networks() -> None:
    code = (
        "import sys, pyinfra.experiments.recommend;"
        "print({'matplotlib', 'torch'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--budget", "0"], "--budget: expected above 0, got 0"),
        (["--budget", "9", "--range", "200"], "--range: expected above 0 and at most 100, got 200"),
        (
            ["--budget", "9", "--scene", "moon"],
            "--scene: expected one of the scenes road; got 'moon'",
        ),
        (
            ["--budget", "9", "--min-ap", "0.85"],
            "expected above 1 and at most 100, got 0.85; AP is",
        ),
        (
            ["--budget", "9", "--min-ap", "101"],
            "--min-ap: expected above 1 and at most 100, got 101",
        ),
        (["--budget", "nan"], "--budget: expected above 0, got nan"),
        (["--budget", "9", "--latency", "-1"], "--latency: expected above 0, got -1"),
        (
            ["--budget", "9", "--preset", "x"],
            "--preset: expected one of the presets paper; got 'x'",
        ),
        (["--budget", "9", "--tier", "full"], "--tier: expected a tier in"),
    ],
)
def test_wrong_words_say_what_is_allowed(
    words: list[str], message: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["recommend", str(results), *words]) in (1, 2)
    assert message in capsys.readouterr().err


def test_a_folder_of_several_scenes_asks_for_one(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in ("quick", "quick_value", "quick_distance"):
        table = pd.read_csv(results / f"{file}.csv")
        both = pd.concat([table, table.assign(scene="bridge")])
        both.to_csv(results / f"{file}.csv", index=False)
    assert main.main(["recommend", str(results), "--budget", "8000"]) == 2
    assert "--scene: expected one of the scenes bridge, road; got none" in capsys.readouterr().err
    assert output_lines(capsys, results, "--budget", 8000, "--scene", "bridge")[0].startswith(
        "bridge,"
    )


# --- every vehicle of the region ----------------------------------------------------------------


def with_hidden_vehicles(results: Path) -> None:
    """Changes the results: the mount of the Avia sees 55 of 100 vehicles, and the mounts of the
    other LiDARs see all."""
    file = results / "quick.csv"
    ends = {"ap_present": 80.0, "ap_present_low": 79.0, "ap_present_high": 81.0}
    change(file, "seed == 1", **ends, objects_all=100, objects_present=100)
    ends = {"ap_present": 50.0, "ap_present_low": 48.0, "ap_present_high": 52.0}
    change(file, "lidar == 'livox_avia'", **ends, objects_all=55, objects_present=100)
    distance = pd.read_csv(results / "quick_distance.csv")
    present = distance.assign(ground_truth="present", ap=80.0, ap_low=79.0, ap_high=81.0)
    present = with_r1000(present)
    pd.concat([distance, present]).to_csv(results / "quick_distance.csv", index=False)


def test_a_mount_that_sees_half_of_the_vehicles_does_not_win_by_that_half(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_hidden_vehicles(results)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 75)
    assert "AP 75 of every vehicle" in lines[0]
    assert lines[1].startswith("1. helios_16 with")  # of equal AP, the lowest price is first
    assert "AP (R1000) of every vehicle 80.0 [79.0, 81.0]" in lines[1]
    assert "AP above 75 of every vehicle on 200 [200 to 200] of 200 m of road" in lines[1]
    left = "Left out: livox_avia with pointpillars: AP 50.0 of every vehicle."
    assert left in lines
    low = output_lines(capsys, results, "--budget", 8000, "--min-ap", 40)
    assert not any("have no AP of the subset `present`" in line for line in low)


def test_the_hidden_share_stands_beside_the_ap_of_visible_vehicles(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_hidden_vehicles(results)
    change(results / "quick.csv", "lidar != 'livox_avia'", latency_p50_ms=500.0)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 40)
    assert (
        "AP (R1000) of every vehicle 50.0 [48.0, 52.0], of those visible from the mount 94.0 "
        "[93.0, 95.0] (45 % are hidden), of the vehicles it captures 94.0 [93.0, 95.0]"
    ) in lines[1]


def test_the_share_that_is_detected_of_every_vehicle_is_printed(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_hidden_vehicles(results)
    change(results / "quick.csv", "lidar != 'livox_avia'", latency_p50_ms=500.0)
    recall = replicates_of(
        experiments().assign(recall=55.4), "recall", 1, "present", measure="recall"
    )
    file = results / "quick_replicates.csv"
    pd.concat([pd.read_csv(file), recall]).to_csv(file, index=False)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 40)
    assert "AP (R1000) of every vehicle 50.0 [48.0, 52.0], finds 55 % of them, of those" in lines[1]


def test_results_without_every_vehicle_say_so_and_are_compared_as_before(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # only some rows have values of `present`
    change(results / "quick.csv", "lidar == 'livox_avia'", ap_present=50.0)
    lines = output_lines(capsys, results, "--budget", 8000, "--min-ap", 85)
    assert lines[1].startswith(
        "1. livox_avia with pointpillars: AP (R1000) of all visible vehicles 94.0"
    )
    assert any("have no AP of the subset `present`" in line for line in lines)


def add_second_seed(results: Path, fall: float) -> None:
    """Adds rows of seed 2, in which the AP of each experiment is lower by `fall`."""
    for file in results.glob("quick*.csv"):
        table = pd.read_csv(file)
        if "seed" in table:
            second = table.assign(seed=2)
            names = [n for n in table if n == "ap" or n.startswith(("ap_all", "ap_whole"))]
            if file.name == "quick.csv":
                second[names] -= fall
                second = with_r1000(second)
            pd.concat([table, second]).to_csv(file, index=False)


def test_a_recommendation_is_over_all_seeds(results: Path) -> None:
    first = pi.recommend(results, min_ap=2).set_index(["lidar", "detector"])
    add_second_seed(results, 4)
    both = pi.recommend(results, min_ap=2).set_index(["lidar", "detector"])
    np.testing.assert_allclose(both.ap_r1000, (first.ap_r1000 - 2)[both.index])
    assert (both.ap_r1000_low < both.ap_r1000).all()
    assert both.difference.iloc[0] == 0


def columns_of(table: pd.DataFrame, *names: str) -> pd.DataFrame:
    ends = [f"{name}{end}" for name in names for end in ("", "_low", "_high")]
    return table[[*ends]]


def test_equal_trainings_on_the_same_traffic_have_the_intervals_of_one(results: Path) -> None:
    figures = ("ap_r1000", "ap_captured_r1000", "ap_visible_r1000", "covered_m", "difference")
    one = pi.recommend(results, min_ap=85).set_index(["lidar", "detector"])
    add_second_seed(results, 0)
    two = pi.recommend(results, min_ap=85).set_index(["lidar", "detector"])
    assert (one.ap_r1000_low < one.ap_r1000).all()
    assert (one.covered_m_low < one.covered_m).all()
    pd.testing.assert_frame_equal(
        columns_of(two, *figures), columns_of(one.loc[two.index], *figures), atol=1e-6
    )


def test_seeds_without_replicates_leave_the_difference_without_an_interval(results: Path) -> None:
    add_second_seed(results, 4)
    rows = results / "quick_replicates.csv"
    pd.read_csv(rows).query("seed == 1").to_csv(rows, index=False)
    table = pi.recommend(results, min_ap=2)
    assert table.difference_low.iloc[1:].isna().all()
    assert (table.ap_r1000_high - table.ap_r1000_low).to_numpy() == pytest.approx(2)


def test_intervals_over_different_traffic_stay_within_what_is_possible(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With two seeds, Student's t is 12.7: the ends of most figures would be impossible."""
    add_second_seed(results, 10)
    change(results / "quick_replicates.csv", "seed == 2", vehicles_digest="another")
    # All road of seed 1 is covered, and 40 m of 200 m of seed 2.
    change(results / "quick_distance.csv", "seed == 1", ap=95.0)
    table = pi.recommend(results, min_ap=85)
    for name in ("ap_r1000", "ap_captured_r1000", "ap_visible_r1000"):
        assert table[f"{name}_low"].min() == 0
        assert table[f"{name}_high"].max() == 100
    assert (table.covered_m == 120).all()
    assert table.covered_m_low.isna().all()
    lines = output_lines(capsys, results, "--budget", 1e6, "--min-ap", 85)
    assert any("on 120 of 200 m of road (no interval: it would" in line for line in lines)


def test_options_with_a_failed_seed_are_compared_in_the_seeds_of_all(results: Path) -> None:
    first = pi.recommend(results, min_ap=2).set_index(["lidar", "detector"])
    add_second_seed(results, 4)
    lidar, detector = first.index[0]
    failed = f"seed == 1 and lidar == '{lidar}' and detector == '{detector}'"
    change(results / "quick.csv", failed, ap=None)
    both = pi.recommend(results, min_ap=2).set_index(["lidar", "detector"])
    np.testing.assert_allclose(both.ap_r1000, (first.ap_r1000 - 4)[both.index])


def test_a_latency_of_a_loaded_machine_leaves_no_lidar_out(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick.csv", "detector == 'pv-rcnn'", latency_p50_ms=150.0)
    words = ("--budget", 8000, "--min-ap", 75)
    assert any(
        "Left out: " in line and "pv-rcnn" in line and "150 ms" in line
        for line in output_lines(capsys, results, *words)
    )
    change(
        results / "quick.csv",
        "detector == 'pv-rcnn'",
        latency_other_cores=1.5,
        latency_low_ms=95.0,
        latency_high_ms=160.0,
    )
    lines = output_lines(capsys, results, *words)
    assert not any("Left out: " in line and "150 ms" in line for line in lines)
    (note,) = [line for line in lines if "measured while other processes used 1.5 cores" in line]
    assert note.endswith("Measure the latency again on an idle machine.")


def test_replicates_decide_between_the_two_options_that_they_compared(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = pi.recommend(results, min_ap=2)
    first, second = (f"{row.lidar} {row.detector}" for row in before[:2].itertuples())
    row = {"scene": before.scene[0], "preset": before.preset[0], "first": second, "second": first}
    row |= {"subset": before.ground_truth[0], "replicates": 5, "half_width": 0.5}
    until = pd.DataFrame([row | {"difference": -3.0, "low": -3.5, "high": -2.5}])
    until.to_csv(results / "quick_until.csv", index=False)
    after = pi.recommend(results, min_ap=2)
    ends = ["difference", "difference_low", "difference_high"]
    assert after[ends].values.tolist()[1] == [3.0, 2.5, 3.5]
    pd.testing.assert_frame_equal(after[ends][2:], before[ends][2:])
    lines = output_lines(capsys, results, "--budget", 9000, "--min-ap", 75)
    assert any(line.endswith(" is 3.0 [2.5, 3.5].") and "replicates" in line for line in lines)


def test_the_interval_of_a_latency_leaves_out_the_time_of_other_processes() -> None:
    times = np.arange(1.0, 101.0)
    columns = latency_columns(times, times / 2, OtherLoad(1.5))
    assert (columns["latency_low_ms"], columns["latency_high_ms"]) == (20, 61)
    assert columns["latency_p50_ms"] == 50.5
    alone = latency_columns(times[:2], times[:2], OtherLoad(0.0))
    assert (alone["latency_low_ms"], alone["latency_high_ms"]) == (1, 2)
