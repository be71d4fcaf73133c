"""`pyinfra compare`: the results of several poles for the same vehicles, visible or not."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from evaluation_data import Vehicle, box, car, write_lidar, write_predictions, write_roads

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import Subset
from pyinfra.formats import csv_table
from pyinfra.formats.csv_table import write_csv
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.match_input import block_seconds
from pyinfra.metrics.places import compare_places
from pyinfra.metrics.settings import Settings

FRAMES = 200  # one frame per second: eight blocks of 25 s


def vehicles(hidden: bool, seed: int = 0) -> list[list[Vehicle]]:
    """Returns a vehicle that passes every ten seconds, and a vehicle that waits for 40 s behind a
    house."""
    seen = {"points": 0, "visibility": 0.0} if hidden else {}
    return [
        [car(10 + (k + seed) % 10, id=k // 10), car(60, id=1000 + k // 40, **seen)]
        for k in range(FRAMES)
    ]


def evaluated(
    out: Path,
    frames: list[list[Vehicle]],
    missed: int = FRAMES + 1,
    *,
    which: Subset = "present",
) -> Path:
    """Returns the folder of an evaluation. Vehicles with points are detected, except in every
    `missed`-th frame."""
    data = out.parent / f"{out.name}_data"
    data.mkdir(parents=True)
    write_roads(data)
    gt = write_lidar(data / "lidar", frames, period_s=1.0)
    predictions = [
        [(box(v), 0.9) for v in frame if v["points"] and (k + 1) % missed]
        for k, frame in enumerate(frames)
    ]
    settings = Settings(ground_truths=(which, "all"))
    evaluate(gt, write_predictions(data / "predictions", predictions), settings).save(out)
    return out


def value(table: pd.DataFrame, place: Path, minus: Path | str, measure: str) -> pd.Series:
    rows = table[(table.place == str(place)) & (table.minus == str(minus))]
    return rows[rows.measure == measure].iloc[0]


def test_a_place_that_hides_half_of_the_vehicles_is_worse_by_that_half(tmp_path: Path) -> None:
    behind = evaluated(tmp_path / "behind", vehicles(hidden=True))
    beside = evaluated(tmp_path / "beside", vehicles(hidden=False))
    table = compare_places([behind, beside])
    for measure in ("ap_r1000", "recall_percent"):
        assert value(table, behind, "", measure).value == pytest.approx(50)
        assert value(table, beside, "", measure).value == pytest.approx(100)
        difference = value(table, beside, behind, measure)
        assert difference.value == pytest.approx(50)
        assert 0 < difference.low <= 50 <= difference.high
    assert value(table, behind, "", "hidden_percent").value == pytest.approx(50)
    assert value(table, beside, "", "hidden_percent").value == 0
    visible = compare_places([behind, behind.parent / "behind"], "all")
    # `all` can't distinguish the two poles
    assert (visible.value[visible.minus == ""] == 100).all()


def test_blocks_of_present_do_not_depend_on_what_the_pole_sees(tmp_path: Path) -> None:
    truths = []
    for name, hidden in (("behind", True), ("beside", False)):
        (tmp_path / name).mkdir()
        write_roads(tmp_path / name)
        frames = vehicles(hidden)
        truths.append(read_ground_truth(write_lidar(tmp_path / name / "l", frames, period_s=1.0)))
    assert [block_seconds(t) for t in truths] == [20, 25]
    assert [block_seconds(t, present=True) for t in truths] == [25, 25]


@pytest.mark.nightly
def test_seeds_are_paired_by_their_vehicles_whatever_the_folders_are_called(
    tmp_path: Path,
) -> None:
    names = (["a", "b", "c"], ["c", "b", "a"])
    missed = ((4, 5, 10), (8, 10, 20))
    places = [tmp_path / "low", tmp_path / "high"]
    for place, order, every in zip(places, names, missed, strict=True):
        for seed, (name, each) in enumerate(zip(order, every, strict=True)):
            frames = vehicles(hidden=False, seed=seed)
            for frame in frames:  # another seed has other vehicles
                frame[0] = {**frame[0], "dx": 4.0 + 0.1 * seed}
            evaluated(place / name, frames, each)
    difference = value(compare_places(places), places[1], places[0], "recall_percent")
    # differences of the missed shares: 1/4 - 1/8, 1/5 - 1/10 and 1/10 - 1/20
    seeds = [100 / 8, 100 / 10, 100 / 20]
    assert difference.seeds == 3
    assert difference.frames == 3 * FRAMES
    assert difference.value == pytest.approx(sum(seeds) / 3, abs=0.01)
    spread = pd.Series(seeds).std() / 3**0.5
    assert difference.high - difference.value == pytest.approx(4.3027 * spread, rel=0.01)


def test_trainings_on_the_same_frames_have_the_interval_of_the_traffic(tmp_path: Path) -> None:
    """The trainings miss nearly the same vehicles, so Student's t over them is far too narrow."""
    frames = vehicles(hidden=False)
    write_roads(tmp_path)
    gt = write_lidar(tmp_path / "lidar", frames, period_s=1.0)
    hard = np.random.default_rng(0).random((FRAMES, 2))

    def trained(lost: float, seed: int, **settings: int) -> Evaluation:
        kept = hard > lost
        kept[seed] = False
        boxes = [
            [(box(v), 0.9) for v, keep in zip(*row, strict=True) if keep]
            for row in zip(frames, kept, strict=True)
        ]
        folder = write_predictions(tmp_path / f"{lost}_{seed}", boxes)
        return evaluate(gt, folder, Settings(ground_truths=("present",), **settings))

    a, b = ([trained(lost, seed) for seed in (1, 2, 3)] for lost in (0.1, 0.3))
    both, one = pi.compare(a, b), pi.compare(a[0], b[0])
    assert isinstance(both, pi.Interval)
    assert isinstance(one, pi.Interval)
    assert both.value == pytest.approx(one.value, abs=1)
    assert both.high - both.low == pytest.approx(one.high - one.low, rel=0.1)
    assert len(pi.compare(a, b, by="distance")) > 0
    other = [trained(lost, 4, replicates=100) for lost in (0.1, 0.3)]
    with pytest.raises(Error, match="replicates: expected the same"):
        pi.compare([a[0], other[0]], [b[0], other[1]])


def test_places_with_other_vehicles_are_refused_by_their_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = evaluated(tmp_path / "one", vehicles(hidden=False))
    other = evaluated(tmp_path / "other", vehicles(hidden=False)[:-1])
    assert main.main(["compare", str(one), str(other)]) == 2
    error = capsys.readouterr().err
    assert str(one / "replicates.csv") in error
    assert "the seed, the frames or the region differ" in error


@pytest.mark.parametrize(
    ("other", "name"),
    [
        (Settings(ground_truths=("present",), ious=(0.7,)), "iou"),
        (Settings(ground_truths=("present",), metrics=("3d",)), "metric"),
        (Settings(ground_truths=("present",), metrics=("centre",)), "metric"),
        (Settings(ground_truths=("present",), classes={"truck": ("Truck",)}), "class"),
        (Settings(ground_truths=("present",), classes={"vehicle": ("Car", "Van")}), "types"),
        (Settings(ground_truths=("present",), min_score=0.1), "min_score"),
        (Settings(ground_truths=("captured",), min_points=6), "min_points"),
    ],
)
def test_places_that_were_measured_otherwise_are_refused(
    tmp_path: Path, other: Settings, name: str
) -> None:
    which = other.ground_truths[0]
    one = evaluated(tmp_path / "one", vehicles(hidden=False), which=which)
    data = tmp_path / "one_data"
    evaluate(data / "lidar", data / "predictions", other).save(tmp_path / "other")
    with pytest.raises(Error, match=f"{name}: expected the same"):
        compare_places([one, tmp_path / "other"], which)


def test_settings_that_do_not_define_the_ap_may_differ(tmp_path: Path) -> None:
    """`min_points` selects vehicles of `captured` only. Older folders do not name the settings."""
    one = evaluated(tmp_path / "one", vehicles(hidden=False))
    data = tmp_path / "one_data"
    few = Settings(ground_truths=("present",), min_points=6, min_objects=5)
    evaluate(data / "lidar", data / "predictions", few).save(tmp_path / "other")
    assert (
        compare_places([one, tmp_path / "other"]).dropna().query("minus != ''").value == 0
    ).all()
    low = Settings(ground_truths=("present",), min_score=0.1)
    result = evaluate(data / "lidar", data / "predictions", low)
    with pytest.raises(Error, match="min_score: expected the same"):
        pi.compare(result, evaluate(data / "lidar", data / "predictions", few))
    result.save(tmp_path / "older")
    file = tmp_path / "older/replicates.csv"
    pd.read_csv(file).drop(columns=["types", "min_points", "min_score"]).to_csv(file, index=False)
    assert len(compare_places([one, tmp_path / "older"])) > 0


def test_a_stopped_evaluation_leaves_no_older_replicates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = evaluated(tmp_path / "one", vehicles(hidden=False))
    result = evaluate(tmp_path / "one_data/lidar", tmp_path / "one_data/predictions", Settings())

    def stopped(file: Path, *words: object) -> None:
        if file.name == "replicates.csv":
            raise KeyboardInterrupt
        write_csv(file, *words)  # type: ignore[arg-type]

    monkeypatch.setattr(csv_table, "write_csv", stopped)
    with pytest.raises(KeyboardInterrupt):
        result.save(one)
    with pytest.raises(FileNotFoundError, match=r"No replicates.csv"):
        compare_places([one, one])


def test_a_difference_has_no_interval_if_the_ap_has_none(tmp_path: Path) -> None:
    """The vehicles are in the first 15 of 200 s: too few blocks, although the time is long."""
    frames = [[car(10 + k, id=1)] if k < 15 else [] for k in range(FRAMES)]
    places = [evaluated(tmp_path / name, frames, each) for name, each in (("a", 3), ("b", 99))]
    ap = pd.read_csv(places[0] / "ap.csv")
    assert ap.ap_r1000_low.isna().all()
    table = compare_places(places)
    assert value(table, places[1], places[0], "ap_r1000").value > 30
    assert table.low.isna().all()


@pytest.mark.parametrize(
    ("words", "code"),
    [(["one"], 2), (["one", "one"], 2), (["one", "missing"], 1), (["one", "captured"], 2)],
)
def test_places_that_cannot_be_compared_end_in_one_line(
    tmp_path: Path, words: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluated(tmp_path / "one", vehicles(hidden=False))
    captured = evaluated(tmp_path / "captured", vehicles(hidden=True))
    table = pd.read_csv(captured / "replicates.csv")
    table.assign(ground_truth="captured").to_csv(captured / "replicates.csv", index=False)
    assert main.main(["compare", *(str(tmp_path / word) for word in words)]) == code
    assert capsys.readouterr().err.count("\n") == 1


def test_the_command_prints_and_writes_the_differences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    behind = evaluated(tmp_path / "behind", vehicles(hidden=True))
    beside = evaluated(tmp_path / "beside", vehicles(hidden=False))
    file = tmp_path / "new" / "places.csv"
    assert main.main(["compare", str(behind), str(beside), "--out", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "present, one seed" in lines[0]
    row = next(line for line in lines if line.startswith(f"{beside} - {behind}  "))
    assert "+50.0 [" in row
    assert lines[-1] == f"{beside} - {behind}: AP differs significantly"
    assert len(pd.read_csv(file)) == len(compare_places([behind, beside]))


def test_folders_of_the_default_evaluation_are_compared_by_their_visible_vehicles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    default = evaluated(tmp_path / "default", vehicles(hidden=False), 4, which="captured")
    present = evaluated(tmp_path / "present", vehicles(hidden=False))
    words = ["compare", str(default), str(present)]
    assert main.main(words) == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert "because not all folders have present" in first
    assert second.startswith("ground truth all,")
    expected = compare_places([default, present], "all")
    pd.testing.assert_frame_equal(compare_places([default, present]), expected)
    assert main.main([*words, "--ground-truth", "present"]) == 2
    assert "--ground-truth present all" in capsys.readouterr().err
