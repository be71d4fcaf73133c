"""A folder, a row of results and a checkpoint of version 0.3 are read and compared.

Version 0.3.0 wrote the files in tests/data/v0_3. They can be read after a new release and after a
key is renamed. Their frames have the number 3, so no frames and rows can be added to them.
"""

import dataclasses
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from pyinfra.cli import main
from pyinfra.core import config
from pyinfra.core.config import as_plain, canonical, from_plain
from pyinfra.core.errors import Error
from pyinfra.dataset.frames_version import written_versions
from pyinfra.experiments import store
from pyinfra.experiments.benchmark import inputs
from pyinfra.experiments.benchmark.matrix import read_plan
from pyinfra.experiments.benchmark.provenance import recipe_digest
from pyinfra.experiments.stress import altered_scenes, trials
from pyinfra.experiments.stress.stressors import NONE, STRESSORS
from pyinfra.formats import kitti
from pyinfra.formats.kitti import frame_file
from pyinfra.metrics import replicates
from pyinfra.models.inference import detect
from pyinfra.models.training.provenance import read_provenance
from pyinfra.models.training.recipe import read_recipe

Infrasim = Callable[..., object]
V0_3 = Path(__file__).resolve().parents[1] / "data/v0_3"
V0_3_ROWS, V0_3_REPLICATES = V0_3 / "results/smoke.csv", V0_3 / "results/smoke_draws.csv"
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


def test_a_folder_takes_no_more_frames(
    old: Path, infrasim: Infrasim, digests: Callable[[Path], dict[str, str]]
) -> None:
    before, file = digests(old / "data"), old / "data/dataset.yaml"
    for frames in ("0:20:5", "1:3"):  # with and without the frames of the folder
        result = simulated(old, infrasim, frames)
        assert result.returncode == 1
        assert f"{file}:" in result.stderr
        assert "frames_version: expected 4, got 3: simulate again" in result.stderr
    assert digests(old / "data") == before


def test_keys_of_a_folder_have_their_current_names() -> None:
    mount = kitti.read_written_keys(V0_3 / "fused/north/dataset.yaml")["mounts"]["north"]
    assert mount["own_random_stream"] is True
    assert "own_draws" not in mount


def test_a_fused_folder_takes_no_more_frames(
    old: Path, infrasim: Infrasim, digests: Callable[[Path], dict[str, str]]
) -> None:
    words = ["run", old / "inputs/two_poles.yaml", "--lidar", old / "inputs/rosette.yaml"]
    before = digests(old / "fused")
    result = infrasim(*words, "--frames", "1:2", "--fuse", "--out", old / "fused")
    assert result.returncode == 1
    assert "frames_version: expected 4, got 3" in result.stderr
    assert digests(old / "fused") == before


@pytest.mark.parametrize(
    ("line", "of_now", "goes_on"),
    [
        ("version:", "version:", True),
        ("version:", "version: 0.6.0  #", True),
        ("frames_version:", "frames_version: 3  #", False),
        ("frames_version:", "# frames_version:", False),
        ("detail: low", "detail: mid", False),
    ],
)
def test_a_folder_is_another_by_the_number_of_its_frames_and_not_by_the_release(
    line: str, of_now: str, goes_on: bool, old: Path, infrasim: Infrasim
) -> None:
    shutil.rmtree(old / "data")
    assert simulated(old, infrasim, "0:20:10").returncode == 0
    file = old / "data/dataset.yaml"
    file.write_text(re.sub(f"(?m)^( *){line}", rf"\1{of_now}", file.read_text()))
    result = simulated(old, infrasim, "0:20:5")
    assert result.returncode == (0 if goes_on else 1), result.stderr
    assert goes_on or f"{file}:" in result.stderr


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
    assert written_versions(folder) == ("3", "0.3.0")
    base = altered_scenes.read_base(folder, 10)
    assert STRESSORS["drop_out"].lacks(base) == ""
    assert "expected 4 for stressors that change more than clouds, got 3" in STRESSORS[
        "tilt"
    ].lacks(base)


# Rows of results of version 0.3


def test_a_row_of_results_is_one_of_other_frames(
    old: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["benchmark", str(old / "inputs/small.yaml"), "--tier", "smoke", "--jobs", "1"]
    words += ["--out", str(old / "results"), "--work", str(old / "work")]
    before = (old / "results/smoke.csv").read_bytes()
    assert main.main(words) == 2
    assert "smoke_hits.csv: site datasheet turning: expected" in capsys.readouterr().err
    assert (old / "results/smoke.csv").read_bytes() == before
    assert not (old / "work/data").exists()


def test_a_row_of_results_is_no_pair_with_one_of_other_frames() -> None:
    first, second = (row for _, row in store.read(V0_3_REPLICATES).iloc[:2].iterrows())
    replicates.check_pair(first, second)
    other = second.copy()
    other["version"] = "0.2.0"
    with pytest.raises(Error, match="frames_version"):
        replicates.check_pair(first, other)
    later = second.copy()
    later["version"] = "4.0.0"
    later["frames_version"] = "3"
    replicates.check_pair(first, later)
    later["frames_version"] = "4"
    with pytest.raises(Error, match="frames_version"):
        replicates.check_pair(first, later)


def test_digests_differ_from_those_of_0_3_by_the_number_of_the_frames(
    old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, row = read_plan(old / "inputs/small.yaml", "smoke"), store.read(V0_3_ROWS).iloc[0]
    inputs.resolved.cache_clear()
    assert inputs.digests(plan).inputs.item() != row.inputs
    real = inputs.infrasim
    monkeypatch.setattr(
        inputs, "infrasim", lambda *words: real(*words).removesuffix("frames_version: 4\n")
    )
    inputs.resolved.cache_clear()
    assert inputs.digests(plan).inputs.item() == row.inputs
    inputs.resolved.cache_clear()
    recipes = {
        name: read_recipe(V0_3 / f"inputs/{name}.yaml", "smoke") for name in DIGESTS["recipes"]
    }
    assert {name: recipe_digest(one) for name, one in recipes.items()} == DIGESTS["recipes"]
    run = trials.TrainedRun(V0_3 / "run", "pointpillars", 2, 1)
    base = altered_scenes.read_base(V0_3 / "data/turning", 10)
    assert base.identity.endswith("\nframes_version: 3")
    vars(base)["identity"] = base.identity.removesuffix("\nframes_version: 3")
    trial = trials.Trial(run, run, NONE, NONE.severities[0])
    assert trials.inputs_of(trial, base) == DIGESTS["stress"]


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
    assert read_provenance(last).frames_version == "3"
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
