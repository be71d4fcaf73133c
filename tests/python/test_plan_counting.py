"""Counts of an option: passages of tracks against true passages, and the line of the answer."""

from dataclasses import replace

import numpy as np
import pytest

import pyinfra as pi
from pyinfra.experiments.planner import simulate
from pyinfra.experiments.planner.answer import count_line
from pyinfra.experiments.planner.simulate import Counting, count_option
from pyinfra.experiments.planner.site import open_site

POSE = (-25.0, -10.0, 6.0, 0.0, 0.0)


def test_with_true_boxes_nearly_all_passages_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "detect", lambda _, frames: frames.objects.assign(score=0.9))
    parts = [(POSE, pi.load_lidar("helios_16"))]
    found = count_option(open_site("crossroad", 4), parts, "generalist", seconds=8)
    assert found.seconds == 8
    assert found.passages > 5
    assert found.counted >= found.passages - 2  # the first frames of a track are not counted
    assert found.extra <= 1
    assert found.speed_error_km_h < 0.5


def test_the_interval_is_wilsons() -> None:
    share = Counting(30, 100, 96, 0, 1.2).share
    assert share.value == 0.96
    np.testing.assert_allclose([share.low, share.high], [0.9016, 0.9843], atol=1e-4)
    assert np.isnan(Counting(30, 0, 0, 0, np.nan).share.value)


@pytest.mark.parametrize(
    ("counted", "words"), [(300, "95 % counted: met."), (200, "not met."), (290, "not known.")]
)
def test_the_line_says_whether_the_goal_is_met(counted: int, words: str) -> None:
    line = count_line(Counting(30, 300, counted, 2, 1.23), 0.95)
    assert line.startswith(f"Counts: {counted} of 300 passages in 30 s of other traffic (")
    assert "2 without a vehicle; speeds within 1.2 km/h (median). 95 % counted: " in line
    assert line.endswith(words)


def test_without_passages_nothing_is_claimed() -> None:
    line = count_line(Counting(2, 0, 0, 0, np.nan), 0.95)
    assert line == "Counts: no vehicle passes a line in 2 s of traffic."
    line = count_line(Counting(2, 0, 0, 0, np.nan, has_lines=False), 0.95)
    assert line == "Counts: no line can be drawn across the roads of the site."


def test_a_site_on_whose_roads_no_line_can_be_drawn_is_told_apart() -> None:
    site = open_site("crossroad", 4)
    parts = [(POSE, pi.load_lidar("helios_16"))]
    found = count_option(replace(site, roads=()), parts, "generalist", seconds=2)
    assert (found.has_lines, found.passages) == (False, 0)


def test_a_share_that_is_none_is_refused() -> None:
    with pytest.raises(pi.Error, match=r"count: expected more than 0, at most 1, got 95"):
        pi.plan("crossroad", 9000, count=95)


@pytest.mark.nightly
def test_a_plan_counts_the_vehicles_of_its_first_option() -> None:
    grid = pi.PoseGrid(every_m=60, heights_m=(5,), pitches_deg=(0,))
    result = pi.plan("crossroad", 9000, lidars=["livox_avia"], frames=6, check_frames=3,
                     count=0.95, grid=grid)  # fmt: skip
    assert result.counting is not None
    assert result.counting.passages > 20
    assert result.counting.share.value > 0.5
    (line,) = [line for line in result.answer.lines if line.startswith("Counts: ")]
    assert line == count_line(result.counting, 0.95)
    assert len(result.answer.lines) <= 10
