"""Counts of an option: passages of tracks against true passages, and the line of the answer."""

import numpy as np
import pytest

import pyinfra as pi
from pyinfra.experiments.planner import counting
from pyinfra.experiments.planner.counting import Counted, count_line, count_option
from pyinfra.experiments.planner.site import open_site

POSE = (-25.0, -10.0, 6.0, 0.0, 0.0)


def test_with_true_boxes_nearly_all_passages_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(counting, "detect", lambda _, frames: frames.objects.assign(score=0.9))
    parts = [(POSE, pi.load_lidar("helios_16"))]
    found = count_option(open_site("crossroad", 4), parts, "generalist", seconds=8)
    assert found is not None
    assert found.seconds == 8
    assert found.passages > 5
    assert found.counted >= found.passages - 2  # the first frames of a track are not counted
    assert found.extra <= 1
    assert found.speed_error_km_h < 0.5


def test_the_interval_is_wilsons() -> None:
    share = Counted(30, 100, 96, 0, 1.2).share
    assert share.value == 0.96
    np.testing.assert_allclose([share.low, share.high], [0.9016, 0.9843], atol=1e-4)
    assert np.isnan(Counted(30, 0, 0, 0, np.nan).share.value)


@pytest.mark.parametrize(
    ("counted", "words"), [(300, "95 % counted: met."), (200, "not met."), (290, "not known.")]
)
def test_the_line_says_whether_the_goal_is_met(counted: int, words: str) -> None:
    line = count_line(Counted(30, 300, counted, 2, 1.23), 0.95)
    assert line.startswith(f"Counts: {counted} of 300 passages in 30 s of other traffic (")
    assert "2 without a vehicle; speeds within 1.2 km/h (median). 95 % counted: " in line
    assert line.endswith(words)


def test_without_passages_nothing_is_claimed() -> None:
    line = count_line(Counted(2, 0, 0, 0, np.nan), 0.95)
    assert line == "Counts: no vehicle passes a line in 2 s of traffic."
