"""Variance components of AP from a table of experiments."""

import itertools

import numpy as np
import pandas as pd
import pytest

from reproduction.commands import variance

TRAINING, SEED, FRAMES, SCENE = 3.0, 1.0, 0.5, 4.0


def table(replicates: int = 400) -> pd.DataFrame:
    """Returns experiments with known variance components. The LiDARs of a test have only the scene
    in common."""
    random = np.random.default_rng(1)
    # offsets with the standard deviation SCENE
    scenes = {"a": -SCENE / np.sqrt(2), "b": SCENE / np.sqrt(2)}
    rows = []
    for (scene, offset), lidar, r in itertools.product(
        scenes.items(), ("ruby_plus", "livox_avia"), range(1, replicates + 1)
    ):
        trained = 80 + offset + random.normal(0, TRAINING)
        for seed in (2 * r - 1, 2 * r):
            ap = trained + random.normal(0, SEED) + random.normal(0, FRAMES)
            rows.append(
                {
                    **{"scene": scene, "preset": "paper", "training": "background", "lidar": lidar},
                    "detector": "background",
                    **{
                        "label_time": "scan",
                        "subset": "captured",
                        "cut_angle_deg": 0,
                        "training_cut_angle_deg": 0,
                        "law_exponent": 0.25,
                    },
                    **{"replicate": r, "seed": seed, "ap_r1000": ap, "ap_r1000_frames_sd": FRAMES},
                }
            )
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def sd() -> pd.Series:
    rows = pd.DataFrame(variance.components(table()))
    return rows.set_index(["quantity", "component"]).sd


@pytest.mark.parametrize(
    ("component", "truth"),
    [("training", TRAINING), ("seed", SEED), ("frames", FRAMES), ("scene", SCENE)],
)
def test_components_are_those_of_the_truth(sd: pd.Series, component: str, truth: float) -> None:
    assert sd["avia", component] == pytest.approx(truth, rel=0.15)


def test_a_difference_of_independent_lidars_has_the_sum_of_the_variances(sd: pd.Series) -> None:
    assert sd[variance.DIFFERENCE, "training"] == pytest.approx(TRAINING * 2**0.5, rel=0.15)


def test_turned_cut_angles_and_other_subsets_are_left_out() -> None:
    rows = table(3)
    more = [rows.assign(cut_angle_deg=45, ap_r1000=0), rows.assign(subset="all", ap_r1000=0)]
    expected = pd.DataFrame(variance.components(rows))
    pd.testing.assert_frame_equal(
        pd.DataFrame(variance.components(pd.concat([rows, *more]))), expected
    )


def test_a_component_of_0_is_not_found_in_many_small_groups() -> None:
    part = table(3)
    one = part[part.scene == "a"]
    rows = pd.concat([one.assign(scene=f"{number}") for number in range(40)], ignore_index=True)
    rows["ap_r1000"] = 80 + np.random.default_rng(2).normal(0, SEED, len(rows))
    rows["ap_r1000_frames_sd"] = 0.0
    sd = pd.DataFrame(variance.components(rows)).set_index(["quantity", "component"]).sd
    assert sd["avia", "seed"] == pytest.approx(SEED, rel=0.15)
    assert sd["avia", "training"] < 0.4 * SEED


def test_label_times_are_compared_in_the_replicates_that_both_have() -> None:
    rows = table(5)
    rows["ap_r1000"] = 80.0 + 10 * rows.replicate
    frame = rows[rows.replicate <= 3].assign(label_time="frame")
    both = pd.DataFrame(variance.components(pd.concat([rows, frame])))
    sd = both.set_index(["quantity", "component"]).sd
    assert sd["avia", "label_time"] == 0
