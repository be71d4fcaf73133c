"""Inputs without an end, of a huge size or with impossible values are refused at once.

Causes are named: a full disk is no bad map, and no path ends as an internal error.
"""

import errno
import gzip
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import report_data
import site_maps

from pyinfra.cli import main
from pyinfra.core.config import read_config
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.files import regular_files_only
from pyinfra.dataset.frame_readers import read_cameras, read_predictions
from pyinfra.dataset.prediction_csv import CSV_COLUMNS
from pyinfra.dataset.prediction_origin import read_origin
from pyinfra.dataset.roads import ROAD_COLUMNS, roads_of
from pyinfra.exchange.object_types import types_of
from pyinfra.experiments.planner.observe import _kept
from pyinfra.formats.csv_table import plain_cell, read_csv
from pyinfra.formats.yaml_file import read_keys, read_yaml
from pyinfra.metrics.replicates import bootstrapped_of
from pyinfra.scenes.maps import sumo
from pyinfra.scenes.maps.lane_map import MapError
from pyinfra.scenes.maps.map_file import unpacked
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.network import read_network
from pyinfra.viz.viewer.page import check_size

Captured = pytest.CaptureFixture[str]

# YAML


LAUGHS = "a: &a [1, 2, 3]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n"
    for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize("text", [LAUGHS, "a: &a [1, *a]\n", "a: &a {b: *a}\n"])
def test_aliases_of_yaml_are_bounded_in_each_reader(text: str, tmp_path: Path) -> None:
    file = tmp_path / "origin.yaml"
    file.write_text(text)
    start = time.process_time()
    for read in (read_yaml, read_keys, lambda f: read_config(f, type), read_origin):
        with pytest.raises(Error, match="alias"):
            read(file.parent if read is read_origin else file)  # type: ignore[operator]
    assert time.process_time() - start < 2


def test_a_few_aliases_are_read(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("a: &a {b: 1}\nc: [*a, *a]\nd: {<<: *a, e: 2}\n")
    assert read_keys(file) == {"a": {"b": 1}, "c": [{"b": 1}] * 2, "d": {"b": 1, "e": 2}}


def test_a_huge_yaml_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.touch()
    os.truncate(file, 2**40)
    for read in (read_yaml, read_keys, lambda f: read_config(f, type)):
        with pytest.raises(Error, match="expected at most 67,108,864 bytes"):
            read(file)  # type: ignore[operator]


# Files without an end


@pytest.mark.parametrize(
    "words",
    [
        ["view", "{in}", "--out", "a.html"],
        ["report", "{in}", "--out", "a.html"],
        ["validate", "{in}"],
        ["site", "import", "{in}.xodr", "--out", "s"],
        ["benchmark", "{in}.yaml", "--out", "b"],
        ["import", "sample", "--out", "rec", "--region", "{in}.yaml"],
        ["plan", "crossroad", "--budget", "9000", "--poses", "{in}.csv", "--out", "p"],
    ],
)
def test_a_fifo_is_no_input(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    """Nothing writes to it, so that a command that opened it would not end."""
    monkeypatch.chdir(tmp_path)
    for name in ("in", "in.xodr", "in.yaml", "in.csv"):
        os.mkfifo(name)
    assert main.main([word.replace("{in}", "./in") for word in words]) in (1, 2)
    message = capsys.readouterr().err
    assert "internal error" not in message
    assert "in" in message


def test_a_fifo_in_a_folder_is_no_input(motorway: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    readers: list[Callable[[Path], object]] = [np.fromfile, Path.read_bytes, pd.read_csv]
    for read in readers:
        with (
            pytest.raises(Error, match="expected a regular file, got a FIFO"),
            regular_files_only(),
        ):
            read(tmp_path / "fifo")
    with regular_files_only(), Path(os.devnull).open("rb") as null:
        assert null.read() == b""


# Sizes and values


def test_a_view_that_is_too_large_is_refused_before_it_is_read(tmp_path: Path) -> None:
    folder = tmp_path / "lidar"
    (folder / "training/velodyne").mkdir(parents=True)
    frame = folder / "training/velodyne/000000.bin"
    frame.touch()
    os.truncate(frame, 16 * 30_000)
    for k in range(1, 2000):
        os.link(frame, frame.with_name(f"{k:06d}.bin"))
    with pytest.raises(Error, match="2000 frames of 1 LiDARs with 78 MB or more"):
        check_size([folder], range(2000))
    check_size([folder], range(1000))
    check_size([folder], range(2000), 10_000)


def predictions_in(file: Path) -> int:
    return len(read_predictions([file], read_cameras(file.parent, [0])))


@pytest.mark.parametrize("ending", ["txt", "csv"])
def test_a_frame_has_a_bounded_number_of_possible_predictions(ending: str, tmp_path: Path) -> None:
    file = tmp_path / f"000000.{ending}"
    head = ",".join(CSV_COLUMNS) + "\n" if ending == "csv" else ""

    def row(size: str = "2", x: str = "5", heading: str = "0") -> str:
        if ending == "csv":
            return f"Car,{x},0,0,{size},2,2,{heading},0.5\n"
        return f"Car 0 0 0 0 0 9 9 2 2 {size} {x} 0 9 {heading} 0.5\n"

    file.write_text(head + 1000 * row())
    assert predictions_in(file) == 1000
    file.write_text(head + 1001 * row())
    with pytest.raises(FormatError, match="expected up to 1000 predictions in a frame, got 1001"):
        predictions_in(file)
    for wrong in (row(size="1e308"), row(size="0"), row(x="-1e300"), row(heading="1e99")):
        file.write_text(head + row() + wrong)
        with pytest.raises(FormatError, match=r":[23]: \w+: expected .*10000, got "):
            predictions_in(file)


def test_a_coordinate_of_a_network_is_bounded(tmp_path: Path) -> None:
    lane = '<lane id="a_0" shape="0,0 {},0" width="3"/>'
    text = f'<net><edge id="a"><{lane[1:]}</edge></net>'
    for far in ("1e9", "1e300", "-2e6"):
        (tmp_path / "a.net.xml").write_text(text.replace("{}", far))
        with pytest.raises(MapError, match=r"lane a_0: shape: expected up to 1e\+06 m"):
            read_network(tmp_path / "a.net.xml")
    (tmp_path / "a.net.xml").write_text(text.replace("{}", "1e3"))
    assert len(read_network(tmp_path / "a.net.xml").lanes) == 1


@pytest.mark.parametrize("missing", [{50}, {1}, {99}, {20, 21}])
def test_roads_with_missing_rows_are_an_error(missing: set[int]) -> None:
    rows = [f"main,{s},{s},0,0,0,5" for s in range(101) if s not in missing]
    with pytest.raises(FormatError, match="are rows missing"):
        roads_of([",".join(ROAD_COLUMNS), *rows], Path("roads.csv"))
    ends = ["main,-0.3,-0.3,0,0,0,5", *(f"main,{s},{s},0,0,0,5" for s in range(101))]
    assert len(roads_of([",".join(ROAD_COLUMNS), *ends], Path("roads.csv"))) == 1


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)"])
def test_a_class_is_no_formula(name: str) -> None:
    (kind,) = types_of(np.array([name]), {})
    assert kind == f"_{name[1:]}"
    assert plain_cell("Car") == "Car"


# Maps


@pytest.fixture(scope="module")
def junction(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Returns a map and its site, which were both in folders with a comma in the name."""
    folder = tmp_path_factory.mktemp("a,b")
    file = site_maps.t_junction(folder, sumo.sumo_folder())
    file = file.rename(folder / "t,1.xodr")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LC_ALL", "xx_YY.UTF-8")  # is not installed
        import_map(file, folder / "s,1")
    return file, folder / "s,1"


def test_an_import_holds_neither_paths_nor_the_machine(
    junction: tuple[Path, Path], tmp_path: Path
) -> None:
    file, site = junction
    import_map(file, tmp_path / "again")
    for name in ("map.net.xml", "map.yaml"):
        text = (site / name).read_text()
        assert text == (tmp_path / "again" / name).read_text()
        assert str(file.parent) not in text
        assert os.uname().nodename not in text
        assert "<!--" not in text
        assert "locale" not in text


def test_a_full_disk_is_no_bad_map(
    junction: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, _ = junction
    packed = tmp_path / "t.xodr.gz"
    packed.write_bytes(gzip.compress(file.read_bytes()))

    class Full:
        def write(self, data: bytes) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        def __enter__(self) -> "Full":
            return self

        def __exit__(self, *_: object) -> None: ...

    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.open", lambda *_, **__: Full())
        with pytest.raises(OSError, match="No space left") as error:
            unpacked(packed, ".xodr", tmp_path)
    assert error.value.errno == errno.ENOSPC
    cut = tmp_path / "cut.net.xml"
    cut.write_text("<net><edge")
    with pytest.raises(OSError, match="the disk may be full"):
        sumo._check_complete(cut, b"</net>")


# Causes


NOT_UTF8 = "a\udcff"


@pytest.mark.parametrize(
    "words",
    [
        ["validate", "{}"],
        ["statistics", "{}", "--out", "s"],
        ["view", "{}", "--out", "a.html"],
        ["export", "{}", "--to", "pcd", "--out", "e"],
        ["split", "{}"],
        ["pictures", "{}", "--out", "p"],
        ["region", "{}", "--out", "a.yaml"],
        ["import", "{}", "--out", "rec"],
        ["evaluate", "{}", "{}", "--out", "e"],
    ],
)
@pytest.mark.parametrize("path", ["loop", NOT_UTF8])
def test_odd_paths_are_no_internal_errors(
    path: str,
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Captured,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    Path(NOT_UTF8).mkdir()
    assert main.main([word.replace("{}", path) for word in words]) in (1, 2)
    message = capsys.readouterr().err
    assert "internal error" not in message
    assert "loop" in message if path == "loop" else "UTF-8" in message


def test_tables_with_missing_columns_name_them(tmp_path: Path) -> None:
    file = tmp_path / "replicates.csv"
    file.write_text("measure,value\nap_r1000,1\n")
    with pytest.raises(FormatError, match=r"replicates\.csv:1: expected the column blocks"):
        read_csv(file, required=("measure", "blocks"))
    row = pd.Series({"value": 1.0, "blocks": 3.0, "replicates": 2.0, "replicate_1": 0.5})
    for count in (2.0, np.nan, -1.0):
        with pytest.raises(Error, match="replicates: expected 0 to 1"):
            bootstrapped_of(row.replace(2.0, count))


def test_a_damaged_observation_is_computed_again(tmp_path: Path) -> None:
    file = tmp_path / "a.npy"
    rows = np.zeros(3, dtype=[("at", "i4"), ("lidar", "i4"), ("frame", "i4")])
    np.save(file, rows)
    whole = file.read_bytes()
    kept = _kept(file)
    assert kept is not None
    assert len(kept) == 3
    for damaged in (b"", whole[:5], whole[:90], whole[:-1], b"\0" + whole[1:]):
        file.write_bytes(damaged)
        assert _kept(file) is None
    np.save(file, np.zeros(3))
    assert _kept(file) is None


@pytest.mark.nightly
def test_a_text_among_numbers_of_a_report_is_named(tmp_path: Path, capsys: Captured) -> None:
    tables = report_data.tables()
    for name in ("lidars.csv", "stress.csv"):
        for column in tables[name].select_dtypes("number"):
            changed = tables[name].astype({column: object})
            changed.loc[changed.index[0], column] = "abc"
            folder = report_data.write(tmp_path / f"{name}_{column}", {**tables, name: changed})
            code = main.main(["report", str(folder), "--out", str(tmp_path / "a.html")])
            assert code in (0, 2), column
            assert "internal error" not in capsys.readouterr().err


def test_yaml_of_a_site_that_is_damaged_is_named(
    junction: tuple[Path, Path], tmp_path: Path
) -> None:
    file, _ = junction
    (tmp_path / "s").mkdir()
    for text in ("a: [1", "[1]", "a: 2001-99-99"):
        (tmp_path / "s/map.yaml").write_text(text)
        with pytest.raises(FormatError, match=r"map\.yaml"):
            import_map(file, tmp_path / "s")
