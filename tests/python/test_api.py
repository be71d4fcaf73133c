"""The public API: frames in memory, detections as a table, and the same results as from disk."""

from __future__ import annotations

import doctest
import inspect
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import report_data
import yaml

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.object_rows import BOX
from pyinfra.dataset.prediction_origin import origin_of
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.metrics.settings import Settings
from pyinfra.models.detectors.detection_area import REGION_MARGIN_M
from pyinfra.models.inference import boxes_table
from pyinfra.models.training.accumulation import Accumulation
from pyinfra.viz.report.report_data import Run
from pyinfra.viz.report.sections import pictures

ROOT = Path(__file__).resolve().parents[2]
SHORT = {"duration_s": 6, "traffic.warm_up_s": 20}
NUMBERS = range(0, 60, 6)
Infrasim = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def frames() -> SimulatedFrames:
    return pi.simulate(pi.load_scene("highway", seed=1, set=SHORT), "helios_16", NUMBERS)


@pytest.fixture(scope="module")
def noisy(frames: FrameSequence) -> pd.DataFrame:
    """Returns boxes of the labels, of which some are displaced, and some boxes without a
    vehicle."""
    rng = np.random.default_rng(1)
    table = frames.labels[["frame", "type", *BOX]].copy()
    table["score"] = rng.uniform(0.1, 1, len(table))
    table.loc[rng.random(len(table)) < 0.3, "x"] += 3
    return table


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes the same frames to disk."""
    return write_frames(tmp_path_factory.mktemp("api") / "highway", "--frames", "0:60:6")


def write_frames(out: Path, *options: str) -> Path:
    scene = ROOT / "configs/scenes/highway.yaml"
    lidar = ROOT / "configs/lidars/helios_16.yaml"
    words = ["run", scene, "--lidar", lidar, "--preset", "datasheet", *options]
    sets = [word for key, value in SHORT.items() for word in ("--set", f"{key}={value}")]
    command = [ROOT / ".venv/bin/infrasim", *words, "--seed", "1", *sets, "--out", out]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return out / "helios_16"


def test_points_in_memory_are_those_on_disk(frames: FrameSequence, written: Path) -> None:
    recorded = pi.load_dataset(written)
    assert isinstance(recorded, FrameSequence)
    assert recorded.numbers == frames.numbers
    for ours, theirs in zip(frames, recorded, strict=True):
        np.testing.assert_array_equal(ours.points, theirs.points)


def test_fields_in_memory_are_those_on_disk(
    frames: FrameSequence, written: Path, tmp_path: Path
) -> None:
    with_fields = pi.load_dataset(write_frames(tmp_path, "--frames", "6:7", "--fields"))
    assert isinstance(with_fields, FrameSequence)
    ours, theirs = frames[1].fields, with_fields[0].fields
    assert ours is not None
    assert theirs is not None
    assert len(ours) == len(frames[1].points)
    assert ours.tobytes() == theirs.tobytes()
    without_fields = pi.load_dataset(written)
    assert isinstance(without_fields, FrameSequence)
    assert without_fields[1].fields is None


def test_labels_in_memory_are_those_on_disk(frames: FrameSequence, written: Path) -> None:
    recorded = pi.load_dataset(written)
    assert isinstance(recorded, FrameSequence)
    pd.testing.assert_frame_equal(frames.labels, recorded.labels, atol=2e-3, rtol=0)


def test_evaluation_in_memory_is_that_on_disk(
    frames: FrameSequence, written: Path, noisy: pd.DataFrame
) -> None:
    settings = pi.Settings(ground_truths=("captured", "all", "present"))
    ours = pi.evaluate(frames, noisy, settings)
    theirs = pi.evaluate(written, noisy, settings)
    pd.testing.assert_frame_equal(ours.ap, theirs.ap, atol=0.01, rtol=0)
    pd.testing.assert_frame_equal(ours.by_distance, theirs.by_distance, atol=0.01, rtol=0)
    assert pi.compare(ours, theirs).value == pytest.approx(0, abs=0.01)


def test_matches_count_every_prediction_and_every_object(
    frames: FrameSequence, noisy: pd.DataFrame
) -> None:
    result = pi.evaluate(frames, noisy)
    count = result.matches.outcome.value_counts()
    vehicles = noisy[~noisy.type.isin(["Pedestrian", "Cyclist"])]
    assert len(result.matches) - count.get("missed", 0) == len(vehicles)
    objects = result.ap.set_index("ground_truth").objects["captured"]
    assert count["true positive"] + count.get("missed", 0) == objects


def test_distance_is_that_from_the_sensor(frames: FrameSequence) -> None:
    """Only boxes beyond 58 m are predicted. AP is 0 in the rings up to 40 m, and 100 in the rings
    from 60 m."""
    labels = frames.labels
    far = labels[np.hypot(labels.x, labels.y) > 58].assign(score=1.0)
    rings = pi.evaluate(frames, far).by_distance.query("ground_truth == 'captured'")
    rings = rings[rings.objects > 0].set_index("distance_m").ap_r1000
    assert (rings[rings.index < 40] == 0).all()
    assert (rings[rings.index > 60] == 100).all()


def test_a_callable_is_a_detector(frames: FrameSequence) -> None:
    """The detector returns one box of a car at a position with points. It has only the required
    columns."""

    def nearest(points: np.ndarray[Any, Any]) -> pd.DataFrame:
        x, y, z = points[0, :3].astype(float)
        return pd.DataFrame([[x, y, z, 4.0, 2.0, 1.5, 0.0]], columns=BOX)

    table = pi.detect(nearest, frames)
    assert table.frame.tolist() == list(frames.numbers)
    assert set(table.type) == {"vehicle"}
    assert set(table.score) == {1.0}


@pytest.mark.parametrize("name", ["openpcdet", "mmdet3d", "pcd", "nuscenes", "openlabel"])
def test_an_export_from_memory_is_that_from_disk(
    frames: FrameSequence,
    written: Path,
    tmp_path: Path,
    name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The files are equal, except that a build may have another version than the binary."""
    description = yaml.safe_load((written.parent / "dataset.yaml").read_text())
    versions = (str(description["frames_version"]), description["version"])
    monkeypatch.setattr(SimulatedFrames, "versions", versions)
    ours, theirs = pi.export(frames, name, tmp_path / "ours"), tmp_path / "theirs"
    with_fields = write_frames(tmp_path / "data", "--frames", "0:60:6", "--fields")
    pi.export(with_fields, name, theirs)
    shutil.rmtree(tmp_path / "data")
    files = [path.relative_to(theirs) for path in sorted(theirs.rglob("*")) if path.is_file()]
    assert files == [p.relative_to(ours) for p in sorted(ours.rglob("*")) if p.is_file()]
    for file in files:
        assert (ours / file).read_bytes() == (theirs / file).read_bytes(), file
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ours", "theirs"]


def test_training_warns_of_labels_that_no_class_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pyinfra.models.training import sources, train

    source = SimpleNamespace(read_warning=lambda: "3 of Tricycle")
    monkeypatch.setattr(sources, "read_source", lambda *_, **__: source)
    monkeypatch.setattr(train, "train", lambda *_, **__: tmp_path)
    monkeypatch.setattr(boxes_table, "load_detector", lambda *_, **__: None)
    with pytest.warns(UserWarning, match="other-types: 3 of Tricycle") as caught:
        pi.train("background", tmp_path, work=tmp_path)
    assert caught[0].filename == __file__


def test_what_stands_goes(frames: FrameSequence) -> None:
    """A box that recurs where nothing moves is left out. The command warns that the recording is
    short."""

    def rail(points: np.ndarray[Any, Any]) -> pd.DataFrame:
        return pd.DataFrame([[25.0, 19.5, -7.0, 4.5, 1.9, 1.6, 0.0]], columns=BOX)

    assert len(pi.detect(rail, frames)) == len(frames)
    with pytest.warns(UserWarning, match="drop_standing: expected .*got 5.4 s"):
        assert len(pi.detect(rail, frames, drop_standing=True)) == 0


def test_a_height_that_the_road_does_not_have_is_warned_of(written: Path) -> None:
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    known = -float(pi.load_dataset(written).ground.height(np.zeros((1, 2)))[0])
    with pytest.warns(UserWarning, match=f"`height_m` is {known - 1:g} m, but the road"):
        pi.detect("generalist", pi.load_dataset(written)[:1], height_m=known - 1)


def test_a_region_is_where_vehicles_are_looked_for(frames: FrameSequence) -> None:
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    everywhere = pi.detect("generalist", frames[:2])
    behind = [[-40.0, -30.0], [0.0, -30.0], [0.0, 30.0], [-40.0, 30.0]]
    within = pi.detect("generalist", frames[:2], region=behind)
    assert everywhere.x.max() > 15
    assert within.x.max() <= REGION_MARGIN_M  # boxes are kept up to this distance
    assert len(within) > 0
    corner = pi.detect("generalist", frames[:2], region=[*behind[:2], behind[3]])
    assert 0 < len(corner) < len(within)  # a triangle of the same extent


def test_frames_are_stacked_as_the_model_learnt(
    frames: FrameSequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The previous frame is taken from the scene, although it is not in the sequence."""
    two = Accumulation(2)
    monkeypatch.setattr("pyinfra.models.inference.detect.accumulation_of", lambda _: two)
    (cloud,) = boxes_table._stacked(Path("model"), frames[1:2])
    now, before = frames.frame(6).points, frames.frame(5).points
    assert cloud.shape == (len(now) + len(before), 5)
    assert sorted(set(cloud[:, 4].tolist())) == pytest.approx([0, 0.1])


def test_several_lidars_share_a_scene() -> None:
    both = pi.simulate(
        pi.load_scene("highway", set=SHORT), ["helios_16", "livox_avia"], range(0, 20, 10)
    )
    assert list(both) == ["helios_16", "livox_avia"]
    perfect = both["helios_16"].labels.assign(score=1.0)
    settings = pi.Settings(ground_truths=("common",))
    assert pi.evaluate(both["helios_16"], perfect, settings).ap.objects.iloc[0] > 0


def test_common_needs_several_lidars(frames: FrameSequence, noisy: pd.DataFrame) -> None:
    settings = pi.Settings(ground_truths=("common",))
    with pytest.raises(pi.Error, match="common"):
        pi.evaluate(frames, noisy, settings)


def test_a_slice_is_a_sequence(frames: FrameSequence) -> None:
    part = frames[2:5]
    assert isinstance(part, FrameSequence)
    assert part.numbers == frames.numbers[2:5]
    np.testing.assert_array_equal(part[0].points, frames[2].points)


def test_an_empty_slice_has_no_labels_and_is_not_evaluated(
    frames: FrameSequence, noisy: pd.DataFrame, written: Path
) -> None:
    for sequence in (frames, pi.load_dataset(written)):
        assert isinstance(sequence, FrameSequence)
        none = sequence[:0]
        assert none.labels.columns.tolist() == frames.labels.columns.tolist()
        assert len(none.labels) == len(none.objects) == 0
        with pytest.raises(pi.Error, match="expected one or more frames to evaluate, got none"):
            pi.evaluate(none, noisy[:0])


def test_the_order_of_the_frames_does_not_matter(
    frames: FrameSequence, noisy: pd.DataFrame
) -> None:
    backwards = pi.evaluate(frames[::-1], noisy[::-1])
    pd.testing.assert_frame_equal(backwards.ap, pi.evaluate(frames, noisy).ap)


def test_results_of_other_frames_are_not_compared(
    frames: FrameSequence, noisy: pd.DataFrame
) -> None:
    whole = pi.evaluate(frames, noisy)
    part = pi.evaluate(frames[:5], noisy[noisy.frame < 30])
    with pytest.raises(pi.Error, match="compare"):
        pi.compare(whole, part)
    with pytest.raises(pi.Error, match="compare"):
        pi.compare([whole], [whole])


@pytest.mark.parametrize(
    "other",
    [
        Settings(ious=(0.7,)),
        Settings(metrics=("3d",)),
        Settings(metrics=("centre",)),
        Settings(min_points=20),
        Settings(classes={"vehicle": ("Truck", "Bus")}),
    ],
)
def test_results_of_other_settings_are_not_compared(
    frames: FrameSequence, noisy: pd.DataFrame, other: Settings
) -> None:
    result = pi.evaluate(frames, noisy, other)
    assert pi.compare(result, result).value == 0
    with pytest.raises(pi.Error, match="expected the same"):
        pi.compare(pi.evaluate(frames, noisy), result)


def test_frames_are_plotted_from_above(frames: FrameSequence, noisy: pd.DataFrame) -> None:
    ax = pi.plot_frame(frames[0], noisy, min_score=0.0)
    assert len(ax.collections) == 3
    assert len(ax.collections[1].get_paths()) == len(frames[0].labels)


IMPORT = """
import sys
calls = []
sys.addaudithook(lambda event, _: calls.append(event) if event == "subprocess.Popen" else None)
import pyinfra
assert not {"torch", "pandas", "numpy", "matplotlib"} & set(sys.modules)
assert not calls
"""


def test_import_is_light_and_starts_no_process() -> None:
    done = subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")


IN_MEMORY = """
import sys
import pyinfra as pi
written = []
def watch(event, arguments):
    if event == "open" and isinstance(arguments[1], str) and set(arguments[1]) & set("wax+"):
        written.append(arguments[0])
    if event in ("subprocess.Popen", "os.system", "os.fork", "os.mkdir"):
        written.append(event)
scene = pi.load_scene("highway", set={"duration_s": 2, "traffic.warm_up_s": 5})
frames = pi.simulate(scene, "helios_16", range(0, 20, 10))
import matplotlib, matplotlib.pyplot, torch, pyinfra.models.detectors.centerpoint_pillar
pi.plot_scene(scene)
sys.addaudithook(watch)
result = pi.evaluate(frames, pi.detect("generalist", frames))
result.by_distance, result.matches, pi.compare(result, result)
pi.plot_scene(scene), pi.plot_frame(frames[0]), pi.plot_ap_by_distance(result)
pi.recommend(sys.argv[1], scene="highway")
assert not written, written
"""


def test_nothing_is_written_and_no_process_started(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    results = report_data.write(tmp_path / "results", report_data.tables())
    command = [sys.executable, "-c", IN_MEMORY, str(results)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr


FUNCTIONS = [name for name in pi.__all__ if inspect.isfunction(getattr(pi, name))]


@pytest.fixture(scope="module")
def example_results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("example")
    pi.benchmark("example", folder / "out", work=folder / "work", tier="smoke")
    return folder / "out"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_examples_of_docstrings_hold(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name in ("recommend", "report"):  # the benchmark that these begin with has an example too
        results = request.getfixturevalue("example_results")
        monkeypatch.setattr(pi, "benchmark", lambda _, out, **__: shutil.copytree(results, out))
    if name == "import_map":
        pytest.importorskip("sumo", reason="Eclipse SUMO is not installed: extra `site`")
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner()
    printed: list[str] = []
    for test in finder.find(getattr(pi, name), name):
        runner.run(test, out=printed.append)
    assert runner.failures == 0, "".join(printed)
    assert runner.tries > 0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_docstring_says_what_goes_in_and_out(name: str) -> None:
    """Docstrings have numpydoc's sections, and name each argument."""
    text = inspect.getdoc(getattr(pi, name)) or ""
    parts = re.split(r"\n(\w+)\n-+\n", text)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    assert list(sections) == ["Parameters", "Returns", "Raises", "Examples"]
    assert parts[0].splitlines()[0].endswith(".")
    named = re.findall(r"^(\w+(?:, \w+)*) : ", sections["Parameters"], re.MULTILINE)
    listed = [word for words in named for word in words.split(", ")]
    assert listed == list(inspect.signature(getattr(pi, name)).parameters)


def test_predictions_of_other_frames_or_another_model_are_refused(
    written: Path, tmp_path: Path
) -> None:
    """`pyinfra detect` writes origin.yaml, which names the LiDAR and the data set."""
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    out = tmp_path / "pred"
    words = ["detect", str(written), "--model", "generalist", "--out", str(out)]
    assert main.main(words) == 0
    assert not [f for f in pi.evaluate(written, out).findings if f.name == "origin"]
    other = Path(shutil.copytree(written.parent, tmp_path / "other"))
    text = (other / "dataset.yaml").read_text()
    (other / "dataset.yaml").write_text(text.replace("seed: 1", "seed: 2"))
    with pytest.raises(pi.Error, match=r"origin.yaml: seed: expected 2, got 1"):
        pi.evaluate(other / "helios_16", out)
    assert main.main(["detect", str(other / "helios_16"), *words[2:]]) == 2
    origin = (out / "origin.yaml").read_text()
    assert "model: generalist\n" in origin
    (out / "origin.yaml").write_text(origin.replace("model_sha256: ", "model_sha256: 0"))
    assert main.main(words) == 2
    (out / "origin.yaml").unlink()
    assert [f for f in pi.evaluate(written, out).findings if f.name == "origin"]
    (out / "999999.txt").touch()  # a file of another tool, so the folder's origin is uncertain
    assert main.main(words) == 0
    assert not (out / "origin.yaml").exists()


def test_whatever_reads_predictions_refuses_those_of_another_lidar(
    written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run/predictions"
    out.mkdir(parents=True)
    for number in pi.load_dataset(written).numbers:
        (out / f"{number:06d}.txt").touch()
    (out / "origin.yaml").write_text("lidar: livox_avia\n")
    message = "origin.yaml: lidar: expected helios_16, got livox_avia: "
    folder, pred = str(written), str(out)
    to = str(tmp_path / "to")
    for words in (
        ["evaluate", folder, pred, "--out", to],
        ["validate", folder, "--pred", pred],
        ["view", folder, "--pred", pred, "--out", f"{to}.html"],
    ):
        assert main.main(words) > 0
        printed = capsys.readouterr()
        assert message in printed.out + printed.err, words
    data = read_data_set(written.parent)
    run = Run(out.parent, data.scene, written.name, data.preset, "x")
    with pytest.raises(pi.Error, match=message):
        pictures._predicted(data, run, data.frames[0])


def test_the_origin_of_frames_is_that_of_their_lidar_but_not_of_its_price(
    written: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(written.parent, tmp_path / "other")) / written.name
    first = origin_of(written)
    file = folder / "lidar.yaml"
    text = file.read_text()
    assert "price_usd:\n" in text
    dearer = re.sub(r"(low|high): [0-9.]+", r"\1: 77", text)
    assert dearer != text
    file.write_text(dearer)
    assert origin_of(folder) == first
    file.write_text(re.sub(r"(range_accuracy_m): .*", r"\1: 0.5", text))
    changed = origin_of(folder)
    assert {key for key in first if first[key] != changed[key]} == {"lidar_sha256"}


def test_a_sequence_on_disk_is_evaluated_as_its_folder(
    written: Path, noisy: pd.DataFrame, tmp_path: Path
) -> None:
    """The result has the warnings of the folder, and ignores predictions of frames that are not
    evaluated."""
    copy = Path(shutil.copytree(written, tmp_path / "copy/helios_16"))  # without roads.csv
    files = tmp_path / "pred"
    files.mkdir()
    for number in NUMBERS:
        rows = noisy[noisy.frame == number].rename(columns={"type": "class"})
        rows.drop(columns="frame").to_csv(files / f"{number:06d}.csv", index=False)
    recorded = pi.load_dataset(copy)
    assert isinstance(recorded, FrameSequence)
    of_files = pi.evaluate(copy, files, frames=recorded.numbers[:5])
    assert {f.name for f in of_files.findings} >= {"no-roads", "outside-split"}
    for result in (
        pi.evaluate(recorded[:5], files),
        pi.evaluate(recorded, files, frames=range(0, 30, 6)),
    ):
        assert result.findings == of_files.findings
        pd.testing.assert_frame_equal(result.ap, of_files.ap)
    of_table = pi.evaluate(copy, noisy)
    assert "no-roads" in {f.name for f in of_table.findings}


def test_a_split_is_of_a_folder(frames: FrameSequence, noisy: pd.DataFrame) -> None:
    with pytest.raises(pi.Error, match="split: expected a LiDAR's folder"):
        pi.evaluate(frames, noisy, split="val")
