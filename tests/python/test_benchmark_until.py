"""`pyinfra benchmark --until` repeats a benchmark with other traffic until the difference has a
small interval."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy import stats

from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset.catalogue import configs
from pyinfra.experiments.benchmark import inputs, until
from pyinfra.experiments.benchmark.matrix import read_plan
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.pool import Pool

CONFIG = """
frames: 0:2500:250
split: {train_until_s: 100, val_from_s: 120}
matrix:
  - scenes: [highway]
    lidars: [helios_16, livox_avia]
    presets: [paper]
    detectors: [background]
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    file = tmp_path / "small.yaml"
    file.write_text(CONFIG)
    return file


def rows(first: float, second: float) -> pd.DataFrame:
    aps = {"ruby_plus": first, "livox_avia": second, "helios_16": 10.0}
    base = {"scene": "highway", "preset": "paper", "detector": "background", "tier": "smoke"}
    return pd.DataFrame(
        [
            {**base, "seed": 1, "lidar": lidar, "ap": ap, "ap_r1000": ap, "ap_present_r1000": ap}
            for lidar, ap in aps.items()
        ]
    )


def test_the_best_two_options_are_compared_pairwise_with_students_interval() -> None:
    table = until.comparison_table([rows(90, 86), rows(80, 75), rows(85, 79)])
    (row,) = table.itertuples()
    assert (row.first, row.second) == ("ruby_plus background", "livox_avia background")
    assert row.difference == pytest.approx(5.5)  # the first replicate chooses the two
    half = stats.t.ppf(1 - 0.05 / 6, 1) * math.sqrt(0.5) / math.sqrt(2)
    assert (row.half_width, row.low) == (pytest.approx(half), pytest.approx(5.5 - half))


@pytest.mark.parametrize(("spread", "runs"), [(0.1, 3), (3.0, 10)])
def test_replicates_stop_at_the_first_look_that_is_precise_enough(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spread: float, runs: int
) -> None:
    random, made = np.random.default_rng(1), []

    def replicate(*_: object) -> pd.DataFrame:
        made.append(rows(90 + random.normal(0, spread), 86))
        return made[-1]

    monkeypatch.setattr(until, "_replicate", replicate)
    workspace = Workspace(tmp_path / "work", tmp_path / "out", "smoke")
    table = until.benchmark_until(read_plan(config, "smoke"), workspace, Pool("local", 1), 1.0)
    assert (len(made), table.replicates.item()) == (runs + 1, runs)
    assert pd.read_csv(workspace.table("until")).replicates.item() == runs


def test_the_table_has_the_rows_of_all_scenes(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace = Workspace(tmp_path / "work", tmp_path / "out", "smoke")
    for scene, ap in (("highway", 90.0), ("crossroad", 80.0), ("highway", 70.0)):
        table = rows(ap, 60).assign(scene=scene)
        monkeypatch.setattr(until, "_replicate", lambda *_, table=table: table)
        plan = read_plan(config, "smoke", scene)
        until.benchmark_until(plan, workspace, Pool("local", 1), 1.0)
    written = pd.read_csv(workspace.table("until")).set_index("scene")
    assert written.difference.to_dict() == {"crossroad": 20, "highway": 10}


def test_recorded_traffic_has_no_replicates(config: Path, tmp_path: Path) -> None:
    scene = yaml.safe_load((configs() / "scenes/highway.yaml").read_text())
    del scene["traffic"]
    (tmp_path / "recorded.yaml").write_text(
        yaml.safe_dump(scene | {"trajectories": "t.csv", "duration_s": 0.1})
    )
    (tmp_path / "t.csv").write_text(
        "t,id,class,x,y,z,heading,dx,dy,dz,speed\n"
        "0,1,Car,1,0,1,0,4,2,2,0\n0.1,1,Car,1,0,1,0,4,2,2,0\n"
    )
    config.write_text(CONFIG.replace("[highway]", "[recorded.yaml]"))
    workspace = Workspace(tmp_path / "work", tmp_path / "out", "smoke")
    with pytest.raises(Error, match="expected simulated traffic, got recorded trajectories"):
        until.benchmark_until(read_plan(config, "smoke"), workspace, Pool("local", 1), 1.0)


def test_other_traffic_changes_the_seed_and_the_digest(config: Path) -> None:
    plan = read_plan(config, "smoke")
    other = until._with_other_traffic(plan, 2)
    assert inputs.traffic_seed(plan, "highway") is None
    assert inputs.traffic_seed(other, "highway") == 3
    assert {experiment.seed for experiment in other.experiments} == {3}
    assert not set(inputs.digests(plan).inputs) & set(inputs.digests(other).inputs)


@pytest.mark.nightly
def test_replicates_of_the_command_have_traffic_of_their_own(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, work = tmp_path / "out", tmp_path / "work"
    words = ["benchmark", str(config), "--tier", "smoke", "--out", str(out), "--work", str(work)]
    assert main.main([*words, "--until", "100"]) == 0
    assert "over 3 replicates" in capsys.readouterr().out
    folders = [out, *(out / f"replicate_{number}" for number in (2, 3, 4))]
    assert not (out / "replicate_5").exists()
    aps = [tuple(pd.read_csv(folder / "smoke.csv").ap_r1000) for folder in folders]
    assert len(set(aps)) == 4


def test_several_seeds_or_no_width_are_refused(config: Path, tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "work", tmp_path / "out", "smoke")
    plan = read_plan(config, "smoke")
    with pytest.raises(Error, match=r"until: expected a half-width above 0 .*, got 0"):
        until.benchmark_until(plan, workspace, Pool("local", 1), 0.0)
    config.write_text(CONFIG + "    seeds: [1, 2]\n")
    with pytest.raises(Error, match="seeds: expected one seed"):
        until.benchmark_until(read_plan(config, "smoke"), workspace, Pool("local", 1), 1.0)
