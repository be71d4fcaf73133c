"""AP, recall and coverage within a range of the sensor, along roads and around the sensor."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmark_data import experiments, replicates_of
from conftest import Infrasim
from evaluation_data import box, car, noisy, traffic, write_lidar, write_predictions, write_roads
from test_recommend import change, output_lines, results
from test_site_files import simulated

from pyinfra import evaluate
from pyinfra.cli import main
from pyinfra.experiments.value import KEY
from pyinfra.formats.kitti import read_lidar
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.match_tables import RANGES_M
from pyinfra.metrics.settings import Settings

__all__ = ["results"]  # this fixture is imported
NEAR, FAR = "livox_avia", "pandar_64"
PAIR = "detector == 'pv-rcnn' and (lidar == 'livox_avia' or lidar == 'pandar_64')"


@pytest.mark.parametrize("range_m", [20, 60])
def test_ap_within_a_range_is_that_of_what_lies_there_alone(tmp_path: Path, range_m: int) -> None:
    frames = traffic(60)
    per_frame = noisy(frames)

    def clear(x: float) -> bool:
        # 6 m or more from the border, where a vehicle and its box may be on different sides
        return abs(abs(x) - range_m) > 6

    frames = [[v for v in frame if clear(float(str(v["x"])))] for frame in frames]
    per_frame = [[b for b in boxes if clear(b[0][0])] for boxes in per_frame]
    near = [[v for v in frame if abs(float(str(v["x"]))) <= range_m] for frame in frames]
    boxes_near = [[b for b in boxes if abs(b[0][0]) <= range_m] for boxes in per_frame]
    settings = Settings(ground_truths=("present",), block_s=1)
    tables = []
    for name, vehicles, boxes in (("all", frames, per_frame), ("near", near, boxes_near)):
        (tmp_path / name).mkdir()
        write_roads(tmp_path / name)
        folder = write_lidar(tmp_path / name / "lidar", vehicles)
        predictions = write_predictions(tmp_path / name / "predictions", boxes)
        tables.append(evaluate(folder, predictions, settings, ranges=True))
    assert tables[0].ranges is not None
    within = tables[0].ranges.set_index("range_m").loc[range_m]
    whole = tables[1].ap.iloc[0]
    for column in ("ap_r1000", "ap_r1000_low", "ap_r1000_high", "objects", "predictions"):
        assert within[column] == pytest.approx(whole[column]), column
    bootstrapped, alone = (
        table.replicates.set_index("measure").filter(regex=r"^replicate_\d+$") for table in tables
    )
    assert len(bootstrapped.columns) > 0
    np.testing.assert_allclose(bootstrapped.loc[f"ap_r1000_{range_m}m"], alone.loc["ap_r1000"])


def test_recall_within_a_range_is_the_share_that_is_detected(tmp_path: Path) -> None:
    write_roads(tmp_path)
    frames = [[car(10), car(-15), car(50), car(95)]] * 30
    predictions = [[(box(car(10)), 0.9), (box(car(50)), 0.2)]] * 30
    folder = write_lidar(tmp_path / "lidar", frames)
    settings = Settings(ground_truths=("present",))
    done = evaluate(folder, write_predictions(tmp_path / "p", predictions), settings, ranges=True)
    assert done.ranges is not None
    rows = done.ranges.set_index("range_m")
    assert tuple(rows.index) == RANGES_M
    assert rows.recall[[20, 60, 100]].to_list() == pytest.approx([50, 200 / 3, 50])
    assert rows.objects[[20, 60, 100]].to_list() == [60, 90, 120]
    assert rows.ap_r1000[100] == done.ap.ap_r1000[0]


def test_a_range_at_a_site_of_lanes_is_around_the_sensor(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    positions = [(-70, -2), (-50, -2), (-30, 2), (10, 2), (30, -2), (50, 2), (60, 2)]
    cars = np.array([(x, y, 0) for x, y in positions], np.float64)
    folder = simulated(infrasim, tmp_path, cars=cars)
    truth = read_ground_truth(folder, [0])
    pose = read_lidar(folder).T_world_levelled
    away = np.hypot(*(truth.places(truth.vehicles.mid_frame).xy - (pose.x, pose.y)).T)
    boxes = [(box.tolist(), 0.9) for box in truth.vehicles.boxes[away < 45]]
    predictions = write_predictions(tmp_path / "predictions", [boxes])
    settings = Settings(ground_truths=("all",), min_objects=1, replicates=5)
    evaluation = evaluate(folder, predictions, settings, ranges=True)
    assert evaluation.ranges is not None
    rows = evaluation.ranges.set_index("range_m")
    assert rows.objects.to_list() == [int((away <= r).sum()) for r in RANGES_M]
    assert rows.ap_r1000[40] == 100
    assert rows.ap_r1000[100] < 100
    assert rows.ap_r1000[100] == evaluation.ap.ap_r1000[0]
    assert evaluation.cells is not None
    at = np.hypot(evaluation.cells.x - pose.x, evaluation.cells.y - pose.y)
    np.testing.assert_allclose(evaluation.cells.distance_m, at)
    evaluation.save(tmp_path / "out")
    replace(evaluation, ranges=None, cells=None).save(tmp_path / "out")
    written = {file.stem for file in (tmp_path / "out").glob("*.csv")}
    assert written == evaluation.tables().keys() - {"ranges", "cells"}


# --- recommend ----------------------------------------------------------------------------------


def with_ranges(results: Path) -> None:
    """Adds ranges. Within 60 m the 64 lines have AP 95 and the Avia has AP 70. Within the whole
    region the values do not change."""
    rows = experiments()[[*KEY, "ap_all"]].rename(columns={"ap_all": "ap_r1000"})
    near = rows.assign(range_m=60)
    near["ap_r1000"] = near.ap_r1000.where(near.lidar != NEAR, 70.0).where(near.lidar != FAR, 95.0)
    both = pd.concat([near, rows.assign(range_m=100)]).assign(objects=9, predictions=9)
    both = both.assign(ap_r1000_low=both.ap_r1000 - 1, ap_r1000_high=both.ap_r1000 + 1)
    both = both.assign(recall=50.0 + both.range_m / 10, recall_low=50.0, recall_high=70.0)
    tables = [both.assign(ground_truth=truth) for truth in ("captured", "common", "all")]
    pd.concat(tables).to_csv(results / "quick_ranges.csv", index=False)
    bootstrapped = pd.read_csv(results / "quick_replicates.csv")
    nearby = replicates_of(near, "ap_r1000", 1, "all").assign(measure="ap_r1000_60m")
    more = bootstrapped.assign(measure="ap_r1000_100m")
    pd.concat([bootstrapped, nearby, more]).to_csv(results / "quick_replicates.csv", index=False)


def test_ap_recall_and_coverage_are_those_of_the_range(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_ranges(results)
    far = output_lines(capsys, results, "--budget", 8000)[1]
    assert far.startswith(f"1. {NEAR} with pointpillars: AP (R1000) of all visible vehicles")
    assert "vehicles in the whole region 94.0 [93.0, 95.0]" in far
    assert "; finds 60 % [50, 70] of all visible vehicles, at any score; " in far
    assert "on 40 [20 to 60] of 200 m of road" in far
    lines = output_lines(capsys, results, "--budget", 8000, "--range", 60)
    assert lines[1].startswith(f"1. {FAR} with ")
    assert "within 60 m 95.0 [94.0, 96.0], of the vehicles it captures 95.0" in lines[1]
    assert "; finds 56 % [50, 70] of all visible vehicles, at any score; " in lines[1]
    assert "on 40 [20 to 60] of 120 m of road" in lines[1]
    assert f"Left out: {NEAR} with pv-rcnn: AP 70.0 of all visible vehicles." in lines
    # The difference between the first two options is also that within the range.
    assert any("does not differ significantly" in line for line in lines)


def test_a_range_that_was_not_measured_is_refused_with_those_that_were(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_ranges(results)
    assert main.main(["recommend", str(results), "--budget", "8000", "--range", "45"]) == 2
    assert "--range: expected one of 60, 100 m, got 45" in capsys.readouterr().err


def test_an_old_table_says_that_its_ap_is_of_the_whole_region(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    message = "These results have no AP within ranges, so AP is of the whole region"
    near = output_lines(capsys, results, "--budget", 8000, "--range", 45)
    assert any(line.startswith(message) for line in near)
    assert not any(
        line.startswith(message) for line in output_lines(capsys, results, "--budget", 8000)
    )


@pytest.mark.nightly
def test_coverage_of_a_site_of_lanes_is_squares_within_the_range(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_ranges(results)
    change(results / "quick_distance.csv", "seed == 1", road="(lanes)")
    table = pd.DataFrame({"distance_m": [10.0, 30.0, 50.0, 90.0], "ap_r1000": [90, 90, 50, 99]})
    table = table.assign(ap_r1000_low=[88, 80, 40, 98], ap_r1000_high=[92, 95, 60, 100])
    table = table.assign(x=table.distance_m, y=0, objects=9, predictions=9, quality="x", ap=1)
    table = experiments()[KEY].merge(table.assign(ground_truth="all"), how="cross")
    table.to_csv(results / "quick_squares.csv", index=False)
    squares = "squares of 20 m; 50 ms a frame"
    far = output_lines(capsys, results, "--budget", 8000)
    assert far[1].endswith(f"on 3 [2 to 3] of 4 {squares}")
    near = output_lines(capsys, results, "--budget", 8000, "--range", 60)
    assert near[1].endswith(f"on 2 [1 to 2] of 3 {squares}")
    out = results.parent / "report.html"
    assert main.main(["report", str(results), "--range", "60", "--out", str(out)]) == 0
    assert "Covered, squares of 20 m" in out.read_text()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("low", "high", "reason"),
    [
        (
            None,
            None,
            "no interval: 41 of 41 windows have no interval: vehicles are in fewer than 4",
        ),
        (5.0, 99.0, "no interval: no window differs significantly from AP 85"),
    ],
)
def test_an_interval_that_says_nothing_is_not_printed_but_its_reason(
    low: float | None,
    high: float | None,
    reason: str,
    results: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change(results / "quick_distance.csv", "seed == 1", ap=90.0, ap_low=low, ap_high=high)
    change(results / "quick.csv", "seed == 1", ap_all_low=low, ap_all_high=high)
    lines = output_lines(capsys, results, "--budget", 8000)
    assert f"on 200 of 200 m of road ({reason}" in lines[1]
    text = "\n".join(lines)
    assert ("No interval is available for the AP of " in text) == (low is None)
    out = results.parent / "report.html"
    assert main.main(["report", str(results), "--out", str(out)]) == 0
    for shown in (text, out.read_text()):
        assert not re.search(r"\[ *nan|\[0(\.0)?(,| to) 200", shown)
    assert reason in out.read_text()
