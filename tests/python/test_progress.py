"""Commands show their progress on a terminal after two seconds. The library shows no progress."""

import io
import sys

import pytest

from pyinfra.core import progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal_of(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Replaces stderr by a terminal. A fixture can't do this, because pytest replaces stderr again
    before the test."""
    monkeypatch.setattr(progress, "DELAY_S", 0.0)
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert isinstance(sys.stderr, Terminal)
    return sys.stderr


def test_a_command_shows_progress_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with progress.shown():
        assert list(progress.track(range(3), "frame")) == [0, 1, 2]
    assert "0/3" in terminal.getvalue()


def test_the_library_shows_no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    assert list(progress.track(range(3), "frame")) == [0, 1, 2]
    assert terminal.getvalue() == ""


def test_nothing_is_shown_in_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress.shown():
        assert list(progress.track(range(3), "frame")) == [0, 1, 2]
    assert isinstance(sys.stderr, io.StringIO)
    assert sys.stderr.getvalue() == ""
