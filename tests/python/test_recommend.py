"""Claims and recommendations from made-up tables with known answers."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from pyinfra import cli
from pyinfra.benchmark.detection_claims import Measured, claims_table, slope
from pyinfra.benchmark.paper import paper_table
from pyinfra.benchmark.value import KEY
from pyinfra.data.paper_tables import paper_ap
from pyinfra.statistics.selection import preset_of_answers

PRICES = {"ruby_plus": 24000, "livox_avia": 2000, "pandar_64": 6000, "helios_16": 1000}
AP = {  # of LiDARs, by detector
    "pointpillars": (93.0, 94.0, 88.0, 60.0),
    "pv-rcnn": (94.0, 94.0, 90.0, 62.0),
    "dsvt": (84.0, 80.0, 80.0, 55.0),
    "pointrcnn": (50.0, 70.0, 40.0, 30.0),
}


def key_of(lidar: str, detector: str) -> dict[str, object]:
    return dict(zip(KEY, ("road", lidar, "paper", detector, "quick", 1), strict=True))


def cells(half: float = 1.0) -> pd.DataFrame:
    """Every LiDAR with every detector; intervals of AP reach `half` to either side."""
    rows = [
        key_of(lidar, detector)
        | {"ap": ap, "ap_low": ap - half, "ap_high": ap + half, "ap_all": ap / 2}
        | {"latency_p50_ms": 50.0, "version": "1"}
        for detector, own in AP.items()
        for lidar, ap in zip(PRICES, own, strict=True)
    ]
    return pd.DataFrame(rows)


def values() -> pd.DataFrame:
    rows = [
        key_of(lidar, detector) | {"price_usd": price, "n_hqda": 10}
        for detector in AP
        for lidar, price in PRICES.items()
    ]
    return pd.DataFrame(rows)


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


def along_the_road() -> pd.DataFrame:
    """Windows from -100 to 100: AP above 85 for sure at 0, likely at 50 and perhaps at -50."""
    table = pd.DataFrame({"s": [5.0 * i for i in range(-20, 21)]})
    table = table.assign(ap=50.0, ap_low=45.0, ap_high=55.0).set_index("s")
    table.loc[0.0] = (90.0, 86.0, 92.0)
    table.loc[50.0] = (90.0, 80.0, 92.0)
    table.loc[-50.0] = (80.0, 75.0, 87.0)
    return table.reset_index().assign(ground_truth="all", road="a", objects=30, predictions=30)


def prices_of_lidars(**ends: tuple[float, float]) -> pd.DataFrame:
    """The table of LiDARs: low and high are the price, where they are not given."""
    both = [ends.get(name, (price, price)) for name, price in PRICES.items()]
    table = pd.DataFrame(both, columns=["price_low_usd", "price_high_usd"])
    table = table.assign(lidar=list(PRICES), preset="paper", units=1)
    return table.assign(price_source="made up", price_date="2026")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """The tables of a benchmark whose LiDARs cost what they did when it was made."""
    own = {"command": "x", "ap_common": 1, "objects": 9, "train_seconds": 1, "latency_p95_ms": 60}
    bought = ("ap", "ap_all", "ap_per_1000_usd", "usd_per_hq_area", "usd_per_m_road")
    value = values().assign(pareto=True, dominated_by="", points_per_1000_usd=1, site_usd=0)
    distance = cells()[KEY].merge(along_the_road().assign(quality="low"), how="cross")
    cells().assign(**own).to_csv(tmp_path / "quick.csv", index=False)
    value.assign(**dict.fromkeys(bought, 1)).to_csv(tmp_path / "quick_value.csv", index=False)
    distance.to_csv(tmp_path / "quick_distance.csv", index=False)
    return tmp_path


def change(file: Path, rows: str, **columns: object) -> None:
    """Other values in the rows that a query finds."""
    table = pd.read_csv(file)
    found = table.query(rows).index
    table = table.astype({name: object for name in columns if name in table})
    for name, new in columns.items():
        table.loc[found, name] = new
    table.to_csv(file, index=False)


def said(capsys: pytest.CaptureFixture[str], *words: object) -> list[str]:
    assert cli.main(["recommend", *map(str, words)]) == 0
    return capsys.readouterr().out.splitlines()


def test_the_cheapest_of_those_that_cover_most_comes_first(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = said(capsys, results, "--budget", 8000, "--min-ap", 85)
    assert lines[1] == (
        "1. livox_avia with pointpillars: 2,000 USD; AP 94.0 [93.0, 95.0] of the vehicles it "
        "captures, 47.0 of all; AP above 85 of all on 40 [20 to 60] of 200 m of road; "
        "50 ms a frame on one core"
    )
    assert lines[3].startswith("3. pandar_64 with pv-rcnn")
    assert "AP does not tell livox_avia with pointpillars from livox_avia with pv-rcnn" in lines[5]
    assert "Left out: ruby_plus with pv-rcnn: costs 24,000 USD." in lines


def test_no_option_is_an_answer_with_its_reasons(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = said(capsys, results, "--budget", 1500, "--min-ap", 85)
    assert lines[1] == "No option meets this."
    assert "Left out: helios_16 with pv-rcnn: AP 62.0." in lines


def test_options_after_the_fifth_are_named_in_a_line(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = said(capsys, results, "--budget", 8000, "--min-ap", 75)
    assert lines[5].startswith("5. pandar_64 with pointpillars")
    assert lines[6] == "And 1 more that meets this: pandar_64 with dsvt."


def test_road_that_does_not_tell_options_apart_names_the_cheapest(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    distance = results / "quick_distance.csv"
    change(distance, "lidar == 'pandar_64' and detector == 'pv-rcnn' and s == -50", ap=90.0)
    change(distance, "lidar == 'livox_avia' and s == -50", ap_high=84.0)
    lines = said(capsys, results, "--budget", 8000, "--min-ap", 85)
    assert "on 60 [20 to 60] of 200 m" in lines[1]
    assert "on 40 [20 to 40] of 200 m" in lines[2]
    both = "livox_avia with pointpillars, livox_avia with pv-rcnn"
    assert (
        f"The road covered does not tell pandar_64 with pv-rcnn from {both}, pandar_64 with "
        f"pointpillars; the cheapest of these are {both} (2,000 USD)." in lines
    )
    rows = "lidar == 'livox_avia' and detector == 'pv-rcnn'"
    change(results / "quick_value.csv", rows, price_usd=1900.0)
    cheapest = "the cheapest of these is livox_avia with pv-rcnn (1,900 USD)."
    assert any(cheapest in line for line in said(capsys, results, "--budget", 8000))


def test_road_that_tells_options_apart_makes_no_doubt(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "lidar == 'pandar_64' and detector == 'pv-rcnn'"
    change(results / "quick_distance.csv", rows, ap=90.0, ap_low=88.0, ap_high=92.0)
    # Four windows hold each metre, so that one which is not sure takes none away.
    change(results / "quick_distance.csv", f"{rows} and s == 0", ap_low=80.0)
    lines = said(capsys, results, "--budget", 8000, "--min-ap", 85)
    assert lines[1].startswith("1. pandar_64 with pv-rcnn")
    assert "on 200 [200 to 200] of 200 m" in lines[1]
    assert not any(line.startswith("The road covered") for line in lines)
    assert not any("covers the whole" in line for line in lines)


def test_a_window_without_an_interval_may_be_covered_and_may_not(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(results / "quick_distance.csv", "s == -50 or s == 50", ap_low=None, ap_high=None)
    assert "on 40 [20 to 60] of 200 m" in said(capsys, results, "--budget", 8000)[1]


def test_road_is_what_was_evaluated_within_the_range(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = pd.read_csv(results / "quick_distance.csv")
    side = table[table.s.between(-20, 5)].assign(road="side")
    both = pd.concat([table[table.s.between(-60, 55)], side])
    both.to_csv(results / "quick_distance.csv", index=False)
    # -60 to 55 and -20 to 5. Covered: -10 to 10 and 40 to 55; -10 to 5 of the side road.
    assert "on 50 [35 to 70] of 140 m" in said(capsys, results, "--budget", 8000)[1]
    near = said(capsys, results, "--budget", 8000, "--range", 12)[1]
    assert "on 35 [35 to 35] of 41 m" in near


def test_an_ap_without_an_interval_is_told_as_such(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "lidar == 'livox_avia' and detector == 'pointpillars'"
    change(results / "quick.csv", rows, ap_low=None, ap_high=None)
    lines = said(capsys, results, "--budget", 8000, "--min-ap", 89)
    first, other = "livox_avia with pointpillars", "livox_avia with pv-rcnn"
    assert "AP 94.0 (no interval) of the vehicles" in lines[1]
    assert (
        f"Whether AP tells {first} from {other}, pandar_64 with pv-rcnn cannot be told: "
        "there is no interval." in lines
    )
    assert not any("intervals overlap" in line for line in lines)
    assert f"Not sure to reach AP 89: {first}: there is no interval." in lines
    assert "Not sure to reach AP 89: pandar_64 with pv-rcnn: the interval begins" not in lines


def test_a_range_of_prices_is_told_and_doubted(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ends = {"livox_avia": (1000, 3000), "pandar_64": (2000, 10000)}
    prices_of_lidars(**ends).to_csv(results / "lidars.csv", index=False)
    rows = "lidar == 'livox_avia' or lidar == 'pandar_64'"
    change(results / "quick_value.csv", "lidar == 'livox_avia'", price_usd=2300.0)
    change(results / "quick_value.csv", "lidar == 'pandar_64'", price_usd=6300.0)
    change(results / "quick_value.csv", rows, site_usd=300.0)
    lines = said(capsys, results, "--budget", 2500, "--min-ap", 85)
    assert lines[1].startswith("1. livox_avia with pointpillars: 2,300 USD (1,300 to 3,300); AP")
    both = "livox_avia with pointpillars, livox_avia with pv-rcnn"
    assert f"{both} may cost more than the budget: 1,300 to 3,300 USD." in lines
    may = "costs 6,300 USD (2,300 to 10,300: may be within the budget)."
    assert f"Left out: pandar_64 with pv-rcnn: {may}" in lines
    assert "Left out: ruby_plus with pv-rcnn: costs 24,000 USD." in lines
    enough = said(capsys, results, "--budget", 3300, "--min-ap", 85)
    assert not any("may cost more" in line for line in enough)
    short = said(capsys, results, "--budget", 99, "--min-ap", 85)
    assert "Left out: pandar_64 with pv-rcnn: costs 6,300 USD (2,300 to 10,300)." in short


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
    assert said(capsys, results, "--budget", 8000)[0].startswith("road, preset paper, quick tier")
    asked = said(capsys, results, "--budget", 8000, "--preset", "datasheet")
    assert asked[0].startswith("road, preset datasheet")


def test_nothing_follows_from_networks_of_the_smoke_tier(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in sorted(results.glob("quick*.csv")):
        table = pd.read_csv(file).assign(tier="smoke")
        table.to_csv(results / file.name.replace("quick", "smoke"), index=False)
    line = "Networks of the smoke tier have hardly learnt: nothing follows from their AP."
    assert said(capsys, results, "--budget", 8000, "--tier", "smoke")[1] == line
    assert line not in said(capsys, results, "--budget", 8000)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("quick.csv", "", "quick.csv: is no table"),
        ("quick.csv", "1,2,3\n4,5,6\n", "quick.csv:1: found no column scene"),
        ("quick_value.csv", "scene,lidar\n", "quick_value.csv:1: found no column preset"),
        ("quick_distance.csv", "", "quick_distance.csv: is no table"),
        ("lidars.csv", "lidar\nruby_plus\n", "lidars.csv:1: found no column price_source"),
    ],
)
def test_a_damaged_table_is_named(
    file: str, text: str, message: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / file).write_text(text)
    assert cli.main(["recommend", str(results), "--budget", "8000"]) == 2
    assert f"{results}/{message}" in capsys.readouterr().err


@pytest.mark.parametrize("file", ["quick", "quick_value", "quick_distance"])
def test_a_table_without_its_rows_is_named(
    file: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = (results / f"{file}.csv").read_text().splitlines()[0]
    (results / f"{file}.csv").write_text(f"{header}\n")
    assert cli.main(["recommend", str(results), "--budget", "8000"]) == 2
    found = "no cells" if file == "quick" else "0 of 16 cells"
    assert f"{results}/{file}.csv: found {found}, allowed" in capsys.readouterr().err


def test_cells_that_all_failed_and_prices_without_a_preset_are_told(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prices_of_lidars().drop(columns="preset").to_csv(results / "lidars.csv", index=False)
    assert cli.main(["recommend", str(results), "--budget", "8000"]) == 2
    assert "lidars.csv: found no column preset, allowed a table" in capsys.readouterr().err
    (results / "lidars.csv").unlink()
    change(results / "quick.csv", "seed == 1", ap=None)
    assert cli.main(["recommend", str(results), "--budget", "8000"]) == 2
    assert "quick.csv: found no finished cell, allowed one or more" in capsys.readouterr().err


def test_help_says_of_which_vehicles_the_ap_is(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["recommend", "--help"])
    assert "AP of the vehicles that a LiDAR captured" in " ".join(capsys.readouterr().out.split())


def test_an_answer_needs_neither_plots_nor_networks() -> None:
    code = (
        "import sys, pyinfra.benchmark.recommend; print({'matplotlib', 'torch'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--budget", "0"], "--budget: found 0, allowed above 0"),
        (["--budget", "9", "--range", "200"], "--range: found 200, allowed above 0 to 100"),
        (["--budget", "9", "--scene", "moon"], "--scene: found 'moon', allowed road"),
        (["--budget", "9", "--preset", "x"], "--preset: found 'x', allowed paper"),
        (["--budget", "9", "--tier", "full"], "full.csv: No such table"),
    ],
)
def test_wrong_words_say_what_is_allowed(
    words: list[str], message: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["recommend", str(results), *words]) in (1, 2)
    assert message in capsys.readouterr().err
