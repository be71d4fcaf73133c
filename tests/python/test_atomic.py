"""Files and folders exist completely or not at all, even if several processes write them."""

import os
import platform
import threading
from pathlib import Path

import pytest

from pyinfra.cli.messages import message_of
from pyinfra.core.files import new_folder, replacing

DEAD = 2**31 - 2  # larger than any process id of the system


def test_a_file_of_many_writers_is_that_of_one_of_them(tmp_path: Path) -> None:
    file = tmp_path / "file"

    def write(letter: str) -> None:
        for _ in range(100):
            with replacing(file) as beside:
                beside.write_text(letter * 1000)

    threads = [threading.Thread(target=write, args=(letter,)) for letter in "abcd"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    text = file.read_text()
    assert text == text[0] * 1000
    assert list(tmp_path.iterdir()) == [file]


def test_hidden_names_hold_host_and_process_and_fit_the_system(tmp_path: Path) -> None:
    file = tmp_path / ("n" * 250)
    with replacing(file) as one, replacing(file) as two:
        assert one != two
        for beside in (one, two):
            assert beside.name.startswith(".n")
            assert f".{platform.node()}.{os.getpid()}." in beside.name
            beside.write_text("x")
    assert list(tmp_path.iterdir()) == [file]


def test_folder_that_came_to_be_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    folder = tmp_path / "folder"

    def both() -> None:
        with new_folder(folder) as first:
            (first / "mine").write_text("1")
            with new_folder(folder) as second:
                (second / "other").write_text("2")

    with pytest.raises(
        FileExistsError, match="expected a new or empty folder, got a folder with files"
    ):
        both()
    assert [p.name for p in folder.iterdir()] == ["other"]
    assert list(tmp_path.iterdir()) == [folder]


def test_what_a_killed_process_left_of_a_folder_goes(tmp_path: Path) -> None:
    left = tmp_path / f".folder.{platform.node()}.{DEAD}.0.tmp"
    others = tmp_path / ".folder.elsewhere.1.0.tmp"
    for path in (left, others):
        path.mkdir()
        (path / "file").write_text("x")
    with new_folder(tmp_path / "folder"):
        assert not left.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == [others.name, "folder"]


def test_messages_hold_no_control_characters() -> None:
    assert message_of(ValueError("a\x1b[31m\nb\x7f\x9b")) == r"a\x1b[31m b\x7f\x9b"
    assert message_of(FileNotFoundError(2, "No such file", "x\x1b\udcff")) == (
        r"x\x1b\udcff: No such file"
    )
    assert message_of(ValueError("Straße € 5")) == "Straße € 5"
