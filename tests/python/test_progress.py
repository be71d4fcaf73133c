"""Long loops show a bar on terminals and in notebooks, and lines elsewhere."""

import io
import itertools
import sys
from types import ModuleType

import pytest

from pyinfra.core import progress
from pyinfra.exchange.rates import Shown


class Stream(io.StringIO):
    def __init__(self, *, terminal: bool) -> None:
        super().__init__()
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


@pytest.mark.parametrize(
    ("terminal", "notebook", "shown"),
    [(True, False, True), (False, True, True), (False, False, False)],
)
def test_progress_is_shown_where_somebody_reads_it(
    monkeypatch: pytest.MonkeyPatch, terminal: bool, notebook: bool, shown: bool
) -> None:
    stream = Stream(terminal=terminal)
    monkeypatch.setattr(progress, "DELAY_S", 0.0)
    monkeypatch.setattr(sys, "stderr", stream)
    if notebook:
        monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    assert list(progress.track(range(3), "frame")) == [0, 1, 2]
    assert ("0/3" in stream.getvalue()) == shown


def test_a_short_loop_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Stream(terminal=True)
    monkeypatch.setattr(sys, "stderr", stream)
    assert list(progress.track(range(3), "frame")) == [0, 1, 2]
    assert stream.getvalue().strip() == ""


def counted(monkeypatch: pytest.MonkeyPatch, step_s: float, count: int = 300) -> list[str]:
    """Returns the lines of a loop without a terminal whose steps take `step_s`."""
    stream, clock = Stream(terminal=False), itertools.count(0, step_s)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    assert list(Shown(range(count))) == list(range(count))
    return stream.getvalue().splitlines()


def test_without_a_terminal_a_line_is_printed_every_half_minute(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lines = counted(monkeypatch, 1.0)
    assert len(lines) == 9
    assert lines[0] == "pyinfra: 30 of 300 frames, 4 min left"
    assert lines[-1] == "pyinfra: 270 of 300 frames, 30 s left"
    assert counted(monkeypatch, 0.1) == []


def test_worker_processes_print_no_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress.multiprocessing, "parent_process", lambda: "parent")
    assert counted(monkeypatch, 1.0) == []


def test_the_time_left_is_that_of_the_items_of_this_run(monkeypatch: pytest.MonkeyPatch) -> None:
    stream, clock = Stream(terminal=False), itertools.count(0, 60)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    progress.Lines("step", 14, done=10).update()
    progress.Lines("site", 0).update()
    assert stream.getvalue() == "pyinfra: 11 of 14 steps, 3 min left\npyinfra: 1 sites\n"
