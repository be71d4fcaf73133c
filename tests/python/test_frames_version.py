"""Models, predictions, plans and tables name the number of the frames on which they rest."""

import argparse
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset import simulation
from pyinfra.dataset.frames_version import number_at, other_frames
from pyinfra.dataset.prediction_origin import read_origin
from pyinfra.experiments.options import other_frames_of
from pyinfra.experiments.planner.detectability import read_detectability
from pyinfra.metrics.prediction_checks import OTHER_FRAMES
from pyinfra.models.detectors.background import Background
from pyinfra.models.inference.detect import model_file
from pyinfra.models.inference.frames_learnt import learnt_from
from reproduction import ROOT, work_folder
from reproduction.commands import tables as pages
from reproduction.frames_number import FIRST, VERSIONS, sentence
from reproduction.tables import common

NOW = str(simulation.frames_version())
V0_3 = ROOT / "tests/data/v0_3"
VERSION_3 = model_file(Path("generalist-3"))
NOTE = re.compile(r"The frames are from simulator version \d+\.\d+ \(`frames_version` \d+\)")


def recorded_as(data: Path, line: str) -> None:
    """Replaces the number of the frames in a data set's description."""
    file = data / "dataset.yaml"
    file.write_text(re.sub(r"(?m)^frames_version: .*\n", line, file.read_text()))


@pytest.fixture
def data(motorway: Path, tmp_path: Path) -> Path:
    """A LiDAR's folder with three frames."""
    copy = tmp_path / "data"
    shutil.copytree(motorway, copy, ignore=shutil.ignore_patterns("livox*", "ruby*", "pandar*"))
    return copy / "helios_16"


def test_files_without_a_number_rest_on_frames_3() -> None:
    assert learnt_from(VERSION_3) == "3"
    assert learnt_from(V0_3 / "run/last.safetensors") == "3"
    assert number_at(V0_3 / "data/turning") == "3"


def test_the_detector_and_the_laws_of_the_package_rest_on_the_present_frames() -> None:
    assert learnt_from(model_file(Path("generalist"))) == NOW
    assert read_detectability("generalist").frames_version == NOW
    assert read_detectability("background").frames_version == NOW


@pytest.mark.parametrize(
    ("learnt", "used", "differs"),
    [
        ("3", "4", True),
        ("4", "4", False),
        ("3 4", "4", False),
        ("3 4", "5", True),
        ("", "4", False),
        ("3", "", False),
    ],
)
def test_only_known_numbers_that_differ_are_named(learnt: str, used: str, differs: bool) -> None:
    text = other_frames("net", learnt, used)
    assert bool(text) == differs
    assert not differs or all(word in text for word in ("net", used, *learnt.split()))


def test_a_trained_detector_has_the_number_of_its_frames(data: Path, tmp_path: Path) -> None:
    (data / "ImageSets").mkdir()
    (data / "ImageSets/train.txt").write_text("000000\n000001\n")
    file = pi.train("background", data, work=tmp_path / "model").file
    assert learnt_from(file) == NOW
    recorded_as(data.parent, "")  # a description without a number, as that of a recording
    assert number_at(data) == ""
    assert learnt_from(pi.train("background", data, work=tmp_path / "recorded").file) == ""
    Background.load(file).save(tmp_path / "old.npz")
    arrays = dict(np.load(tmp_path / "old.npz"))
    del arrays["frames_version"]
    np.savez_compressed(tmp_path / "old.npz", **arrays)
    assert learnt_from(tmp_path / "old.npz") == "3"


def test_detection_on_frames_of_another_number_warns_once(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["detect", str(data), "--out", str(tmp_path / "boxes"), "--max-frames", "1",
             "--model", "generalist-3"]  # fmt: skip
    assert main.main(words) == 0
    text = "generalist-3: learnt from frames of frames_version 3, used on frames of frames_version "
    text += NOW
    assert capsys.readouterr().err.count(text) == 1
    with pytest.warns(UserWarning, match=text):
        pi.detect("generalist-3", pi.load_dataset(data)[:1])
    assert main.main(["evaluate", str(data), str(tmp_path / "boxes"), "--out",
                      str(tmp_path / "ap"), "--allow-missing"]) == 0  # fmt: skip
    assert capsys.readouterr().err.count(text) == 1


@pytest.mark.parametrize(
    ("line", "model"),
    [("", "generalist"), ("frames_version: 3\n", "generalist-3")],
    ids=["recorded", "its own number"],
)
def test_detection_on_recorded_frames_and_on_frames_of_the_training_does_not_warn(
    line: str, model: str, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded_as(data.parent, line)
    words = ["detect", str(data), "--out", str(tmp_path / "boxes"), "--max-frames", "1"]
    assert main.main([*words, "--model", model]) == 0
    assert "learnt from" not in capsys.readouterr().err
    found = pi.evaluate(data, tmp_path / "boxes", frames=[0]).findings
    assert OTHER_FRAMES not in [finding.name for finding in found]


def test_predictions_of_earlier_versions_are_of_models_of_frames_3(
    data: Path, tmp_path: Path
) -> None:
    out = tmp_path / "boxes"
    assert main.main(["detect", str(data), "--out", str(out), "--max-frames", "1"]) == 0
    origin = read_origin(out)
    assert origin is not None
    assert origin["model_frames_version"] == str(NOW)
    file = out / "origin.yaml"
    file.write_text(re.sub(r"(?m)^model_frames_version: .*\n", "", file.read_text()))
    found = pi.evaluate(data, out, frames=[0]).findings
    assert OTHER_FRAMES in [finding.name for finding in found]


def test_a_recommendation_names_a_detector_of_other_frames() -> None:
    row = pd.Series({"detector": "generalist-as-is", "frames_version": "4"})
    assert other_frames_of(row) == ""  # tables of earlier versions have no number of the detector
    row["learnt_frames_version"] = "3"
    assert (
        "learnt from frames of frames_version 3, used on frames of frames_version 4"
        in other_frames_of(row)
    )


def test_a_working_folder_holds_frames_of_one_number(tmp_path: Path) -> None:
    assert work_folder(str(tmp_path / "new")) == tmp_path / "new"
    (tmp_path / "new/frames").mkdir()
    work_folder(str(tmp_path / "new"))
    (tmp_path / "old/frames").mkdir(parents=True)
    with pytest.raises(argparse.ArgumentTypeError, match=rf"frames_version {NOW}, got .* 3"):
        work_folder(str(tmp_path / "old"))


# The tables of results


def test_each_page_of_results_names_the_frames_below_each_table() -> None:
    results = sorted((ROOT / "docs/results").glob("*.md"))
    results.remove(ROOT / "docs/results/measured.md")  # it lists commands and costs
    assert len(results) > 10
    for page in (ROOT / "README.md", ROOT / "docs/generalist.md", *results):
        found = pages.BLOCK.finditer(page.read_text())
        blocks = [match[4] for match in found if match[2] == "table"]
        assert blocks, page
        for block in blocks:
            assert NOTE.search(block), page


def test_the_present_number_has_a_version() -> None:
    assert int(NOW) in VERSIONS
    assert FIRST in VERSIONS


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Returns a function that writes a table of results with the given numbers of its rows."""
    monkeypatch.setattr(common, "ROOT", tmp_path)
    (tmp_path / "results").mkdir()
    common._read.cache_clear()

    def write(name: str, *numbers: object) -> None:
        columns = {"value": range(len(numbers))}
        table = pd.DataFrame(
            columns if set(numbers) == {None} else {**columns, "frames_version": numbers}
        )
        table.to_csv(tmp_path / f"results/{name}.csv", index=False)
        common._read.cache_clear()

    yield write
    common._read.cache_clear()


def made(*names: str) -> str:
    """Returns a page's table that is made of tables of results."""

    def make() -> str:
        return common.markdown(["rows"], [[str(len(common.results(name)))] for name in names])

    return common.with_frames(make)


def test_a_table_names_the_number_of_its_rows(recorded: Callable[..., None]) -> None:
    for name, numbers, expected in (("old", (None, None), 3), ("new", (4, 4), 4)):
        recorded(name, *numbers)
        assert made(name).endswith(f"| 2 |\n\n{sentence(expected)}\n")
    simulator = "simulator version 0.5 (`frames_version` 4)"
    assert sentence(4) == f"The frames are from {simulator}."


def test_a_table_of_several_numbers_is_refused(recorded: Callable[..., None]) -> None:
    recorded("mixed", 4, 3)
    recorded("resumed", 4, None)
    recorded("old", None)
    recorded("new", 4)
    recorded("lidars", None)  # prices do not depend on frames
    for names in (["mixed"], ["resumed"], ["old", "new"]):
        with pytest.raises(Error, match="frames_version: expected"):
            made(*names)
    assert sentence(4) in made("new", "lidars")


def test_the_index_lists_the_tables_of_each_number(recorded: Callable[..., None]) -> None:
    recorded("old", None)
    assert common.frames_of_results() == (
        "The frames are from simulator version 0.4 (`frames_version` 3).\n"
    )
    recorded("new", 4)
    text = common.frames_of_results()
    assert f"| {sentence(3)} | `old` |" in text
    assert f"| {sentence(4)} | `new` |" in text


def test_laws_of_the_present_frames_need_no_note() -> None:
    law = replace(read_detectability("generalist"), frames_version=NOW)
    assert other_frames("law", law.frames_version, NOW) == ""
