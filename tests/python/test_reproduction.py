"""`python -m reproduction`: the study's commands."""

import ast
from pathlib import Path

import pytest

from reproduction import __main__ as reproduction
from reproduction import commands

FILES = sorted(Path(commands.__path__[0]).glob("[a-z]*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_each_command_has_a_summary_and_a_main(file: Path) -> None:
    tree = ast.parse(file.read_text("utf-8"))
    assert reproduction.summaries()[file.stem]
    assert "main" in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_a_command_gets_the_words_after_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduction.main(["tables", "--check"]) == 0
    with pytest.raises(SystemExit) as end:
        reproduction.main(["tables", "--help"])
    assert end.value.code == 0
    assert "python -m reproduction tables [-h] [--check]" in capsys.readouterr().out


def test_an_unknown_command_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        reproduction.main(["claim"])
    assert end.value.code == 2
    assert "invalid choice: 'claim'" in capsys.readouterr().err
