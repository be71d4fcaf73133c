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
