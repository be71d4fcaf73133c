"""Tables of results: impossible values are refused with file, row and column."""

import importlib
import re
from pathlib import Path

import pandas as pd
import pytest
import report_data

from pyinfra.core.errors import FormatError
from pyinfra.experiments.result_tables import read_results
from pyinfra.formats.csv_table import read_csv

RESULTS = Path(__file__).resolve().parents[2] / "results"
TABLES = ("quick", "quick_areas", "quick_distance", "quick_value", "lidars")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Writes results with a few rows per table."""
    tables = report_data.tables()
    files = [f"{name}.csv" for name in TABLES]
    return report_data.write(tmp_path, {file: tables[file][:5] for file in files})


def changed(file: Path, row: int, **values: object) -> None:
    table = pd.read_csv(file, dtype=str, keep_default_na=False)
    for name, value in values.items():
        table.loc[row, name] = str(value)
    table.to_csv(file, index=False)


@pytest.mark.parametrize(
    ("table", "values", "message"),
    [
        ("quick", {"ap": 943}, "quick.csv:3: ap: expected 0 to 100, got 943"),
        ("quick", {"ap_all": -1}, "quick.csv:3: ap_all: expected 0 to 100, got -1"),
        ("quick", {"ap": "inf"}, "quick.csv:3: ap: expected 0 to 100, got inf"),
        (
            "quick",
            {"ap": "much"},
            "quick.csv:3: ap: expected a number or an empty cell, got 'much'",
        ),
        ("quick", {"ap_low": 90, "ap_high": 80}, "quick.csv:3: ap_low: expected"),
        ("quick", {"latency_p50_ms": -3}, "csv:3: latency_p50_ms: expected 0 or more, got -3"),
        ("quick", {"lidar": ""}, "quick.csv:3: lidar: expected a name, got an empty cell"),
        ("quick_areas", {"n_hqda": -1}, "quick_areas.csv:3: n_hqda: expected 0 or more, got -1"),
        ("quick_distance", {"s": "inf"}, "csv:3: s: expected a finite number, got inf"),
        ("quick_value", {"price_usd": -1}, "csv:3: price_usd: expected 0 or more, got -1"),
        ("lidars", {"units": 0}, "lidars.csv:3: units: expected 1 to 1e+06, got 0"),
        ("lidars", {"price_low_usd": 9e6}, "lidars.csv:3: price_low_usd: expected"),
    ],
)
def test_a_number_out_of_range_is_named_by_row_and_column(
    table: str, values: dict[str, object], message: str, folder: Path
) -> None:
    changed(folder / f"{table}.csv", 1, **values)
    with pytest.raises(ValueError, match=re.escape(message)):
        read_results(folder, "quick")


@pytest.mark.parametrize("table", TABLES)
def test_a_row_that_comes_twice_is_an_error(table: str, folder: Path) -> None:
    file = folder / f"{table}.csv"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join([*lines, lines[2]]))
    last = len(lines) + 1
    message = rf"{table}.csv:{last}: .*: expected one row with this key, got rows 3 and {last}"
    with pytest.raises(ValueError, match=message):
        read_results(folder, "quick")


def test_the_lidars_of_the_project_are_in_range() -> None:
    assert len(read_results(RESULTS).table("lidars"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "t.csv:1: expected"),
        ("a,b\n1\n", "t.csv:2: expected 2 columns, got 1"),
        ("a,b\n1,2,3\n", "t.csv:2: expected 2 columns, got 3"),
        ("a,b\n1,2\n\n3,4\n", "t.csv:3: expected 2 columns, got 0"),
        ("a,a\n1,2\n", "t.csv:1: expected each column name once, got column a twice"),
        ("a,b\n1,x\n", "t.csv:2: b: expected a number or an empty cell, got 'x'"),
        ('a,b\n1,"2\n', "t.csv: cannot be read as a table: unexpected end of data"),
        ("a,b\n1,\0\n", "t.csv"),
    ],
)
def test_what_is_no_table_is_said_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "t.csv"
    file.write_text(text)
    with pytest.raises(FormatError, match=re.escape(message)):
        read_csv(file)


def test_words_stay_words_and_numbers_numbers(tmp_path: Path) -> None:
    names = ["007", "NA", "1e5", "null", "True", "nan", ""]
    file = tmp_path / "t.csv"
    file.write_text("lidar,ap\n" + "".join(f"{name},{i}\n" for i, name in enumerate(names)))
    table = read_csv(file)
    assert table.lidar.fillna("").to_list() == names
    assert table.lidar.isna().sum() == 1
    assert table.ap.to_list() == list(range(7))


def test_a_measurement_replaces_no_recorded_result_unless_it_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`make bench` calls the programs without options."""
    monkeypatch.syspath_prepend(RESULTS.parent / "benchmarks")
    arguments = importlib.import_module("run").arguments()
    assert arguments.parse_args([]).out == RESULTS.parent / "out/speed.csv"
    recipe = (RESULTS.parent / "Makefile").read_text().split("\nbench:")[1].split("\n\n")[0]
    assert recipe.endswith("benchmarks/run.py $(if $(AGAINST),--against $(AGAINST))")
