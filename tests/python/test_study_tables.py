"""The tables of the study: means over seeds, paired differences, and what is missing."""

import itertools
import re

import pandas as pd
import pytest

from reproduction.claims import scanning
from reproduction.claims.two_detectors import PRIMARY
from reproduction.commands.experiments import LAW_EXPONENTS
from reproduction.commands.verdicts import CHEAPER, CLAIMS, UNDECIDED, Claim
from reproduction.commands.verdicts import verdict as verdict_of
from reproduction.tables import (
    integration,
    label_times,
    rungs,
    simulator,
    sites,
    stress,
    verdicts,
    versions,
)
from reproduction.tables.common import markdown, results, with_interval


def cells(table: str) -> list[list[str]]:
    """Returns the cells of a Markdown table, without the line below the heads."""
    heads, _, *rows = table.splitlines()
    return [line[2:-2].split(" | ") for line in (heads, *rows)]


def stress_rows() -> pd.DataFrame:
    """Returns rows of three seeds. AP falls by 40 for each unit of drop_out, and not with rain."""
    common = {"lidar": "ruby_plus", "setup": "background", "unit": "share"}
    rows = []
    for seed in (1, 2, 3):
        rows.append({**common, "seed": seed, "stressor": "none", "severity": "0", "ap_r1000": 90.0})
        for at in (0.25, 1.0):
            fall = {"drop_out": 20 * seed * at, "rain": 0.0}
            rows += [
                {**common, "seed": seed, "stressor": s, "severity": f"{at}", "ap_r1000": 90 - down}
                for s, down in fall.items()
            ]
        named = {"stressor": "vehicle_class", "severity": "Bus", "unit": "name"}
        rows.append({**common, **named, "seed": seed, "ap_r1000": 80.0 - seed})
    return pd.DataFrame(rows)


def test_a_fall_has_its_severity_and_the_ends_over_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stress, "results", lambda _: stress_rows())
    table = dict(row[:2] for row in cells(stress.stress()))
    assert table["drop_out, share"] == "0.25 [0.17 to 0.5]"
    assert table["rain, mm/h"] == "beyond"
    assert table["vehicle_class: Bus, change of AP"].startswith("-12.0 [")
    assert table["AP (R1000) without stress"] == "90.0 [90.0, 90.0]"


def test_a_significant_change_is_printed_with_an_interval_without_0(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = stress_rows()
    rows.loc[rows.stressor == "vehicle_class", "ap_r1000"] = [89.2, 89.3, 89.25]
    monkeypatch.setattr(stress, "results", lambda _: rows)
    table = dict(row[:2] for row in cells(stress.stress()))
    assert table["vehicle_class: Bus, change of AP"] == "-0.8 [-0.9, -0.6]"


def rung_rows() -> pd.DataFrame:
    """Returns rows of three seeds: without beams, the Avia loses a fifth of its points at 30 m, and
    The Ruby Plus loses a tenth. At 60 m, the Avia has too few points."""
    kept = {("livox_avia", 30): (50, 40), ("ruby_plus", 30): (200, 180)}
    kept |= {("livox_avia", 60): (0.5, 0.1), ("ruby_plus", 60): (20, 20)}
    rows = [
        {"rung": "one ray", "lidar": lidar, "from_m": m, "points_default": a, "points_rung": b}
        for (lidar, m), (a, b) in kept.items()
    ]
    return pd.DataFrame([{**row, "seed": seed} for seed in (1, 2, 3) for row in rows])


def test_a_rung_has_the_largest_change_relative_to_another_lidar(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rungs, "results", lambda _: rung_rows())
    monkeypatch.setattr(rungs, "BANDS", {30: "30 to 60 m", 60: "60 to 90 m"})
    monkeypatch.setattr(rungs, "LIDARS", {"ruby_plus": "Ruby Plus", "livox_avia": "Avia"})
    ((_, *row),) = cells(rungs.rungs())[1:]
    assert row[:2] == ["-20.0 to -10.0", "+0.0 to +0.0"]
    assert row[2] == "+12.5 [+12.5, +12.5]: Ruby Plus relative to Avia, 30 to 60 m"
    assert cells(rungs.rungs_by_lidar())[1][:2] == ["Avia", "-20.0 [-20.0, -20.0]"]


def test_a_change_of_ap_by_beams_is_paired_by_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rungs, "LIDARS", {"ruby_plus": "Ruby Plus"})
    table = pd.DataFrame(
        {"rung": rung, "lidar": "ruby_plus", "detector": "background", "seed": seed, "ap_r1000": ap}
        for rung, aps in {"default": (90.0, 80.0, 70.0), "one ray": (88.0, 78.0, 68.0)}.items()
        for seed, ap in enumerate(aps)
    )
    monkeypatch.setattr(rungs, "results", lambda _: table)
    assert cells(rungs.rungs_ap())[1][2] == "**-2.0 [-2.0, -2.0]**"


def ladder_rows() -> pd.DataFrame:
    usual = {"detail": "low", "aggregation": "exact", "parts": "glass", "vegetation": "scene"}
    usual |= {"label_time": "scan", "detector": "background", "lidar": "ruby_plus"}
    usual |= {"preset": "datasheet"}
    models = [("low", 500, 80.0), ("box", 500, 85.0), ("low", 50, 70.0)]
    return pd.DataFrame(
        usual
        | {"detail": detail, "frames": frames, "seed": seed, "ap_r1000": ap + seed}
        | {"ms_per_frame_set": 40.0}
        for (detail, frames, ap), seed in itertools.product(models, (1, 2, 3))
    )


def test_models_are_compared_with_the_default_by_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulator, "results", lambda _: ladder_rows())
    _, *rows = cells(simulator.ladder())
    assert [row[0] for row in rows] == ["default", "detail `box`", "frames `50`"]
    assert rows[0][1:] == ["20", "82.0 [79.5, 84.5]"]
    assert rows[1][2] == "**+5.0 [+5.0, +5.0]**"
    assert rows[2][1:] == ["2", "**-10.0 [-10.0, -10.0]**"]


def test_the_default_model_is_known_by_its_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several processes add rows, so that the default model need not be the first one."""
    other = ladder_rows().assign(preset="paper", ap_r1000=0.0)
    rows = pd.concat([other, ladder_rows()[::-1]], ignore_index=True)
    monkeypatch.setattr(simulator, "results", lambda _: rows)
    _, *lines = cells(simulator.ladder())
    assert {line[0]: line[2] for line in lines} == {
        "frames `50`": "**-10.0 [-10.0, -10.0]**",
        "detail `box`": "**+5.0 [+5.0, +5.0]**",
        "default": "82.0 [79.5, 84.5]",
    }


def pole_rows() -> pd.DataFrame:
    common = {"lidar": "helios_16", "detector": "background", "ground_truth": "all"}
    aps = {(1, "none"): 30.0, (2, "none"): 45.0, (4, "none"): 60.0, (2, "clock_20_ms"): 44.0}
    figures = {"points_per_vehicle": 5, "background_per_frame": 1.0, "misplaced_per_frame": 2.0}
    return pd.DataFrame(
        {**common, **figures, "poles": n, "error": error, "seed": seed, "ap_r1000": ap + 3 * seed}
        for ((n, error), ap), seed in itertools.product(aps.items(), (1, 2, 3))
    )


def test_gains_and_costs_of_poles_are_paired_by_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sites, "results", lambda _: pole_rows())
    (_, row), (_, errors) = cells(sites.poles()), cells(sites.pole_errors())
    assert row[:2] == ["Helios 16", "Background"]
    assert row[2].startswith("36.0 [")
    assert row[5:] == ["+15.0 [+15.0, +15.0]", "+15.0 [+15.0, +15.0]"]
    assert errors[2:4] == ["2", "-1.0 [-1.0, -1.0]"]
    assert errors[4:] == ["", "", ""]


@pytest.mark.parametrize(
    ("points", "text"),
    [
        ((9, 7, 5, 4), "40"),
        ((9, 4, 5, 4), "40 (all to 20)"),
        ((0, 7, 5, 4), "20 to 40"),
        ((0, 7, 4, 5), "20 to 50 (all to 30)"),
        ((4, 4, 4, 4), "-"),
    ],
)
def test_distances_with_too_few_points_are_named(points: tuple[int, ...], text: str) -> None:
    bins = pd.DataFrame({"from_m": range(10, 50, 10), "points": points})
    assert sites.people_distance(bins) == text


def experiment_rows() -> pd.DataFrame:
    """Returns PointPillars with one replicate, and the fine-tuned detector at two cut angles."""
    common = {"scene": "highway", "preset": "paper", "subset": "captured", "train_cpu_s": 60.0}
    common |= {"law_exponent": 0.25}
    rows = []
    for lidar, ap in (("ruby_plus", 95.0), ("livox_avia", 90.0)):
        nothing = {"training": "from scratch", "detector": "pointpillars", "label_time": "scan"}
        nothing |= {"replicate": 1, "training_cut_angle_deg": 0, "cut_angle_deg": 0}
        rows.append({**common, **nothing, "lidar": lidar, "ap_r1000": ap})
    tuned = {"training": "fine-tuned", "detector": "generalist", "label_time": "frame"}
    for angle, test, r in itertools.product((0, 90), label_times.ANGLES_DEG, (1, 2, 3)):
        angles = {"training_cut_angle_deg": angle, "cut_angle_deg": test, "replicate": r}
        ap = 95.0 if angle == test else 80.0
        rows.append({**common, **tuned, **angles, "lidar": "ruby_plus", "ap_r1000": ap})
    return pd.DataFrame(rows)


def test_a_detector_with_one_replicate_has_no_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    latency = {"scene": "highway", "preset": "paper", "training": "from scratch"}
    latency |= {"detector": "pointpillars", "latency_p50_ms": [30.0, 40.0]}
    tables = {"experiments": experiment_rows(), "latency": pd.DataFrame(latency)}
    monkeypatch.setattr(verdicts, "results", tables.__getitem__)
    heads, *rows = cells(verdicts.detectors("highway", "paper"))
    assert rows == [["PointPillars", "95.0", "90.0", "-5.0", "1", "60", "35"]]
    assert heads[-2:] == ["training, CPU s", "frame, ms"]


def test_claims_about_detectors_have_a_verdict_for_each_lidar(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wide = {"claim": "similar", "lidar": "ruby_plus", "value": 1.0, "low": 0.0, "high": 2.0}
    rows = [
        {**wide, "verdict": "holds", "replicates": 3},
        {**wide, "lidar": "avia", "verdict": verdicts.TOO_FEW, "replicates": 1},
        {**wide, "claim": "comparable", "lidar": None, "replicates": 3},
    ]
    monkeypatch.setattr(verdicts, "results", lambda _: pd.DataFrame(rows))
    _, *table = cells(verdicts.claims_of_detectors())
    assert table == [["`similar`", "1.0 [0.0, 2.0], holds", "1.0, too few replicates (1)"]]


def test_times_of_different_machines_are_not_averaged(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = experiment_rows().query("training == 'fine-tuned'").assign(machine="fast")
    slow = rows.assign(machine="slow", train_cpu_s=600.0, replicate=rows.replicate + 3)
    some = slow[slow.replicate == 4]
    monkeypatch.setattr(verdicts, "results", lambda _: pd.concat([rows, some]))
    heads, row = cells(verdicts.costs())
    assert heads[2:] == ["trainings", "CPU s of a training", "machine", "CPU h"]
    assert row[2:] == ["8", "60", "fast", "0.4"]


def version_rows(verdict: str, value: float) -> pd.DataFrame:
    """Returns a verdict of each primary detector, with an interval of 1 to either side."""
    rows = [
        {"training": training, "detector": detector, "value": value, "verdict": verdict}
        for training, detector in PRIMARY
    ]
    fixed = {"claim": "comparable", "scene": "curve", "preset": "paper", "subset": "captured"}
    fixed |= {"label_time": "scan", "low": value - 1, "high": value + 1}
    return pd.DataFrame(rows).assign(**fixed)


def test_verdicts_are_compared_with_those_of_version_0_4(monkeypatch: pytest.MonkeyPatch) -> None:
    before = version_rows("holds", -1.0)
    now = version_rows("fails below", -5.0).assign(law_exponent=LAW_EXPONENTS[0])
    now.loc[1, ["value", "low", "high", "verdict"]] = [-1.9, -3.6, -0.2, "undecided"]
    other = now.assign(law_exponent=LAW_EXPONENTS[1], verdict="fails above")
    few = version_rows(versions.TOO_FEW, 0.0).assign(scene="highway", law_exponent=LAW_EXPONENTS[0])
    tables = {"0.4/claims": before, "claims": pd.concat([now, other, few])}
    tables |= {"0.4/scanning_claims": before, "scanning_claims": now}
    monkeypatch.setattr(versions, "results", tables.__getitem__)
    table, _, frames = versions.detection().partition("\n\n")
    _, *rows = cells(table)
    assert [row[3:] for row in rows] == [
        [
            "fine-tuned",
            "`captured`",
            "-1.0 [-2.0, 0.0] holds",
            "-5.0 [-6.0, -4.0] fails below",
            "yes",
        ],
        [
            "PointPillars, trained at the scene",
            *("`captured`", "-1.0 [-2.0, 0.0] holds", "-1.9 [-3.6, -0.2] undecided", "no"),
        ],
    ]
    assert versions.counts_of(versions.of_detection()) == (2, 2, 1, 1)
    assert frames.startswith(
        "The frames are from simulator version 0.4 (`frames_version` 3) and version "
    )


def test_an_end_near_a_limit_has_more_digits() -> None:
    assert verdicts.with_interval("comparable", -4, -5, -3.02) == "-4.00 [-5.00, -3.02]"
    assert verdicts.with_interval("comparable", -4, -5, -3.2) == "-4.0 [-5.0, -3.2]"
    assert verdicts.with_interval("gentle", 1, -0.01, 2) == "+1.00 [-0.01, 2.00]"


def test_cut_angles_of_training_and_test_make_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    data = experiment_rows()
    at_0 = (data.training_cut_angle_deg == 0) & (data.replicate == 3)
    fourth = data[at_0].assign(replicate=4, ap_r1000=0.0)
    monkeypatch.setattr(label_times, "results", lambda _: pd.concat([data, fourth]))
    _, *rows = cells(label_times.training_cut_angles())
    assert [row[4] for row in rows] == ["0 degrees", "90 degrees"]
    assert [[cell[:4] for cell in row[5:]] for row in rows] == [
        ["95.0", "80.0", "80.0", "80.0"],
        ["80.0", "95.0", "80.0", "80.0"],
    ]


def label_time_rows() -> pd.DataFrame:
    """Returns five replicates with labels at scan time, and three with labels at mid-frame."""
    common = {"scene": "highway", "preset": "paper", "subset": "captured", "training": "fine-tuned"}
    common |= {"law_exponent": 0.25}
    common |= {"training_cut_angle_deg": 0, "cut_angle_deg": 0}
    return pd.DataFrame(
        {**common, "lidar": lidar, "label_time": label_time, "replicate": r, "ap_r1000": ap + r}
        for lidar, aps in (("ruby_plus", (90.0, 80.0)), ("livox_avia", (85.0, 84.0)))
        for label_time, ap, replicates in zip(("scan", "frame"), aps, (5, 3), strict=True)
        for r in range(1, replicates + 1)
    )


def test_ap_is_the_mean_over_the_replicates_of_the_verdicts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scan = label_time_rows().query("label_time == 'scan' and replicate <= 4")
    monkeypatch.setattr(verdicts, "results", lambda _: scan)
    _, (*_, wide, avia, middle, narrow) = cells(verdicts.average_precision())
    assert [wide[:4], avia[:4], middle, narrow] == ["92.0", "87.0", "", ""]


def test_label_times_are_compared_in_the_same_replicates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(label_times, "results", lambda _: label_time_rows())
    _, *rows = cells(label_times.label_times())
    assert [row[4][:4] for row in rows] == ["92.0", "87.0"]
    assert [row[6] for row in rows] == ["-10.0 [-10.0, -10.0]", "-1.0 [-1.0, -1.0]"]
    _, *rows = cells(label_times.comparison())
    assert [row[4] for row in rows] == ["-5.0 [-5.0, -5.0]", "4.0 [4.0, 4.0]"]


def integration_rows() -> pd.DataFrame:
    common = {"speed_km_h": 20, "lidar": "livox_avia"}
    stacks = ((1, "newest", 80.0), (5, "newest", 78.0), (5, "middle", 84.0))
    return pd.DataFrame(
        common
        | {"accumulate": n, "label_at": at, "seed": seed, "subset": subset, "ap_r1000": ap + seed}
        for (n, at, ap), seed, subset in itertools.product(
            stacks, (1, 2, 3), ("captured", "present")
        )
    )


def test_stacked_frames_are_compared_with_single_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integration, "results", lambda _: integration_rows())
    heads, row = cells(integration.integration("present"))
    assert heads[2:] == [
        "AP, 0.1 s",
        "change, 0.5 s, label of the last frame",
        "change, 0.5 s, label of the middle frame",
    ]
    assert row[:2] == ["20 km/h", "Avia"]
    assert row[2].startswith("82.0 [")
    assert row[3:] == ["-2.0 [-2.0, -2.0]", "+4.0 [+4.0, +4.0]"]


def test_the_single_frame_is_known_by_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integration, "results", lambda _: integration_rows()[::-1])
    heads, row = cells(integration.integration("present"))
    assert heads[3:] == [
        "change, 0.5 s, label of the middle frame",
        "change, 0.5 s, label of the last frame",
    ]
    assert row[3:] == ["+4.0 [+4.0, +4.0]", "-2.0 [-2.0, -2.0]"]


def test_a_table_with_a_value_that_is_no_number_is_refused() -> None:
    assert markdown(["a", "b"], [["1", ""]]).count("\n") == 3
    with pytest.raises(ValueError, match=r"\| 1 \| nan \|"):
        markdown(["a", "b"], [["1", "nan"]])


def ends_of(cell: str) -> tuple[float, float]:
    """Returns the ends of the interval in a cell."""
    low, high = re.findall(r"\[(.+), (.+)\]", cell)[0]
    return float(low), float(high)


@pytest.mark.parametrize(
    ("claim", "subset"),
    [(c, subset) for c in CLAIMS for subset in c.subsets],
    ids=lambda value: getattr(value, "name", value),
)
def test_printed_intervals_of_detection_agree_with_their_verdicts(
    claim: Claim, subset: str
) -> None:
    _, *rows = cells(verdicts.verdicts(claim.name, subset))
    for cell in itertools.chain.from_iterable(row[2:] for row in rows):
        # the verdict of `value` depends on other LiDARs too, and that of both has no interval
        of_others = claim.name == "value" and cell.endswith((CHEAPER, UNDECIDED))
        if "[" in cell and not of_others:
            assert cell.endswith(verdict_of(claim, *ends_of(cell))), cell


def test_printed_intervals_of_scanning_agree_with_their_verdicts() -> None:
    table = results("scanning_claims")
    limits = table.statement.str.extract(r"(?:is|are) (?:above (\d)|([\d.]+) to ([\d.]+));?")
    for row, (above, least, most) in zip(
        table.itertuples(), limits.astype(float).to_numpy(), strict=True
    ):
        if row.claim not in ("deskew", "only-one"):
            inside = (least, most) if above != above else (above, float("inf"))
            ends = ends_of(with_interval(row.value, row.low, row.high))
            assert scanning.verdict(*ends, inside) == row.verdict, row.statement
