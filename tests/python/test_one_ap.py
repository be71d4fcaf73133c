"""AP has one name, one value and one interval in all outputs."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from evaluation_data import car, noisy, traffic, write_lidar, write_predictions, write_roads
from report_data import Read

from pyinfra import evaluate
from pyinfra.cli import main
from pyinfra.experiments.benchmark import measure
from pyinfra.experiments.benchmark.matrix import Experiment
from pyinfra.experiments.value import Costs, value_table
from pyinfra.metrics import ap
from pyinfra.metrics.evaluation_result import Evaluation

SPAN = r"(\d+\.\d) +\[(\d+\.\d), (\d+\.\d)\]"
LIDAR = {"lidar": "livox_avia", "preset": "paper"}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Writes 90 s of a road, and predictions for it."""
    top = tmp_path_factory.mktemp("one_ap")
    write_roads(top)
    frames = traffic(300, per_frame=4)
    predictions = write_predictions(top / "predictions", noisy(frames))
    # the first car is hidden in every third frame, and has no points in another third
    for k, cars in enumerate(frames):
        cars[0] |= {"points": 0 if k % 3 else 9, "visibility": 0.0 if k % 3 == 1 else 1.0}
    # The id of a vehicle is its position in the list of a frame. These vehicles shift the
    # positions, so that the ids change after 10 s.
    away = [[car(900, points=0, visibility=0.0)] * (4 * (k // 33)) for k in range(len(frames))]
    later = [[*others, *cars] for others, cars in zip(away, frames, strict=True)]
    return write_lidar(top / "livox_avia", later, period_s=0.3), predictions


@pytest.fixture(scope="module")
def evaluation(folders: tuple[Path, Path]) -> Evaluation:
    """Evaluates the predictions with the settings of a benchmark."""
    return evaluate(*folders, measure.SETTINGS, ranges=True)


@pytest.fixture(
    scope="module", params=["highway", pytest.param("bridge", marks=pytest.mark.nightly)]
)
def results(
    request: pytest.FixtureRequest,
    evaluation: Evaluation,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Writes the tables of a benchmark of these predictions, for a scene of the paper or for
    another site."""
    out = tmp_path_factory.mktemp(request.param) / "results"
    out.mkdir()
    experiment = Experiment(request.param, "livox_avia", "paper", "pointpillars", "quick", 1)
    row = measure.row(experiment, evaluation, 9.0, 1) | {
        "latency_p50_ms": 10.0,
        "latency_p95_ms": 12.0,
    }
    tables = {
        "experiments": pd.DataFrame([row]),
        "areas": measure.keyed(experiment, evaluation.areas),
        "distance": measure.keyed(experiment, evaluation.distance_ap),
        "replicates": measure.keyed(experiment, evaluation.replicates),
        "ranges": measure.keyed(experiment, evaluation.ranges),
        "lidars": pd.DataFrame([LIDAR]).assign(
            price_low_usd=2000, price_high_usd=2000, units=1, price_source="x", price_date="2026"
        ),
        "hits": pd.DataFrame([LIDAR]).assign(
            scene=request.param, frames=9, hits_per_frame=9.0, vehicle_points_per_frame=9.0
        ),
    }
    tables["value"] = value_table(tables, Costs())
    names = {"experiments": "quick.csv", "lidars": "lidars.csv"}
    for name, table in tables.items():
        table.to_csv(out / names.get(name, f"quick_{name}.csv"), index=False, float_format="%.6g")
    return out


@pytest.fixture
def evaluated(
    folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, tuple[str, ...]]:
    """Returns the values that `pyinfra evaluate` prints, by ground truth: AP (R1000) and the ends
    of its interval."""
    words = [folders[0], folders[1], "--out", tmp_path, "--no-figures"]
    truths = ["--ground-truth", "captured", "all", "present"]
    assert main.main(["evaluate", *map(str, words), *truths]) == 0
    text = capsys.readouterr().out
    lines = re.findall(rf"^vehicle +(\w+) +0.5 AP \(R1000\) +{SPAN}", text, re.MULTILINE)
    return {truth: tuple(numbers) for truth, *numbers in lines}


def shown(numbers: tuple[str, ...]) -> str:
    return "{} [{}, {}]".format(*numbers)


@pytest.mark.usefixtures("undrawn")
def test_evaluate_report_and_recommend_show_the_same_digits(
    evaluated: dict[str, tuple[str, ...]], results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert len({numbers[0] for numbers in evaluated.values()}) == 3
    captured, whole = shown(evaluated["captured"]), shown(evaluated["present"])
    assert main.main(["recommend", str(results), "--budget", "9000", "--min-ap", "20"]) == 0
    output = capsys.readouterr().out
    assert f"AP (R1000) of every vehicle in the whole region {whole}, of those visible" in output
    assert f"of the vehicles it captures {captured};" in output
    out = results.parent / "report.html"
    assert main.main(["report", str(results), "--out", str(out)]) == 0
    text = Read(out).text
    head, rest = text.split("experiments have an AP (R1000)", 1)
    if "highway" in str(results):
        assert f"AP (R1000) {captured}" in head
    else:
        assert f"AP (R1000) of every vehicle {whole}" in head
    # The value is in the grid of LiDARs and detectors, and in the table of experiments.
    assert rest.count(captured) >= 2


def test_what_is_called_ap_in_the_report_is_ap_r1000(results: Path, tmp_path: Path) -> None:
    """The AP at 40 recalls gets a value that occurs nowhere else. The report must not contain
    it."""
    for file in results.glob("*.csv"):
        table = pd.read_csv(file)
        r40 = [n for n in table if re.fullmatch(r"ap(_common|_all|_present|_whole)?", n)]
        ends = [f"{name}{end}" for name in r40 for end in ("_low", "_high")]
        known = [name for name in (*r40, *ends) if name in table]
        table.assign(**dict.fromkeys(known, 12.34)).to_csv(tmp_path / file.name, index=False)
    out = tmp_path / "report.html"
    assert main.main(["report", str(tmp_path), "--out", str(out)]) == 0
    text = Read(out).text
    assert "12.3" not in text
    words = ["--sections", "reproduction.report", "--out", str(out)]
    assert main.main(["report", str(tmp_path), *words]) == 0
    # the report has this value only beside the paper's
    contexts = re.findall(r"(.{12})12\.3", Read(out).text)
    assert all("R40" in before for before in contexts), contexts
    assert len(contexts) == ("highway" in str(results))


def rankings() -> Iterator[ap.Ranking]:
    for seed in range(20):
        random = np.random.default_rng(seed)
        count = int(random.integers(1, 300))
        slot = random.integers(0, 9, count)
        hit = random.random(count) < random.random()
        missed = random.integers(0, 9, 9)
        objects = np.bincount(slot[hit], minlength=9) + missed
        yield ap.rank(random.random(count), hit, objects, slot)


def test_both_ap_of_one_pass_are_those_of_one_pass_each() -> None:
    weights = np.random.default_rng(0).integers(0, 3, (20, 9))
    for ranking in rankings():
        for drawn in (None, weights):
            r40, r1000 = ap.r40_and_r1000(ranking, drawn)
            one, other = (
                ap.average_precision(ranking, recalls, drawn)
                for recalls in (ap.RECALLS, ap.R1000_RECALLS)
            )
            np.testing.assert_array_equal(r40, one)
            np.testing.assert_array_equal(r1000, other)
