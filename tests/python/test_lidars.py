"""`pyinfra lidars` lists the catalogue and LiDARs from files."""

import json
import re
import time
from pathlib import Path

import pytest
from message_pattern import pattern

from pyinfra.cli import main
from pyinfra.dataset.lidars import catalogue_files, read_catalogue, read_sheet

MOST_LETTERS = 100


def listed(capsys: pytest.CaptureFixture[str], *words: object) -> list[str]:
    assert main.main(["lidars", *map(str, words)]) == 0
    return capsys.readouterr().out.splitlines()


def test_the_catalogue_has_a_row_for_each_lidar_that_a_terminal_holds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = listed(capsys)
    names = [file.stem for file in catalogue_files()]
    assert [line.split()[0] for line in lines[1 : len(names) + 1]] == names
    assert lines[len(names) + 1] == ""
    assert max(map(len, lines[: len(names) + 1])) <= MOST_LETTERS


def test_a_row_is_what_the_simulator_makes_of_the_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    head, first, _, presets, assumption, source = listed(capsys, "ruby_plus")
    assert head.split() == "lidar model lines view, deg range 10 % USD presets".split()
    words = "ruby_plus RoboSense Ruby Plus 128 360 x 40 250 240* 24000 [1] p e D"
    assert first.split() == words.split()
    assert presets.startswith("presets: p paper, e equal, d datasheet")
    assert assumption.startswith("* the only published range")
    assert source == "[1] table of the paper 'Repetitive or Non-repetitive?', 2025"


def test_a_lidar_with_several_published_ranges_rests_on_no_assumption(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = "\n".join(listed(capsys, "livox_avia"))
    assert " 190 2079 " in " ".join(text.split())
    assert "assumed" not in text
    assert read_sheet(catalogue_files()[0]).published_ranges == 6, "of the bundle's Avias"


def test_a_preset_changes_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    row = listed(capsys, "ruby_plus", "--preset", "paper")[1].split()
    assert row[-10:] == "360 x 40 100 - 24000 [1] P e d".split()


def test_a_bundle_adds_up_its_units_and_looks_all_ways() -> None:
    sheet = read_sheet(next(file for file in catalogue_files() if file.stem.startswith("bundle")))
    assert (sheet.price_low_usd, sheet.price_source) == (5 * 2079, "sum of the units")
    assert sheet.lines is None
    assert sheet.horizontal_fov_deg == pytest.approx(5 * 70.62, abs=0.1)


def test_the_price_of_a_bundle_with_an_unconfirmed_unit_is_unconfirmed(tmp_path: Path) -> None:
    units = [catalogue_files()[0].parent / f"{name}.yaml" for name in ("livox_avia", "hesai_xt32")]
    file = tmp_path / "pair.yaml"
    file.write_text(f"name: pair\nbundle: [{{lidar: {units[0]}}}, {{lidar: {units[1]}}}]\n")
    sheet = read_sheet(file)
    assert (sheet.price_low_usd, sheet.price_source) == (4079, "sum of the units, unconfirmed")


def test_a_range_of_prices_is_reported_with_its_source(capsys: pytest.CaptureFixture[str]) -> None:
    lines = listed(capsys, "hesai_xt32")
    assert " 2000-8000 [1] " in lines[1]
    assert lines[-1] == "[1] nominal, unconfirmed, 2026-11"


def test_a_lidar_of_a_file_stands_beside_those_of_the_catalogue(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.yaml").write_text(
        "name: mine\nprice_usd: {low: 5, high: 9, source: me, date: now}\n"
        "pattern: {spinning: {rate_hz: 10, azimuth_step_deg: 0.4,"
        " channels: {count: 8, upper_deg: 5, lower_deg: -10}}}\nreturns: {max_range_m: 70}\n"
    )
    lines = listed(capsys, tmp_path / "mine.yaml", "livox_avia")
    assert lines[1].split() == "mine mine 8 360 x 15 70 - 5-9 [1]".split()
    assert lines[2].startswith("livox_avia")


def test_json_has_every_figure_and_null_for_what_is_not_known(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (sheet,) = json.loads("\n".join(listed(capsys, "helios_16", "--preset", "paper", "--json")))
    assert sheet["lines"] == 16
    assert sheet["presets"] == ["paper", "equal", "datasheet"]
    assert sheet["range_at_10_percent_m"] is None


def test_a_preset_that_most_lack_is_reported_for_each() -> None:
    problems = {sheet.name: sheet.problem for sheet in read_catalogue("paper")}
    assert problems["ruby_plus"] == ""
    assert "expected equal, datasheet, got unknown preset 'paper'" in problems["hesai_xt32"]


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        (None, 2, "LIDAR: expected a file or a name from the package, got '...mine'"),
        ("name: [a\n", 2, "mine.yaml:2:1: (document): expected YAML, got malformed text"),
        ("name: b\nprice_usd: 3\n", 2, "mine.yaml:2:12: price_usd: expected ..., got "),
        (
            "name: b\nbundle: [{yaw_deg: 3}]\n",
            2,
            "mine.yaml:2:10: bundle.0.lidar: expected ..., got neither or both",
        ),
    ],
)
def test_a_wrong_lidar_is_reported_in_one_line(
    text: str | None, code: int, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    if text is not None:
        file.write_text(text)
    assert main.main(["lidars", str(file if text else file.with_suffix(""))]) == code
    error = capsys.readouterr().err
    assert re.search(pattern(message), error)
    assert error.count("\n") == 1


def test_the_shipped_lidars_are_listed_without_a_run_of_the_simulator(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each start of the binary takes 0.1 s or more. Without it the list takes half a second."""

    def run(*words: object) -> str:
        raise AssertionError(words)

    monkeypatch.setattr("pyinfra.dataset.lidars.infrasim", run)
    start = time.process_time()
    assert main.main(["lidars"]) == 0
    assert time.process_time() - start < 5
    assert "ruby_plus" in capsys.readouterr().out
