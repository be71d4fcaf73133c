"""The examples in docs/ do what they say."""

import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
import yaml

from pyinfra import cli

DOCS = Path(__file__).resolve().parents[2] / "docs"


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


@pytest.mark.slow
def test_the_detector_of_the_page_finds_vehicles(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    command = run_command("ruby_plus", frames="0:50:10", out=tmp_path / "data/highway")
    infrasim(*command, check=True)
    monkeypatch.chdir(tmp_path)
    detector, use = blocks("own_detector.md", "python")
    assert len(detector.splitlines()) <= 60
    names: dict[str, object] = {"__name__": "own_detector"}
    exec(compile(detector + use, "own_detector.md", "exec", dont_inherit=True), names)
    words = ["--gt", "data/highway/ruby_plus", "--pred", "out/blocks", "--out", "out/evaluation"]
    assert cli.main(["evaluate", *words]) == 0
    assert pd.read_csv("out/evaluation/ap.csv").ap[0] > 20


def test_the_configuration_of_the_page_is_one(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="the extra `detectors` is not installed")
    from pyinfra.training.recipe import read_recipe

    (text,) = blocks("own_detector.md", "yaml")
    (tmp_path / "own.yaml").write_text(text)
    recipe = read_recipe(tmp_path / "own.yaml", "smoke")
    assert recipe.network.pillar_m == yaml.safe_load(text)["tiers"]["smoke"]["network"]["pillar_m"]
    assert recipe.augmentation.pasted == 10


@pytest.mark.slow
def test_the_commands_for_own_data_run(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On 30 frames of a simulation as somebody else's recording, with a short training."""
    infrasim(*run_command("helios_16", frames="0:30", out=tmp_path / "site"), check=True)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(DOCS.parent / "configs")
    recording = ["--to", "pcd", "--out", "recordings/junction"]
    assert cli.main(["export", "site/helios_16", *recording]) == 0
    commands = [c for block in blocks("own_data.md", "") for c in block.splitlines()]
    assert len(commands) == 17
    for command in commands:
        short = command.replace("--tier quick", "--tier smoke --budget 0.1")
        short += " --no-figures" if " evaluate " in command else ""
        program, *words = short.split()
        assert program == "pyinfra"
        assert cli.main(words) == 0, command
    assert pd.read_csv("out/junction_background/ap.csv").objects[0] > 0
