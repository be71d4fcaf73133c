"""The check of the detectability: beams in an empty scene, and measures over poses."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pyinfra.experiments.planner import detectability as laws
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from reproduction.commands.placement import order_rows, place_rows
from reproduction.detectability import check, runs
from reproduction.detectability.empty_scene import Occupancy, reached_voxels
from reproduction.detectability.runs import CHECK_SEEDS, Run, check_runs, fit_runs


def grid() -> Occupancy:
    """Returns a grid 10 m long, 4 m wide and 2 m high, with vehicles in half of it."""
    probability = np.zeros((10, 4, 4))
    probability[:5] = 0.5
    return Occupancy(np.array([0.0, -2.0, 0.0]), probability)


def test_a_beam_reaches_the_voxels_before_its_end_and_none_behind() -> None:
    reached = reached_voxels(np.array([-5.0, 0.5, 1.2]), np.array([[6.5, 0.5, 1.2]]), grid())
    assert np.flatnonzero(reached.any((1, 2))).tolist() == list(range(7))
    assert reached.sum() == 7


def test_a_beam_from_above_reaches_only_voxels_below_the_height_of_the_grid() -> None:
    reached = reached_voxels(np.array([0.5, 0.5, 8.0]), np.array([[8.5, 0.5, 0.0]]), grid())
    columns = np.flatnonzero(reached.any((1, 2)))
    assert columns.min() == 6  # the beam is 2 m high at x = 6.5
    assert columns.max() == 8


def test_beams_that_end_above_the_grid_reach_no_voxel() -> None:
    ends = np.array([[9.0, 0.0, 5.0], [9.0, 0.0, 20.0]])
    assert not reached_voxels(np.array([0.0, 0.0, 8.0]), ends, grid()).any()


def test_many_beams_reach_what_each_reaches_alone() -> None:
    rng = np.random.default_rng(1)
    ends = np.column_stack(
        [rng.uniform(-20, 30, 300), rng.uniform(-8, 8, 300), rng.uniform(0, 3, 300)]
    )
    start = np.array([4.0, -6.0, 6.0])
    alone = [reached_voxels(start, ends[i : i + 1], grid()) for i in range(len(ends))]
    together = reached_voxels(start, ends, grid())
    assert not (np.any(alone, axis=0) & ~together).any()
    assert np.any(alone, axis=0).sum() >= 0.9 * together.sum()  # samples are closer together there


def test_voxels_without_vehicles_have_no_information() -> None:
    entropy = grid().entropy
    assert (entropy[:5] == 1).all()
    assert (entropy[5:] == 0).all()


def made_up(prediction: list[float], measured: list[float], noise: float = 0.0) -> pd.DataFrame:
    """Returns a check of one site and LiDAR: a row per pose and seed."""
    return pd.DataFrame(
        [
            {
                "detector": "generalist",
                "site": 1,
                "lidar": "one",
                "pose": pose,
                "seed": seed,
                "ap_predicted": p,
                "ap_measured": m + noise * (seed - 2) * (-1) ** pose,
                "ap_same_traffic": m,
                "recall_predicted": p,
                "recall_measured": m,
                "recall_same_traffic": m,
                "ten_points_percent": p,
                "coverage_percent": -p,
                "information_bits": 1.0,
                "vehicles_per_frame": 9.0,
            }
            for pose, (p, m) in enumerate(zip(prediction, measured, strict=True))
            for seed in CHECK_SEEDS
        ]
    )


def by_name(table: pd.DataFrame) -> pd.Series:
    rows = pd.DataFrame(check.summary(table))
    return rows.set_index(["measure", "predictor"]).value


def test_errors_and_regret_of_a_known_check() -> None:
    values = by_name(made_up([60.0, 70.0, 80.0], [62.0, 75.0, 70.0]))
    assert values["mean error, ap", ""] == pytest.approx((2 + 5 + 10) / 3)
    assert values["regret of the best pose, AP", "ap_predicted"] == pytest.approx(5)
    assert values["regret of the best pose, AP", "coverage_percent"] == pytest.approx(13)
    assert values["r within a site", "another seed"] == pytest.approx(1)


def test_a_predictor_that_is_the_same_at_each_pose_has_no_correlation() -> None:
    rows = pd.DataFrame(check.summary(made_up([60.0, 70.0], [62.0, 75.0])))
    row = rows[(rows.measure == "r within a site") & (rows.predictor == "information_bits")]
    assert row.groups.item() == 0
    assert np.isnan(row.value.item())


class Measured(Exception):
    """Is raised when a run is measured."""


def test_a_run_of_another_number_of_frames_is_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def site_of(*_: object, **__: object) -> None:
        raise Measured

    monkeypatch.setattr(runs, "site_of", site_of)
    run = Run(1, 0, "ruby_plus")
    np.savez(tmp_path / f"{run.name}.npz", frames=30)
    runs.store(run, 30, tmp_path)
    with pytest.raises(Measured):
        runs.store(run, 60, tmp_path)


def test_a_mean_over_sites_has_students_interval() -> None:
    values = np.array([8.0, 9.0, 13.0, np.nan])
    row = check.row("mean error, ap", "", values)
    half = stats.t.ppf(0.975, 2) * values[:3].std(ddof=1) / np.sqrt(3)
    assert (row["groups"], row["value"], row["median"]) == (3, 10.0, 9.0)
    assert (row["low"], row["high"]) == (pytest.approx(10 - half), pytest.approx(10 + half))
    assert check.row("mean error, ap", "", np.array([1.0, 2.0, 6.0]))["low"] == 0
    assert check.row("r within a site", "", np.array([0.0, 1.0, 1.0]))["high"] == 1


def test_seeds_that_differ_set_a_ceiling() -> None:
    values = by_name(made_up([60.0, 70.0, 80.0], [62.0, 70.0, 75.0], noise=5.0))
    assert values["mean error of another seed, ap", ""] > 0
    assert values["r within a site", "another seed"] < 1


def test_a_place_is_worth_the_difference_to_the_mean_pose() -> None:
    table = pd.concat([made_up([60.0, 80.0], [50.0, 70.0]).assign(site=s) for s in (1, 2)])
    rows = {str(row["quantity"]): row["value"] for row in place_rows(table)}
    assert rows["chosen pose less mean pose, AP"] == pytest.approx(10)
    assert rows["chosen pose less the scene's own pose, AP"] == pytest.approx(20)


def test_the_order_of_lidars_is_the_same_where_their_differences_are() -> None:
    table = pd.DataFrame(
        [
            {"site": s, "pose": p, "lidar": lidar, "seed": seed, "ap": 50.0 + 5 * p + gain}
            for s in (1, 2)
            for p in range(3)
            for seed in (1, 2)
            for lidar, gain in (("ruby_plus", 20), ("pandar_64", 10), ("livox_avia", 0))
        ]
    )
    rows = {str(row["quantity"]): row["value"] for row in order_rows(table)}
    assert rows["ruby_plus less livox_avia, AP"] == pytest.approx(20)
    assert rows["ruby_plus less livox_avia, AP: variance over the poses of a site"] == 0
    assert rows["ruby_plus: share of poses at which it is best, percent"] == 100


def test_the_check_measures_other_traffic_than_the_prediction() -> None:
    runs = [*check_runs(2)]
    assert {run.seed for run in runs if run.detect} == set(CHECK_SEEDS)
    assert {run.seed for run in runs if not run.detect} == {0}
    assert not {run.site for run in runs} & {run.site for run in fit_runs(200)}
    assert len({run.name for run in runs}) == len(runs)


def test_a_run_is_named_by_all_that_changes_it() -> None:
    assert Run(1, 2, "one", 3).name == "1_2_one_3"


def test_the_laws_were_fitted_for_the_detector_of_the_package() -> None:
    fitted = json.loads(laws.FILE.read_text(encoding="utf-8"))["generalist"]
    assert fitted["model"] == checkpoint.digest(model_file(Path("generalist")))


def test_errors_of_options_come_from_calibration_sites_without_the_noise_of_their_means() -> None:
    rng, rows = np.random.default_rng(1), []
    stds = {"recall": 8.0, "people_recall": 5.0, "ap": 6.0}
    noise, seeds = 3.0, 10
    for option in range(4000):
        use = "calibration" if option % 2 else "test"
        for figure, std in stds.items():
            mean = 50 + rng.normal(0, noise)
            value = 50 + rng.normal(0, std if use == "calibration" else 1)
            rows.append((use, figure, value, mean, noise * stats.t.ppf(0.975, seeds - 1)))
        rows.append((use, "false_per_frame", float(np.exp(rng.normal(0, 0.4))), 1.0, 0.0))
    table = pd.DataFrame(rows, columns=["use", "figure", "value", "mean", "half"])
    table = table.assign(source="predicted", site=1, seeds=seeds)
    table = table.assign(mean_low=table["mean"] - table.half, mean_high=table["mean"] + table.half)
    simulated = table.assign(source="simulated", value=0.0)
    found = check.unseen_std_of_options(pd.concat([table, simulated]))
    expected = {"recall": 0.08, "people": 0.05, "ap": 6.0, "log_false": 0.4}
    assert found == pytest.approx(expected, rel=0.05)
