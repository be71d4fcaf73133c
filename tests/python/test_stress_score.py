"""The cost of each kind of error for frames made by hand, and the falls of artificial curves."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmark_data import with_r1000
from evaluation_data import box, car, noisy, traffic, write_lidar, write_predictions, write_roads

from pyinfra.experiments.stress import score, summary
from pyinfra.experiments.stress.stressors import STRESSORS
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.models.detectors import Detections
from pyinfra.viz import stress_plots

FRAMES = 10


def detections(boxes: list[tuple[list[float], float]]) -> Detections:
    return Detections(
        np.array([b for b, _ in boxes]).reshape(-1, 7),
        np.array([s for _, s in boxes]),
        np.array(["vehicle"] * len(boxes), dtype=np.str_),
    )


def site(folder: Path, vehicles: list[list[dict[str, object]]]) -> Path:
    folder.mkdir()
    write_roads(folder)
    return write_lidar(folder / "made_up", vehicles)


def measured(
    tmp_path: Path, boxes: list[tuple[list[float], float]], vehicles: list[dict[str, object]]
) -> dict[str, float]:
    folder = site(tmp_path / "data", [vehicles] * FRAMES)
    return score.scored(read_ground_truth(folder), [detections(boxes)] * FRAMES)[0]


NEAR, MID, FAR = car(20), car(55), car(80)


def test_figures_are_those_of_evaluate(tmp_path: Path) -> None:
    frames = traffic(60)
    predictions = noisy(frames)
    folder = site(tmp_path / "data", frames)
    pred = write_predictions(tmp_path / "pred", predictions)
    expected = evaluate(folder, pred)
    row, _ = score.scored(read_ground_truth(folder), [detections(one) for one in predictions])
    first = expected.ap.iloc[0]
    for name in ("ap", "objects"):
        assert row[name] == pytest.approx(first[name], abs=1e-6)
    background = expected.false_positives.query(
        "cause == 'background' and ground_truth == 'captured'"
    )
    assert row["background_per_frame"] == background["count"].iloc[0] / 60


def test_a_perfect_detector_has_nothing_to_forgive(tmp_path: Path) -> None:
    row = measured(tmp_path, [(box(v), 0.9) for v in (NEAR, MID, FAR)], [NEAR, MID, FAR])
    assert row["ap"] == 100
    assert [row[f"recall_{band}"] for band in score.BANDS_M] == [1, 1, 1]
    assert row["position_error_m"] == row["heading_error_deg"] == row["background_per_frame"] == 0
    assert all(row[f"forgiven_{error}"] == 0 for error in score.ERRORS)


def test_a_missed_far_vehicle_is_forgiven_there_alone(tmp_path: Path) -> None:
    """Half of the recalls are reached, so AP is 50. It is 100 if the far vehicle need not be
    detected."""
    row = measured(tmp_path, [(box(NEAR), 0.9)], [NEAR, FAR])
    assert row["ap"] == pytest.approx(50)
    assert row["recall_far"] == 0
    assert math.isnan(row["recall_mid"])
    gains = {error: row[f"forgiven_{error}"] for error in score.ERRORS}
    assert gains.pop("misses_far") == pytest.approx(50)
    assert set(gains.values()) == {0}


def test_boxes_on_background_and_duplicates_are_forgiven_as_background(tmp_path: Path) -> None:
    """The box on background comes before the first match, so AP is 50.
    The last box is a duplicate."""
    background, twice = box(car(-50)), box(NEAR | {"x": 20.5})
    row = measured(tmp_path, [(background, 0.9), (box(NEAR), 0.8), (twice, 0.85)], [NEAR])
    assert row["background_per_frame"] == 1
    assert row["ap"] == pytest.approx(50)  # the second of the two boxes matches the vehicle
    assert row["forgiven_background"] == pytest.approx(50)
    assert row["forgiven_position"] == 0


def test_a_box_beside_its_vehicle_is_an_error_of_position(tmp_path: Path) -> None:
    """The box is 1.8 m beside a car of 2 m width. Their IoU is 0.05, so the box counts as
    background and the car as missed."""
    beside = box(NEAR | {"y": 3 + 1.8})
    row = measured(tmp_path, [(beside, 0.9)], [NEAR])
    assert row["ap"] == 0
    assert row["background_per_frame"] == 1
    assert row["forgiven_position"] == pytest.approx(100)
    assert row["forgiven_background"] == row["forgiven_misses_near"] == row["forgiven_heading"] == 0


def test_a_box_that_lies_across_is_an_error_of_heading(tmp_path: Path) -> None:
    across = box(NEAR | {"heading": math.pi / 2})
    row = measured(tmp_path, [(across, 0.9)], [NEAR])
    assert row["ap"] == 0
    assert row["forgiven_heading"] == pytest.approx(100)
    assert row["forgiven_position"] == 0


def test_errors_of_boxes_that_hit_are_medians_to_the_nearer_way(tmp_path: Path) -> None:
    off = box(NEAR | {"x": 20.3, "y": 3.4, "heading": math.pi + math.radians(4)})
    row = measured(tmp_path, [(off, 0.9)], [NEAR])
    assert row["position_error_m"] == pytest.approx(0.5, abs=1e-6)
    assert row["heading_error_deg"] == pytest.approx(4, abs=1e-3)


def test_a_partner_is_near_free_and_the_nearest(tmp_path: Path) -> None:
    bus = car(-40, dx=12.0)
    folder = site(tmp_path / "data", [[NEAR, MID, bus]])
    boxes = [
        (box(NEAR), 0.9),  # matches its vehicle
        (box(NEAR | {"y": 4.9}), 0.8),  # its vehicle is already matched
        # 2.5 m from a car of 4 m length, which is too far for a partner
        (box(MID | {"x": 57.5}), 0.7),
        # 5.5 m from a bus of 12 m length, which is near enough for a partner
        (box(bus | {"x": -34.5, "dx": 4.0}), 0.6),
    ]
    one = score.match_input(
        read_ground_truth(folder), score.as_predictions([detections(boxes)]), "vehicle",
        score.Settings(ground_truths=("captured",)), "bev",
    )  # fmt: skip
    np.testing.assert_array_equal(score.partners(score._match_result(one)), [-1, -1, -1, 2])


@pytest.mark.parametrize("vehicles", [[NEAR], []])
def test_nothing_detected_and_nothing_to_detect(
    tmp_path: Path, vehicles: list[dict[str, object]]
) -> None:
    row = measured(tmp_path, [], vehicles)
    assert math.isnan(row["position_error_m"])
    assert row["ap"] == 0 if vehicles else math.isnan(row["ap"])


def test_a_box_where_nothing_drives(tmp_path: Path) -> None:
    assert measured(tmp_path, [(box(NEAR), 0.9)], [])["background_per_frame"] == 1


# Artificial curves.


def rows(
    stressor: str, points: dict[str, float], detector: str = "a", **columns: float
) -> pd.DataFrame:
    """Returns the rows of a curve. `points` has the AP by severity, first without stress."""
    (none, *others) = points
    key = {"detector": detector, "run": detector, "lidar": "l", "preset": "p", "scene": "s"}
    key |= {"seed": "1", "frames": "9"}
    standard = {f"forgiven_{error}": 0.0 for error in score.ERRORS}
    standard |= {"trained_frames": 800, "ap_low": 0, "ap_high": 100} | columns
    table = pd.DataFrame(
        [
            key | {"stressor": name, "severity": severity, "ap": points[severity], **standard}
            for name, severity in [("none", none), *((stressor, other) for other in others)]
        ]
    )
    return with_r1000(table)


def test_a_curve_falls_between_its_severities() -> None:
    """From 0 to 0.5 the AP falls from 90 to 70, so it is 80 at 0.25. Up to 0.75 it falls to 20, so
    it is 45 half way."""
    table = rows("drop_out", {"0": 90, "0.75": 20, "0.5": 70})
    (row,) = summary.summary(table).to_dict("records")
    assert row["falls_by_10"] == "0.25"
    assert row["falls_to_half"] == "0.625"
    assert row["ap_least"] == 20
    # The areas under the curve are 80 x 0.5 and 45 x 0.25. Without stress the area is 90 x 0.75.
    assert row["gentleness"] == pytest.approx((40 + 11.25) / 67.5)


def test_a_curve_that_stays_up_is_beyond_and_blames_nobody() -> None:
    (row,) = summary.summary(rows("drop_out", {"0": 90, "0.5": 81})).to_dict("records")
    assert row["falls_by_10"] == row["falls_to_half"] == "beyond"
    assert row["fails_first"] == ""


def test_a_detector_that_finds_nothing_has_no_gentleness() -> None:
    (row,) = summary.summary(rows("fog", {"0": 0, "5": 0})).to_dict("records")
    assert math.isnan(row["gentleness"])
    assert row["falls_by_10"] == "beyond"
    assert len(summary.summary(rows("fog", {"0": math.nan, "5": 9}))) == 0


def test_the_first_crossing_counts_and_undefined_severities_are_passed_over() -> None:
    at = np.array([0.0, 1, 2, 3])
    assert summary.crossing(at, np.array([90.0, 70, 90, 10]), 80) == 0.5
    assert summary.crossing(at, np.array([90.0, np.nan, 70, 10]), 80) == 1
    assert summary.crossing(at, np.array([90.0, 95, 92, 91]), 80) == math.inf
    assert summary.crossing(at, np.array([0.0, 0, 0, 0]), 0) == 0


def test_names_fall_without_lines_between_them() -> None:
    table = rows("unseen_scene", {"own": 90, "curve": 80, "crossroad": 30})
    (row,) = summary.summary(table).to_dict("records")
    assert row["falls_by_10"] == "crossroad curve"
    assert row["falls_to_half"] == "crossroad"
    assert row["gentleness"] == pytest.approx((80 + 30) / 2 / 90)


def test_fewer_training_frames_are_the_stronger_severity() -> None:
    table = rows("training_frames", {"0": 90, "200": 60, "400": 70})
    (row,) = summary.summary(table).to_dict("records")
    assert row["falls_by_10"] == "600"
    assert row["gentleness"] == pytest.approx((80 * 400 + 65 * 200) / 600 / 90)


@pytest.mark.parametrize(
    ("stressor", "none", "milder", "harder"),
    [("density", "0", "0.5", "2"), ("training_frames", "0", "1600", "200")],
)
def test_a_curve_begins_without_stress_and_leaves_out_what_is_milder(
    stressor: str, none: str, milder: str, harder: str
) -> None:
    (row,) = summary.summary(rows(stressor, {none: 80, milder: 95, harder: 60})).to_dict("records")
    assert (row["ap_none"], row["ap_least"], row["severities"]) == (80, 60, 2)
    assert row["gentleness"] == pytest.approx(70 / 80)
    assert summary.summary(rows(stressor, {none: 80, milder: 95})).empty


def test_the_blame_is_what_stress_added() -> None:
    """The AP falls by 20. Correcting the position gains 12, against 2 without stress. Correcting
    the heading gains 9 in both cases."""
    table = rows("yaw_error", {"0": 90, "1": 85, "2": 70, "4": 10})
    table["forgiven_position"] = [2.0, 3, 12, 0]
    table["forgiven_heading"] = [9.0, 9, 9, 99]
    table["forgiven_background"] = [0.0, 99, 4, 0]
    (row,) = summary.summary(table).to_dict("records")
    assert row["fails_first"] == "position"
    assert row["share_of_fall"] == pytest.approx(0.5)
    table["forgiven_position"] = [9.0, 3, 12, 0]
    (row,) = summary.summary(table).to_dict("records")
    assert row["fails_first"] == "background"
    table["forgiven_background"] = 0.0
    (row,) = summary.summary(table).to_dict("records")
    assert row["fails_first"] == "mixed"
    assert row["largest_blame"] == "position"


def test_ranking_takes_what_all_detectors_went_through() -> None:
    table = pd.concat(
        [
            rows("drop_out", {"0": 90, "0.5": 45}, "a"),
            rows("fog", {"0": 90, "5": 90, "10": 90}, "a").iloc[1:],
            rows("training_frames", {"0": 90, "100": 0}, "a").iloc[1:],
            rows("drop_out", {"0": 80, "0.5": 60}, "b"),
            rows("fog", {"0": 80, "5": 0}, "b").iloc[1:],
        ]
    )
    ranks = summary.ranking(table).to_dict("records")
    assert [row["detector"] for row in ranks] == ["b", "a"]
    assert [row["gentleness"] for row in ranks] == pytest.approx([0.875, 0.75])
    assert {row["stressors"] for row in ranks} == {1}
    apart = pd.concat([rows("fog", {"0": 90, "5": 80}, "a"), rows("rain", {"0": 9, "5": 8}, "b")])
    assert len(summary.ranking(apart)) == 0
    other_severities = [rows("fog", {"0": 90, "5": 80}, "a"), rows("fog", {"0": 90, "10": 80}, "b")]
    assert len(summary.ranking(pd.concat(other_severities))) == 0


def test_a_detector_that_finds_nothing_has_no_rank_and_takes_none() -> None:
    table = pd.concat(
        [
            rows("fog", {"0": 80, "5": 40}, "a"),
            rows("fog", {"0": 0, "5": 0}, "b"),
            rows("fog", {"0": 60, "5": 60}, "c"),
        ]
    )
    assert summary.ranking(table).detector.tolist() == ["c", "a"]


def test_tables_and_figures_of_nothing(tmp_path: Path) -> None:
    table = rows("fog", {"0": math.nan, "5": 9})
    for rows_, columns in (
        (summary.summary(table), summary.COLUMNS),
        (summary.ranking(table), summary.RANKING),
    ):
        assert rows_.columns.tolist() == columns
        assert len(rows_) == 0
    assert stress_plots.draw_all(table, tmp_path) == []


def test_a_figure_keeps_the_dots_of_its_names(tmp_path: Path) -> None:
    table = rows("fog", {"0": 80, "5": 40}).assign(lidar="own.v2")
    files = stress_plots.draw_all(table, tmp_path)
    assert [file.name.partition("_own")[2] for file in files] == [".v2.svg", ".v2.png"]
    assert all(file.is_file() for file in files)


def test_figures_have_a_panel_for_each_stressor(tmp_path: Path) -> None:
    table = pd.concat(
        [
            rows("drop_out", {"0": 90, "0.5": 45}),
            rows("unseen_scene", {"own": 90, "curve": 80}).iloc[1:],
        ]
    )
    figure = stress_plots.stress(table)
    assert [ax.get_title() for ax in figure.axes] == ["drop out", "unseen scene"]
    turned = rows("unseen_scene", {"own": 9, "curve": 8, "crossroad": 7}, "b")
    (ax,) = stress_plots.stress(pd.concat([rows("unseen_scene", {"own": 90}), turned])).axes
    ticks = [text.get_text() for text in ax.get_xticklabels()]
    assert ticks == ["own", "crossroad", "curve"]
    files = stress_plots.draw_all(table, tmp_path)
    assert [file.name for file in files] == ["stress_s_p_l.svg", "stress_s_p_l.png"]
    assert all(file.stat().st_size > 1000 for file in files)


def test_every_stressor_starts_without_stress_and_breaks_harder() -> None:
    for row in STRESSORS.values():
        if not row.named and row.acts_on != "training":
            assert list(row.severities) == sorted(set(row.severities)), row.name
            assert len(row.severities) >= 3, row.name
