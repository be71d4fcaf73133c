"""`python -m reproduction`: the study's commands."""

import argparse
import ast
import importlib
import shlex
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import SUBSETS
from reproduction import ROOT, add_out, commands
from reproduction import __main__ as reproduction
from reproduction.commands import (
    demo,
    experiments,
    fairness,
    generalist,
    integration,
    ladder,
    poles,
)

FILES = sorted(Path(commands.__path__[0]).glob("[a-z]*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_each_command_has_a_summary_and_a_main(file: Path) -> None:
    tree = ast.parse(file.read_text("utf-8"))
    assert reproduction.summaries()[file.stem]
    assert "main" in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_a_command_gets_the_words_after_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        reproduction.main(["tables", "--help"])
    assert end.value.code == 0
    assert "python -m reproduction tables [-h] [--check]" in capsys.readouterr().out


class Parsed(Exception):
    """Is raised to end a program after its options are defined."""


def options_of(module: str, monkeypatch: pytest.MonkeyPatch) -> argparse.ArgumentParser:
    """Returns the parser of a program."""
    parsers = []

    def parse_args(self: argparse.ArgumentParser, *_: object, **__: object) -> None:
        parsers.append(self)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_args)
    with pytest.raises(Parsed):
        importlib.import_module(module).main()
    return parsers[0]


PROGRAMS = [f"reproduction.commands.{f.stem}" for f in FILES]
SPEED = ["ops", "evaluate_speed", "run"]


@pytest.mark.parametrize("module", [*PROGRAMS, *SPEED])
def test_no_program_replaces_a_recorded_measurement_by_default(
    module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Outputs are written to out/. `--out results/NAME` replaces a recorded measurement, as --help
    says."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    parser = options_of(module, monkeypatch)
    paths = {a.dest: a.default for a in parser._actions if isinstance(a.default, (str, Path))}
    for name in ("results", "docs", "pyinfra", "configs"):
        assert [k for k, path in paths.items() if (ROOT / path).is_relative_to(ROOT / name)] == []
    if module in SPEED:
        assert (ROOT / paths["out"]).parent == ROOT / "out"
        assert "record" in parser.format_help()


def test_an_output_is_where_it_is_asked_and_a_wrong_one_is_an_error_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = argparse.ArgumentParser()
    add_out(parser, "speed.csv")
    assert parser.parse_args([]).out == ROOT / "out/speed.csv"
    assert (ROOT / "out").is_dir()
    asked = parser.parse_args(["--out", f"{tmp_path}/new/speed.csv"]).out
    assert asked == tmp_path / "new/speed.csv"
    assert asked.parent.is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit) as end:
        parser.parse_args(["--out", f"{tmp_path}/file/speed.csv"])
    assert end.value.code == 2
    assert "--out: expected a path" in capsys.readouterr().err


ONE = {"ap_r1000": 1.0, "train_cpu_s": 1.0, "steps": 1, "objects": 1}
NOTHING = dict.fromkeys(integration.MEASURES, 0)


def without_work(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Replaces the simulations, trainings and tests of some commands by results at once."""

    def rows_of_test(*_: object) -> list[dict[str, object]]:
        return [{**NOTHING, **ONE, "subset": subset} for subset in SUBSETS]

    def simulated(*values: object) -> float:
        Path(str(values[-1])).mkdir(parents=True)
        return 1.0

    def rows_of_poles(self: poles.Experiment, _: Path) -> pd.DataFrame:
        return pd.DataFrame([{**self.key, **ONE, "ground_truth": "all"}])

    def made(*_: object) -> Path:
        lidar = folder / "data/lidar"
        lidar.mkdir(parents=True, exist_ok=True)
        return lidar

    monkeypatch.setattr(experiments, "model_of", lambda *_: (Path("model"), 1.0))
    monkeypatch.setattr(experiments, "simulated", made)
    monkeypatch.setattr(experiments, "rows_of_test", rows_of_test)
    monkeypatch.setattr(integration, "rows_of_test", rows_of_test)
    monkeypatch.setattr(integration, "simulated", made)
    monkeypatch.setattr(integration, "train_detector", lambda *_, **__: (Path("model"), 1.0))
    monkeypatch.setattr(poles.Experiment, "rows", rows_of_poles)
    monkeypatch.setattr(ladder, "simulated", simulated)
    monkeypatch.setattr(ladder, "row", lambda *_: ONE)
    monkeypatch.setattr(generalist, "simulated", made)
    monkeypatch.setattr(generalist, "shows_vehicles", lambda _: True)
    monkeypatch.setattr(generalist, "row", lambda *_: dict(ONE))


@pytest.mark.parametrize(
    ("module", "words"),
    [
        (
            experiments,
            "--scenes curve --presets paper --setups dsvt --replicates 1 --cut-angles 90",
        ),
        (
            experiments,
            "--scenes curve --presets paper --setups dsvt --replicates 1 --training-cut-angles 90",
        ),
        pytest.param(poles, "--seeds 4 --lidars pandar_64", marks=pytest.mark.nightly),
        (integration, "--seeds 4 --lidars helios_16 --speeds 20"),
        pytest.param(
            ladder,
            "--seeds 4 --frames 1000 --lidars hesai_ot128 --settings frames",
            marks=pytest.mark.nightly,
        ),
        (fairness, "generalist --scenes curve --lidars pandar_64 --seeds 2"),
        pytest.param(generalist, "--seeds 1 --sites 15 --arms none", marks=pytest.mark.nightly),
        (generalist, "--sites 2"),
    ],
)
def test_a_recorded_command_repeats_its_row(
    module: object, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_work(monkeypatch, tmp_path)
    name = str(module.__name__).rpartition(".")[2]

    def keys(command: str, out: Path) -> set[tuple[str, ...]]:
        """Runs a command; returns the keys of its rows, with the command that each row records."""
        paths = ["--work", f"{out}", "--out", f"{out}.csv"]
        assert reproduction.main([*shlex.split(command), *paths]) == 0
        columns = [*module.KEY, "command"]
        return set(pd.read_csv(f"{out}.csv", dtype=str)[columns].itertuples(index=False, name=None))

    first = keys(f"{name} {words}", tmp_path / "first")
    for number, command in enumerate({key[-1] for key in first}):
        again = keys(command.removeprefix(f"{reproduction.PROGRAM} "), tmp_path / f"{number}")
        wanted = {key[:-1] for key in first if key[-1] == command}
        assert wanted <= {key[:-1] for key in again}


def test_an_unknown_command_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        reproduction.main(["claim"])
    assert end.value.code == 2
    assert "invalid choice: 'claim'" in capsys.readouterr().err


@pytest.mark.parametrize("frames", ["5:2", "0:999999"])
def test_wrong_frames_of_the_demo_are_one_line(
    frames: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reproduction.main(["demo", "--out", str(tmp_path), "--frames", frames]) == 2
    (line,) = (x for x in capsys.readouterr().err.splitlines() if not x.startswith("["))
    assert line.startswith("python -m reproduction demo: infrasim run: ")


@pytest.mark.nightly
@pytest.mark.slow
def test_demo_writes_all_it_names_and_resumes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "SCENES", ("highway",))
    monkeypatch.setattr(demo, "LIDARS", ("livox_avia", "helios_16"))
    command = ["demo", "--out", str(tmp_path), "--frames", "4:6"]
    assert reproduction.main(command) == 0
    first = capsys.readouterr()
    named = [Path(line.split()[-1]) for line in first.out.splitlines() if str(tmp_path) in line]
    assert len(named) == 2 + 4
    assert all(path.exists() for path in named)
    assert "mean error" in first.out
    assert "pictures" in first.err
    frame = tmp_path / "data/highway/helios_16/training/velodyne/000004.bin"
    before = frame.stat().st_mtime_ns
    assert reproduction.main(command) == 0
    assert capsys.readouterr().out == first.out
    assert frame.stat().st_mtime_ns == before


def test_words_replace_constants_of_a_command_and_unknown_ones_are_named() -> None:
    module = SimpleNamespace(__name__="toy", SEEDS=(1, 2, 3), FRAMES="0:9")
    words = ["FRAMES='0:2'", "SEEDS=SEEDS[:1]", "--out", "a=b"]
    assert reproduction.without_constants(module, words) == ["--out", "a=b"]  # type: ignore[arg-type]
    assert (module.SEEDS, module.FRAMES) == ((1,), "0:2")
    with pytest.raises(Error, match="expected the name of a constant of toy, got OTHER"):
        reproduction.without_constants(module, ["OTHER=1"])  # type: ignore[arg-type]
