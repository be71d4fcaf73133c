"""The `pyinfra` command: errors in one line, help."""

import argparse
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset import catalogue, runs


def pyinfra(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "pyinfra", *words], capture_output=True, text=True, cwd=cwd
    )


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], 2),
        (["nothing"], 2),
        (["report", "results", "--tier"], 2),
        (["report", "missing", "--out", "out.html"], 1),
        (["pictures", "missing", "--out", "out"], 1),
    ],
)
def test_errors_are_one_line_on_stderr(tmp_path: Path, words: list[str], code: int) -> None:
    done = pyinfra(*words, cwd=tmp_path)
    assert done.returncode == code
    assert done.stdout == ""
    messages = [line for line in done.stderr.splitlines() if not line.startswith("[")]
    assert len(messages) == 1
    assert messages[0].startswith("pyinfra")


@pytest.mark.parametrize("bug", [ValueError("shapes (3,) (4,)"), KeyError("x"), RuntimeError()])
def test_a_bug_is_no_wrong_usage(
    bug: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The exit code is 1. The error is one line, which names a file with the traceback."""

    def run(args: object) -> int:
        raise bug

    monkeypatch.setattr("pyinfra.cli.lidars.run", run)
    assert main.main(["lidars"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"pyinfra: internal error: {type(bug).__name__}")
    file = Path(line.split()[-1])
    text = file.read_text()
    file.unlink()
    assert "Traceback" in text
    assert "command: pyinfra lidars" in text


def test_an_error_of_the_user_names_the_option(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The library names an argument in its message. The command replaces it by the option."""

    def run(args: object) -> int:
        raise Error("height_m: expected 0 to 100, got -3; see `period_s` and `lines`")

    monkeypatch.setattr("pyinfra.cli.import_.run", run)
    assert main.main(["import", "x", "--from", "pcd", "--out", "y"]) == 2
    message = "--height-m: expected 0 to 100, got -3; see --period-s and `lines`"
    assert capsys.readouterr().err == f"pyinfra: {message}\n"


@pytest.mark.parametrize("command", main.COMMANDS)
def test_help_of_every_command_has_an_example(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as done:
        main.main([command, "--help"])
    assert done.value.code == 0
    assert f"example: pyinfra {command}" in capsys.readouterr().out


def test_help_lists_every_command_in_one_group(capsys: pytest.CaptureFixture[str]) -> None:
    grouped = [name for names in main.GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(main.COMMANDS)
    with pytest.raises(SystemExit):
        main.main(["--help"])
    text = capsys.readouterr().out
    assert all(f"{title}:" in text for title in main.GROUPS)


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_has_commands_steps_and_options(
    shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shtab", reason="shtab is not installed: extra `completion`")
    assert main.main(["--completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(word in script for word in ("recommend", "trajectories", "--min-ap", "--radius"))


def test_closed_pipe_is_no_traceback(tmp_path: Path) -> None:
    data = tmp_path / "highway"
    lidar = ["--lidar", catalogue.lidar_file("helios_16"), "--preset", "paper"]
    runs.infrasim("run", catalogue.scene_file("highway"), *lidar, "--frames", "0:1", "--out", data)
    words = ["pictures", str(data), "--out", str(tmp_path / "out")]
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write) as pipe:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "pyinfra", *words],
            stdout=pipe,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
        )
    assert (done.returncode, done.stderr) == (1, "")


def parsers() -> Iterator[argparse.ArgumentParser]:
    """Yields the parser of every command, and of every subcommand of `site`."""
    for command, (module, _) in main.COMMANDS.items():
        parser = argparse.ArgumentParser(command)
        importlib.import_module(module).add_arguments(parser)
        steps = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        yield from (p for step in steps for p in step.choices.values())
        yield parser


def test_every_option_has_a_help_text_that_names_its_default() -> None:
    without = []
    for parser in parsers():
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
                continue
            has_default = action.default not in (None, False, "", []) and not action.required
            if not action.help or (has_default and "default: " not in action.help.lower()):
                without.append(f"{parser.prog} {action.dest}")
    assert not without
