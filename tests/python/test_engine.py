"""The engine of `make results`: keys, resumption after a kill, and the list of steps."""

import os
import re
import shlex
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from pyinfra.core.errors import Error
from pyinfra.experiments.pool import Pool
from reproduction import ROOT, engine
from reproduction.engine import Command, Places, Step
from reproduction.steps import OTHERS, STEPS
from reproduction.toys import TOYS

# Steps whose smallest trial trains a network for minutes, or has no smaller size.
WITHOUT_TOY = {
    "integration.csv",
    "generalist.csv",
    "people.csv",
    "detector_latency.csv",
    "onnx_files.csv",
}

SLEEPS = """
    import argparse, pathlib, time
    parser = argparse.ArgumentParser()
    parser.add_argument("--number", default="0")
    parser.add_argument("--sleep", type=float, default=0)
    parser.add_argument("--reads", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path)
    args = parser.parse_args()
    with (args.out.parent / "started").open("a") as log:
        print("x", file=log)
    time.sleep(args.sleep)
    rows = args.reads.read_text().count("\\n") if args.reads else args.number
    args.out.write_text(f"number\\n{rows}\\n")
"""


@pytest.fixture
def script(tmp_path: Path) -> Path:
    file = tmp_path / "script.py"
    file.write_text(textwrap.dedent(SLEEPS))
    return file


@pytest.fixture
def steps(script: Path) -> list[Step]:
    """Returns a step of three parts, and one that reads its file."""
    numbers = ("--number", ("1", "2", "3"))
    first = Command(f"{script}", 0, "", out="a.csv", split=(numbers,))
    second = Command(f"{script} --reads {{a.csv}}", 0, "", out="b.csv")
    return [Step(("b.csv",), (second,)), Step(("a.csv",), (first,))]


@pytest.fixture
def places(tmp_path: Path) -> Places:
    return Places(tmp_path / "results", tmp_path / "work")


def starts(places: Places) -> int:
    return sum(len(f.read_text().split()) for f in places.work.rglob("started"))


def stale(steps: list[Step], places: Places) -> set[str]:
    parts = {step: engine.parts_of(step, steps, places) for step in steps}
    return {step.name for step in steps if not engine.is_current(step, parts[step], places)}


def test_a_file_has_the_rows_of_all_parts_and_is_made_once(
    steps: list[Step], places: Places
) -> None:
    for _ in range(2):
        assert engine.run(steps, [], places, Pool(jobs=2)) == []
    assert pd.read_csv(places.results / "a.csv").number.tolist() == [1, 2, 3]
    assert pd.read_csv(places.results / "b.csv").number.tolist() == [4]
    assert starts(places) == 4
    record = engine.recorded(places)
    assert (record.cpu_s > 0).all()
    assert record.step.tolist() == ["a", "a", "a", "b"]


@pytest.mark.parametrize(
    ("change", "names"),
    [("frames", {"a", "b"}), ("model", {"a", "b"}), ("version", {"a", "b"}), ("file", {"b"})],
)
def test_a_changed_key_makes_a_file_and_what_reads_it_out_of_date(
    change: str,
    names: set[str],
    steps: list[Step],
    places: Places,
    script: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    uses = replace(steps[1], commands=(replace(steps[1].commands[0], model=True),))
    steps = [steps[0], uses]
    engine.run(steps, [], places, Pool())
    assert stale(steps, places) == set()
    if change == "frames":
        monkeypatch.setattr(engine, "frames_version", lambda: 99)
    elif change == "model":
        monkeypatch.setattr(engine, "MODEL", script)
    elif change == "version":
        monkeypatch.setitem(engine.VERSIONS, f"{script}", 2)
    else:
        (places.results / "b.csv").unlink()
    assert stale(steps, places) == names


def test_a_failed_part_stops_only_what_reads_it(steps: list[Step], places: Places) -> None:
    (command,) = steps[1].commands
    wrong = replace(command, words=f"{command.words} --sleep x")
    good = Step(("c.csv",), (replace(command, out="c.csv"),))
    some = [steps[0], replace(steps[1], commands=(wrong,)), good]
    failed = engine.run(some, [], places, Pool(jobs=2))
    assert len(failed) == 3
    assert "invalid float value" in (failed[0].folder / "log.txt").read_text()
    assert {file.name for file in places.results.iterdir()} == {"c.csv", engine.RECORD}


def test_finished_parts_of_an_incomplete_file_resume_in_another_clone(
    steps: list[Step], places: Places, tmp_path: Path
) -> None:
    (command,) = steps[1].commands
    bad = replace(command, split=(("--number", ("1", "2", "x --sleep x")),))
    some = [steps[0], replace(steps[1], commands=(bad,))]
    assert len(engine.run(some, [], places, Pool())) == 1
    kept = places.results / "parts/a"
    assert sorted(file.name for file in kept.rglob("*.*")) == ["a.csv", "a.csv", *2 * ["done.json"]]
    elsewhere = replace(places, work=tmp_path / "elsewhere")
    assert engine.run(steps, [], elsewhere, Pool()) == []
    assert starts(elsewhere) == 2  # the third part, and what reads the file
    assert pd.read_csv(places.results / "a.csv").number.tolist() == [1, 2, 3]
    assert not kept.parent.exists()


def test_a_command_that_outlives_a_killed_engine_is_waited_for(
    steps: list[Step], places: Places
) -> None:
    slow = replace(steps[1].commands[0], words=f"{steps[1].commands[0].words} --sleep 2", split=())
    (part,) = engine.parts_of(step := Step(("a.csv",), (slow,)), [step], places)
    code = f"from reproduction import engine; from pathlib import Path; engine.run_part({part!r})"
    code = code.replace("PosixPath", "Path").replace("Part(", "engine.Part(", 1)
    killed = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT)
    while not (part.folder / "started").is_file():
        time.sleep(0.05)
    killed.kill()
    killed.wait()
    started = time.monotonic()
    engine.run_part(part)
    assert time.monotonic() - started > 2.5
    assert part.done.is_file()


def results(work: Path, *words: str) -> subprocess.Popen[str]:
    line = [sys.executable, "-m", "reproduction", "results", "--toy", "--dirty", "--work", work]
    return subprocess.Popen(
        [*map(str, line), *words], cwd=ROOT, text=True, stdout=subprocess.PIPE, process_group=0
    )


def killed(work: Path, files: Sequence[str], seconds: Sequence[float]) -> list[float]:
    """Kills runs of the toy steps after the given seconds; returns when finished parts were made
    before the last kill."""
    for limit in seconds:
        process = results(work, *files)
        try:
            process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    return sorted(file.stat().st_mtime for file in work.rglob("done.json"))


def killed_in_a_part(work: Path, file: str) -> None:
    """Kills a run of a toy step as soon as a part has begun, which opens a log."""
    for log in work.rglob("log.txt"):
        log.unlink()
    process = results(work, file)
    while not list(work.rglob("log.txt")):
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert not list(work.rglob("done.json"))


def test_a_toy_step_that_is_killed_twice_has_the_rows_of_an_uninterrupted_run(
    tmp_path: Path,
) -> None:
    for _ in range(2):
        killed_in_a_part(tmp_path / "killed", "rungs.csv")
    for name in ("killed", "whole"):
        printed, _ = results(tmp_path / name, "rungs.csv", "--jobs", "2").communicate()
        assert re.search(r"will take about .* CPU hours\n(.|\n)*took .* CPU hours", printed)
    one, whole = (tmp_path / name / "toy/results/rungs.csv" for name in ("killed", "whole"))
    assert one.read_bytes() == whole.read_bytes()
    one.unlink()  # as if the run had been killed after its last part
    results(tmp_path / "killed", "rungs.csv").communicate()
    assert one.read_bytes() == whole.read_bytes()


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_all_toy_steps_resume_after_two_kills(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `bag` is not installed")
    finished = killed(tmp_path, (), (60, 120))
    printed, _ = results(tmp_path).communicate()
    assert "failed: " not in printed, printed
    record = pd.read_csv(tmp_path / "toy/results" / engine.RECORD)
    assert set(record.step) == {file.removesuffix(".csv") for file in TOYS}
    made = sorted(file.stat().st_mtime for file in tmp_path.rglob("done.json"))
    assert made[: len(finished)] == finished  # no finished part ran again


def test_each_step_with_one_command_and_no_toy_size_is_known() -> None:
    without = {step.files[0] for step in STEPS} - TOYS.keys()
    assert without <= WITHOUT_TOY
    assert TOYS.keys() <= {step.files[0] for step in STEPS}


def test_changed_code_is_refused(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    from reproduction.commands import results

    monkeypatch.setattr(engine, "changed_code", lambda: ["cpp/a.cpp"])
    monkeypatch.setattr(engine, "RECORD", "none.csv")  # no file is up to date
    monkeypatch.setattr(sys, "argv", ["results", "people.csv"])
    with pytest.raises(
        Error, match=r"expected committed code, got uncommitted changes in cpp/a\.cpp"
    ):
        results.main()
    assert "people.csv" in capsys.readouterr().out


def test_each_version_is_that_of_a_command() -> None:
    names = {shlex.split(command.words)[0] for step in STEPS for command in step.commands}
    assert engine.VERSIONS.keys() <= names


def test_an_unknown_file_is_named() -> None:
    with pytest.raises(Error, match=r"got nothing\.csv"):
        list(engine.levels(STEPS, ["nothing.csv"]))


def test_each_recorded_file_has_one_step_or_another_origin() -> None:
    made = [file for step in STEPS for file in step.files]
    recorded = {file.name for file in (ROOT / "results").glob("*.csv")}
    assert len(made) == len(set(made))
    assert not set(made) & set(OTHERS)
    assert recorded <= {*made, *OTHERS}


def test_a_command_that_uses_the_pretrained_detector_says_so() -> None:
    for command in (command for step in STEPS for command in step.commands):
        name = shlex.split(command.words)[0]
        if not name.endswith(".py") and name != "experiments":
            text = (ROOT / f"reproduction/commands/{name}.py").read_text()
            uses = '"generalist"' in text or "models/generalist" in text
            assert command.model or not uses, name


OPTIONS = re.compile(r"^--(work|out)$")


def parsed(words: str) -> list[str]:
    """Returns the words of a command without its working folder and output."""
    found = shlex.split(words)
    drop = {i + k for i, word in enumerate(found) if OPTIONS.match(word) for k in (0, 1)}
    return [word for i, word in enumerate(found) if i not in drop]


def test_the_pages_repeat_the_commands_of_the_steps() -> None:
    typed = {}
    for step in STEPS:
        for command in step.commands:
            name, *words = shlex.split(re.sub(r"{(.*?)}", r"results/\1", command.words))
            typed.setdefault(name, []).append(words)
    pages = [*(ROOT / "docs").rglob("*.md")]
    for page in pages:
        text = " ".join(page.read_text("utf-8").split())
        for sentence in re.findall(r"To reproduce[^`]*: `python -m reproduction ([^`]+)`", text):
            name, *words = parsed(sentence.replace("MODEL", "generalist"))
            if name in typed:
                assert words in typed[name], f"{page.name}: {sentence}"
        for files in re.findall(r"`?make results FILES=\"?([\w. ]+?)\"?[`\n ]", text):
            assert list(engine.levels(STEPS, files.split())), f"{page.name}: {files}"
