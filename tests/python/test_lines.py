"""Lines at the arms of junctions: crossings, T junctions, bridges and several junctions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from site_maps import junction

import pyinfra as pi
from pyinfra.dataset.roads import Road
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.tracking.lines import Line, of_roads


@pytest.fixture(scope="module")
def frames() -> SimulatedFrames:
    return pi.simulate(pi.load_scene("flat", seed=1), "helios_16", range(2))


def road(name: str, start: tuple[float, float], end: tuple[float, float], z: float = 0) -> Road:
    """Returns a road of 10 m width."""
    step = np.subtract(end, start)
    s = np.arange(round(float(np.hypot(*step))) + 1.0)
    xy = start + s[:, None] * step / np.hypot(*step)
    return Road(name, s, xy, 0 * s + z, 0 * s + np.arctan2(step[1], step[0]), 0 * s + 5)


MAIN = road("main", (-100, 0), (100, 0))
NORTH_SOUTH = (0, -80), (0, 80)


def names(lines: list[Line]) -> list[str]:
    return sorted(line.name for line in lines if line.group)


@pytest.mark.parametrize("end", [0.0, -0.5, -4.0])
@pytest.mark.parametrize("turned", [False, True])
def test_a_t_junction_has_three_arms(frames: SimulatedFrames, end: float, turned: bool) -> None:
    ends = ((0, end), (0, -80)) if turned else ((0, -80), (0, end))
    for roads in ([MAIN, road("side", *ends)], [road("side", *ends), MAIN]):
        lines = of_roads(roads, frames)
        assert names(lines) == ["main E", "main W", "side S"]
        assert {line.group for line in lines} == {f"{roads[0].name} x {roads[1].name}"}


def test_roads_that_follow_each_other_or_end_outside_do_not_cross(frames: SimulatedFrames) -> None:
    other = road("other", (100, 0), (180, 0))
    away = road("away", (0, -80), (0, -7))
    assert names(of_roads([MAIN, other, away], frames)) == []


@pytest.mark.parametrize(("z", "arms"), [(0.0, 4), (1.0, 4), (5.5, 0), (-5.5, 0)])
def test_a_bridge_is_no_crossing(frames: SimulatedFrames, z: float, arms: int) -> None:
    assert len(names(of_roads([MAIN, road("side", *NORTH_SOUTH, z=z)], frames))) == arms


def test_arms_have_different_names_at_each_junction(frames: SimulatedFrames) -> None:
    others = [road("a", (-40, -80), (-40, 80)), road("b", (40, -80), (40, 80))]
    assert names(of_roads([MAIN, *others], frames)) == [
        "a N", "a S", "b N", "b S", "main E (main x a)", "main E (main x b)",
        "main W (main x a)", "main W (main x b)",
    ]  # fmt: skip


def test_crossing_lanes_of_a_map_ask_for_lines(tmp_path: Path) -> None:
    (tmp_path / "x.xodr").write_text(junction([0, 90, 180, 270], 20.0))
    pi.import_map(tmp_path / "x.xodr", tmp_path / "site", seconds=20)
    scene = pi.load_scene(tmp_path / "site/site.yaml")
    frames = pi.simulate(scene, "helios_16", range(2))
    tracks = pi.track(frames.objects.assign(score=0.9), frames)
    for run in (lambda: pi.count(tracks, frames), lambda: pi.evaluate_tracks(frames, tracks)):
        with pytest.raises(pi.Error, match="lines_m"):
            run()
    own = {"arm": [[10.0, 20.0], [10.0, -20.0]]}
    assert len(pi.count(tracks, own).lines) == 1
