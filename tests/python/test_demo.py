"""`pyinfra demo` with fewer LiDARs and frames: its files and its printed text."""

import shlex
from pathlib import Path

import pytest

from pyinfra.cli import demo, main

SMALL = """
frames: 0:90:10
split: {train_until_s: 2, val_from_s: 4}
matrix:
  - {scenes: [crossroad], lidars: [helios_16], presets: [datasheet], detectors: [generalist-as-is]}
"""


@pytest.mark.slow
def test_the_demo_ends_with_an_answer_its_report_and_the_next_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL)
    monkeypatch.setattr(demo, "BENCHMARK", str(config))
    out = tmp_path / "demo"
    assert main.main(["demo", "--out", str(out)]) == 0
    answer, report, following = capsys.readouterr().out.splitlines()
    assert "Helios" in answer
    assert report == f"report: {out / 'report.html'}"
    assert answer.split(":")[0] in (out / "report.html").read_text()
    program, *words = shlex.split(following.removeprefix("next: "))
    assert program == "pyinfra"
    assert main.main(words) == 0
    assert (out / "view.html").is_file()
