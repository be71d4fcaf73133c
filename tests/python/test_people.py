"""The AP of pedestrians and cyclists beside that of vehicles, by footprints and by centres."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from evaluation_data import (
    box,
    car,
    label_line,
    noisy,
    traffic,
    write_lidar,
    write_predictions,
    write_roads,
)

import pyinfra
from pyinfra.cli import main
from pyinfra.cli.evaluate import class_types
from pyinfra.core.vocabulary import OBJECT_CLASSES, PERSON_TYPES, SUBSETS, VEHICLE_TYPES
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.frame_readers import read_cameras, read_predictions, read_vehicles
from pyinfra.experiments.benchmark.measure import off_region_per_min
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.evaluation_input import class_settings
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.match_input import block_seconds, match_input
from pyinfra.metrics.match_results import count_matches
from pyinfra.metrics.matching import Metric
from pyinfra.metrics.prediction_checks import find_files
from pyinfra.metrics.scanning_statistics import speed_table
from pyinfra.metrics.settings import Settings
from pyinfra.viz import clouds
from pyinfra.viz.clouds import read_snapshot

HALF_WIDTH_M = 10.0  # half width of the road
FRAMES = 40


def walker(x: float, y: float, name: str = "Pedestrian", **changes: object) -> dict[str, object]:
    length = 1.67 if name == "Cyclist" else 0.73
    size = {"dx": length, "dy": 0.67, "dz": 1.77, "z": 0.885 - 6}
    return car(x, y, **{"class": name, **size, **changes})


def scene(folder: Path, frames: list, predictions: list) -> tuple[Path, Path]:
    """Writes a LiDAR's folder on a straight road, and predictions of (type, box, score)."""
    gt = write_lidar(folder / "data/lidar", frames)
    write_roads(folder / "data", HALF_WIDTH_M)
    pred = folder / "pred"
    pred.mkdir()
    for k, boxes in enumerate(predictions):
        text = "".join(label_line(*one) + "\n" for one in boxes)
        (pred / f"{k:06d}.txt").write_text(text)
    return gt, pred


def ap(evaluation: Evaluation, which: str = "captured") -> dict[str, float]:
    rows = evaluation.ap[evaluation.ap.ground_truth == which]
    return dict(zip(rows.protocol, rows.ap, strict=True))


def moved(person: dict[str, object], x_m: float) -> list[float]:
    return [float(box(person)[0]) + x_m, *box(person)[1:]]


def test_a_class_has_its_own_ap_by_footprints_and_by_centres(tmp_path: Path) -> None:
    person, rider, vehicle = walker(20, 12), walker(30, -12, "Cyclist"), car(40)
    predictions = [("Pedestrian", box(person), 0.9), ("Cyclist", box(rider), 0.8)]
    predictions.append(("Car", box(vehicle), 0.7))
    gt, pred = scene(tmp_path, [[person, rider, vehicle]] * FRAMES, [predictions] * FRAMES)
    for name in ("pedestrian", "cyclist"):
        result = pyinfra.evaluate(gt, pred, object_class=name)
        assert set(result.ap["class"]) == {name}
        assert ap(result) == ap(result, "all") == {"definition": 100, "definition-centre": 100}
        assert result.ap.iou.tolist() == pytest.approx([0.25, 0.25, np.nan, np.nan], nan_ok=True)
        assert (result.ap.objects == FRAMES).all()
    assert ap(pyinfra.evaluate(gt, pred)) == {"definition": 100}


@pytest.mark.parametrize(
    ("metres", "footprints", "centres"), [(0.4, 100, 100), (0.48, 0, 100), (0.52, 0, 0)]
)
def test_a_centre_counts_up_to_half_a_metre(
    tmp_path: Path, metres: float, footprints: float, centres: float
) -> None:
    # the person is 0.73 m long, so the IoU is 0.25 after a shift of 0.438 m along the person
    person = walker(20, 3)
    predictions = [("Pedestrian", moved(person, metres), 0.9)]
    gt, pred = scene(tmp_path, [[person]] * FRAMES, [predictions] * FRAMES)
    result = evaluate(gt, pred, object_class="pedestrian")
    assert ap(result) == {"definition": footprints, "definition-centre": centres}


def test_the_nearest_free_centre_is_taken_in_order_of_score(tmp_path: Path) -> None:
    a, b = walker(20, 3), walker(20.6, 3)
    predictions = [("Pedestrian", moved(a, 0.25), 0.9), ("Pedestrian", moved(a, 0.15), 0.8)]
    gt, pred = scene(tmp_path, [[a, b]] * FRAMES, [predictions] * FRAMES)
    result = evaluate(gt, pred, object_class="pedestrian")
    # The first prediction matches a, which is nearer. b is 0.45 m from the second prediction, and
    # their overlap is too small.
    assert ap(result)["definition-centre"] == 100
    assert ap(result)["definition"] == 50


def test_people_count_six_metres_beside_the_carriageway(tmp_path: Path) -> None:
    near, far = walker(20, HALF_WIDTH_M + 5.9), walker(30, HALF_WIDTH_M + 6.1, visibility=-1)
    gt, pred = scene(tmp_path, [[near, far]] * FRAMES, [[("Pedestrian", box(far), 0.9)]] * FRAMES)
    result = evaluate(gt, pred, object_class="pedestrian")
    # the near person counts; the box on the far person is ignored
    assert set(result.ap.objects) == {FRAMES}
    assert set(result.ap.predictions) == {0}


def test_vehicles_are_matched_as_if_nobody_was_on_the_footways(tmp_path: Path) -> None:
    cars = [[car(20 + k, id=0)] for k in range(FRAMES)]
    predictions = [[("Car", moved(frame[0], 0.2), 0.9)] for frame in cars]
    gt, pred = scene(tmp_path / "without", cars, predictions)
    alone = evaluate(gt, pred)
    with_people = [[*frame, walker(10, 12)] for frame in cars]
    beside, pred = scene(tmp_path / "with", with_people, predictions)
    both = evaluate(beside, pred)
    assert both.ap.equals(alone.ap)
    assert both.errors.equals(alone.errors)
    assert read_vehicles(beside, range(FRAMES)).names.tolist().count("Pedestrian") == FRAMES


@pytest.mark.parametrize("aside_m", [3.0, HALF_WIDTH_M + 2, HALF_WIDTH_M + 30])
@pytest.mark.parametrize("name", ["Pedestrian", "Cyclist"])
def test_a_vehicle_box_on_a_person_is_wrong_wherever_it_stands(
    tmp_path: Path, aside_m: float, name: str
) -> None:
    vehicle, person = car(40), walker(20, aside_m, name)
    predictions = [("Car", box(vehicle), 0.8), ("vehicle", box(car(20.5, aside_m)), 0.9)]
    # the person is detected twice, once with the right class and once with a wrong class
    predictions.append((name, box(person), 0.9))
    gt, pred = scene(tmp_path, [[vehicle, person]] * FRAMES, [predictions] * FRAMES)
    result = pyinfra.evaluate(gt, pred)
    assert ap(result) == ap(result, "all") == {"definition": 50}
    assert set(result.ap.predictions) == {2 * FRAMES}
    background = result.false_positives.query("cause == 'background'")
    assert set(background["count"]) == {FRAMES}
    of_people = pyinfra.evaluate(gt, pred, object_class=name.lower())
    counts = aside_m < HALF_WIDTH_M + 6
    assert set(of_people.ap.predictions) == {FRAMES * counts}
    assert not counts or set(of_people.ap.ap) == {100}


@pytest.mark.parametrize(
    ("beside", "why"),
    [
        ([walker(20, 30, points=0)], "a person whom the LiDAR does not see"),
        ([walker(20, 30), car(22, 30)], "a vehicle stands there too, and the box is poor"),
        ([walker(23, 30)], "the person stands beside the box"),
    ],
)
def test_a_vehicle_box_off_the_region_is_ignored_unless_it_stands_on_a_person(
    tmp_path: Path, beside: list, why: str
) -> None:
    predictions = [("Car", box(car(40)), 0.8), ("Car", box(car(20, 30)), 0.9)]
    gt, pred = scene(tmp_path, [[car(40), *beside]] * FRAMES, [predictions] * FRAMES)
    assert ap(pyinfra.evaluate(gt, pred)) == {"definition": 100}, why


def test_a_person_detected_twice_at_the_border_counts_once_and_once_wrong(tmp_path: Path) -> None:
    edge = HALF_WIDTH_M + 6 - 0.1
    person = walker(20, edge)
    outside = [float(box(person)[0]), edge + 0.2, *box(person)[2:]]
    predictions = [("Pedestrian", box(person), 0.8), ("Pedestrian", outside, 0.9)]
    gt, pred = scene(tmp_path, [[person]] * FRAMES, [predictions] * FRAMES)
    result = pyinfra.evaluate(gt, pred, object_class="pedestrian")
    assert set(result.ap.objects) == {FRAMES}
    assert set(result.ap.predictions) == {2 * FRAMES}
    once = [predictions[1:]] * FRAMES
    gt, pred = scene(tmp_path / "once", [[person]] * FRAMES, once)
    assert ap(pyinfra.evaluate(gt, pred, object_class="pedestrian"))["definition"] == 100


def test_boxes_off_the_region_are_reported_a_minute(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    predictions = [
        ("Car", box(car(40)), 0.9),
        ("Car", box(car(20, 30)), 0.6),  # box on a person
        ("Car", box(car(60, 40)), 0.2),  # box without an object
        ("Car", box(car(80, 40)), 0.8),  # box on a vehicle that does not count
        ("Car", box(car(60, 0)), 0.8),  # box inside the region
    ]
    frames = [[car(40), walker(20, 30), car(80, 40)]] * FRAMES
    gt, pred = scene(tmp_path, frames, [predictions] * FRAMES)
    words = ["evaluate", str(gt), str(pred), "--no-figures"]
    assert main.main([*words, "--out", str(tmp_path / "out")]) == 0
    line = "boxes outside the region per minute, vehicle: 1200.0 from score 0.1 (600.0 on people), "
    assert line + "600.0 from score 0.5 (600.0 on people)" in capsys.readouterr().out
    table = pyinfra.evaluate(gt, pred).off_region.set_index("score")
    assert table.boxes.tolist() == [2 * FRAMES, 2 * FRAMES, FRAMES, FRAMES, 0]
    assert table.on_people.tolist() == [FRAMES] * 4 + [0]
    assert table.minutes.tolist() == pytest.approx([FRAMES / 600] * 5)
    # the value of a benchmark
    assert off_region_per_min(pyinfra.evaluate(gt, pred)) == pytest.approx(600)
    (gt.parent / "roads.csv").unlink()
    assert pyinfra.evaluate(gt, pred).off_region.boxes.isna().all()
    assert np.isnan(off_region_per_min(pyinfra.evaluate(gt, pred)))


@pytest.mark.parametrize("metric", ["bev", "3d", "centre"])
def test_frames_without_people_are_matched_as_before_there_were_rules_for_people(
    tmp_path: Path, metric: Metric
) -> None:
    frames = traffic(60)
    gt = write_lidar(tmp_path / "data/lidar", [[*f, car(20, 14), car(30, 40)] for f in frames])
    write_roads(tmp_path / "data", HALF_WIDTH_M)
    random = np.random.default_rng(3)
    beside = [[(box(car(x, y)), 0.5) for x, y in random.uniform(-60, 60, (9, 2))] for _ in frames]
    detected = [
        [*noisy_boxes, *more] for noisy_boxes, more in zip(noisy(frames), beside, strict=True)
    ]
    pred = write_predictions(tmp_path / "pred", detected)
    truth = read_ground_truth(gt)
    predictions = read_predictions(
        find_files(pred, range(60), range(60)).files, read_cameras(gt, range(60))
    )
    one = match_input(truth, predictions, "vehicle", Settings(), metric)
    matches = one.match(0.5, strict=False)
    false_positive = (matches < 0) & one.prediction_places.inside
    assert 0 < np.count_nonzero(false_positive) < np.count_nonzero(matches < 0)
    for which in SUBSETS:
        seen = truth.in_common_view(predictions.boxes) if which == "common" else True
        counted = count_matches(one, which, matches, 1)
        assert np.array_equal(counted.false_positive, false_positive & seen)


def test_the_scenes_of_the_study_have_no_people() -> None:
    for file in Path("configs/scenes").glob("*.yaml"):
        assert "people" not in file.read_text(), file


@pytest.mark.nightly
def test_blocks_are_as_long_as_the_class_stays(tmp_path: Path) -> None:
    frames = [[walker(10, 12), car(20)][: 2 if k < 20 else 1] for k in range(600)]
    gt, _ = scene(tmp_path, frames, [])
    truth = read_ground_truth(gt)
    assert block_seconds(truth, people=True) == 60
    assert (
        block_seconds(truth) == 20
    )  # the minimum counts only vehicles, and not people beside the road


PEOPLE = (
    "people=[{road: bend, offset_m: -11, per_km: 60, class: Pedestrian, "
    "speed: {mean_km_h: 5, std_km_h: 1}}, {road: bend, offset_m: -18, per_km: 60, "
    "class: Cyclist, speed: {mean_km_h: 16, std_km_h: 3}}]"
)


def test_a_run_has_people_who_count_where_the_simulator_says(
    tmp_path: Path, infrasim: Callable[..., Any]
) -> None:
    words = ["--lidar", "ruby_plus", "--preset", "paper", "--frames", "0:3", "--set", PEOPLE]
    done = infrasim("run", "curve", *words, "--set", "traffic.warm_up_s=1", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    truth = read_ground_truth(tmp_path / "ruby_plus")
    v = truth.vehicles
    for name, types in OBJECT_CLASSES.items():
        selected = v.select(np.isin(v.names, types))
        inside = truth.places(selected.mid_frame, 0.0 if name == "vehicle" else 6.0).inside
        assert inside.any() == (name != "cyclist")  # cyclists move 18 m from the line of the road
        assert np.array_equal(inside, selected.visibility >= 0)
        assert name == "cyclist" or (selected.points > 0).any()

    vehicles = ~np.isin(v.names, PERSON_TYPES)
    objects = [len(v.frame[vehicles]) / 3, v.points[vehicles].sum() / 3]
    assert len(v.frame) / 3 > objects[0]
    for frames in ("0:3", "1:2"):  # the second run also counts the frames on disk
        words[-3] = frames
        again = infrasim("run", "curve", *words, "--set", "traffic.warm_up_s=1", "--out", tmp_path)
        row = pd.read_csv(tmp_path / "summary.csv").iloc[0]
        counts = [row.vehicles_per_frame, row.vehicle_points_per_frame]
        assert again.returncode == 0
        assert counts == pytest.approx(objects, rel=1e-4)
    selected = kitti.read_objects(kitti.frame_file(tmp_path / "ruby_plus", "objects", 0))
    people = np.isin(selected.names, PERSON_TYPES)
    assert selected.points[people].sum() > 0
    view = read_snapshot(tmp_path / "ruby_plus", 0)
    assert view.counts().endswith(f" points, {selected.points[~people].sum():,} on vehicles")
    legend = [handle.get_label() for handle in clouds.legend_handles([view])]
    assert ("people" in legend) == people.any()
    speeds = speed_table(read_data_set(tmp_path))
    assert speeds.samples.sum() == vehicles_of(tmp_path / "trajectories.csv", range(3))


def vehicles_of(trajectories: Path, frames: range) -> int:
    """Returns the number of rows of vehicles at the starts of some frames."""
    rows = pd.read_csv(trajectories)
    at = np.isin(np.round(rows.t * 10), frames)
    return int((at & ~rows["class"].isin(PERSON_TYPES)).sum())


def test_classes_of_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    person = walker(20, 12)
    predictions = [("Pedestrian", box(person), 0.9)]
    gt, pred = scene(tmp_path, [[person, car(40)]] * FRAMES, [predictions] * FRAMES)
    words = ["evaluate", str(gt), str(pred), "--out", str(tmp_path / "out")]
    assert main.main([*words, "--no-figures", "--class", "pedestrian"]) == 0
    text = capsys.readouterr().out
    assert "pedestrian  captured       0.25 AP (R1000)" in text
    assert "pedestrian  captured            AP (R1000), centre" in text
    assert main.main([*words, "--no-figures", "--class", "pedestrian", "vehicle"]) == 2
    assert (
        "--class: expected only vehicles or only people, or both with --iou"
        in capsys.readouterr().err
    )
    both = ["--class", "pedestrian", "vehicle", "--iou", "0.3"]
    assert main.main([*words, "--no-figures", *both]) == 0


def test_an_unknown_class_and_two_ways_to_say_it_are_refused(tmp_path: Path) -> None:
    gt, pred = scene(tmp_path, [[walker(20, 12)]], [[]])
    with pytest.raises(
        ValueError,
        match=r"object_class: expected .*, got 'dog'; names: cyclist, pedestrian, vehicle",
    ):
        evaluate(gt, pred, object_class="dog")
    with pytest.raises(ValueError, match="object_class: use object_class or settings, not both"):
        evaluate(gt, pred, Settings(), object_class="cyclist")


def test_types_of_classes() -> None:
    assert class_types(["pedestrian", "cyclist"]) == {
        "pedestrian": ("Pedestrian",),
        "cyclist": ("Cyclist",),
    }
    assert class_settings(class_types(["Pedestrian"])).ious == (0.25,)
    assert class_settings(class_types(["Car"])) == Settings(classes={"Car": ("Car",)})
    assert set(PERSON_TYPES).isdisjoint(VEHICLE_TYPES)
