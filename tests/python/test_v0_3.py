"""A folder, a row of results and a checkpoint of version 0.3 are read, resumed and compared.

Version 0.3.0 wrote the files in tests/data/v0_3. They remain valid after a new release and after a
key is renamed, because their identity depends only on the version number of the frames and on the
names of keys in 0.3.
"""

import dataclasses
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pyinfra.cli import main
from pyinfra.core import config
from pyinfra.core.arrays import Points
from pyinfra.core.config import as_plain, canonical, from_plain
from pyinfra.experiments import store
from pyinfra.experiments.benchmark import inputs
from pyinfra.experiments.benchmark.matrix import read_plan
from pyinfra.experiments.benchmark.provenance import recipe_digest
from pyinfra.experiments.stress import altered_scenes, trials
from pyinfra.experiments.stress.stressors import NONE
from pyinfra.formats import kitti
from pyinfra.formats.kitti import frame_file
from pyinfra.metrics import replicates
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.models.inference import detect
from pyinfra.models.training.recipe import read_recipe

Infrasim = Callable[..., object]
V0_3 = Path(__file__).resolve().parents[1] / "data/v0_3"
DIGESTS = json.loads((V0_3 / "digests.json").read_text())
# keys of LiDARs that were renamed after 0.3
RENAMED_KEYS = {"seam_deg:": "cut_angle_deg:", "wedges:": "prisms:"}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """Copies the data. As a user would do, it renames the keys of the LiDARs in the input files."""
    copy = Path(shutil.copytree(V0_3, tmp_path / "v0_3"))
    for name in ("turning", "rosette"):
        file = copy / f"inputs/{name}.yaml"
        text = file.read_text()
        for key, current in RENAMED_KEYS.items():
            text = text.replace(key, current)
        file.write_text(text)
    return copy


def simulated(old: Path, infrasim: Infrasim, frames: str, *more: object) -> object:
    lidars = [old / f"inputs/{name}.yaml" for name in ("turning", "rosette")]
    words = ["run", old / "inputs/site.yaml", "--set", "duration_s=2", "--lidar", *lidars]
    return infrasim(*words, "--frames", frames, "--out", old / "data", *more)


# A folder of version 0.3


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("turning", "pattern.spinning.seam_deg: expected cut_angle_deg, "),
        ("rosette", "pattern.wedges: expected prisms, "),
    ],
)
def test_the_current_name_of_a_key_of_an_input_is_named(
    name: str, message: str, infrasim: Infrasim
) -> None:
    result = infrasim("check", V0_3 / f"inputs/{name}.yaml", "--preset", "datasheet")
    assert result.returncode == 2
    assert message in result.stderr


def test_a_folder_takes_more_frames_and_keeps_those_it_has(
    old: Path, infrasim: Infrasim, digests: Callable[[Path], dict[str, str]]
) -> None:
    before = digests(old / "data")
    result = simulated(old, infrasim, "0:20:5")
    assert result.returncode == 0, result.stderr
    assert digests(old / "data") == before
    assert simulated(old, infrasim, "1:3").returncode == 0
    after = digests(old / "data")
    assert {name: after[name] for name in before} == before
    assert "turning/training/velodyne/000002.bin" in after


def test_its_frames_are_the_bytes_of_now(
    old: Path, infrasim: Infrasim, digests: Callable[[Path], dict[str, str]]
) -> None:
    before, clouds = digests(old / "data"), clouds_of(old / "data")
    for file in (old / "data").glob("*/training/*/*"):
        file.unlink()
    assert simulated(old, infrasim, "0:20:5").returncode == 0
    after = digests(old / "data")
    assert [name for name in before if name not in clouds and before[name] != after[name]] == []
    # Embree takes the processor's instruction set, on which the last bit of a coordinate depends.
    for name, points in clouds_of(old / "data").items():
        np.testing.assert_allclose(points, clouds[name], rtol=0, atol=1e-5)
    assert after.keys() == before.keys()


def clouds_of(folder: Path) -> dict[str, Points]:
    """Returns the points of each cloud of a data set by the path of its file."""
    files = sorted(folder.glob("*/training/velodyne/*.bin"))
    return {str(file.relative_to(folder)): kitti.read_points(file) for file in files}


def test_keys_of_a_folder_have_their_current_names() -> None:
    mount = kitti.read_written_keys(V0_3 / "fused/north/dataset.yaml")["mounts"]["north"]
    assert mount["own_random_stream"] is True
    assert "own_draws" not in mount


def test_a_fused_folder_is_resumed(
    old: Path, infrasim: Infrasim, digests: Callable[[Path], dict[str, str]]
) -> None:
    words = ["run", old / "inputs/two_poles.yaml", "--lidar", old / "inputs/rosette.yaml"]
    before = digests(old / "fused")
    result = infrasim(*words, "--frames", "1:2", "--fuse", "--out", old / "fused")
    assert result.returncode == 0, result.stderr
    assert digests(old / "fused") == before
    result = infrasim(*words, "--frames", "0:2", "--fuse", "--out", old / "fused")
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("line", "of_now", "goes_on"),
    [
        ('version: "0.3.0"', 'version: "0.3.1"', True),
        ('version: "0.3.0"', 'version: "4.0.0"\nframes_version: 3', True),
        ('version: "0.3.0"', 'version: "0.3.0"\nframes_version: 4', False),
        ('version: "0.3.0"', 'version: "0.2.0"', False),
        ('version: "0.3.0"', 'version: "4.0.0"', False),
        ("detail: low", "detail: mid", False),
    ],
)
def test_a_folder_is_another_by_the_number_of_its_frames_and_not_by_the_release(
    line: str, of_now: str, goes_on: bool, old: Path, infrasim: Infrasim
) -> None:
    file = old / "data/dataset.yaml"
    file.write_text(file.read_text().replace(line, of_now))
    result = simulated(old, infrasim, "0:20:5")
    assert result.returncode == (0 if goes_on else 1), result.stderr
    assert goes_on or f"{file}:" in result.stderr


def test_a_folder_whose_frames_have_changed_since_takes_no_more(
    old: Path, infrasim: Infrasim
) -> None:
    file, rainy = old / "data/dataset.yaml", ("--set", "weather.rain_mm_per_h=2")
    file.write_text(file.read_text().replace("rain_mm_per_h: 0", "rain_mm_per_h: 2"))
    frames = sorted((old / "data").rglob("*.bin"))
    refused = simulated(old, infrasim, "1:3", *rainy)
    assert refused.returncode == 1
    assert f"{file}: " in refused.stderr
    assert "rain or fog: simulate again" in refused.stderr
    assert sorted((old / "data").rglob("*.bin")) == frames
    file.write_text(file.read_text() + "frames_version: 3\n")  # later versions write this key
    assert simulated(old, infrasim, "1:3", *rainy).returncode == 0


def test_a_folder_takes_no_lidar_whose_frames_have_changed_since(
    old: Path, infrasim: Infrasim
) -> None:
    file, beam = old / "inputs/turning.yaml", "beam: {vertical_deg: 8, horizontal_deg: 0.1}"
    file.write_text(file.read_text().replace("returns: {", f"returns: {{{beam}, "))
    refused = simulated(old, infrasim, "1:3")
    assert refused.returncode == 1
    assert "a beam wider than 0.28 degrees, got 0.3.0; simulate turning again" in refused.stderr


def test_it_is_validated_evaluated_and_stressed(
    old: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = old / "data/turning", old / "predictions"
    assert main.main(["validate", str(folder)]) == 0
    run = ["train", str(old / "inputs/untrained.yaml"), str(folder), "--tier", "smoke"]
    assert main.main([*run, "--out", str(old / "model")]) == 0
    assert main.main(["detect", str(folder), "--model", str(old / "model"), "--out", str(out)]) == 0
    words = ["evaluate", str(folder), str(out), "--out", str(old / "ap")]
    assert main.main(words) == 0
    assert "vehicle" in capsys.readouterr().out
    assert replicates.versions_of(read_ground_truth(folder, [15])) == ("3", "0.3.0")
    base = altered_scenes.read_base(folder, 10)
    assert altered_scenes.check(base, altered_scenes.tilt(base, 1.0)) is None


# Rows of results of version 0.3


def test_a_row_of_results_is_resumed_and_nothing_runs_again(
    old: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["benchmark", str(old / "inputs/small.yaml"), "--tier", "smoke", "--jobs", "1"]
    words += ["--out", str(old / "results"), "--work", str(old / "work")]
    before = (old / "results/smoke.csv").read_bytes()
    assert main.main([*words, "--dry-run"]) == 0
    assert "stale" not in capsys.readouterr().out
    assert main.main(words) == 0
    assert (old / "results/smoke.csv").read_bytes() == before
    assert not (old / "work/data").exists()


def test_a_row_of_results_is_a_pair_with_one_of_now(old: Path) -> None:
    out = old / "of_now"
    words = ["benchmark", str(old / "inputs/small.yaml"), "--tier", "smoke", "--jobs", "1"]
    assert main.main([*words, "--out", str(out), "--work", str(old / "work")]) == 0
    rows = {name: store.read(old / name / "smoke_replicates.csv") for name in ("results", "of_now")}
    of_now = rows["of_now"]
    known = of_now.measure.isin(rows["results"].measure)  # rows of 0.3 have only these measures
    rows["of_now"] = of_now[known & (of_now.ground_truth != "present")]
    # as in a table to which a later version adds rows
    both = pd.concat(rows.values(), ignore_index=True)
    both.to_csv(old / "both.csv", index=False)
    both = store.read(old / "both.csv")
    both.loc[both.index >= len(rows["results"]), "version"] = "4.0.0"
    rest = zip(both.index[: len(rows["results"])], both.index[len(rows["results"]) :], strict=True)
    for a, b in rest:
        difference = replicates.difference(both.loc[a], both.loc[b], ("measure", "ground_truth"))
        assert abs(difference.value) < 5  # since 0.3, Background finds its ground in another way
        assert np.isfinite(difference.replicates).all()
    other = both.loc[0].copy()
    other["version"] = "0.2.0"
    assert not replicates.are_pairs(both.loc[0], other)
    later = both.iloc[-1].copy()
    later["frames_version"] = "4"
    assert not replicates.are_pairs(both.loc[0], later)


def test_digests_of_inputs_recipes_and_rows_of_stress_are_those_of_0_3(old: Path) -> None:
    inputs.resolved.cache_clear()
    row = store.read(V0_3 / "results/smoke.csv").iloc[0]
    table = inputs.digests(read_plan(old / "inputs/small.yaml", "smoke"))
    assert table.inputs.to_list() == [row.inputs]
    recipes = {
        name: read_recipe(V0_3 / f"inputs/{name}.yaml", "smoke") for name in DIGESTS["recipes"]
    }
    assert {name: recipe_digest(one) for name, one in recipes.items()} == DIGESTS["recipes"]
    run = trials.TrainedRun(V0_3 / "run", "pointpillars", 2, 1)
    base = altered_scenes.read_base(V0_3 / "data/turning", 10)
    trial = trials.Trial(run, run, NONE, NONE.severities[0])
    assert trials.inputs_of(trial, base) == DIGESTS["stress"]


def test_a_raised_number_of_frames_makes_rows_others(
    old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = read_plan(old / "inputs/small.yaml", "smoke")
    real = inputs.infrasim
    monkeypatch.setattr(
        inputs,
        "infrasim",
        lambda *words: real(*words).replace("frames_version: 3", "frames_version: 4"),
    )
    inputs.resolved.cache_clear()
    row = store.read(V0_3 / "results/smoke.csv").iloc[0]
    assert inputs.digests(plan).inputs.item() != row.inputs
    inputs.resolved.cache_clear()


# A checkpoint of version 0.3


def test_a_training_goes_on_with_its_optimisers_state(old: Path) -> None:
    load_file = pytest.importorskip("safetensors.torch").load_file
    last = old / "run/last.safetensors"
    before = load_file(last)
    words = [
        "train",
        str(old / "inputs/learner.yaml"),
        "--tier",
        "smoke",
        "--out",
        str(old / "run"),
    ]
    assert main.main([words[0], words[1], str(old / "data/turning"), *words[2:]]) == 0
    after = load_file(last)
    steps = {key: float(value) for key, value in after.items() if key.endswith(".step")}
    assert set(steps.values()) == {4.0}
    assert {float(before[key]) for key in steps} == {2.0}
    assert after.keys() == before.keys()
    log = pd.read_csv(old / "run/log.csv")
    assert log.step.to_list() == [1, 2, 3, 4]
    assert log.loss[:2].to_list() == pd.read_csv(V0_3 / "run/log.csv").loss.to_list()


def test_a_checkpoint_detects_and_so_does_the_shipped_model() -> None:
    pytest.importorskip("torch")
    cloud = [frame_file(V0_3 / "data/turning", "velodyne", 15)]
    for model in (V0_3 / "run", Path("generalist")):
        detector = detect.detector_at(model, V0_3 / "data/turning")
        assert len(detect.detect(detector, cloud, None)[0]) == 1


# Renamed keys


@dataclass(frozen=True)
class Part:
    rate: float = 0.5


@dataclass(frozen=True)
class OfNow:
    """Like `Then` of version 0.3, with a renamed key and a new key."""

    part: Part = dataclasses.field(default_factory=Part)
    step: int = 1
    width_m: float = 2.0
    late: bool = False


@dataclass(frozen=True)
class Then:
    part: Part = dataclasses.field(default_factory=Part)
    steps: int = 1
    width_m: float = 2.0


def test_a_key_with_another_name_keeps_the_identity_of_a_row(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(config, "RENAMED", {"OfNow.step": "steps"})
    monkeypatch.setattr(config, "LATER", frozenset({"late"}))
    then, now = Then(Part(0.25), 7), OfNow(Part(0.25), 7)
    assert canonical(now) == canonical(then) == as_plain(then)
    assert as_plain(now) != as_plain(then)
    assert from_plain(as_plain(then), OfNow, "run.yaml") == now
    assert from_plain(as_plain(now), OfNow, "run.yaml") == now
    assert canonical(dataclasses.replace(now, late=True)) != canonical(then)
    with pytest.raises(config.ConfigError, match="step: expected the key once, got it twice"):
        from_plain({"step": 1, "steps": 1}, OfNow, "run.yaml")


@pytest.mark.parametrize(
    "file",
    ["data/dataset.yaml", "data/turning/lidar.yaml", "data/rosette/lidar.yaml",
     "fused/south/dataset.yaml", "fused/fused/dataset.yaml", "fused/fused/rosette/lidar.yaml"],
)  # fmt: skip
def test_a_file_of_0_3_has_the_canonical_names(file: str, infrasim: Infrasim) -> None:
    text = (V0_3 / file).read_text()
    result = infrasim("check", V0_3 / file, "--canonical")
    assert result.stderr == ""
    kept = text.split("\npreset: ")[0] if "dataset" in file else text
    assert result.stdout.startswith(kept)
    assert result.stdout.endswith("frames_version: 3\n" if "dataset" in file else text[-20:])
