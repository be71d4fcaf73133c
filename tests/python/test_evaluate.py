"""Evaluation of files: counted and ignored boxes, windows, areas, output files and wrong input."""

import math
import random
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from evaluation_data import (
    box,
    car,
    label_line,
    noisy,
    perfect,
    traffic,
    write_lidar,
    write_predictions,
    write_roads,
)

from pyinfra.cli import main
from pyinfra.cli.evaluate import class_types
from pyinfra.core.errors import ConfigError, FormatError
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frames import frame_numbers
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.settings import Settings

ScoredBoxes = list[tuple[list[float], float]]
SETS = ("captured", "common", "all")


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Evaluation]:
    """Returns a function that evaluates predictions for one LiDAR on a straight road."""

    def call(
        frames: list, predictions: list[ScoredBoxes], name: str = "vehicle", **settings
    ) -> Evaluation:
        label_time = str(settings.pop("label_time", "frame"))
        data = tmp_path / label_time
        gt = write_lidar(data / "lidar", frames, label_time=label_time)
        write_roads(data)
        pred = write_predictions(data / "pred", predictions, name)
        return evaluate(gt, pred, Settings(**{"ground_truths": SETS, "block_s": 5} | settings))

    return call


def row(evaluation: Evaluation, **where: object) -> pd.Series:
    table = evaluation.ap
    for column, value in where.items():
        table = table[table[column] == value]
    return table.iloc[0]


# --- what counts and what is ignored


def test_a_perfect_detector_has_100_by_every_measure(run: Callable[..., Evaluation]) -> None:
    frames = traffic(60)
    result = run(
        frames, perfect(frames), protocols=("definition", "r11", "kitti"), metrics=("bev", "3d")
    )
    assert (result.ap.ap == 100).all()
    everything = result.ap[result.ap.ground_truth != "common"]
    assert (everything.objects == 480).all()
    assert len(result.ap) == 3 * 3 * 2
    assert result.errors[result.errors.error == "horizontal"].mean_absolute.max() < 1e-5
    assert (result.false_positives["count"] == 0).all()


def test_first_row_is_the_primary_one(run: Callable[..., Evaluation]) -> None:
    frames = traffic(3)
    first = run(frames, noisy(frames), ious=(0.5, 0.7)).ap.iloc[0]
    expected = ["vehicle", "captured", 0.5, "definition"]
    assert first[["class", "ground_truth", "iou", "protocol"]].tolist() == expected


def test_a_vehicle_without_points_counts_for_all_but_is_ignored_for_captured(
    run: Callable[..., Evaluation],
) -> None:
    frames = [[car(20), car(40, points=0)]]
    unseen_result = run(frames, [[(box(car(20)), 0.9), (box(car(40)), 0.8)]])
    assert row(unseen_result, ground_truth="captured").ap == 100
    assert row(unseen_result, ground_truth="captured").predictions == 1
    assert row(unseen_result, ground_truth="all").ap == 100


def test_a_missed_vehicle_without_points_costs_recall_for_all(
    run: Callable[..., Evaluation],
) -> None:
    result = run([[car(20), car(40, points=0)]], [[(box(car(20)), 0.9)]])
    assert row(result, ground_truth="captured").ap == 100
    assert row(result, ground_truth="all").ap == 50


def test_captured_needs_as_many_points_as_asked(run: Callable[..., Evaluation]) -> None:
    result = run([[car(20, points=4), car(40, points=5)]], [[(box(car(40)), 0.9)]], min_points=5)
    assert row(result, ground_truth="captured").objects == 1
    assert row(result, ground_truth="captured").ap == 100


def test_a_hidden_vehicle_counts_for_captured_alone(run: Callable[..., Evaluation]) -> None:
    result = run([[car(20, visibility=0.1), car(40)]], [[(box(car(40)), 0.9)]])
    assert [row(result, ground_truth=which).objects for which in SETS] == [2, 1, 1]


def test_vehicles_and_false_positives_outside_the_region_are_ignored(
    run: Callable[..., Evaluation],
) -> None:
    """The region extends 100 m along the road and 10 m to each side."""
    out = [car(103, visibility=-1), car(50, 12, visibility=-1)]
    background = [(box(car(-120)), 0.95), (box(car(0, -14)), 0.95)]
    predictions = [(box(v), 0.9) for v in out] + background + [(box(car(20)), 0.5)]
    result = run([[car(20), *out]], [predictions])
    assert (result.ap.ap == 100).all()
    assert (result.ap.predictions == 1).all()


def test_a_drawn_region_stands_for_roads(tmp_path: Path) -> None:
    """With an outline instead of roads, a vehicle outside is not missed, and a box outside is not a
    false positive."""
    gt = write_lidar(tmp_path / "lidar", [[car(20), car(60)]])
    pred = write_predictions(tmp_path / "pred", [[(box(car(20)), 0.9), (box(car(60)), 0.95)]])
    misplaced = write_predictions(
        tmp_path / "background", [[(box(car(20)), 0.5), (box(car(80)), 0.9)]]
    )
    settings = Settings(ground_truths=("captured",), block_s=5)
    assert row(evaluate(gt, misplaced, settings)).ap < 50
    (gt / "region.yaml").write_text("outline_m: [[-9, -9], [40, -9], [40, 9], [-9, 9]]\n")
    for predicted in (pred, misplaced):
        counted = row(evaluate(gt, predicted, settings))
        assert counted[["objects", "predictions", "ap"]].tolist() == [1, 1, 100]
    (gt / "region.yaml").write_text("outline_m: [[0, 0], [9, 9]]\n")
    with pytest.raises(
        ConfigError, match=r"region.yaml.*outline_m: expected 3 or more corners, got 2"
    ):
        evaluate(gt, pred, settings)
    write_roads(tmp_path)
    assert row(evaluate(gt, pred, settings)).objects == 2


def test_a_vehicle_is_detected_where_its_label_is(run: Callable[..., Evaluation]) -> None:
    frames, predictions = [[car(20, ahead=1.5)]], [[(box(car(21.5)), 0.9)]]
    assert (run(frames, predictions, label_time="scan").ap.ap == 100).all()
    assert (run(frames, predictions, label_time="frame").ap.ap == 0).all()


def test_a_vehicle_belongs_where_it_is_at_mid_frame(run: Callable[..., Evaluation]) -> None:
    """At scan time the vehicle is 2 m further on, which is beyond the end of the region or within
    it."""
    frames = [[car(99, ahead=2), car(-101, ahead=2, visibility=-1)]]
    predictions = [[(box(car(101)), 0.9), (box(car(-99)), 0.8)]]
    result = run(frames, predictions, label_time="scan")
    assert (result.ap.objects == 1).all()
    assert (result.ap.ap == 100).all()
    assert (result.ap.predictions == 1).all()


def test_a_vehicle_out_of_reach_is_labelled_at_mid_frame(tmp_path: Path) -> None:
    write_roads(tmp_path)
    near = write_lidar(tmp_path / "near", [[car(20)]], reach_m=50, label_time="scan")
    write_lidar(tmp_path / "far", [[car(20), car(80, ahead=2)]], label_time="scan")
    truth = read_ground_truth(near, beyond_range=True).vehicles
    assert truth.boxes[:, 0].tolist() == truth.mid_frame[:, 0].tolist() == [20, 80]
    far = read_ground_truth(tmp_path / "far").vehicles
    assert far.boxes[:, 0].tolist() == [20, 82]


def test_a_vehicle_at_the_border_goes_with_the_box_that_matches_it(
    run: Callable[..., Evaluation],
) -> None:
    hit = run([[car(99.8)]], [[(box(car(100.2)), 0.9)]])
    assert row(hit, ground_truth="captured").ap == 100


def test_a_box_inside_that_matched_a_vehicle_outside_is_ignored(
    run: Callable[..., Evaluation],
) -> None:
    result = run([[car(100.2, visibility=-1), car(0)]], [[(box(car(99.8)), 0.9)]])
    assert row(result, ground_truth="captured").predictions == 0


def test_a_second_box_on_a_vehicle_is_a_duplicate(run: Callable[..., Evaluation]) -> None:
    predictions = [
        (box(car(20)), 0.9),
        (box(car(20.2)), 0.95),
        (box(car(42.5)), 0.8),
        (box(car(80)), 0.7),
    ]
    result = run([[car(20), car(40)]], [predictions])
    counts = result.false_positives[result.false_positives.ground_truth == "captured"]
    assert counts.set_index("cause")["count"].to_dict() == {
        "background": 1,
        "duplicate": 1,
        "localisation": 1,
    }


def test_scores_below_the_threshold_do_not_count(run: Callable[..., Evaluation]) -> None:
    predictions = [[(box(car(20)), 0.1), (box(car(60)), 0.0999)]]
    assert (
        row(run([[car(20)]], predictions, min_score=0.1), ground_truth="captured").predictions == 1
    )


def test_every_score_counts_by_default(run: Callable[..., Evaluation]) -> None:
    predictions = [[(box(car(20)), 0.1), (box(car(60)), 0.0)]]
    assert row(run([[car(20)]], predictions), ground_truth="captured").predictions == 2


def test_common_leaves_out_what_another_lidar_cannot_see(tmp_path: Path) -> None:
    """The other LiDAR sees 35 degrees to either side. For `common`, a box behind it is left out."""
    frames = [[car(50), car(-50)]]
    write_roads(tmp_path)
    gt = write_lidar(tmp_path / "wide", frames)
    write_lidar(tmp_path / "narrow", frames, half_deg=35)
    predictions = [[(box(car(50)), 0.9), (box(car(-70)), 0.95)]]
    result = evaluate(
        gt, write_predictions(tmp_path / "pred", predictions), Settings(ground_truths=SETS)
    )
    assert row(result, ground_truth="common")[["objects", "predictions", "ap"]].tolist() == [
        1,
        1,
        100,
    ]
    assert row(result, ground_truth="all")[["objects", "predictions"]].tolist() == [2, 2]


def test_all_is_the_same_for_a_lidar_of_short_range(tmp_path: Path) -> None:
    """A vehicle beyond the range of this LiDAR is not in its objects. It counts as missed."""
    near, far = car(30), car(90)
    write_roads(tmp_path)
    short = write_lidar(tmp_path / "short", [[near]], reach_m=50)
    write_lidar(tmp_path / "long", [[near, far]])
    pred = write_predictions(tmp_path / "pred", perfect([[near]]))
    result = evaluate(short, pred, Settings(ground_truths=SETS))
    assert [row(result, ground_truth=which).objects for which in SETS] == [1, 1, 2]
    assert row(result, ground_truth="all").ap == 50


def test_classes_are_chosen_by_name(run: Callable[..., Evaluation]) -> None:
    frames = [[car(20), car(40, **{"class": "Truck"}), car(60, **{"class": "Pedestrian"})]]
    classes = class_types(["vehicle", "Car", "large=Truck,Bus"])
    result = run(frames, perfect(frames), name="Car", classes=classes)
    assert row(result, **{"class": "vehicle"}).objects == 2
    assert row(result, **{"class": "Car"}).objects == 1
    assert row(result, **{"class": "large"}).predictions == 0


def test_a_vehicle_of_unknown_type_counts_as_one(run: Callable[..., Evaluation]) -> None:
    frames = [[car(20, **{"class": "vehicle"}), car(40), car(60, **{"class": "Tram"})]]
    assert row(run(frames, perfect(frames))).objects == 2


# --- input


def test_labels_alone_give_captured_by_distance(tmp_path: Path) -> None:
    """This works for any folder in KITTI's layout. It has no region, and AP is by distance from the
    sensor."""
    frames = traffic(4)
    gt = write_lidar(tmp_path / "kitti", frames, objects=False)
    (gt / "lidar.yaml").unlink()
    result = evaluate(gt, write_predictions(tmp_path / "pred", perfect(frames)))
    assert result.ap.ground_truth.tolist() == ["captured"]
    assert result.ap.ap.tolist() == [100]
    assert set(result.distance_ap.road) == {"distance"}
    assert result.distance_ap.s.min() == 10
    with pytest.raises(ValueError, match="kitti: expected a folder `objects`, got none"):
        evaluate(gt, tmp_path / "pred", Settings(ground_truths=("common",)))


def test_files_read_together_are_as_read_alone(tmp_path: Path) -> None:
    frames = traffic(300)
    gt = write_lidar(tmp_path / "lidar", frames)
    together = read_vehicles(gt, range(300))
    alone = [kitti.read_objects(kitti.frame_file(gt, "objects", k)) for k in range(300)]
    assert np.array_equal(together.boxes, np.concatenate([o.boxes for o in alone]))
    assert np.array_equal(together.points, np.concatenate([o.points for o in alone]))
    (gt / "training/objects").rename(tmp_path / "objects")
    together = read_vehicles(gt, range(300))
    labels = [kitti.read_labels(kitti.frame_file(gt, "label_2", k)) for k in range(300)]
    assert np.array_equal(together.boxes, np.concatenate([one.boxes for one in labels]))
    assert together.names.tolist() == ["Car"] * 2400


def test_csv_and_kitti_predictions_give_the_same(tmp_path: Path) -> None:
    frames = traffic(5)
    predictions = noisy(frames)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", predictions)
    as_csv = tmp_path / "csv"
    as_csv.mkdir()
    for k, boxes in enumerate(predictions):
        rows = "".join(
            f"{score:.6f},vehicle,{','.join(f'{value:.6f}' for value in b)}\n" for b, score in boxes
        )
        header = "score,class,x,y,z,dx,dy,dz,heading\n"
        (as_csv / f"{k:06d}.csv").write_text(header + rows)
    one, two = evaluate(gt, pred), evaluate(gt, as_csv)
    assert one.ap.ap.tolist() == pytest.approx(two.ap.ap.tolist())
    for file in as_csv.iterdir():  # as spreadsheet programs save CSV files
        file.write_bytes(file.read_text().replace("\n", "\r\n").encode("utf-8-sig"))
    assert evaluate(gt, as_csv).ap.ap.tolist() == two.ap.ap.tolist()


def test_only_the_split_is_evaluated(tmp_path: Path) -> None:
    frames = traffic(6)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", perfect(frames))
    assert evaluate(gt, pred).ap.frames[0] == 6
    (gt / "ImageSets").mkdir()
    (gt / "ImageSets/val.txt").write_text("000004\n000005\n")
    assert frame_numbers(gt) == [4, 5]
    result = evaluate(gt, pred)
    assert result.ap.frames[0] == 2
    assert [finding.name for finding in result.findings if finding.level == "note"] == [
        "origin",
        "outside-split",
    ]
    assert evaluate(gt, pred, split="all").ap.frames[0] == 6
    (gt / "ImageSets/val.txt").write_text("000004\n000007\n")
    with pytest.raises(FormatError, match=r"val\.txt:2: expected .*got '000007'"):
        evaluate(gt, pred)


@pytest.mark.parametrize("seed", range(3))
def test_order_of_boxes_in_the_files_has_no_influence(tmp_path: Path, seed: int) -> None:
    """Scores have one digit, so many are equal."""
    frames = traffic(20)
    predictions = [[(b, round(s, 1)) for b, s in boxes] for boxes in noisy(frames, spread=0.8)]
    write_roads(tmp_path)
    gt = write_lidar(tmp_path / "a", frames)
    pred = write_predictions(tmp_path / "pred", predictions)
    shuffle = random.Random(seed).shuffle
    for boxes in [*frames, *predictions]:
        shuffle(boxes)
    other = write_predictions(tmp_path / "other", predictions)
    shuffled = write_lidar(tmp_path / "b", frames)
    first, second = evaluate(gt, pred), evaluate(shuffled, other)
    for name, table in first.tables().items():
        again = second.tables()[name].replace("b", "a")
        pd.testing.assert_frame_equal(table, again, rtol=1e-12, obj=name)


def test_order_of_frames_has_no_influence_on_ap(tmp_path: Path) -> None:
    frames = traffic(20)
    predictions = noisy(frames)
    one = evaluate(
        write_lidar(tmp_path / "a", frames), write_predictions(tmp_path / "p", predictions)
    )
    two = evaluate(
        write_lidar(tmp_path / "b", frames[::-1]),
        write_predictions(tmp_path / "q", predictions[::-1]),
    )
    assert one.ap.ap.tolist() == two.ap.ap.tolist()


# --- windows, areas, intervals


def test_windows_are_20_m_long_every_5_m(run: Callable[..., Evaluation]) -> None:
    result = run([[car(12)]], [[(box(car(12)), 0.9)]])
    captured = result.distance_ap[result.distance_ap.ground_truth == "captured"]
    assert captured.s.tolist() == list(range(-100, 101, 5))
    assert captured[captured.objects == 1].s.tolist() == [5, 10, 15, 20]
    assert (captured[captured.objects == 1].ap == 100).all()
    assert captured[captured.objects == 0].ap.isna().all()


def test_cutting_first_makes_errors_at_the_cut(run: Callable[..., Evaluation]) -> None:
    """The vehicle and its box are on different sides of s = 20. No window loses the match, unless
    boxes are divided into windows before matching."""
    result = run([[car(19.9)] * 1], [[(box(car(20.1)), 0.9)]], cut_first=True)
    table = result.distance_ap[result.distance_ap.ground_truth == "captured"].set_index("s")
    assert table.loc[[10, 15, 20, 25], "ap"].tolist() == [100, 100, 100, 100]
    assert table.loc[10, "ap_cut_first"] == 0
    assert table.loc[10, "difference"] == -100
    assert table.loc[15, "ap_cut_first"] == 100


def test_area_tables_by_hand(run: Callable[..., Evaluation]) -> None:
    """Each frame of a minute has one car at s = 12. It lies in four windows and is always
    detected."""
    frames = [[car(12)] for _ in range(600)]
    result = run(frames, perfect(frames))
    for which in ("captured", "all"):
        areas = result.areas[result.areas.ground_truth == which].iloc[0]
        assert areas[["n_tda", "n_hqda", "p_hqda", "undecided"]].tolist() == [4, 4, 100, 0]
        assert areas[["p_low", "p_high"]].tolist() == [100, 100]
    assert result.ap[["ap_low", "ap_high"]].iloc[0].tolist() == [100, 100]


def test_areas_with_few_objects_do_not_count(run: Callable[..., Evaluation]) -> None:
    frames = [[car(12)] for _ in range(19)]
    result = run(frames, perfect(frames))
    assert result.areas.n_tda.tolist() == [0, 0, 0]
    assert result.areas.p_hqda.isna().all()


def test_an_area_whose_interval_holds_85_is_undecided(run: Callable[..., Evaluation]) -> None:
    """In some blocks of 5 s all vehicles are detected. In the other blocks few are."""
    frames = [[car(12)] for _ in range(1000)]
    predictions = [
        boxes if (k // 50) % 6 or k % 4 == 0 else [] for k, boxes in enumerate(perfect(frames))
    ]
    result = run(frames, predictions)
    one = result.distance_ap[(result.distance_ap.s == 10)].iloc[0]
    assert one.ap_low < 85 < one.ap_high
    assert one.quality == "undecided"
    assert result.areas.undecided.tolist() == [4, 4, 4]


def test_an_area_without_an_interval_is_left_out_of_that_of_the_share(
    run: Callable[..., Evaluation],
) -> None:
    """Near the sensor, vehicles pass in two of twenty blocks of 5 s. Far from it, no vehicle is
    detected."""
    near = [[car(12)] if k % 50 < 15 and k < 100 else [] for k in range(1000)]
    frames = [[*cars, car(80)] for cars in near]
    result = run(
        frames, [boxes[: len(cars)] for boxes, cars in zip(perfect(frames), near, strict=True)]
    )
    assert set(result.distance_ap.ap.dropna()) == {0, 100}
    assert (result.areas.p_hqda == 50).all()
    assert result.areas[["p_low", "p_high"]].to_numpy().tolist() == [[50, 50]] * 3


def test_few_blocks_give_no_interval_and_a_warning(run: Callable[..., Evaluation]) -> None:
    frames = traffic(190)  # 3.8 blocks of 5 s
    result = run(frames, perfect(frames))
    assert result.ap.ap_low.isna().all()
    assert "few-blocks" in [finding.name for finding in result.findings]
    assert "high" not in set(result.distance_ap.quality)


def test_the_interval_holds_the_ap_of_more_frames(run: Callable[..., Evaluation]) -> None:
    frames = traffic(800)
    predictions = noisy(frames, spread=0.6)
    first = run(frames[:500], predictions[:500]).ap.iloc[0]
    assert first.ap_low < first.ap < first.ap_high
    assert first.ap_high - first.ap_low < 10


def test_crossing_roads_share_no_vehicle(tmp_path: Path) -> None:
    """A vehicle belongs to the road with the nearest centreline."""
    along = "".join(f"along,{s},10,{20 + s},0,{math.pi / 2},8\n" for s in range(-100, 101))
    across = "".join(f"across,{s},{10 - s},30,0,{math.pi},8\n" for s in range(-100, 101))
    header = "road,s,x,y,z,heading,half_width\n"
    (tmp_path / "roads.csv").write_text(header + along + across)
    frames = [[car(10, 6), car(16, 1)]]
    gt = write_lidar(tmp_path / "lidar", frames)
    truth = read_ground_truth(gt)
    places = truth.places(truth.vehicles.boxes)
    assert [truth.roads[road].name for road in places.road] == ["across", "along"]
    assert places.s.tolist() == pytest.approx([6, 16])


def test_errors_are_in_the_vehicles_own_directions(run: Callable[..., Evaluation]) -> None:
    vehicle = car(20, heading=math.pi / 2)
    moved = car(19.9, 3.3, heading=math.pi / 2 + math.radians(2), z=-5.05, dx=4.2)
    result = run([[vehicle]], [[(box(moved), 0.9)]], ground_truths=("captured",))
    mean = result.errors.set_index("error")["mean"]
    expected = {"ahead": 0.3, "left": 0.1, "up": 0.2, "length": 0.2, "heading": 2, "reversed": 0}
    assert {name: mean[name] for name in expected} == pytest.approx(expected, abs=1e-4)


def test_a_box_that_points_the_other_way_is_reversed(run: Callable[..., Evaluation]) -> None:
    result = run([[car(20)]], [[(box(car(20, heading=math.pi)), 0.9)]])
    mean = result.errors.set_index("error").loc["reversed", "mean"]
    assert (mean == 100).all()
    assert result.errors.set_index("error").loc["heading", "mean"].abs().max() < 1e-3


def test_precision_recall_curve_ends_at_the_recall(run: Callable[..., Evaluation]) -> None:
    result = run([[car(20), car(40)]], [[(box(car(20)), 0.9), (box(car(80)), 0.8)]])
    curve = result.pr_curve[result.pr_curve.ground_truth == "captured"].set_index("recall")
    assert curve.precision.loc[0.5] == 1
    assert curve.score.loc[0.5] == pytest.approx(0.9)
    assert curve.precision.loc[0.51] == 0


# --- command line


def test_command_writes_tables_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = traffic(520)
    write_roads(tmp_path)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", noisy(frames))
    words = [str(gt), str(pred), "--out", str(tmp_path / "out")]
    options = ["--ground-truth", *SETS, "--iou", "0.5", "0.7", "--protocol", "definition", "kitti"]
    assert main.main(["evaluate", *words, *options]) == 0
    printed = capsys.readouterr()
    assert "vehicle     captured" in printed.out
    table = pd.read_csv(tmp_path / "out/ap.csv")
    assert ",".join(table.columns) == (
        "class,ground_truth,iou,protocol,ap,ap_low,ap_high,ap_r1000,ap_r1000_low,ap_r1000_high,"
        "objects,predictions,frames,block_s"
    )
    assert table.iloc[0, :4].tolist() == ["vehicle", "captured", 0.5, "definition"]
    assert len(table) == 12
    names = {path.name for path in (tmp_path / "out").iterdir()}
    tables = "ap distance_ap areas pr_curve errors false_positives replicates off_region".split()
    figures = "pr_curve distance_ap areas areas_plan".split()
    assert names == {f"{t}.csv" for t in tables} | {
        f"{f}.{kind}" for f in figures for kind in ("svg", "png")
    }


@pytest.mark.nightly
def test_the_same_command_writes_the_same_bytes(tmp_path: Path) -> None:
    frames = traffic(520)
    write_roads(tmp_path)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", noisy(frames))
    for out in ("a", "b"):
        words = [str(gt), str(pred), "--out", str(tmp_path / out)]
        assert main.main(["evaluate", *words]) == 0
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name


def spoiled(text: str, change: Callable[[list[str]], list[str]]) -> str:
    """Returns a result file in which the words of the second line are changed."""
    lines = text.splitlines()
    lines[1] = " ".join(change(lines[1].split()))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda words: [*words[:11], "nan", *words[12:]],
            "pred/000001.txt:2: x: expected .*, got nan",
        ),
        (
            lambda words: [*words[:8], "-1.5", *words[9:]],
            "pred/000001.txt:2: h: expected .*, got -1.5",
        ),
        (lambda words: [*words[:8], "0", *words[9:]], "pred/000001.txt:2: h: expected .*, got 0"),
        (lambda words: words[:15], "pred/000001.txt:2: expected .*, got 15"),
        (lambda words: [*words, "1"], "pred/000001.txt:2: expected .*, got 17"),
        (lambda words: [*words[:12], "north", *words[13:]], "got 'north'"),
        (lambda words: [*words[:15], "inf"], "pred/000001.txt:2: score: expected .*, got inf"),
    ],
)
def test_a_wrong_line_is_named(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[list[str]], list[str]],
    message: str,
) -> None:
    frames = traffic(3)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", perfect(frames))
    file = pred / "000001.txt"
    file.write_text(spoiled(file.read_text(), change))
    words = [str(gt), str(pred), "--out", str(tmp_path / "out")]
    assert main.main(["evaluate", *words]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("row_", "message"),
    [
        ("Car,20,3,-5,4,2,1.5,0", "000000.csv:2: expected 9 columns, got 8"),
        (
            "Car,20,3,-5,4,-2,1.5,0,0.9",
            "000000.csv:2: dy: expected more than 0, at most 10000, got -2",
        ),
        ("Car,20,3,-5,4,2,1.5,nan,0.9", "000000.csv:2: heading: expected .*, got nan"),
        ("Car,20,3,-5,4,2,1.5,0,", "000000.csv:2: score: expected .*, got ''"),
    ],
)
def test_a_wrong_line_of_a_csv_is_named(tmp_path: Path, row_: str, message: str) -> None:
    gt = write_lidar(tmp_path / "lidar", [[car(20)]])
    (tmp_path / "pred").mkdir()
    file = tmp_path / "pred/000000.csv"
    file.write_text(f"class,x,y,z,dx,dy,dz,heading,score\n{row_}\n")
    with pytest.raises(FormatError, match=message):
        evaluate(gt, tmp_path / "pred")
    file.write_text("class,x,y,z,dx,dy,dz,heading\nCar,20,3,-5,4,2,1.5,0\n")
    with pytest.raises(FormatError, match=r"000000\.csv:1: expected the columns score; got none"):
        evaluate(gt, tmp_path / "pred")


def test_missing_unknown_and_no_files(tmp_path: Path) -> None:
    frames = traffic(3)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", perfect(frames))
    (pred / "000001.txt").unlink()
    with pytest.raises(
        FormatError, match=r"pred/000001\.txt: this file is missing; 1 of 3 .*; write an empty file"
    ):
        evaluate(gt, pred)
    allowed = evaluate(gt, pred, allow_missing=True)
    assert allowed.ap.ap[0] == pytest.approx(100 * 26 / 40)
    assert "missing-files" in [finding.name for finding in allowed.findings]
    (pred / "000001.txt").write_text("")
    assert evaluate(gt, pred).ap.ap[0] == pytest.approx(100 * 26 / 40)
    (pred / "000003.txt").write_text("")
    with pytest.raises(
        FormatError,
        match=r"000003\.txt: expected one of .* frames of the ground truth .*, got frame 3",
    ):
        evaluate(gt, pred)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FormatError, match=r"empty: expected predictions .*, got none"):
        evaluate(gt, tmp_path / "empty")


def test_ap_is_never_silently_0(tmp_path: Path) -> None:
    frames = traffic(3)
    gt = write_lidar(tmp_path / "lidar", frames)
    nothing = write_predictions(tmp_path / "nothing", [[], [], []])
    names = [finding.name for finding in evaluate(gt, nothing).findings]
    assert {"all-empty", "ap-zero"} <= set(names)
    away = write_predictions(tmp_path / "away", [[(box(car(30, 60)), 0.9)]] * 3)
    names = [finding.name for finding in evaluate(gt, away).findings]
    assert {"far-from-vehicles", "ap-zero"} <= set(names)
    named = write_predictions(tmp_path / "named", perfect(frames), name="car")
    with pytest.raises(
        FormatError, match=r"000000\.txt:1: types .* evaluated: car \(24\); expected Car,"
    ):
        evaluate(gt, named)


def test_no_vehicles_give_no_ap_and_a_warning(run: Callable[..., Evaluation]) -> None:
    result = run([[], []], [[(box(car(20)), 0.9)], []])
    assert result.ap.ap.isna().all()
    assert "no-objects" in [finding.name for finding in result.findings]


def test_no_vehicles_and_no_roads_are_reported_too(tmp_path: Path) -> None:
    gt = write_lidar(tmp_path / "lidar", [[], []])
    pred = write_predictions(tmp_path / "pred", [[(box(car(20)), 0.9)], []])
    result = evaluate(gt, pred, Settings(ground_truths=SETS))
    assert "no-objects" in [finding.name for finding in result.findings]
    assert result.areas.n_tda.tolist() == [0, 0, 0]


def test_the_devkits_cap_is_reported(run: Callable[..., Evaluation]) -> None:
    result = run([[car(20), car(40)]], perfect([[car(20), car(40)]]), protocols=("kitti",))
    assert result.ap.ap.tolist() == [2.5, 2.5, 2.5]
    assert "kitti-cap" in [finding.name for finding in result.findings]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--iou", "1.5"], "iou: expected 0.1 to 0.999, got 1.5"),
        (["--class", "large="], "--class: expected .*, got 'large='"),
        (["--frames", "2-4"], "--frames: expected A:B.*, got '2-4'"),
        (["--frames", "7:9"], "--frames: expected .*, got '7:9'"),
        (["--ground-truth", "seen"], "got 'seen'"),
        (["--split", "all", "--frames", "0:2"], "not allowed with"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    frames = traffic(2)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", perfect(frames))
    words = [str(gt), str(pred), "--out", str(tmp_path / "out"), *options]
    try:
        code: object = main.main(["evaluate", *words])
    except SystemExit as stop:
        code = stop.code
    error = capsys.readouterr().err
    assert code == 2
    assert re.search(message, error)
    assert error.count("\n") == 1


def test_a_folder_that_is_none_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [str(tmp_path), str(tmp_path), "--out", str(tmp_path / "out")]
    assert main.main(["evaluate", *words]) == 1
    assert capsys.readouterr().err == (
        f"pyinfra: DATA: {tmp_path}: The folder has no training/velodyne and no training/label_2\n"
    )


def test_label_lines_of_these_tests_are_what_the_reader_reads(tmp_path: Path) -> None:
    file = tmp_path / "000000.txt"
    values = box(car(20, -4, heading=0.5))
    file.write_text(label_line("Car", values, 0.25) + "\n")
    read = kitti.read_labels(file, scores=True)
    assert read.boxes[0] == pytest.approx(values, abs=1e-5)
    assert read.scores == 0.25


@pytest.mark.parametrize("lost_near", [0.0, 0.02])
def test_the_slope_of_ap_is_that_of_all_windows(tmp_path: Path, lost_near: float) -> None:
    """Windows of a perfect detector have AP 100 in every replicate. They count like any other."""
    frames = traffic(200)
    random = np.random.default_rng(1)
    boxes = [
        [
            (box(v), 0.9)
            for v in frame
            if random.random() > (lost_near if float(str(v["x"])) < 50 else 0.4)
        ]
        for frame in frames
    ]
    write_roads(tmp_path)
    gt = write_lidar(tmp_path / "lidar", frames, period_s=1.0)
    predictions = write_predictions(tmp_path / "predictions", boxes)
    result = evaluate(gt, predictions, Settings(ground_truths=("captured",), block_s=5))
    ahead = result.distance_ap[result.distance_ap.s.between(0, 100)].dropna(subset="ap_r1000")
    rows = result.replicates[result.replicates.measure == "ap_slope"]
    assert rows.value.tolist() == pytest.approx([10 * np.polyfit(ahead.s, ahead.ap_r1000, 1)[0]])
    assert rows[[f"replicate_{k}" for k in range(1, 201)]].to_numpy().std() > 0
