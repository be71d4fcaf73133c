"""The planner: candidate poses, observations, race, choice, costs and the answer."""

import itertools
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.fused import fused
from pyinfra.dataset.roads import Road
from pyinfra.experiments.planner import detectability as laws
from pyinfra.experiments.planner.candidates import (
    POSE,
    make_candidates,
    off_carriageways,
    read_candidates,
    with_faults,
)
from pyinfra.experiments.planner.choice import (
    Units,
    considered,
    greedy,
    pairs,
    singles,
    upper_bound,
)
from pyinfra.experiments.planner.costs import open_lidars, read_costs
from pyinfra.experiments.planner.detectability import read_detectability
from pyinfra.experiments.planner.observe import check_site, observe, weighted_objects
from pyinfra.experiments.planner.race import is_worse
from pyinfra.experiments.planner.request import Area, Request, crossings_of, of_name, read_areas
from pyinfra.experiments.planner.simulate import frames_at
from pyinfra.experiments.planner.site import PlanSite, frame_order, open_site
from pyinfra.viz.plan_page import site_map
from reproduction.detectability.fit import average_precision, fit_detection

LAW = read_detectability("generalist")
FEW = pi.PoseGrid(every_m=40, heights_m=(5.0,), pitches_deg=(0.0,), yaws=1)


@pytest.fixture(scope="module")
def site() -> PlanSite:
    return open_site("crossroad", 4)


def test_the_same_objects_count_for_every_pose(site: PlanSite) -> None:
    assert set(site.present.frame) == set(site.frames)
    assert np.abs(site.present[["x", "y"]]).max().max() < 130


def test_frames_without_objects_are_counted(site: PlanSite) -> None:
    empty = site.frames[-1]
    rest = replace(site, present=site.present[site.present.frame != empty])
    assert weighted_objects(rest, Request(9000), LAW, site.frames).frames == len(site.frames)


def test_people_alone_are_no_traffic_that_a_plan_can_find(site: PlanSite) -> None:
    people = replace(site, present=site.present.assign(person=True))
    with pytest.raises(pi.Error, match="within_m: expected vehicles"):
        check_site(people, Request(9000, people=1.0), LAW, 0, drawn=False)


def test_frames_show_every_phase_of_a_pattern_of_200_frames() -> None:
    order = frame_order(5000, 400)
    assert len(set(order)) == 400
    assert len({k % 200 for k in order}) > 150
    assert len({k // 500 for k in order[:20]}) == 10


def test_candidates_stand_beside_the_carriageway(site: PlanSite) -> None:
    table = with_faults(make_candidates(site, 60, FEW), site)
    free = table[table.fault == ""]
    assert len(free) >= 4
    assert (free[["x_m", "y_m"]].abs().min(axis=1) > 7).all()
    assert (np.hypot(free.x_m - site.centre[0], free.y_m - site.centre[1]) <= 60).all()


def lane(start: tuple[float, float], end: tuple[float, float]) -> Road:
    """Returns a straight lane of 3.5 m with a point each metre."""
    ends = np.array([start, end], float)
    length = float(np.hypot(*(ends[1] - ends[0])))
    s = np.linspace(0, length, round(length) + 1)
    heading = np.full(len(s), np.arctan2(*(ends[1] - ends[0])[::-1]))
    xy = ends[0] + np.outer(s / length, ends[1] - ends[0])
    return Road("lane", s, xy, np.zeros(len(s)), heading, np.full(len(s), 1.75))


def test_no_pole_stands_between_lanes_or_in_a_gap_of_a_junction() -> None:
    first, second = lane((-50, 0), (50, 0)), lane((-50, 3.5), (50, 3.5))
    beyond_a_median = lane((-50, 11), (50, 11))
    places = np.array([[0, 2.55], [0, 0.95], [0, -2.55], [0, 7.0]])
    standing = off_carriageways(places, [first, second, beyond_a_median])
    assert standing.tolist() == [False, False, True, True]
    around = [lane((-20, y), (20, y)) for y in (-4, 4)] + [lane((x, -20), (x, 20)) for x in (-4, 4)]
    corners = np.array([[0.0, 0.0], [-8, -8]])
    assert off_carriageways(corners, around).tolist() == [False, True]


def test_a_roundabout_is_drawn_where_its_roads_meet() -> None:
    roads = [
        replace(lane((-40, 20), (60, 20)), name="a"),
        replace(lane((30, 0), (30, 90)), name="b"),
    ]
    ring = {"roads": ["a", "b"], "roundabout": {"radius_m": 15, "width_m": 6}}
    site = SimpleNamespace(keys={"junctions": [ring]}, roads=roads)
    circles = [
        one for one in site_map._roads(site, [], site_map.window_of(roads[0].xy)) if "circle" in one
    ]
    assert len(circles) == 2
    assert all('cx="30.0" cy="-20.0"' in one for one in circles)


def units(count: int = 12, objects: int = 40) -> Units:
    rng = np.random.default_rng(3)
    law = laws.read_detectability("generalist")
    helios = open_lidars(["helios_16"], open_site("crossroad", 1))[0]
    return Units(
        probability=rng.uniform(0, 0.8, (count, objects)).astype(np.float32),
        weight=rng.uniform(0.5, 2, objects),
        place=np.arange(count) // 2,
        existing=np.zeros(count, bool),
        lidars=[helios] * count,
        costs=read_costs(None, 5, law),
    )


def test_pairs_are_the_best_of_all_pairs() -> None:
    some = units()
    every = [
        some.value(pair)
        for pair in itertools.combinations(range(12), 2)
        if some.place[pair[0]] != some.place[pair[1]]
    ]
    best = pairs(some, Request(1e9, poles=2))[0]
    assert best.value == pytest.approx(max(every))
    assert best.gap == pytest.approx(0, abs=1e-6)
    assert singles(some, 1e9)[0].value == pytest.approx(max(some.value([u]) for u in range(12)))


def test_options_at_the_same_position_are_listed_once_with_the_best_pose() -> None:
    """Two units have each position, like two pitches of a LiDAR on one pole."""
    some = units()
    options = considered(some, Request(1e6, poles=2))
    for count in (1, 2):
        places = [tuple(sorted(some.place[[*o.units]])) for o in options if len(o.units) == count]
        assert len(places) == len(set(places)) > 1
    for one in (one for one in options if len(one.units) == 1):
        twins = np.flatnonzero(some.place == some.place[one.units[0]])
        assert one.value == pytest.approx(max(some.value([u]) for u in twins))


def test_prices_of_pairs_are_those_of_their_parts() -> None:
    some = units()
    best = pairs(some, Request(1e9, poles=2, lidars_per_pole=2))
    assert any(some.place[a] == some.place[b] for a, b in (one.units for one in best))
    least = min(one.price.middle for one in best)
    assert pairs(some, Request(least - 1, poles=2, lidars_per_pole=2)) == []
    assert pairs(some, Request(least + 1, poles=2, lidars_per_pole=2))


def test_no_set_exceeds_the_bound_of_the_greedy_search() -> None:
    some = units()
    option = greedy(some, Request(1e9, poles=3))
    assert option is not None
    every = [
        some.value(three)
        for three in itertools.combinations(range(12), 3)
        if len({some.place[u] for u in three}) == 3
    ]
    assert option.value <= max(every) + 1e-9 <= option.bound + 2e-9
    assert upper_bound(some, [], 0, 3) == 0


def test_a_pose_is_worse_only_by_the_interval_of_the_paired_difference() -> None:
    best = np.array([10.0, 12, 9, 11, 10, 13])
    same, lower = best + np.array([2, -2, 2, -2, 2, -2]), best - 3 + 0.1 * best
    assert is_worse(np.stack([best, same, lower]), best, 0.99).tolist() == [False, False, True]


def test_the_laws_recover_made_up_coefficients() -> None:
    rng = np.random.default_rng(1)
    count = 4000
    seen = pd.DataFrame(
        {
            "points": rng.integers(1, 200, count),
            "along": rng.uniform(0, 4, count),
            "up": rng.uniform(0, 2, count),
            "distance": rng.uniform(5, 100, count),
            "visibility": rng.uniform(0, 1, count),
            "type": "Car",
            "speed": rng.uniform(0, 20, count),
            "spinning": rng.random(count) < 0.5,
        }
    )
    terms = laws.object_terms(seen)
    true = np.array([-3, 1.2, 0, 0.3, 0, -0.5, 0, 0.5, 0, 0, 0, -1, -1, 0])
    odds = terms @ true + rng.logistic(size=count)
    # an object is found at score s if odds minus the score term is above 0
    scores = 1 / (1 + np.exp(-odds))
    fitted = fit_detection(terms, scores)
    for cut in (0.2, 0.5, 0.8):
        p = laws.detection_probability(fitted, terms, cut)
        assert p.mean() == pytest.approx((scores >= cut).mean(), abs=0.02)
        assert p[seen.points < 10].mean() < p[seen.points > 100].mean()


def test_a_perfect_detector_has_ap_100_and_a_blind_one_0() -> None:
    seen = pd.DataFrame(
        {"points": [99] * 9, "along": 4.0, "up": 1.0, "distance": 20.0, "visibility": 1.0,
         "type": "Car", "speed": 1.0, "spinning": True}
    )  # fmt: skip
    terms = laws.object_terms(seen)
    sure, none = np.zeros(len(laws.OBJECT_TERMS)), np.zeros(len(laws.OBJECT_TERMS))
    sure[0], none[0] = 30, -30
    never = np.array([-30.0, *np.zeros(len(laws.FALSE_TERMS) - 1)])
    assert average_precision(sure, never, terms, 9, 3, spinning=True) == pytest.approx(100)
    assert average_precision(sure, never, terms, 18, 3, spinning=True) == pytest.approx(50)
    assert average_precision(none, never, terms, 9, 3, spinning=True) == pytest.approx(0, abs=1e-6)


def test_plan_writes_its_tables_and_resumes(tmp_path: Path) -> None:
    words = {
        "lidars": ["helios_16", "livox_avia"],
        "frames": 6,
        "grid": FEW,
        "check_frames": 0,
        "out": tmp_path,
    }
    first = pi.plan("crossroad", 12_000, poles=2, **words)
    for name in (*POSE, "lidar", "price_usd_low", "price_usd_high", "ap_predicted", "gap"):
        assert name in first.options
    best = first.options[first.options.option == 1]
    assert (best.price_usd <= 12_000).all()
    assert (best.recall_low <= best.recall).all()
    assert (best.recall_in_rain <= best.recall + 2).all()
    assert "in rain 25 mm/h" in first.text
    assert set(first.options.groupby("option").size()) <= {1, 2}
    assert pd.read_csv(tmp_path / "candidates.csv").lidar.isin(["helios_16", "livox_avia"]).any()
    assert set(pd.read_csv(tmp_path / "candidates.csv").existing) <= {"yes", "no"}
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "observations").iterdir()}
    again = pi.plan("crossroad", 12_000, poles=2, **words)
    pd.testing.assert_frame_equal(first.options, again.options)
    assert kept == {file: file.stat().st_mtime_ns for file in kept}


def test_a_bundle_with_one_unconfirmed_price_is_unconfirmed(site: PlanSite, tmp_path: Path) -> None:
    units = [lidar_file(name) for name in ("helios_16", "velodyne_vlp_16")]
    assert [lidar.confirmed for lidar in open_lidars(units, site)] == [True, False]
    file = tmp_path / "two.yaml"
    words = ", ".join(f"{{lidar: {unit}}}" for unit in units)
    file.write_text(f"name: two\nmodel: two\nbundle: [{words}]\n")
    (bundle,) = open_lidars([file], site)
    assert not bundle.confirmed


def test_observations_are_made_again_if_a_file_changed(site: PlanSite, tmp_path: Path) -> None:
    text = lidar_file("helios_16").read_text()
    text = text.replace("channels/", f"{lidar_file('helios_16').parent}/channels/")
    lidar, trajectories = tmp_path / "own.yaml", tmp_path / "t.csv"
    trajectories.write_text("first")
    named = replace(site, file=tmp_path / "s.yaml", keys=site.keys | {"trajectories": "t.csv"})
    pose = pd.DataFrame([(-14.0, 9.5, 5.0, 0.0, 0.0)], columns=POSE)

    def points() -> int:
        lidars = open_lidars([lidar], site)
        rows = observe(named, pose, lidars, np.ones((1, 1), bool), site.frames, folder=tmp_path)
        return int(rows.points.sum())

    lidar.write_text(text)
    before = points()
    assert before == points() > 0
    assert len(list(tmp_path.glob("*.npy"))) == 1
    lidar.write_text(text.replace("columns_per_turn: 1800", "columns_per_turn: 900"))
    assert points() < 0.7 * before
    trajectories.write_text("second")
    points()
    assert len(list(tmp_path.glob("*.npy"))) == 3


def test_the_answer_says_what_an_engineer_asks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = tmp_path / "poses.csv"
    poses.write_text("x_m,y_m,existing\n-14,9.5,yes\n-14,-9.5,no\n-20,0,no\n")
    words = ["plan", "crossroad", "--budget", "9000", "--find", "0.9", "--within", "60", "--poses",
             str(poses), "--lidar", "helios_16", "--max-frames", "6", "--heights", "5",
             "--pitches", "0", "--check-frames", "4", "--out", str(tmp_path / "out")]  # fmt: skip
    assert main.main(words) == 0
    text = capsys.readouterr().out
    assert "90 of 100 vehicles within 60 m" in text
    assert "on an existing mast" in text
    assert "Unconfirmed costs" in text
    assert re.search(r"1\. helios_16 at .*: finds \d+ of 100 .*, simulated;", text)
    assert len(text.splitlines()) <= 10
    assert len((tmp_path / "out/answer.txt").read_text().splitlines()) == len(text.splitlines())
    table = pd.read_csv(tmp_path / "out/options.csv")
    done = table[table.source == "simulated"]
    assert 1 in done.option.tolist()
    assert (done.share == done.recall_simulated).all()
    assert done.ap_simulated.between(0, 100).all()


def test_areas_have_their_weights_and_their_share(tmp_path: Path, site: PlanSite) -> None:
    file = tmp_path / "areas.csv"
    file.write_text("name,x_m,y_m,radius_m,class,weight\nstop,-30,-3,20,vehicle,5\n")
    areas = read_areas(file)
    objects = weighted_objects(site, Request(9000, areas=areas), LAW, site.frames)
    inside = of_name(areas, "stop", objects.table)
    assert 0 < inside.sum() < len(inside)
    assert (objects.weight[inside] == 5).all()
    assert set(objects.weight[~inside]) <= {0, 1}
    grid = {"grid": FEW, "check_frames": 0, "frames": 6}
    plan = pi.plan("crossroad", 9000, lidars=["helios_16"], areas=file, **grid)
    assert plan.options.recall_stop.between(0, 100).all()
    assert "at stop" in plan.text
    file.write_text("name,x_m,y_m,radius_m,class\nstop,-30,-3,20,vehicles\n")
    with pytest.raises(pi.Error, match=r":2: class: expected vehicle, person, any"):
        read_areas(file)


def test_people_have_no_weight_for_a_detector_that_finds_none(site: PlanSite) -> None:
    """A simulation has no people for Background, so the prediction must not count them either."""
    table = site.present.assign(person=np.arange(len(site.present)) % 3 == 0)
    people = replace(site, present=table)
    areas = (Area("all", *site.centre.tolist(), 200.0, 5.0),)
    for detector, weight in (("generalist", 5), ("background", 0)):
        law = read_detectability(detector)
        objects = weighted_objects(people, Request(9000, areas=areas), law, site.frames)
        person = objects.table.person.to_numpy(bool)
        assert (objects.weight[person] == weight).all()
        assert (objects.weight[~person] == 5).all()


def test_a_blank_cell_of_a_pose_is_a_missing_value(tmp_path: Path, site: PlanSite) -> None:
    file = tmp_path / "poses.csv"
    grid = pi.PoseGrid(heights_m=(4.0, 6.0), pitches_deg=(0.0, 10.0), yaws=3)
    file.write_text("x_m,y_m,z_m,yaw_deg,pitch_deg,existing,arm_m,bearing_deg\n"
                    "-14,9.5,5,90,2,yes,3,180\n-14,-9.5,,,,,,\n-20,-9.5,5,,2,no,,\n")  # fmt: skip
    poses = read_candidates(file, site, grid)
    rows = dict(list(poses.groupby(["foot_x_m", "foot_y_m"])))
    (whole,) = rows[-14, 9.5][[*POSE, "turn"]].to_numpy(float).tolist()
    assert whole == pytest.approx([-14, 6.5, 5, 90, 2, 0])
    made = rows[-14, -9.5]
    assert len(made) == 2 * 3 * 2
    assert made.kind.eq("file").all()
    assert not made.existing.any()
    assert len(rows[-20, -9.5]) == 3
    file.write_text("x_m,y_m\n-14,-9.5\n")
    without = read_candidates(file, site, grid)
    pd.testing.assert_frame_equal(made.reset_index(drop=True), without, check_dtype=False)


def test_crossings_of_a_map_are_one_area_of_people(tmp_path: Path) -> None:
    assert crossings_of(tmp_path, 1.0) == ()
    rows = "[{x_m: 1, y_m: 2}, {x_m: 5, y_m: 2}]"
    (tmp_path / "map.yaml").write_text(f"features: {{crossing: {rows}}}\n")
    assert {area.object_class for area in crossings_of(tmp_path, 1.0)} == {"person"}
    # Numbers of NumPy cannot be written to YAML.
    assert {type(v) for area in crossings_of(tmp_path, 1.0) for v in (area.x_m, area.y_m)} == {
        float
    }
    assert len({area.name for area in crossings_of(tmp_path, 1.0)}) == 1


def test_fused_frames_have_the_points_of_both_poses(site: PlanSite) -> None:
    lidar = simulation.load_lidar(lidar_file("helios_16"))
    poses = ([-14.0, 9.5, 5.0, -30.0, 0.0], [14.0, -9.5, 6.0, 120.0, 0.0])
    alone = [frames_at(site, pose, lidar, site.frames[:1]) for pose in poses]
    both = fused([frames_at(site, pose, lidar, site.frames[:1]) for pose in poses])[0]
    assert len(both.points) == sum(len(one[0].points) for one in alone)
    first, second = (one[0].objects.set_index("id") for one in alone)
    for row in both.objects.itertuples():
        parts = [one.points.get(row.id, 0) for one in (first, second)]
        assert row.points == sum(parts)
        if parts[0] and not parts[1]:
            assert (row.x, row.y) == pytest.approx((first.x[row.id], first.y[row.id]))
    inside = both.points[:, :2] - both.objects.query("points > 50").iloc[0][["x", "y"]].to_numpy(
        float
    )
    assert (np.hypot(*inside.astype(float).T) < 6).sum() > 40


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"budget_usd": 500}, "budget_usd: expected 5,.* or more"),
        ({"find": 90}, "find: expected 0 to 1, got 90; it is a share"),
        ({"poles": 0}, "poles: "),
        ({"detector": "generalst"}, "detector: .*generalist"),
        ({"lidars": ["helios_61"]}, "lidars: .*helios_16"),
        ({"false_per_minute": 0}, "false_per_minute: "),
        ({"scene": "crosroad"}, "scene: .*crossroad"),
        ({"preset": "papr"}, "preset: .*paper"),
    ],
)
def test_wrong_requests_say_what_works(change: dict[str, object], message: str) -> None:
    words = {"scene": "crossroad", "budget_usd": 9000, "lidars": ["helios_16"], "frames": 6}
    with pytest.raises(pi.Error, match=message):
        pi.plan(**(words | {"grid": FEW} | change))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("x_m,y_m\n-30,5\n", r"poses: expected one or more possible poses.*lane.*, use \(-"),
        ("x_m\n0\n", "expected the column y_m"),
        ("x_m,y_m\n", "expected one pose or more"),
        ("x_m,y_m,existing\n-14,9.5,maybe\n", r":2: existing: expected yes or no"),
        ("x_m,y_m\n-14,\n", r":2: y_m: expected a number"),
        ("x_m,y_m,z_m\n-14,9.5,1e6\n", r":2: z_m: expected a number"),
        ("x_m,y_m,arm_m,bearing_deg\n-14,9.5,2,\n", r":2: bearing_deg: expected -360 to 360"),
    ],
)
def test_wrong_files_of_poses_say_what_works(tmp_path: Path, rows: str, message: str) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(rows)
    grid = pi.PoseGrid(heights_m=(3.0,))
    with pytest.raises(pi.Error, match=message):
        pi.plan("crossroad", 9000, lidars=["helios_16"], poses=file, frames=6, grid=grid)


def test_a_mast_inside_a_house_is_refused_with_a_place_outside(tmp_path: Path) -> None:
    scene = tmp_path / "house.yaml"
    house = "{x_m: -30, y_m: 25, length_m: 10, width_m: 10, height_m: 9}"
    scene.write_text(scene_file("crossroad").read_text() + f"buildings: [{house}]\n")
    file = tmp_path / "poses.csv"
    file.write_text("x_m,y_m,z_m\n-30,23,5\n")
    with pytest.raises(pi.Error, match=r"inside a building.*, use \(-3"):
        pi.plan(scene, 9000, lidars=["helios_16"], poses=file, frames=6)
    site = open_site(scene, 1)
    walls = make_candidates(site, 60, pi.PoseGrid(every_m=5, heights_m=(6,)))
    on_wall = with_faults(walls[walls.kind == "wall"], site)
    assert len(on_wall) > 0
    assert (on_wall.fault == "").all()
    assert on_wall.existing.all()


def test_a_lidar_without_a_price_and_a_scene_without_traffic_are_refused(tmp_path: Path) -> None:
    text = lidar_file("livox_avia").read_text()
    priceless = tmp_path / "mine.yaml"
    priceless.write_text("\n".join(r for r in text.splitlines() if "price_usd" not in r))
    with pytest.raises(pi.Error, match="price"):
        pi.plan("crossroad", 9000, lidars=[priceless], frames=6, grid=FEW)
    scene = tmp_path / "empty.yaml"
    lines = scene_file("crossroad").read_text()
    start, end = lines.index("traffic:"), lines.index("# Street trees")
    scene.write_text(lines[:start] + lines[end:])
    with pytest.raises(pi.Error, match="traffic"):
        pi.plan(scene, 9000, lidars=["helios_16"], frames=6, grid=FEW)
