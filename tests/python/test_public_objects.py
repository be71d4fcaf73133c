"""What public functions return can be pickled, copied and shown.

LiDARs and scenes can also be dumped, and loaded again.
"""

from __future__ import annotations

import copy
import inspect
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import pyinfra as pi
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.lidars import catalogue_files, presets_of
from pyinfra.dataset.outlines import Drawn
from pyinfra.models.inference.region_proposal import Proposal

SHORT = {"duration_s": 2, "traffic.warm_up_s": 5}
WALL = ("structure", [[20, -9, 0], [20, 9, 0], [20, 0, 9]], [[0, 1, 2]])


class Given:
    """What the objects are made of."""

    def __init__(self) -> None:
        self.world = pi.load_scene("highway", set=SHORT)
        self.frames = pi.simulate(self.world, "helios_16", range(0, 20, 10))
        self.detections = pi.Detections(self.frames.labels.assign(score=0.5))

    def tracks(self) -> pd.DataFrame:
        return pi.track(self.detections, self.frames)

    def result(self) -> pi.Evaluation:
        return pi.evaluate(self.frames, self.detections)


given = cache(Given)


def of_keys(name: str) -> pi.Lidar:
    return pi.load_lidar(yaml.safe_load(pi.load_lidar(name).dump()))


MADE: dict[str, Callable[[], Any]] = {
    "World": lambda: given().world,
    "World of keys": lambda: pi.load_scene(yaml.safe_load(given().world.dump())),
    "World with a mesh": lambda: pi.load_scene("highway", set=SHORT, meshes=[WALL]),
    "Lidar": lambda: pi.load_lidar("ruby_plus"),
    "Lidar of keys": lambda: of_keys("ruby_plus"),
    "Lidar with changes": lambda: pi.load_lidar("livox_avia", rate_hz=20, echo="first"),
    "Lidar with a method": lambda: pi.load_lidar("ruby_plus").with_free_motors(),
    "FrameSequence": lambda: given().frames,
    "LidarFrame": lambda: given().frames[1],
    "Detections": lambda: given().detections,
    "Evaluation": lambda: given().result(),
    "Interval": lambda: pi.compare(given().result(), given().result()),
    "TrainedDetector": lambda: pi.load_detector("generalist", threads=2),
    "Settings": lambda: pi.Settings(ious=(0.3,)),
    "PoseGrid": lambda: pi.PoseGrid(every_m=3),
    "TrackSettings": lambda: pi.TrackSettings(),
    "Counts": lambda: pi.count(given().tracks(), given().frames),
    "TrackEvaluation": lambda: pi.evaluate_tracks(given().frames, given().tracks()),
    "Proposal": lambda: Proposal(Drawn((np.eye(3, 2),)), 12.3, 40, 4, 0.5, 0.25),
}
SETTINGS = {"Settings", "PoseGrid", "TrackSettings"}  # arguments, of which no table is shown
COPIES: dict[str, Callable[[Any], Any]] = {
    "pickled": lambda one: pickle.loads(pickle.dumps(one)),
    "copied": copy.copy,
    "copied deeply": copy.deepcopy,
}


def state(one: Any) -> object:
    """Returns what must be equal in a copy."""
    if isinstance(one, (pi.World, pi.Lidar)):
        return one.dump()
    if isinstance(one, FrameSequence):
        return one[1].points.tobytes(), one.numbers
    if isinstance(one, pi.LidarFrame):
        return one.points.tobytes()
    if isinstance(one, pi.Plan):
        return [
            table.to_csv() for table in (one.options, one.candidates, one.sensitivity)
        ], one.text
    return one.to_csv() if isinstance(one, pd.DataFrame) else repr(one)


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("name", MADE)
def test_a_copy_is_equal(name: str, how: str) -> None:
    one = MADE[name]()
    again = COPIES[how](one)
    assert type(again) is type(one)
    assert state(again) == state(one)
    assert state(pickle.loads(pickle.dumps(again))) == state(one)


@pytest.mark.parametrize("name", MADE)
def test_an_object_is_shown_in_one_line_and_as_a_table(name: str) -> None:
    one = MADE[name]()
    if name != "Detections":  # a pandas table
        assert repr(one).startswith((name.split()[0], type(one).__name__))
        assert len(repr(one)) < 300
        assert "\n" not in repr(one)
        assert " object at 0x" not in repr(one)
    if name not in SETTINGS:
        assert one._repr_html_().startswith(("<table", "<div"))


def test_a_plan_is_copied_and_shown(planned: Any) -> None:
    for copied in COPIES.values():
        again = copied(planned)
        assert state(again) == state(planned)
        assert len(again.site.observer.present([again.site.frames[0]])) > 0
    assert repr(planned).startswith("Plan(scene=crossroad, verdict=")
    assert len(repr(planned)) < 300
    assert planned._repr_html_().startswith("<table")


def test_every_public_class_is_tested_here() -> None:
    classes = {name for name in pi.__all__ if inspect.isclass(getattr(pi, name))}
    assert classes - {*MADE, "Plan", "Error", "FindingWarning"} == set()


@pytest.mark.parametrize("name", ["World with a mesh", "Lidar of keys"])
def test_a_pickle_outlives_the_files_of_its_process(name: str, tmp_path: Path) -> None:
    """Objects in memory are written to files that end with the process."""
    here = Path(__file__).parent
    code = (
        f"import pickle, sys; sys.path.insert(0, {str(here)!r}); import test_public_objects as t;"
        f"one = t.MADE[{name!r}](); "
        f"open({str(tmp_path / 'one.pkl')!r}, 'wb').write(pickle.dumps((one, t.state(one))))"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=here.parents[1], env=os.environ)
    one, expected = pickle.loads((tmp_path / "one.pkl").read_bytes())
    assert state(one) == expected


@pytest.mark.parametrize(
    ("name", "preset"),
    [(file.stem, preset) for file in catalogue_files() for preset in presets_of(file)],
)
def test_a_dumped_lidar_can_be_loaded(name: str, preset: Any, tmp_path: Path) -> None:
    lidar = pi.load_lidar(name, preset=preset)
    (tmp_path / "lidar.yaml").write_text(lidar.dump())
    keys = yaml.safe_load(lidar.dump())
    for source in (tmp_path / "lidar.yaml", keys):
        again = pi.load_lidar(source, preset=preset)
        assert again.dump() == lidar.dump()
        np.testing.assert_array_equal(again.pattern(0, 1, 1), lidar.pattern(0, 1, 1))
    assert keys["price_usd"]["low"] > 0


@pytest.mark.parametrize("name", pi.list_scenes())
def test_a_dumped_scene_can_be_loaded(name: str) -> None:
    mount = "west" if name == "crossroad_poles" else ""
    world = pi.load_scene(name, seed=3, mount=mount)
    assert pi.load_scene(yaml.safe_load(world.dump())).dump() == world.dump()
