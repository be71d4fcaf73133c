"""Long loops show their progress on terminals and in notebooks, after two seconds."""

import io
import sys
from types import ModuleType

import pytest

from pyinfra.core import progress


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
