"""An output replaces neither an input nor a device, a FIFO or a link; errors can be pickled.

Device nodes, FIFOs and links are made in the test's own folder.
"""

import importlib
import os
import pickle
import pkgutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import report_data

import pyinfra
from pyinfra import _core
from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.core.files import check_output, held, new_folder, replacing, resolved, write
from pyinfra.core.public import PathError
from pyinfra.dataset.runs import SimulatorError

ROOT = Path(__file__).resolve().parents[2]
Infrasim = Callable[..., Any]


def device(path: Path) -> None:
    """Makes a node of the null device, or a FIFO where nodes are not allowed."""
    try:
        os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 3))
    except PermissionError:
        os.mkfifo(path)


def link_to_device(path: Path) -> None:
    device(path.with_name("node"))
    path.symlink_to("node")


SPECIAL = {"device": device, "FIFO": os.mkfifo, "link to a device": link_to_device}
# Options of commands that write one file; {out} is that file.
COMMANDS = {
    "view": ["view", "{data}", "--frames", "0:1", "--out", "{out}"],
    "report": ["report", "{results}", "--out", "{out}"],
    "region": ["region", "{data}/helios_16", "--out", "{out}.yaml"],
    "trajectories": ["trajectories", "{scene}", "--set", "duration_s=1", "--out", "{out}"],
    "pattern": ["pattern", "helios_16", "--frames", "0:1", "--out", "{out}"],
    "static": ["static", "{scene}", "--lidar", "helios_16", "--out", "{out}"],
    "run": ["run", "{scene}", "--lidar", "helios_16", "--frames", "0:1", "--summary", "{out}"],
}
OF_SIMULATOR = ("trajectories", "pattern", "static", "run")


@pytest.fixture
def words(motorway: Path, tmp_path: Path) -> Callable[..., list[str]]:
    """Returns the words of a command of COMMANDS for an output."""
    report_data.write(tmp_path / "results")
    (tmp_path / "s.yaml").write_text((ROOT / "configs/scenes/highway.yaml").read_text())
    places = {"data": motorway, "results": tmp_path / "results", "scene": tmp_path / "s.yaml"}

    def of(name: str, out: Path) -> list[str]:
        return [word.format(**places, out=out) for word in COMMANDS[name]]

    return of


def code_of(name: str, words: list[str], infrasim: Infrasim) -> int:
    if name in OF_SIMULATOR:
        return int(infrasim(*words).returncode)
    return main.main(words)


@pytest.mark.parametrize("kind", SPECIAL)
@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "region"])
def test_a_special_file_is_no_output(
    name: str, kind: str, words: Any, infrasim: Infrasim, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    SPECIAL[kind](out)
    before = {path: path.lstat().st_mode for path in tmp_path.iterdir()}
    assert code_of(name, words(name, out), infrasim) == 2
    assert {path: path.lstat().st_mode for path in before} == before
    assert {*tmp_path.iterdir()} == {*before}


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "region"])
def test_a_link_is_followed(name: str, words: Any, infrasim: Infrasim, tmp_path: Path) -> None:
    out, target = tmp_path / "out", tmp_path / "else/target"
    target.parent.mkdir()
    out.symlink_to("else/target")
    assert code_of(name, words(name, out), infrasim) == 0
    assert out.is_symlink()
    assert target.stat().st_size > 0
    assert [*target.parent.iterdir()] == [target]


INPUTS = {
    "view": "{data}/dataset.yaml",
    "report": "{results}/quick.csv",
    "trajectories": "{scene}",
    "static": "{scene}",
    "run": "{scene}",
}


@pytest.mark.parametrize("name", INPUTS)
def test_an_input_is_no_output(
    name: str, words: Any, infrasim: Infrasim, motorway: Path, tmp_path: Path
) -> None:
    places = {"data": motorway, "results": tmp_path / "results", "scene": tmp_path / "s.yaml"}
    out = Path(INPUTS[name].format(**places))
    link, hard = tmp_path / "link", tmp_path / "hard"
    link.symlink_to(out)
    before = out.read_bytes()
    for path in (out, link, *([hard] if out.parent == tmp_path else [])):
        if path == hard:
            os.link(out, hard)
        assert code_of(name, words(name, path), infrasim) == 2
        assert out.read_bytes() == before
    assert not (tmp_path / "results/quick_data").exists()


def test_a_table_of_a_lidar_is_no_output_of_its_pattern(infrasim: Infrasim, tmp_path: Path) -> None:
    text = (ROOT / "configs/lidars/helios_16.yaml").read_text()
    name = "channels/robosense_helios_16.csv"
    assert name in text
    (tmp_path / "channels").mkdir()
    table = tmp_path / name
    table.write_bytes((ROOT / "configs/lidars" / name).read_bytes())
    (tmp_path / "mine.yaml").write_text(text.replace("name: helios_16", "name: mine"))
    before = table.read_bytes()
    assert infrasim("pattern", tmp_path / "mine.yaml", "--out", table).returncode == 2
    assert table.read_bytes() == before


def test_an_earlier_output_and_an_empty_file_are_replaced(tmp_path: Path) -> None:
    file = tmp_path / "a.html"
    for start in (None, b"", b"\n <!DOCTYPE HTML>old"):
        if start is not None:
            file.write_bytes(start)
        check_output(file, b"<!doctype html")
    file.write_text("name: a")
    with pytest.raises(Error, match="earlier output"):
        check_output(file, b"<!doctype html")


def test_functions_for_files_refuse_loops_of_links_and_follow_others(tmp_path: Path) -> None:
    loop, link = tmp_path / "loop", tmp_path / "link"
    loop.symlink_to("loop")
    for act in (lambda: write(loop, "x"), lambda: resolved(loop), lambda: _make(loop)):
        with pytest.raises(OSError, match="Too many levels"):
            act()
    link.symlink_to("folder")
    _make(link)
    assert (tmp_path / "folder/file").read_text() == "x"
    with held(tmp_path / "folder", wait=True) as first, held(link, wait=False) as second:
        assert (first, second) == (True, False)
    assert [*(tmp_path / "folder").iterdir()] == [tmp_path / "folder/file"]


def _make(folder: Path) -> None:
    with new_folder(folder) as beside:
        (beside / "file").write_text("x")


def test_a_lock_keeps_the_content_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    with held(tmp_path / "notes", wait=True):
        pass
    assert (tmp_path / "notes").read_text() == "mine"
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(Error, match="got a FIFO"), held(tmp_path / "fifo", wait=True):
        pass
    with pytest.raises(Error, match="got a FIFO"), replacing(tmp_path / "fifo"):
        pass


def test_only_one_function_resolves_links() -> None:
    """`Path.resolve` raises RuntimeError for a loop of links, which would be an internal error."""
    for file in (ROOT / "pyinfra").rglob("*.py"):
        text = file.read_text().replace("Path(__file__).resolve()", "")
        assert ".resolve()" not in text or file.name == "files.py", file


# Errors


def own_errors() -> Iterator[type[BaseException]]:
    for module in pkgutil.walk_packages(pyinfra.__path__, "pyinfra."):
        if module.name.endswith("__main__"):
            continue
        try:
            names = vars(importlib.import_module(module.name))
        except ImportError:  # of an extra that is not installed
            continue
        yield from (
            kind
            for kind in names.values()
            if isinstance(kind, type)
            and issubclass(kind, BaseException)
            and kind.__module__.startswith("pyinfra")
        )


def test_own_errors_survive_the_way_between_processes() -> None:
    kinds = {*own_errors(), _core.ConfigError, _core.IoError}
    assert {Error, PathError, SimulatorError} <= kinds
    for kind in kinds:
        error = kind("a.csv:3: expected b")
        error.add_note("command: c")
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is kind
        assert (again.args, str(again)) == (error.args, str(error))
        assert vars(again) == vars(error)
        assert kind.__new__(kind, "a").args == ("a",)  # Dask makes them so
    failed = pickle.loads(pickle.dumps(SimulatorError("full", 2)))
    assert (str(failed), failed.exit_code) == ("full", 2)
