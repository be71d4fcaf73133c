"""The `pyinfra` command: the demo, errors in one line, help."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pyinfra.cli import demo, main
from pyinfra.dataset import catalogue, runs


@pytest.mark.slow
def test_demo_writes_all_it_names_and_resumes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "SCENES", ("highway",))
    monkeypatch.setattr(demo, "LIDARS", ("livox_avia", "helios_16"))
    command = ["demo", "--out", str(tmp_path), "--frames", "4:6"]
    assert main.main(command) == 0
    first = capsys.readouterr()
    named = [Path(line.split()[-1]) for line in first.out.splitlines() if str(tmp_path) in line]
    assert len(named) == 2 + 4
    assert all(path.exists() for path in named)
    assert "mean error" in first.out
    assert "pictures" in first.err
    frame = tmp_path / "data/highway/helios_16/training/velodyne/000004.bin"
    before = frame.stat().st_mtime_ns
    assert main.main(command) == 0
    assert capsys.readouterr().out == first.out
    assert frame.stat().st_mtime_ns == before


def pyinfra(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "pyinfra", *words], capture_output=True, text=True, cwd=cwd
    )


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], 2),
        (["nothing"], 2),
        (["demo", "--frames"], 2),
        (["demo", "--frames", "5:2"], 2),
        (["demo", "--frames", "0:999999"], 2),
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


@pytest.mark.parametrize("command", [command.name for command in main.COMMANDS])
def test_help_of_every_command_has_an_example(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as done:
        main.main([command, "--help"])
    assert done.value.code == 0
    assert f"example: pyinfra {command}" in capsys.readouterr().out


def test_closed_pipe_is_no_traceback(tmp_path: Path) -> None:
    data = tmp_path / "highway"
    runs.simulate(catalogue.scene_file("highway"), [catalogue.lidar_file("helios_16")], "0:1", data)
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
