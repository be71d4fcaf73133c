"""Typical mistakes of users give the exit code 2 and a message that helps. Nothing is simulated."""

import argparse
import shutil
from pathlib import Path

import pytest
import report_data

from pyinfra.cli import main

MISTAKES = {
    # commands, options and names
    "command with a typing error": ("detct data", ["did you mean 'detect'?"]),
    "step with a typing error": ("site imprt town.osm --out t", ["did you mean 'import'?"]),
    "option with a typing error": ("report results --teir full", ["did you mean '--tier'?"]),
    "choice with a typing error": ("export data/site/pole --to openpcdt --out o",
        ["did you mean 'openpcdet'?"]),
    "abbreviated option": ("recommend results --bud 9000", ["--bud: no such option", "--budget"]),
    "option of an earlier version": ("detect runs/a --data data/site/pole --out o",
        ["pyinfra detect DATA/LIDAR --model RUN"]),
    "predictions as an option": ("evaluate --gt data/site/pole --pred boxes --out o",
        ["pyinfra evaluate DATA/LIDAR PRED"]),
    "LiDAR with a typing error": ("lidars ruby_pls", ["did you mean 'ruby_plus'?"]),
    "detector with a typing error": ("train pointpilars data/site/pole --out o",
        ["did you mean 'pointpillars'"]),
    "benchmark with a typing error": ("benchmark first_lok --out o",
        ["did you mean 'first_look'?"]),
    "scene with a typing error": ("benchmark demo --scene higway --out o",
        ["--scene", "did you mean 'highway'?"]),
    "pretrained detector with a typing error": ("detect data/site/pole --model generalst --out o",
        ["--model", "did you mean 'generalist'"]),
    "output forgotten": ("report results", ["--out"]),
    "boxes without a folder": ("detect data/site/pole", ["--out: expected a folder"]),
    # numbers and their units
    "latency in seconds": ("recommend results --budget 9000 --latency 0.5",
        ["--latency: expected milliseconds", "500"]),
    "AP as a share": ("recommend results --budget 9000 --min-ap 0.85", ["AP is 0 to 100"]),
    "budget with a decimal comma": ("recommend results --budget 9.000", ["write 9000 or 9"]),
    "budget of a plan in words": ("plan crossroad --budget cheap --out o",
        ["such as 9000, 9,000 or 9k"]),
    "budget in words": ("recommend results --budget cheap", ["such as 9000, 9,000 or 9k"]),
    "range of frames for one frame": ("view data/site --frame 0:10 --out o.html",
        ["one frame", "--frames 0:10"]),
    "one frame for a range": ("detect data/site/pole --frames 60 --out o",
        ["A:B[:STEP]", "--max-frames 60"]),
    "height in centimetres": ("detect cloud.bin --height-m 600", ["--height-m", "6"]),
    "tier that was not measured": ("recommend results --budget 9000 --tier full",
        ["--tier: expected a tier in results (quick)"]),
    "tier that the report lacks": ("report results --tier smoke --out r.html",
        ["--tier: expected a tier in results (quick)"]),
    "number with a decimal comma": ("plan crossroad --budget 9000 --find 0,9 --out o",
        ["--find: expected a number", "such as 0.5", "'0,9'"]),
    "number with a unit": ("site import town.osm --out t --radius 0.5km",
        ["--radius: expected a number", "'0.5km'"]),
    "number with a fraction": ("detect data/site/pole --max-frames 1.5 --out o",
        ["--max-frames: expected a whole number", "'1.5'"]),
    # folders
    "folder of sites for a site": ("site traffic sites --vehicles-per-hour 600",
        ["sites in it: sites/a"]),
    "file of a site for its folder": ("site traffic sites/a/site.yaml --vehicles-per-hour 600",
        ["use sites/a"]),
    "folder of sites in a plan": ("plan sites --budget 9000 --out o", ["sites in it: sites/a"]),
    "map for a site": ("plan town.osm --budget 9000 --out o",
        ["`pyinfra site import`"]),
    "folder one level too high": ("evaluate data/site boxes --out o", ["data/site/pole"]),
    "folder two levels too high": ("detect data --out o", ["data/site/pole"]),
    "folder one level too deep": ("detect data/site/pole/training --out o",
        ["use data/site/pole"]),
    "folder two levels too deep": ("export data/site/pole/training/velodyne --to pcd --out o",
        ["use data/site/pole"]),
    "LiDAR for a data set": ("split data/site/pole", ["use data/site"]),
    "training for a folder of clouds": ("detect runs/a --out o", ["--model runs/a"]),
    "folder of unknown files": ("import runs --out data/new/pole", ["kitti", "--from"]),
    "folder of two formats": ("import mixed --out data/new/pole", ["pcd", "bin", "--from"]),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes a data set with one LiDAR, a training, clouds and results. Nearly all files are
    empty."""
    top = tmp_path_factory.mktemp("mistakes")
    for name in (
        "data/site/dataset.yaml",
        "data/site/pole/lidar.yaml",
        "data/site/pole/training/velodyne/000000.bin",
        "runs/a/last.safetensors",
        "boxes/000000.txt",
        "mixed/0.pcd",
        "mixed/0.bin",
        "cloud.bin",
        "town.osm",
        "sites/a/site.yaml",
    ):
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).touch()
    (top / "results").mkdir()
    report_data.write(top / "results")
    for file in (top / "results").glob("full*.csv"):
        shutil.move(file, file.with_name(file.name.replace("full", "quick")))
    return top


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_answered_with_what_to_do(
    mistake: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    command, words = MISTAKES[mistake]
    before = sorted(folder.rglob("*"))
    try:
        code: object = main.main(command.split())
    except SystemExit as end:
        code = end.code
    error = capsys.readouterr().err
    assert code == 2, error
    assert len(error.splitlines()) == 1
    for word in words:
        assert word in error
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("data", ["nowhere/pole", "cloud.bin"])
def test_missing_data_are_named_before_what_they_would_need(
    data: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(tmp_path / data)
    words = ["detect", path, "--model", "generalist", "--out", str(tmp_path / "boxes")]
    assert main.main(words) == 1
    assert capsys.readouterr().err == f"pyinfra: {path}: No such file or directory\n"


@pytest.mark.parametrize(
    "command", ["recommend results", "report results --out o", "plan x --out o"]
)
@pytest.mark.parametrize("text", ["9000", "9,000", "9k", "9K", "$9,000", "9000.0"])
def test_an_amount_of_money_may_be_written_in_several_ways(command: str, text: str) -> None:
    words = [*command.split(), "--budget", text]
    assert main.make_parser(words).parse_args(words).budget_usd == 9000


def test_arguments_may_stand_behind_the_options_if_argparse_accepts_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    # Since Python 3.13, argparse reads optional arguments without a name wherever they stand.
    probe = argparse.ArgumentParser()
    probe.add_argument("config")
    probe.add_argument("data", nargs="*")
    probe.add_argument("--out")
    _, refused = probe.parse_known_args(["background", "--out", "o", "data/site/pole"])
    words = ["train", "background", "--out", "o", "data/site/pole"]
    if refused:
        with pytest.raises(SystemExit):
            main.make_parser(words).parse_args(words)
        error = capsys.readouterr().err
        assert "'data/site/pole'" in error
        assert "before the options" in error
    else:
        assert main.make_parser(words).parse_args(words).data == [Path("data/site/pole")]
