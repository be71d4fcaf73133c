"""The verdicts of the study have a sign and use Student's interval over replicates."""

import itertools
import math
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import SUBSETS
from pyinfra.experiments import store
from reproduction import shared_frames, work_folder
from reproduction.claims import two_detectors
from reproduction.commands import experiments, variance, verdicts

AVIA_LESS_WIDE = {1: -5.0, 2: -4.0, 3: -6.0}


def table(replicates: int = 3, avia: str = "livox_avia") -> pd.DataFrame:
    """Returns rows of one scene and training. Each replicate has two test seeds, whose AP differ
    by 2."""
    base = {"ruby_plus": 95.0, avia: 95.0, "pandar_64": 80.0, "helios_16": 60.0}
    rows = []
    for r, lidar, test in itertools.product(range(1, replicates + 1), base, (0, 1)):
        ap = base[lidar] + (AVIA_LESS_WIDE[r] if lidar == avia else 0) + 2 * test
        row = {
            **{"scene": "highway", "preset": "paper", "lidar": lidar, "replicate": r},
            **{"detector": "generalist", "training": "fine-tuned", "label_time": "scan"},
            **{"cut_angle_deg": 0, "training_cut_angle_deg": 0, "version": "1", "frames": 107},
            **{"frames_version": 4},
            **{"law_exponent": 0.25},
            **{"seed": 2 * r - 1 + test, "ap_r1000": ap, "ap_r1000_near": ap + 1},
            **{"ap_r1000_far": ap - (4 if lidar == avia else 9), "p_hqda": ap / 2},
        }
        rows += [{**row, "subset": subset} for subset in SUBSETS]
    return pd.DataFrame(rows)


def rows_of(data: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(verdicts.claims(data)).set_index(["claim", "subset"])


def test_a_difference_is_a_mean_over_replicates_with_students_interval() -> None:
    row = rows_of(table()).loc["comparable", "captured"]
    values = np.array(list(AVIA_LESS_WIDE.values()))
    half = stats.t.ppf(1 - 0.05 / 6, 2) * values.std(ddof=1) / math.sqrt(3)
    assert (row.replicates, row.value) == (3, pytest.approx(-5))
    assert (row.low, row.high) == (pytest.approx(-5 - half), pytest.approx(-5 + half))


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-2, 2, "holds"),
        (-2, 4, "undecided"),
        (4, 5, "fails above"),
        (-9, -4, "fails below"),
        (math.nan, math.nan, "too few replicates"),
    ],
)
def test_verdicts_are_signed(low: float, high: float, expected: str) -> None:
    (comparable,) = [claim for claim in verdicts.CLAIMS if claim.name == "comparable"]
    assert verdicts.verdict(comparable, low, high) == expected


def test_two_replicates_have_no_interval() -> None:
    row = rows_of(table(2)).loc["64-below", "captured"]
    assert math.isnan(row.low)
    assert row.verdict == "too few replicates"


def as_replicate(data: pd.DataFrame, number: int) -> pd.DataFrame:
    """Returns the rows of replicate 1 as another replicate."""
    first = data[data.replicate == 1]
    return first.assign(replicate=number, seed=first.seed + 2 * (number - 1))


@pytest.mark.parametrize("lacking", ["", "pandar_64"])
def test_replicates_count_if_complete_and_up_to_a_planned_test(lacking: str) -> None:
    data = table()
    fourth, fifth = as_replicate(data, 4), as_replicate(data, 5)
    four = pd.concat([data, fourth], ignore_index=True)
    pd.testing.assert_frame_equal(rows_of(four), rows_of(data))
    five = pd.concat([four, fifth[fifth.lidar != lacking]], ignore_index=True)
    assert set(rows_of(five).replicates) == {3 if lacking else 5}


def test_two_lidars_are_enough_for_a_claim_about_two() -> None:
    data = table()
    pair = rows_of(data[data.lidar.isin(("livox_avia", "ruby_plus"))])
    assert set(pair.index.get_level_values("claim")) == {"comparable", "areas"}
    pd.testing.assert_frame_equal(pair, rows_of(data).loc[pair.index])


def test_the_loss_with_distance_is_compared_with_the_best_spinning_lidar() -> None:
    row = rows_of(table()).loc["gentle", "captured"]
    assert (row.value, row.verdict) == (pytest.approx(5), "holds")


def test_a_bundle_stands_for_the_avia() -> None:
    both = [
        # this verdict depends on the price
        rows_of(table(avia=name)).drop(index=("value", "present"))
        for name in ("livox_avia", "bundle_5_livox_avia")
    ]
    pd.testing.assert_frame_equal(*both)


def test_each_replicate_has_traffic_of_its_own() -> None:
    every = [experiments.Replicate("highway", "paper", "scan", r) for r in range(1, 11)]
    seeds = [seed for replicate in every for seed in replicate.test_seeds]
    train = {experiments.TRAIN_SEEDS_FROM + replicate.replicate for replicate in every}
    assert seeds == list(range(1, 21))
    assert not train & set(seeds)


def test_steps_of_frames_share_no_factor_with_the_pattern_of_200_frames() -> None:
    for frames in (experiments.TRAIN_FRAMES, experiments.TEST_FRAMES):
        assert math.gcd(int(frames.split(":")[2]), 200) == 1


@pytest.mark.parametrize(("done", "used"), [(False, False), (True, False), (True, True)])
def test_frames_stay_while_another_process_uses_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: bool, used: bool
) -> None:
    work_folder(str(tmp_path))
    frames = tmp_path / "data/highway_paper_scan_1_1001"
    frames.mkdir(parents=True)
    # as if another process held the locks
    monkeypatch.setattr(experiments, "fill", lambda *_: None)
    monkeypatch.setattr(experiments.Trained, "is_done", lambda *_: done)
    words = ["--scenes", "highway", "--presets", "paper", "--replicates", "1"]
    words += ["--work", str(tmp_path), "--out", str(tmp_path / "experiments.csv")]
    monkeypatch.setattr(sys, "argv", ["experiments", *words])
    # A process that measures other detectors uses the same frames.
    other = shared_frames.in_use(tmp_path, "highway_paper_scan_1")
    with other if used else nullcontext():
        experiments.main()
    assert frames.is_dir() == (used or not done)


def test_only_spinning_lidars_are_tested_at_turned_cut_angles() -> None:
    replicate = experiments.Replicate("highway", "paper", "scan", 2)
    tests = {
        lidar: experiments.Trained("background", replicate, lidar, (0, 45)).tests
        for lidar in replicate.lidars
    }
    assert tests["livox_avia"] == [(3, 0), (4, 0)]
    assert tests["ruby_plus"] == [(3, 0), (3, 45), (4, 0), (4, 45)]


@pytest.mark.nightly
def test_a_detector_is_trained_at_a_turned_cut_angle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained: list[Path] = []
    monkeypatch.setattr(experiments, "TRAIN_FRAMES", "0:1")
    monkeypatch.setattr(experiments, "TEST_FRAMES", "0:1")

    def train_detector(_: str, folder: Path, *__: object) -> tuple[Path, float]:
        trained.append(folder)
        return folder, 0.0

    monkeypatch.setattr(experiments, "train_detector", train_detector)
    replicate = experiments.Replicate("highway", "paper", "frame", 1)
    one = experiments.Trained("fine-tuned", replicate, "ruby_plus", (0, 90), 90)
    experiments.model_of(one, tmp_path)
    assert "cut_angle_deg: 270" in (trained[0] / "lidar.yaml").read_text()
    assert one.key["training_cut_angle_deg"] == 90
    assert one.name.endswith("_cut_90")


@pytest.mark.nightly
def test_turned_frames_differ_in_the_cut_angle_alone(tmp_path: Path) -> None:
    replicate = experiments.Replicate("highway", "paper", "scan", 1)
    turned = experiments.simulated(replicate, 1, "0:1", tmp_path, 45)
    plain = experiments.simulated(replicate, 1, "0:1", tmp_path)
    assert not (turned / "livox_avia").exists()
    lines = [
        set((folder / "ruby_plus/lidar.yaml").read_text().splitlines())
        for folder in (plain, turned)
    ]
    assert lines[1] - lines[0] == {"    cut_angle_deg: 225"}


def test_verdicts_leave_out_turned_cut_angles() -> None:
    turned = table().assign(cut_angle_deg=45, ap_r1000=0.0)
    pd.testing.assert_frame_equal(rows_of(table()), rows_of(pd.concat([table(), turned])))


@pytest.mark.parametrize(
    ("ends", "replicates", "expected"),
    [
        ([], 3, "holds"),
        ([(-9, -1), (-5, -2)], 3, "holds"),
        ([(-9, -1), (1, 2)], 3, verdicts.CHEAPER),
        # too few measurements do not make a claim hold
        ([(-9, -1), (-1, 2)], 5, "undecided"),
        ([(-9, -1), (-1, 2)], 10, "not known"),
        ([(math.nan, math.nan)], 3, "undecided"),
    ],
)
def test_value_holds_only_if_each_cheaper_lidar_is_below_the_level(
    ends: list[tuple[float, float]], replicates: int, expected: str
) -> None:
    assert verdicts.of_value("holds", ends, replicates) == expected
    # Without the Avia's verdict, only a cheaper LiDAR that reaches the level decides.
    for avia in ("undecided", "not known"):
        fails = expected == verdicts.CHEAPER
        assert verdicts.of_value(avia, ends, replicates) == (expected if fails else avia)


def test_an_undecided_claim_is_not_known_after_ten_replicates() -> None:
    (comparable,) = [claim for claim in verdicts.CLAIMS if claim.name == "comparable"]
    assert [verdicts.verdict(comparable, -2, 4, n) for n in (3, 5, 10)] == [
        "undecided",
        "undecided",
        "not known",
    ]
    assert verdicts.verdict(comparable, -2, 2, 10) == "holds"


@pytest.mark.parametrize(
    ("of_two", "expected"),
    [
        (["holds", "holds"], "holds"),
        (["fails below", "fails below"], "fails below"),
        (["holds", "fails below"], "depends on the detector"),
        (["fails above", "fails below"], "depends on the detector"),
        (["holds", "undecided"], "undecided"),
        (["undecided", "not known"], "undecided"),
        (["fails above", "not known"], "not known"),
        (["holds"], "one detector only"),
        (["holds", "too few replicates"], "one detector only"),
        (["fails below", verdicts.CHEAPER], "fails"),
        (["holds", verdicts.CHEAPER], "depends on the detector"),
    ],
)
def test_two_detectors_decide(of_two: list[str], expected: str) -> None:
    for verdicts_of_two in (of_two, of_two[::-1]):
        assert two_detectors.combined(verdicts_of_two) == expected


def of_both(data: pd.DataFrame) -> pd.DataFrame:
    rows = pd.DataFrame(two_detectors.of_both(pd.DataFrame(verdicts.claims(data))))
    return rows.set_index(["claim", "subset"])


def with_network(wide_ap: float = 0.0) -> pd.DataFrame:
    """Returns rows of the fine-tuned detector and of PointPillars, which has another AP with 128
    lines."""
    network = table().assign(training="from scratch", detector="pointpillars")
    network.loc[network.lidar == "ruby_plus", "ap_r1000"] += wide_ap
    return pd.concat([table(), network], ignore_index=True)


def test_a_verdict_of_both_needs_both_detectors() -> None:
    assert set(of_both(table()).verdict) == {"one detector only"}
    same, other = of_both(with_network()), of_both(with_network(wide_ap=-60.0))
    key = ("comparable", "captured")
    # -5 with an interval of 4 to either side, and +55
    assert same.loc[key].verdict == "undecided"
    assert other.loc[key].verdict == "undecided"
    assert set(same.replicates) == {3}
    assert set(same.loc["64-below"].verdict) == {"holds"}


def test_other_networks_and_label_times_do_not_decide() -> None:
    dsvt = table().assign(training="from scratch", detector="dsvt")
    assert set(of_both(pd.concat([table(), dsvt])).verdict) == {"one detector only"}
    frame = with_network().assign(label_time="frame")
    assert not any(row["primary"] for row in verdicts.claims(frame))


def test_each_end_of_the_law_of_range_has_its_own_verdict() -> None:
    steep = with_network().assign(law_exponent=0.5)
    steep.loc[steep.lidar == "pandar_64", "ap_r1000"] += 30
    rows = of_both(pd.concat([with_network(), steep], ignore_index=True)).loc["64-below"]
    by_exponent = dict(zip(rows.law_exponent, rows.verdict, strict=True))
    assert by_exponent == {0.25: "holds", 0.5: "fails above"}


def test_experiments_that_further_replicates_may_decide_are_named() -> None:
    rows = pd.DataFrame(verdicts.claims(with_network()))
    first, second = two_detectors.undecided(rows)
    assert first.startswith("--scenes highway --presets paper --label-times scan --setups")
    assert "--setups fine-tuned --law-exponents 0.25: 3 replicates, undecided: comparable" in first
    assert "--setups pointpillars " in second


def test_frames_of_another_law_have_their_own_folder_and_key() -> None:
    usual = experiments.Replicate("highway", "datasheet", "scan", 1)
    steep = experiments.Replicate("highway", "datasheet", "scan", 1, 0.5)
    assert usual.name == "highway_datasheet_scan_1"
    assert not steep.name.startswith(usual.name)  # unused frames are removed by this prefix
    assert experiments.Trained("background", steep, "ruby_plus").key["law_exponent"] == 0.5


def test_value_fails_if_a_cheaper_lidar_reaches_the_level() -> None:
    bundle = table(avia="bundle_5_livox_avia").assign(scene="crossroad")
    # the LiDAR with 64 lines has 81 AP and is cheaper
    assert rows_of(bundle).loc["value", "present"].verdict == verdicts.CHEAPER
    bundle.loc[bundle.lidar == "pandar_64", "ap_r1000"] -= 20
    assert rows_of(bundle).loc["value", "present"].verdict == "holds"
    # no cheaper LiDAR has this AP
    assert rows_of(table()).loc["value", "present"].verdict == "holds"


@pytest.mark.parametrize(
    ("less", "expected"), [(10, verdicts.CHEAPER), (20, "fails below"), (0, verdicts.CHEAPER)]
)
def test_a_cheaper_lidar_that_reaches_the_level_decides_also_if_the_avia_is_open(
    less: float, expected: str
) -> None:
    """The Avia's AP minus 80 is 11 -+ 4.4 in the table."""
    bundle = table(avia="bundle_5_livox_avia").assign(scene="crossroad")
    bundle.loc[bundle.lidar.str.contains("avia"), "ap_r1000"] -= less
    assert rows_of(bundle).loc["value", "present"].verdict == expected


def test_lidars_of_one_replicate_must_have_one_version_and_the_same_frames() -> None:
    verdicts.check_pairs(table())
    for column, value in (("version", "2"), ("frames_version", 2), ("frames", 50)):
        other = table()
        other.loc[other.lidar == "helios_16", column] = value
        with pytest.raises(Error, match=f"highway .*: {column}: expected one value .*{value}"):
            verdicts.check_pairs(other)


@pytest.mark.parametrize("count", [0, 2])
def test_each_lidar_has_one_row_of_each_seed(count: int) -> None:
    rows = table()
    one = (rows.lidar == "helios_16") & (rows.seed == 4)
    other = pd.concat([rows[~one], *[rows[one]] * count])
    with pytest.raises(Error, match=f" 2: helios_16: expected one row with seed 4, got {count}"):
        verdicts.check_pairs(other)


def test_a_replicate_counts_only_if_each_seed_has_the_measure() -> None:
    data = table()
    five = pd.concat([data, as_replicate(data, 4), as_replicate(data, 5)], ignore_index=True)
    five.loc[(five.seed == 10) & (five.lidar == "livox_avia"), "p_hqda"] = math.nan
    rows = rows_of(five)
    assert rows.replicates["areas", "captured"] == 3
    assert rows.replicates["comparable", "captured"] == 5
    pd.testing.assert_series_equal(
        rows.loc["areas", "captured"], rows_of(data).loc["areas", "captured"]
    )


def test_missing_replicates_are_named() -> None:
    rows = table()
    lacking = (rows.lidar == "helios_16") & (rows.replicate > 1)
    (text,) = verdicts.missing(rows[~lacking])
    assert text.endswith(" scan 0.25: helios_16 has no replicate 2, 3")


def test_verdicts_and_variance_read_the_file_of_the_experiments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "experiments.csv"
    store.put(file, table().assign(ap_r1000_frames_sd=1.0), experiments.KEY)
    for command in (verdicts, variance):
        out = tmp_path / f"{command.__name__}.csv"
        monkeypatch.setattr(sys, "argv", ["command", str(file), "--out", str(out)])
        command.main()
        assert len(pd.read_csv(out))


def test_detectors_are_compared_for_each_lidar() -> None:
    less = {"pointpillars": 0.0, "pv-rcnn": -2.0, "dsvt": -8.0, "pointrcnn": -40.0}
    data = pd.concat(
        data.assign(detector=name, training="from scratch", ap_r1000=data.ap_r1000 + ap)
        for name, ap in less.items()
        for data in (table(),)
    )
    rows = pd.DataFrame(verdicts.claims(data)).dropna(subset="lidar")
    assert set(rows.lidar) == {"ruby_plus", "avia", "pandar_64", "helios_16"}
    of_wide = rows[rows.lidar == "ruby_plus"].set_index("claim")[["value", "verdict"]]
    assert {claim: tuple(row) for claim, row in of_wide.iterrows()} == {
        "similar": (8, "fails above"),
        "algorithms, dsvt": (6, "holds"),
        "algorithms, pointrcnn": (40, "holds"),
    }
    without = data[(data.detector != "dsvt") | (data.replicate > 1)]
    rows = pd.DataFrame(verdicts.claims(without)).dropna(subset="lidar")
    assert set(rows.verdict) == {"too few replicates"}
