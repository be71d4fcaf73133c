"""Traffic of a site: the vehicles of SUMO become boxes with the motion of vehicles."""

import os
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("sumo", reason="Eclipse SUMO is not installed: extra `site`")

import site_maps
import traffic_data as data

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.launch import binary
from pyinfra.scenes.maps.road_net import RoadNet, read_road_net
from pyinfra.scenes.maps.site_folder import set_duration
from pyinfra.scenes.maps.smoothing import MAX_ACCELERATION_M_S2, MAX_TURN_DEG, smooth, spread_jumps
from pyinfra.scenes.maps.sumo import sumo_folder
from pyinfra.scenes.maps.tracks import CLASSES, HEADING, PITCH, FrontPath, Track, lasts_s
from pyinfra.scenes.maps.traffic import REACH_M, Traffic, simulate, without_route
from pyinfra.scenes.maps.traffic_demand import Demand
from pyinfra.scenes.maps.traffic_figures import (
    MAX_OVERLAP_SHARE,
    by_reason,
    traffic_figures,
    without_overlaps,
)
from pyinfra.scenes.maps.trajectory_file import NAME, write_trajectories

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("traffic")


@pytest.fixture(scope="module")
def busy(folder: Path) -> Traffic:
    net = data.crossing(folder / "crossing")
    return simulate(net, data.FOOT, Demand(1500, 200, 200), SECONDS, seed=3)


def test_sizes_are_those_of_the_simulator() -> None:
    text = (ROOT / "cpp/infrasim/core/classes.h").read_text()
    rows = re.findall(r'"(\w+)", \{([\d.]+), ([\d.]+)\}, \{([\d.]+), ([\d.]+)\}, '
                      r"\{([\d.]+), ([\d.]+)\}", text)  # fmt: skip
    theirs = {name: tuple(map(float, values)) for name, *values in rows}
    ours = {n: (*zip(c.mean_m, c.std_m, strict=True),) for n, c in CLASSES.items()}
    assert {n: tuple(v for pair in pairs for v in pair) for n, pairs in ours.items()} == theirs


def test_vehicles_turn_and_brake_as_vehicles_do(busy: Traffic) -> None:
    figures = traffic_figures(busy.tracks, data.FOOT)
    assert figures.turn_deg <= MAX_TURN_DEG
    assert figures.acceleration_m_s2 <= MAX_ACCELERATION_M_S2
    assert figures.overlap_share <= MAX_OVERLAP_SHARE
    assert figures.appearing == 0
    assert len(busy.rough) <= 0.01 * busy.asked
    assert {"Car", "Pedestrian", "Cyclist"} <= set(figures.classes)


def test_who_walks_is_slow_and_who_drives_stands_on_the_road(busy: Traffic) -> None:
    for track in busy.tracks:
        np.testing.assert_allclose(track.states[:, 2], track.size_m[2] / 2, atol=0.01)
        if track.object_class == "Pedestrian":
            assert track.states[:, 5].max() < 2.5


def test_a_roundabout_turns_vehicles_without_jumps(folder: Path) -> None:
    net = data.roundabout(folder / "roundabout")
    simulated = simulate(net, data.FOOT, Demand(800), SECONDS, seed=5)
    figures = traffic_figures(simulated.tracks, data.FOOT)
    assert figures.turn_deg <= MAX_TURN_DEG
    assert figures.acceleration_m_s2 <= MAX_ACCELERATION_M_S2
    assert figures.appearing == 0
    turned = [np.ptp(np.unwrap(t.states[:, HEADING])) for t in simulated.tracks]
    assert max(turned) > np.pi / 4


def test_the_same_seed_gives_the_same_file(folder: Path) -> None:
    net = data.crossing(folder / "again")
    files = []
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        simulated = simulate(net, data.FOOT, Demand(600), 10, seed)
        write_trajectories(folder / name, simulated.tracks)
        files.append((folder / name).read_bytes())
    assert files[0] == files[1] != files[2]


def test_vehicles_lean_with_a_hill(folder: Path) -> None:
    net = data.crossing(folder / "hill", rise_m=20)
    simulated = simulate(net, data.FOOT, Demand(1000), 30, seed=3)
    leaning = [t for t in simulated.tracks if np.abs(t.states[:, PITCH]).max() > 0.04]
    assert leaning
    for track in leaning:
        step = np.diff(track.states[:, :3], axis=0)
        ahead = np.hypot(step[:, 0], step[:, 1])
        climbs = (ahead > 0.5) & (track.states[1:, 0] > 60) & (track.states[1:, 0] < 350)
        slope = np.arctan2(step[climbs, 2], ahead[climbs])
        np.testing.assert_allclose(-track.states[1:, PITCH][climbs], slope, atol=0.02)
    write_trajectories(folder / "hill.csv", simulated.tracks)
    assert pd.read_csv(folder / "hill.csv").columns[-1] == "pitch"


def test_the_simulator_reads_the_file(folder: Path, busy: Traffic) -> None:
    program = binary()
    if program is None or not os.access(program, os.X_OK):
        pytest.skip("the infrasim binary is not built")
    import subprocess

    write_trajectories(folder / "trajectories.csv", busy.tracks)
    scene = folder / "scene.yaml"
    scene.write_text(
        "name: corner\nmounts:\n  pole: {x_m: 12, y_m: 12, z_m: 6, yaw_deg: 0}\n"
        "roads:\n  - name: main\n    start: {x_m: -300, y_m: 0, heading_deg: 0}\n"
        "    centreline: [{line_m: 600}]\n"
        "    lanes: {each_way: 2, width_m: 3.5, shoulder_m: 0.5, sidewalk_m: 2.5}\n"
        "trajectories: trajectories.csv\nduration_s: 60\n"
    )
    done = subprocess.run([program, "check", scene], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


REFUSED_TRACKS = {
    "state": (np.nan, 4.0, r"track 'a': state 2: expected finite numbers, got \[nan, "),
    "size": (0.2, np.inf, r"track 'a': size_m: expected finite numbers, got \[inf, "),
    "large": (0.2, 60.0, "track 'a': expected sizes of 0.1 to 50 m, got a size of "),
    "step": (20.0, 4.0, "track 'a': expected steps of at most 10 m in 0.1 s, got a step of 20"),
}


@pytest.mark.parametrize("case", REFUSED_TRACKS)
def test_refused_tracks_name_the_state(case: str, tmp_path: Path) -> None:
    x_m, length_m, message = REFUSED_TRACKS[case]
    states = np.zeros((3, 6))
    states[2, 0] = x_m
    track = Track("a", "Car", np.array([length_m, 2.0, 1.5]), 0, states)
    with pytest.raises(pi.Error, match=message):
        write_trajectories(tmp_path / NAME, [track])
    assert not (tmp_path / NAME).exists()


def test_trips_go_only_where_their_class_may(folder: Path) -> None:
    """A turn begins on a lane for buses only. SUMO has no valid route for cars there."""
    net = data.crossing(folder / "lanes")
    text = net.read_text()
    turns = re.findall(r'<connection from="ei" to="(?:no|so)" fromLane="(\d)"', text)
    assert turns
    for lane in set(turns):
        text = text.replace(f'<lane id="ei_{lane}"', f'<lane id="ei_{lane}" allow="bus"')
    net.write_text(text)
    roads = read_road_net(net)
    reached = {c: set(roads.routes_from(roads.edges["ei"], c)) for c in ("passenger", "bus")}
    assert reached["bus"] >= {"no", "so"}
    assert reached["passenger"].isdisjoint({"no", "so"})
    assert roads.routes_from(roads.edges["wi"], "passenger").keys() >= {"no", "so"}


def test_trips_without_a_valid_route_are_left_out_and_counted(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    net = data.crossing(folder / "cut")
    from pyinfra.scenes.maps import traffic

    lone = re.sub(r'<connection from="wi" to="no".*?/>', "", net.read_text())
    net.write_text(lone)
    monkeypatch.setattr(traffic, "read_road_net", _with_turn)
    words = ["site", "traffic", str(net.parent), "--seconds", "20", "--vehicles-per-hour", "900"]
    assert main.main(words) == 0
    left_out = re.search(r"(\d+) of (\d+) trips left out: no valid route", capsys.readouterr().out)
    assert left_out
    assert 0 < int(left_out[1]) < int(left_out[2])


def _with_turn(file: Path) -> RoadNet:
    """Network with an additional turn."""
    roads = read_road_net(file)
    roads.links["wi"]["no"] = None
    return roads


def test_only_errors_of_routes_leave_trips_out() -> None:
    xml = '<routes>\n<vehicle id="Car_1"><route edges="a b"/></vehicle>\n</routes>'
    assert without_route(xml, "sumo: out of memory (exit 1)") == (xml, [])
    assert without_route(xml, "sumo: Vehicle 'Car_1' has no valid route.")[1] == ["Car_1"]


def test_a_small_map_is_refused_with_its_reach(folder: Path) -> None:
    net = data.crossing(folder / "small", arm_m=60)
    with pytest.raises(ValueError, match=r"the map reaches \d+ m"):
        simulate(net, data.FOOT, Demand(600), 10, seed=1)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--vehicles-per-hour", "1000000"], "expected 0 to 20000"),
        (["--vehicles-per-hour", "nan"], "expected 0 to 20000"),
        (["--vehicles-per-hour", "0"], "expected a sum of all rates above 0"),
        (["--seconds", "-5"], "--seconds: expected 1 to 3600, got -5"),
        (["--seed", "-1"], "--seed: expected 0 to 2147483647, got -1"),
    ],
)
def test_impossible_demand_gives_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], expected: str
) -> None:
    data.crossing(folder / "asked")
    assert main.main(["site", "traffic", str(folder / "asked"), *words]) == 2
    err = capsys.readouterr().err
    assert expected in err
    assert err.count("\n") == 1
    assert not (folder / "asked/trajectories.csv").exists()


@pytest.mark.parametrize(
    "text", ["", "<net", "<routes/>", '<net><edge id="a"><lane/></edge></net>']
)
def test_a_broken_network_is_refused_by_name(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    site = folder / "broken"
    site.mkdir(exist_ok=True)
    (site / "site.yaml").write_text(data.SITE)
    (site / "map.net.xml").write_text(text)
    assert main.main(["site", "traffic", str(site)]) == 2
    assert "map.net.xml: expected" in capsys.readouterr().err


def test_the_scene_is_as_long_as_its_traffic(folder: Path) -> None:
    net = data.crossing(folder / "timed")
    file = net.parent / "site.yaml"
    file.write_text(data.SITE + "duration_s: 500.0  # of ten minutes\nregion_half_length_m: 90\n")
    words = ["site", "traffic", str(net.parent), "--seconds", "12", "--vehicles-per-hour", "900"]
    assert main.main(words) == 0
    end = pd.read_csv(net.parent / "trajectories.csv").t.max()
    assert file.read_text() == (
        data.SITE + f"duration_s: {end:g}  # of ten minutes\nregion_half_length_m: 90\n"
    )
    set_duration(net.parent, 7.5)
    assert "duration_s: 7.5  #" in file.read_text()


def test_the_traffic_of_other_arguments_is_not_taken(tmp_path: Path) -> None:
    map_file = site_maps.t_junction(tmp_path, sumo_folder())
    arguments = {"vehicles_per_hour": 400, "seconds": 5, "seed": 2}
    scene = pi.import_map(map_file, tmp_path / "site", **arguments)
    traffic = (scene.parent / NAME).read_bytes()
    assert pi.import_map(map_file, tmp_path / "site", **arguments) == scene
    with pytest.raises(
        pi.Error, match=r"seed: expected 2, as for the existing trajectories of .*, got 3"
    ):
        pi.import_map(map_file, tmp_path / "site", **(arguments | {"seed": 3}))
    pi.import_map(map_file, tmp_path / "site", vehicles_per_hour=0)
    (scene.parent / "traffic.yaml").unlink()  # the trajectories are recorded
    pi.import_map(map_file, tmp_path / "site", **arguments)
    assert (scene.parent / NAME).read_bytes() == traffic


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("{a}\nduration_s: 500\n", "{a}\nduration_s: 7.5\n"),
        ('{a}\n"duration_s"  :   500.0 # x\n', '{a}\n"duration_s"  : 7.5 # x\n'),
        ("{a}\nduration_s:\n", "{a}\nduration_s: 7.5\n"),
        ("{a}\n? duration_s\n: 500\n", "{a}\n? duration_s\n: 7.5\n"),
        ("\ufeffduration_s: 5 # s\n{a}\n", "duration_s: 7.5 # s\n{a}\n"),
        ("{{b: [é, {{duration_s: 9}}], duration_s: 500, c: 1}}\n",) * 2,
        ("{a}\nc: &d 3\nduration_s: *d\n", ""),
        ("{a}\nc: &d {{duration_s: 500}}\n<<: *d\n", ""),
        ("{{b: 1}}\n", ""),
        ("{a}\nduration_s: |\n  500\n", ""),
    ],
)
def test_the_duration_is_set_in_any_style_or_refused(old: str, new: str, tmp_path: Path) -> None:
    """Nothing else in the file changes. Before, other styles kept the old value silently."""
    file = tmp_path / "site.yaml"
    file.write_text(old.format(a="b: 1"), encoding="utf-8")
    before = file.read_bytes()
    if new:
        set_duration(tmp_path, 7.5)
        text = new.format(a="b: 1").replace("duration_s: 500", "duration_s: 7.5")
        assert file.read_text(encoding="utf-8") == text
    else:
        with pytest.raises(pi.Error, match=r"site.yaml.*duration_s"):
            set_duration(tmp_path, 7.5)
        assert file.read_bytes() == before


def test_duration_is_added_where_there_is_none(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(data.SITE)
    set_duration(tmp_path, 30.0)
    assert (tmp_path / "site.yaml").read_text() == data.SITE + "duration_s: 30\n"


def test_a_map_whose_ends_no_route_joins_has_traffic_between_its_edges(folder: Path) -> None:
    simulated = simulate(data.closed(folder / "closed"), data.FOOT, Demand(600), 60, seed=1)
    near = [track for track in simulated.tracks if np.hypot(*track.states[:, :2].T).min() < 60]
    assert near
    for track in near:  # the vehicle passes through the region: it neither begins nor ends in it
        ends = track.states[[0, -1], :2] - data.FOOT[0]
        inside = np.hypot(*ends.T) < 100
        assert not (inside & [track.first > 0, track.first + len(track.states) < 600]).any()


def test_a_lane_that_bars_all_is_for_nobody(folder: Path) -> None:
    """The borders of an OpenDRIVE road are such lanes."""
    net = data.crossing(folder / "barred")
    text = net.read_text()
    for k in range(2):
        text = text.replace(f'<lane id="ei_{k}"', f'<lane id="ei_{k}" disallow="all"')
    net.write_text(text)
    road_net = read_road_net(net)
    assert road_net.edges["ei"].lanes_for("passenger") == 0
    assert "ei" not in {edge.name for edge in road_net.sources("passenger")}


def test_few_vehicles_are_a_file_that_starts_with_the_first(folder: Path) -> None:
    net = data.crossing(folder / "lonely")
    simulated = simulate(net, data.FOOT, Demand(40), 200, seed=4)
    assert min(track.first for track in simulated.tracks) == 0
    write_trajectories(folder / "lonely/trajectories.csv", simulated.tracks)
    assert pd.read_csv(folder / "lonely/trajectories.csv").t.max() == lasts_s(simulated.tracks)


def box_track(name: str, first: int, xy: FloatArray) -> Track:
    states = np.zeros((len(xy), 6))
    states[:, :2] = xy
    return Track(name, "Car", np.array([4.0, 2.0, 1.5]), first, states)


def test_tracks_end_far_from_the_mounts_and_come_back_as_others() -> None:
    x = np.concatenate([np.arange(0.0, 350, 5), np.arange(350.0, 0, -5)])
    far = box_track("a", 3, np.column_stack([x, 0 * x]))
    there, back = far.near(np.array([[0.0, 0.0]]), REACH_M)
    assert (there.first, len(there.states)) == (3, 61)
    assert there.states[-1, 0] == back.states[0, 0] == REACH_M
    assert back.first + len(back.states) == far.first + len(far.states)


def test_an_overlap_between_two_instants_counts() -> None:
    """A car passes a standing car in two steps. The boxes overlap only between the instants."""
    still = box_track("a", 0, np.zeros((3, 2)))
    across = np.array([[-4.5, 1.6], [4.5, 1.6], [13.5, 1.6]])
    assert traffic_figures([still, box_track("b", 0, across)], data.FOOT).overlap_share > 0
    apart = traffic_figures([still, box_track("b", 0, across + np.array([0, 0.6]))], data.FOOT)
    assert apart.overlap_share == 0
    kept, gone = without_overlaps([still, box_track("b", 0, across)])
    assert (len(kept), len(gone)) == (1, 1)


def test_a_lane_change_in_one_step_takes_seconds() -> None:
    rows = data.drive(10, 12)
    rows[50:, 2] = 3.2
    path = FrontPath("a", "Car", np.array([4.5, 1.9, 1.5]), 0, rows[:, 1:4] * [1, 1, 0], rows[:, 3])
    spread = spread_jumps(path.points)
    assert np.abs(np.diff(spread[:, 1])).max() < 0.25
    np.testing.assert_allclose(spread[[0, -1], 1], [0, 3.2], atol=1e-9)
    track = smooth(path)
    assert track is not None
    assert np.abs(track.states[:, HEADING]).max() < np.radians(20)


def test_the_box_is_half_a_length_behind_the_bumper() -> None:
    rows = data.drive()
    size = np.array([4.0, 1.8, 1.5])
    track = smooth(FrontPath("a", "Car", size, 0, rows[:, 1:4], rows[:, 3]))
    assert track is not None
    np.testing.assert_allclose(track.states[:, 0], rows[:, 1] - 2, atol=1e-6)
    np.testing.assert_allclose(track.states[:, 2], 0.75, atol=1e-6)
    np.testing.assert_allclose(track.states[:, 5], 10, atol=1e-6)


def test_tracks_that_are_left_out_for_one_reason_share_a_line() -> None:
    notes = [f"car{k}: left out: it stood in another" for k in range(20)]
    notes += ["bus: cut at 3.1 s: gap of 2.0 s", "van: cut at 4.5 s: gap of 1.2 s"]
    notes += ["3 of 40 trips left out: no valid route"]
    assert by_reason(notes) == [
        "20 tracks: left out: it stood in another (car0, car1, car2, ...)",
        "2 tracks, such as bus: cut at 3.1 s: gap of 2.0 s",
        "3 of 40 trips left out: no valid route",
    ]
