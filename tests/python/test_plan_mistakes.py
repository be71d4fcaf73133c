"""Realistic mistakes in plans: exit code 2, what is missing and what works, and no file written."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import configs, lidar_file, scene_file
from pyinfra.experiments.planner import observe
from pyinfra.experiments.planner.answer import false_boxes
from pyinfra.experiments.planner.candidates import make_candidates, with_faults
from pyinfra.experiments.planner.site import PlanSite, open_site, other_traffic
from pyinfra.formats.csv_table import read_csv

BASE = (
    "--budget 9000 --lidar helios_16 --max-frames 2 --check-frames 0 --heights 5 --pitches 0 "
    "--every 60 --out o"
)
TINY = {
    "lidars": ["helios_16"],
    "frames": 4,
    "check_frames": 0,
    "grid": pi.PoseGrid(every_m=60, heights_m=(5.0,), pitches_deg=(0.0,), yaws=1),
}
COSTS = (configs() / "planner/costs.csv").read_text()

# Each mistake: the site, more words of the command, and parts of the message.
MISTAKES = {
    # sites
    "unknown site": ("crosroad", "", ["SITE: ", "did you mean 'crossroad'"]),
    "folder without a site": ("empty", "", ["empty: expected a site folder with site.yaml"]),
    "no traffic": ("still.yaml", "", ["traffic: expected either traffic or trajectories"]),
    "no traffic within the distance": ("small.yaml", "--centre 900 900",
        ["--within: expected vehicles", "the nearest is"]),
    "no kerb within the distance": ("small.yaml", "--centre 40 0 --within 5",
        ["--within: ", "the nearest", "m away"]),
    # what is asked
    "percent": ("small.yaml", "--find 90", ["--find: expected 0 to 1, got 90", "percent: 0.9"]),
    "distance of 0": ("small.yaml", "--within 0", ["--within: expected 5 to 500, got 0"]),
    "no pole": ("small.yaml", "--poles 0", ["--poles: expected 1 to 20, got 0"]),
    "no false box": ("small.yaml", "--false-per-minute 0", ["--false-per-minute: "]),
    "negative years": ("small.yaml", "--years -1", ["--years: expected 0 to 100"]),
    "people for Background": ("small.yaml", "--people 1 --detector background",
        ["--people: expected 0", "generalist"]),
    "budget with a decimal comma": ("small.yaml", "--budget 9.000", ["write 9000 or 9"]),
    "budget below a LiDAR": ("small.yaml", "--budget 500",
        ["--budget: expected ", "helios_16", "got 500"]),
    "budget below a pole": ("small.yaml", "--budget 5700",
        ["--budget: expected 7,", "for a pole with a LiDAR", "existing mast"]),
    "centre that is no number": ("small.yaml", "--centre nan 0", ["--centre: expected x and y"]),
    "distance between poles of 0": ("small.yaml", "--every 0", ["--every: expected 0.5 to 1000"]),
    "height in centimetres": ("small.yaml", "--heights 600", ["--heights: expected 0.5 to 100"]),
    "pitch above 90": ("small.yaml", "--pitches 100", ["--pitches: expected -90 to 90"]),
    "negative frames of the check": ("small.yaml", "--check-frames -1", ["--check-frames: "]),
    "no threads": ("small.yaml", "--jobs 0", ["--jobs: expected 1 or more"]),
    # names
    "unknown LiDAR": ("small.yaml", "--lidar helios_61", ["--lidar: ", "did you mean 'helios_16'"]),
    "LiDAR twice": ("small.yaml", "--lidar helios_16 helios_16", ["--lidar: ", "twice"]),
    "LiDAR without a price": ("small.yaml", "--lidar free.yaml", ["free.yaml", "price_usd"]),
    "unknown detector": ("small.yaml", "--detector generalst", ["did you mean 'generalist'"]),
    "unknown preset": ("small.yaml", "--preset datashet", ["--preset", "did you mean 'datasheet'"]),
    # poses
    "no file of poses": ("small.yaml", "--poses none.csv", ["none.csv"]),
    "unknown column of poses": ("small.yaml", "--poses column.csv",
        ["column.csv:1: ", "'yaw'", "did you mean 'yaw_deg'"]),
    "height above the road in poses": ("small.yaml", "--poses height.csv",
        ["height.csv:1: expected the column z_m"]),
    "pose that is no number": ("small.yaml", "--poses nan.csv", ["nan.csv:3: y_m"]),
    "pose twice": ("small.yaml", "--poses twice.csv", ["twice.csv:3: existing"]),
    "position twice": ("small.yaml", "--poses mast.csv", ["mast.csv:3: existing"]),
    "pose below the ground": ("small.yaml", "--poses low.csv",
        ["--poses: ", "below the ground", "use (-14.0, 9.5) at z_m 5.0"]),
    "pose in a lane": ("small.yaml", "--poses lane.csv", ["--poses: ", "use ("]),
    "pose in a house": ("house.yaml", "--poses inside.csv", ["inside a building", "use ("]),
    # areas
    "unknown class of an area": ("small.yaml", "--areas class.csv",
        ["class.csv:2: class: expected vehicle, person, any, got 'pedestrian'"]),
    "unknown column of areas": ("small.yaml", "--areas radius.csv", ["radius.csv:1: ", "radius_m"]),
    "area that is no number": ("small.yaml", "--areas nowhere.csv", ["nowhere.csv:2: x_m"]),
    "area without a name": ("small.yaml", "--areas nameless.csv", ["nameless.csv:2: name"]),
    "area named like a column": ("small.yaml", "--areas column_name.csv",
        ["column_name.csv:2: name: ", "'in_rain'"]),
    "area named like a column of another": ("small.yaml", "--areas ends.csv",
        ["ends.csv:3: name: ", "'stop_low'"]),
    "area outside": ("small.yaml", "--areas far.csv", ["--areas: ", "'stop'", "from its nearest"]),
    # costs
    "missing cost": ("small.yaml", "--costs missing.csv", ["missing.csv: item", "pole_usd"]),
    "negative cost": ("small.yaml", "--costs negative.csv", ["negative.csv:2: low, high"]),
    "low above high": ("small.yaml", "--costs swapped.csv", ["swapped.csv:2: low, high"]),
    "cost twice": ("small.yaml", "--costs again.csv", ["again.csv:10: item", "pole_usd twice"]),
    # folders
    "file as the output": ("small.yaml", "--out small.yaml", ["--out: expected a folder"]),
    "tables of something else": ("small.yaml", "--out other", ["--out: expected a new folder"]),
}  # fmt: skip

FILES = {
    "empty/readme.txt": "",
    "other/options.csv": "option\n",
    "column.csv": "x_m,y_m,yaw\n-14,9.5,0\n",
    "height.csv": "x_m,y_m,height_m\n-14,9.5,5\n",
    "nan.csv": "x_m,y_m\n-14,9.5\n-14,nan\n",
    "twice.csv": "x_m,y_m,existing\n-14,9.5,yes\n-14,9.5,no\n",
    "mast.csv": "x_m,y_m,z_m,existing\n-14,9.5,5,yes\n-14,9.5,7,no\n",
    "column_name.csv": "name,x_m,y_m,radius_m\nin_rain,-30,-3,20\n",
    "ends.csv": "name,x_m,y_m,radius_m\nstop,-30,-3,20\nstop_low,-30,-3,20\n",
    "low.csv": "x_m,y_m,z_m\n-14,9.5,-1\n",
    "lane.csv": "x_m,y_m,z_m\n-30,5,3\n",
    "inside.csv": "x_m,y_m,z_m\n-30,23,5\n",
    "class.csv": "name,x_m,y_m,radius_m,class\nstop,-30,-3,20,pedestrian\n",
    "radius.csv": "name,x_m,y_m,radius_m,radius\nstop,-30,-3,20,20\n",
    "nowhere.csv": "name,x_m,y_m,radius_m\nstop,nan,-3,20\n",
    "nameless.csv": "name,x_m,y_m,radius_m\n,-30,-3,20\n",
    "far.csv": "name,x_m,y_m,radius_m\nstop,500,500,20\n",
    "missing.csv": "\n".join(line for line in COSTS.splitlines() if "pole_usd" not in line),
    "negative.csv": COSTS.replace("800,3000", "-800,3000"),
    "swapped.csv": COSTS.replace("800,3000", "3000,800"),
    "again.csv": COSTS.rstrip("\n") + "\npole_usd,new pole,1,2,mine\n",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes of 20 s, and files with mistakes."""
    top = tmp_path_factory.mktemp("plan")
    for name, text in FILES.items():
        (top / name).parent.mkdir(exist_ok=True)
        (top / name).write_text(text)
    scene = yaml.safe_load(scene_file("crossroad").read_text()) | {"duration_s": 20}
    scene["traffic"]["warm_up_s"] = 5
    still = {key: value for key, value in scene.items() if key not in ("traffic", "people")}
    house = {"x_m": -30, "y_m": 25, "length_m": 10, "width_m": 10, "height_m": 9}
    row = {"road": "main", "offset_m": -8.7, "from_m": 100, "to_m": 125}
    buses = row | {"class_shares": {"Bus": 1}, "occupied": 1}
    scenes = {
        "small": scene,
        "still": still,
        "house": scene | {"buildings": [house]},
        "buses": {key: scene[key] for key in scene if key != "presets"} | {"parked": [buses]},
    }
    for name, keys in scenes.items():
        (top / f"{name}.yaml").write_text(yaml.safe_dump(keys, sort_keys=False))
    rows = lidar_file("livox_avia").read_text().splitlines()
    (top / "free.yaml").write_text("\n".join(row for row in rows if "price_usd" not in row))
    return top


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_answered_with_what_works(
    mistake: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    site, more, words = MISTAKES[mistake]
    before = sorted(folder.rglob("*"))
    try:
        code: object = main.main(f"plan {site} {BASE} {more}".split())
    except SystemExit as end:
        code = end.code
    error = capsys.readouterr().err
    assert code == (1 if "No such file" in error else 2), error
    assert len(error.splitlines()) == 1
    for word in words:
        assert word in error
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("site", "more", "message"),
    [
        ("small.yaml", {"lidars": ["free.yaml"]}, "free.yaml"),
        ("small.yaml", {"lidars": ["none.yaml"]}, "lidars: "),
        ("small.yaml", {"poses": "column.csv"}, "column.csv:1"),
        ("small.yaml", {"areas": "radius.csv"}, "radius.csv:1"),
        ("small.yaml", {"costs": "negative.csv"}, "negative.csv:2"),
        # The buses of the seeds 1 to 3 are narrow enough.
        ("buses.yaml", {"check_frames": 30}, "offset_m: expected .* traffic seed 4"),
    ],
)
def test_inputs_are_checked_before_anything_is_simulated(
    site: str,
    more: dict[str, Any],
    message: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def simulated(*_: object, **__: object) -> None:
        raise AssertionError("the traffic was simulated")

    monkeypatch.chdir(folder)
    monkeypatch.setattr(simulation, "load_observer", simulated)
    with pytest.raises(pi.Error, match=message):
        pi.plan(site, 9000, **(TINY | more))


def test_another_plan_is_not_replaced(folder: Path, tmp_path: Path) -> None:
    scene, out = folder / "small.yaml", tmp_path / "out"
    pi.plan(scene, 9000, out=out, **TINY)
    before = {file: file.read_bytes() for file in out.glob("*.*")}
    with pytest.raises(pi.Error, match=r"out: .*budget_usd was 9000\S*, is now 8000"):
        pi.plan(scene, 8000, out=out, **TINY)
    assert {file: file.read_bytes() for file in out.glob("*.*")} == before


def test_two_plans_do_not_write_to_one_folder(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second plan starts while the first one observes, and would end with its own answer."""
    scene, out = folder / "small.yaml", tmp_path / "out"
    observed = observe._observed

    def meanwhile(*words: object) -> object:
        monkeypatch.setattr(observe, "_observed", observed)
        with pytest.raises(pi.Error, match="another process writes to this folder"):
            pi.plan(scene, 8000, out=out, **TINY)
        return observed(*words)

    monkeypatch.setattr(observe, "_observed", meanwhile)
    pi.plan(scene, 9000, out=out, **TINY)
    assert "budget_usd: '9000'" in (out / "plan.yaml").read_text()
    assert "9,000" in (out / "answer.txt").read_text()


def test_an_interrupted_plan_resumes_with_the_same_tables(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = folder / "small.yaml"
    pi.plan(scene, 9000, out=tmp_path / "whole", **TINY)
    calls, observed = [], observe._observed

    def once(*words: object) -> object:
        if calls:
            raise KeyboardInterrupt
        calls.append(words)
        return observed(*words)

    with monkeypatch.context() as patch:
        patch.setattr(observe, "_observed", once)
        with pytest.raises(KeyboardInterrupt):
            pi.plan(scene, 9000, out=tmp_path / "stopped", **TINY)
    assert not list((tmp_path / "stopped").glob("*.csv"))
    assert len(list((tmp_path / "stopped/observations").iterdir())) == 1
    pi.plan(scene, 9000, out=tmp_path / "stopped", **TINY)
    for file in ("options.csv", "candidates.csv", "sensitivity.csv", "answer.txt"):
        assert (tmp_path / "stopped" / file).read_bytes() == (
            tmp_path / "whole" / file
        ).read_bytes()


def test_frames_without_vehicles_give_no_recall(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No vehicle is near in the rainy frames."""
    monkeypatch.setattr("pyinfra.experiments.planner.sensitivity.other_traffic", without_traffic)
    result = pi.plan(folder / "small.yaml", 9000, **TINY)
    assert "nan" not in result.text
    assert not result.sensitivity.case.str.startswith("rain").any()
    assert result.options.recall_in_rain.isna().all()


def without_traffic(
    site: PlanSite, frames: int, scene_keys: dict[str, object] | None = None
) -> PlanSite:
    other = other_traffic(site, frames, scene_keys)
    return replace(other, present=other.present.assign(x=1e4)) if scene_keys else other


def test_more_poles_than_poses_give_what_is_possible(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text("x_m,y_m\n-14,9.5\n-14,9.5\n")
    plan = pi.plan(folder / "small.yaml", 90_000, poses=file, poles=5, **TINY)
    assert set(plan.options.poles) == {1}
    assert "Only 1 position" in plan.text


def test_rows_of_the_candidates_are_a_file_of_poses(folder: Path, tmp_path: Path) -> None:
    pi.plan(folder / "small.yaml", 9000, out=tmp_path / "out", **TINY)
    file = tmp_path / "out/candidates.csv"
    again = pi.plan(folder / "small.yaml", 9000, poses=file, **TINY)
    assert len(again.candidates) == len(pd.read_csv(file))


def test_a_curved_region_is_planned() -> None:
    """The middle of the region's bounding box is off the road, and no pole stands on a lane."""
    site = open_site("curve", 2)
    grid = pi.PoseGrid(every_m=40, heights_m=(5.0,), pitches_deg=(0.0,), yaws=1)
    table = with_faults(make_candidates(site, 80, grid), site)
    free = table[table.fault == ""]
    assert len(free) >= 4
    for road in site.roads:
        away = [np.hypot(*(road.xy - at).T) - road.half_width for at in free[["x_m", "y_m"]].values]
        assert min(one.min() for one in away) > 0


def test_a_lidar_of_other_frames_has_the_same_frames(folder: Path, tmp_path: Path) -> None:
    """A LiDAR that turns 20 times a second is planned in frames of the scene."""
    text = lidar_file("helios_16").read_text()
    text = text.replace("rate_hz: 10, columns_per_turn: 1800", "rate_hz: 20, columns_per_turn: 900")
    table = lidar_file("helios_16").parent / "channels"
    fast = tmp_path / "fast.yaml"
    fast.write_text(text.replace("channels/", f"{table}/"))
    plan = pi.plan(folder / "small.yaml", 9000, **TINY | {"lidars": [fast]})
    assert (plan.options.latency_ms > 50).all()
    assert plan.options.recall.between(1, 100).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x_m;y_m\n-17,5;14,5\n", ":1: expected commas between columns, got semicolons"),
        ('x_m,y_m\n-17,"14,5"\n', ":2: y_m: .*got '14,5'; .*decimal point"),
    ],
)
def test_a_table_of_a_spreadsheet_with_decimal_commas(
    text: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / "masts.csv").write_text(text)
    with pytest.raises(FormatError, match=words):
        read_csv(tmp_path / "masts.csv")


@pytest.mark.parametrize(
    ("per_frame", "text"), [(0.0, "no"), (0.25, "in 4 frames"), (0.9, "a frame"), (1.5, "1.5")]
)
def test_false_boxes_in_words(per_frame: float, text: str) -> None:
    assert text in false_boxes(per_frame)
    assert "1 frames" not in false_boxes(per_frame)
