"""On a terminal, every command prints the next command at its end."""

import shlex
import sys
from pathlib import Path

import pytest

from pyinfra.cli import main
from pyinfra.cli.next_command import NEXT, next_command

COMMANDS = {
    "lidars": "lidars",
    "pictures": "pictures data --out out",
    "view": "view data/pole --out out/view.html",
    "split": "split data",
    "site": "site draw sites/town --out plan.svg",
    "sites": "sites --out generated",
    "train": "train background data/pole --out runs/a",
    "track": "track data/pole --out out/tracks.csv",
    "count": "count out/tracks.csv data/pole --out out/counts",
    "region": "region data/pole --out outline.yaml",
    "detect": "detect data/pole --out boxes",
    "onnx": "onnx runs/a --out a.onnx",
    "statistics": "statistics data --out out",
    "validate": "validate data/pole --pred boxes",
    "evaluate": "evaluate data/pole boxes --out out",
    "stress": "stress data/pole --model runs/a --out out --dry-run",
    "compare": "compare a b",
    "benchmark": "benchmark demo --tier smoke --out out",
    "plan": "plan crossroad --budget 9000 --out out",
    "recommend": "recommend out --budget 9k",
    "report": "report out --out out/report.html",
    "import": "import recording --out data/pole",
    "export": "export data/pole --to pcd --out out",
}


def test_the_requirements_of_a_recommendation_are_kept() -> None:
    words = "--budget 1234567 --min-ap 60.25 --range 60 --latency 200"
    for command, more in (("recommend", ""), ("report", " --out a.html")):
        text = next_command(command, parsed(f"{command} out {words}{more}".split()))
        assert words in text
        assert text.count("--budget") == 1


def test_every_command_has_a_next_one() -> None:
    assert set(NEXT) == set(COMMANDS)
    # demo prints its own text
    assert {*NEXT, "demo"} == set(main.COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_next_command_is_parsed_and_has_real_paths(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("data/pole/training", "generated"):
        Path(folder).mkdir(parents=True)
    Path("data/pole/lidar.yaml").touch()
    Path("generated/site_0.yaml").touch()
    words = COMMANDS[command].split()
    program, *following = shlex.split(next_command(command, parsed(words)))
    assert all(word[:1] not in "<[" and not word.isupper() for word in following)
    if program == "pyinfra":
        parsed(following)
    else:
        assert program == "infrasim"


def parsed(words: list[str]) -> object:
    return main.make_parser(words).parse_args(words)


@pytest.mark.parametrize("is_terminal", [True, False])
def test_it_is_printed_on_a_terminal_alone(
    is_terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: is_terminal)
    assert main.main(["lidars", "ruby_plus"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("next: infrasim run highway --lidar ruby_plus ") == is_terminal
