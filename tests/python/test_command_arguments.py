"""Commands pass each of their options to the function of the public API that they call."""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyinfra as pi
from pyinfra.cli.main import main, make_parser
from pyinfra.formats.ply import Triangles, write_ply

OF_PARSER = {"command", "run", "options", "step", "traceback", "completion"}
OF_PARSER.add("boxes_of")  # with it, `import` calls Detections.from_csv
CASES: dict[str, tuple[list[str], Callable[..., Any]]] = {
    "import": (["import", "a", "--out", "b/c"], pi.import_recording),
    "site import": (["site", "import", "a", "--out", "b"], pi.import_map),
    "site mesh": (["site", "mesh", "a.ply", "--out", "b"], pi.import_mesh),
}
# The other commands of the first table in docs/api.md, and words that they need.
SAME = CASES | {
    "split": (["split", "a"], pi.split),
    "statistics": (["statistics", "a", "--out", "b"], pi.statistics),
    "pictures": (["pictures", "a", "--out", "b"], pi.pictures),
    "report": (["report", "a", "--out", "b"], pi.report),
    "recommend": (["recommend", "a", "--budget", "1"], pi.recommend),
    "region": (["region", "a", "--out", "b"], pi.propose_region),
    "onnx": (["onnx", "a", "--out", "b"], pi.export_onnx),
    "site traffic": (["site", "traffic", "a"], pi.simulate_traffic),
    "site draw": (["site", "draw", "a", "--out", "b.svg"], pi.draw_site),
    "sites": (["sites", "--out", "a"], pi.make_sites),
}


@pytest.mark.parametrize("command", SAME)
def test_each_option_is_an_argument_of_the_function(command: str) -> None:
    words, function = SAME[command]
    given = set(vars(make_parser(words).parse_args(words))) - OF_PARSER
    assert given - set(inspect.signature(function).parameters) == set()


@pytest.mark.parametrize(
    ("function", "word", "hint"),
    [
        (pi.evaluate, "ground_truth", "settings=Settings(ground_truths=...)"),
        (pi.evaluate, "min_score", "settings=Settings(min_score=...)"),
        (pi.track, "birth_score", "settings=TrackSettings(birth_score=...)"),
        (pi.plan, "heights_m", "grid=PoseGrid(heights_m=...)"),
    ],
)
def test_a_field_of_settings_is_no_unknown_argument(
    function: Callable[..., Any], word: str, hint: str
) -> None:
    with pytest.raises(pi.Error, match=re.escape(f"got '{word}'; write {hint}")):
        function(**{word: 1})


@pytest.mark.parametrize("command", CASES)
def test_defaults_of_options_are_those_of_the_function(command: str) -> None:
    words, function = CASES[command]
    given = vars(make_parser(words).parse_args(words))
    for name, parameter in inspect.signature(function).parameters.items():
        if name in given and parameter.default is not parameter.empty:
            assert given[name] == parameter.default or not (given[name] or parameter.default)


def test_import_prints_what_the_function_returns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = pi.load_scene("highway", set={"duration_s": 2, "traffic.warm_up_s": 5})
    source = pi.export(pi.simulate(scene, "helios_16", [0, 5]), "pcd", tmp_path / "recording")
    shutil.rmtree(source / "labels")
    given: dict[str, Any] = {
        "price_usd": (10.0, 20.0),
        "scene": "here",
        "model": "mine",
        "upright": "as-is",
    }
    with pytest.warns(pi.FindingWarning, match="no labels"):
        imported = pi.import_recording(source, None, tmp_path / "python/pole", **given)
    words = "--price-usd 10 20 --scene-name here --lidar-model mine --upright as-is".split()
    assert main(["import", str(source), "--out", str(tmp_path / "command/pole"), *words]) == 0
    out, error = capsys.readouterr()
    assert out.count("assumed: ") == len(imported.assumed)
    assert "guessed: format pcd" in out
    assert "pyinfra: warning: " in error
    files = {file.relative_to(tmp_path / "python") for file in (tmp_path / "python").rglob("*")}
    for file in files:
        if (tmp_path / "python" / file).is_file():
            one, other = (tmp_path / name / file for name in ("python", "command"))
            assert one.read_bytes() == other.read_bytes(), file
    text = (imported.folder / "lidar.yaml").read_text()
    assert "mine" in text
    assert "low: 10" in text
    assert repr(imported).startswith("ImportedFrames(lidar=pole, frames=2")


def test_site_mesh_prints_the_mesh_that_the_function_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = tmp_path / "site"
    site.mkdir()
    (site / "site.yaml").write_text(
        "name: a\nmounts: {pole: {x_m: 0, y_m: 0, z_m: 6}}\nground: []\n"
    )
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 1]], float)
    write_ply(tmp_path / "wall.ply", Triangles(corners, np.array([[0, 1, 2]])))
    words = ["site", "mesh", str(tmp_path / "wall.ply"), "--out", str(site), "--offset=10,0,0"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert str(site / "meshes/wall.ply") in out
    assert "1 triangles, x 10.0 to 12.0, y 0.0 to 2.0, z 0.0 to 1.0 m" in out
