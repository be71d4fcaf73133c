"""How the choice of a plan moves, and predictions in frames that the choice has not used."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml

import pyinfra as pi
from pyinfra.core.errors import Error, FindingWarning
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.fused import fused
from pyinfra.experiments.planner import answer, predict, sensitivity, simulate
from pyinfra.experiments.planner import detectability as laws
from pyinfra.experiments.planner.answer import price_line, verdict_lines
from pyinfra.experiments.planner.check import cheaper_line, paired, share
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.costs import open_lidars, read_costs
from pyinfra.experiments.planner.notes import how_chosen
from pyinfra.experiments.planner.observe import Setting
from pyinfra.experiments.planner.request import Effort, Request
from pyinfra.experiments.planner.sensitivity import (
    PRICES,
    Move,
    cases_of,
    losses,
    simulated_rows,
    with_prices,
)
from pyinfra.experiments.planner.simulate import Found, frames_at
from pyinfra.experiments.planner.site import PlanSite, choice_end, open_site, other_traffic
from pyinfra.experiments.planner.verdict import Compared, Standing, in_order, verdict
from pyinfra.metrics.comparison import UNKNOWN, Interval, clipped

POSE = [-14.0, 9.5, 5.0, -30.0, 0.0]
ONE = [(POSE, simulation.load_lidar(lidar_file("helios_16")))]
NAN = float("nan")
NO_POSES = pd.DataFrame({"height_m": [6.0]})


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The crossroad for 20 s."""
    keys = yaml.safe_load(scene_file("crossroad").read_text()) | {"duration_s": 20}
    keys["traffic"]["warm_up_s"] = 5
    file = tmp_path_factory.mktemp("scene") / "small.yaml"
    file.write_text(yaml.safe_dump(keys, sort_keys=False))
    return file


@pytest.fixture(scope="module")
def site(scene: Path) -> PlanSite:
    return open_site(scene, 4)


@pytest.fixture(scope="module")
def units(site: PlanSite) -> Units:
    law = laws.read_detectability("generalist")
    helios = open_lidars(["helios_16"], site)[0]
    return Units(
        probability=np.full((4, 3), 0.5, np.float32),
        weight=np.ones(3),
        place=np.array([0, 0, 1, 2]),
        existing=np.zeros(4, bool),
        lidars=[helios] * 4,
        costs=read_costs(None, 5, law),
    )


def standing(
    recall: float, half: float = 0.02, *, weighted: float | None = None, source: str = "simulated"
) -> Standing:
    find = Interval(recall, recall - half, recall + half)
    false = Interval(0.01, 0, 0.02)
    value = recall if weighted is None else weighted
    return Standing(find, UNKNOWN, {}, value, false, UNKNOWN, 0.5, source)


def chosen(units: Units, *some: int) -> Choice:
    return Choice(some, 0.5, units.price(some), 0.5, "exact")


def test_the_kinds_of_prices_add_up_to_the_price(units: Units) -> None:
    now = units.price([0, 2]).middle
    more = {kind: with_prices(units, kind, 1.2).price([0, 2]).middle - now for kind in PRICES}
    assert more["all prices"] == pytest.approx(0.2 * now)
    lidars_usd = 2 * units.lidars[0].price_usd.middle
    assert more["LiDAR prices"] == pytest.approx(0.2 * lidars_usd)
    parts = units.costs.parts([units.lidars[0]] * 2, 2, 2)
    per_pole = [parts[name] for name in ("pole_usd", "installation_usd", "upkeep_usd")]
    assert more["costs per pole"] == pytest.approx(0.2 * sum(one.middle for one in per_pole))


def test_a_lidar_or_a_pole_is_lost(units: Units) -> None:
    assert losses(chosen(units, 3), units) == {"LiDAR 1 lost": {3}}
    lost = losses(chosen(units, 0, 1, 2), units)
    assert lost["LiDAR 3 lost"] == {2}
    assert lost["pole 1 lost"] == {0, 1}
    assert "pole 2 lost" not in lost


def test_a_choice_that_stays_is_one_sentence(units: Units) -> None:
    first, other = chosen(units, 2), chosen(units, 3)
    at = {(2,): standing(0.9), (3,): standing(0.93)}
    moves = [Move(kind, percent, first) for kind in PRICES for percent in (-20, 20)]
    line = price_line(moves, [first, other], units, at)
    assert line.startswith("The choice stays the same if LiDAR prices, costs per pole or all")
    moves[0] = replace(moves[0], choice=other)
    moves[1] = replace(moves[1], choice=None)
    line = price_line(moves, [first, other], units, at)
    assert "fall by 20 %, the choice is option 2 (helios_16), which finds 93 of 100" in line
    assert "no option is within the budget." in line
    assert line.endswith("stays the same.")


def ap_row(ap: float, low: float, high: float) -> pd.Series:
    return pd.Series({"ap_r1000": ap, "ap_r1000_low": low, "ap_r1000_high": high})


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(63.0, NAN, NAN)], (63.0, NAN, NAN)),
        ([(NAN, NAN, NAN), (63.0, 53.0, 73.0)], (63.0, 53.0, 73.0)),
        ([(98.0, 90.0, 100.0)], (98.0, 93.0, 100.0)),
        ([(50.0, NAN, NAN), (60.0, NAN, NAN)], (55.0, 0.0, 100.0)),
        ([(NAN, NAN, NAN)], (NAN, NAN, NAN)),
        ([], (NAN, NAN, NAN)),
    ],
)
def test_the_mean_ap_of_seeds_has_an_interval_only_if_one_is_known(
    rows: list[tuple[float, float, float]], expected: tuple[float, float, float]
) -> None:
    found = simulate._mean_ap([ap_row(*row) for row in rows])
    np.testing.assert_allclose((found.value, found.low, found.high), expected)


def test_clipping_keeps_an_unknown_interval_unknown() -> None:
    assert clipped(Interval(5, -1, 200), 0, 100) == Interval(5, 0, 100)
    assert not clipped(Interval(5, NAN, NAN), 0, 100).is_known
    assert not predict._limited([NAN, 0.5, 0.6], 1, 0.1).is_known


def test_a_verdict_follows_from_the_interval() -> None:
    request = Request(9000, find=0.9)
    assert verdict(standing(0.93), request) == "met"
    assert verdict(standing(0.91), request) == "not known"
    assert verdict(standing(0.89), request) == "not known"
    assert verdict(standing(0.85), request) == "not met"
    assert verdict(replace(standing(0.93), recall=UNKNOWN), request) == "not known"
    often = replace(standing(0.93), false_per_frame=Interval(2, 1, 3))
    rare = replace(request, false_per_minute=300.0)
    assert verdict(often, replace(request, false_per_minute=1200.0)) == "not known"
    assert verdict(often, rare) == "not met"
    assert verdict(standing(0.93), rare) == "met"


def test_the_lines_of_a_verdict_say_what_would_settle_or_change_it(units: Units) -> None:
    request, first = Request(9000, find=0.9), chosen(units, 2)
    (met,) = verdict_lines([(first, standing(0.93))], request, 30)
    assert met.startswith("Met: option 1 finds 93 of 100 vehicles [91 to 95], simulated in 30")
    unsure, how = verdict_lines([(first, standing(0.91))], request, 30)
    assert unsure.startswith("Not known whether 90 of 100 are found")
    assert "About 120 simulated frames" in how
    *_, how = verdict_lines([(first, standing(0.9001))], request, 30)
    assert "too close to the requirement" in how
    *_, how = verdict_lines([(first, standing(0.91, source="predicted"))], request, 0)
    assert "A simulation in full" in how
    missed, how = verdict_lines([(first, standing(0.85))], request, 30)
    assert missed.startswith("Not met: 90 of 100 were asked for, and option 1 finds 85 of 100")
    assert "a requested share of 0.83 would be met" in how


@pytest.mark.parametrize(
    ("share", "false", "first", "then"),
    [
        (
            Interval(0.97, 0.95, 0.99),
            Interval(0.10, 0.05, 0.15),
            "Not met: 90 of 100 with at most 6 false boxes a minute were asked for, and option 1",
            "A higher budget or more poles may help; at most 90 false boxes a minute would be met.",
        ),
        (
            Interval(0.7, 0.6, 0.8),
            Interval(0.10, 0.05, 0.15),
            "Not met: 90 of 100 with at most 6 false boxes a minute were asked for, and option 1",
            "A higher budget or more poles may help; a requested share of 0.6 and at most 90 false",
        ),
        (
            Interval(0.97, 0.95, 0.99),
            Interval(0.008, 0.002, 0.014),
            "Not known whether there are at most 6 false boxes a minute: ",
            "About 270 simulated frames",
        ),
        (
            Interval(0.91, 0.89, 0.93),
            Interval(0.008, 0.002, 0.014),
            "Not known whether 90 of 100 are found with at most 6 false boxes a minute: ",
            "About 270 simulated frames",
        ),
        (
            Interval(0.91, 0.89, 0.93),
            Interval(0, 0, 0.004),
            "Not known whether 90 of 100 are found: ",
            "About 120 simulated frames",
        ),
        (
            Interval(0.97, 0.95, 0.99),
            Interval(0.0099, 0.0, 0.02),
            "Not known whether there are at most 6",
            "The number of false boxes is too close to the requirement",
        ),
    ],
)
def test_the_lines_of_a_verdict_are_of_the_condition_that_decides(
    units: Units, share: Interval, false: Interval, first: str, then: str
) -> None:
    """6 false boxes a minute are 0.01 in a frame."""
    one = replace(standing(0.9), recall=share, false_per_frame=false)
    request = Request(9000, find=0.9, false_per_minute=6)
    lines = list(verdict_lines([(chosen(units, 2), one)], request, 30))
    assert lines[0].startswith(first)
    assert lines[1].startswith(then)


def test_a_share_is_not_rounded_up_to_the_wanted_one(units: Units) -> None:
    line, *_ = verdict_lines([(chosen(units, 2), standing(0.8996))], Request(9000, find=0.9), 30)
    assert "finds 89.96 of 100" in line


def test_no_cheaper_option_that_finds_as_much_loses(units: Units) -> None:
    """The second one is cheaper and finds more, but its interval is wider by chance."""
    dear = replace(chosen(units, 0, 2), price=units.price([0, 2]))
    cheap = chosen(units, 3)
    request = Request(50_000, find=0.9, poles=2)
    at = {dear.units: standing(0.93), cheap.units: standing(0.94, 0.05)}
    assert [verdict(at[one.units], request) for one in (dear, cheap)] == ["met", "not known"]
    assert in_order([dear, cheap], at, request) == [cheap, dear]
    at[cheap.units] = standing(0.94, 0.05, source="predicted")
    assert in_order([dear, cheap], at, request) == [dear, cheap]


def test_weights_decide_between_options_of_one_price_and_if_none_finds_enough(
    units: Units,
) -> None:
    """The second option finds fewer vehicles, and more of the objects with a large weight."""
    found = {(2,): standing(0.93, weighted=0.5), (3,): standing(0.92, weighted=0.8)}
    options = [chosen(units, 2), chosen(units, 3)]
    for find in (0.9, 0.96):
        assert in_order(options, found, Request(9000, find=find, people=1))[0].units == (3,)
    order = in_order(options, found, Request(9000, find=0.91, people=1))
    assert order[0].units == (2,)


def objects(found: list[list[int]]) -> Found:
    """Frames with vehicles at the centre, each found or not."""
    rows = [(k, False, 0.0, 0.0, bool(one)) for k, some in enumerate(found) for one in some]
    table = pd.DataFrame(rows, columns=["frame", "person", "x", "y", "found"])
    return Found(table, len(found), np.zeros(len(found)), UNKNOWN, 0.0)


def test_the_interval_of_a_simulated_share_has_the_frames_as_clusters() -> None:
    """Twenty frames in which all or none are found say less than as many independent vehicles."""
    together = objects([[1] * 5] * 16 + [[0] * 5] * 4)
    mixed = objects([[1, 1, 1, 1, 0]] * 20)
    all_found = objects([[1] * 5] * 20)
    one, other, sure = (
        share(x, np.ones(len(x.objects), bool)) for x in (together, mixed, all_found)
    )
    assert one.value == other.value == pytest.approx(0.8)
    assert one.high - one.low > 1.5 * (other.high - other.low)
    assert 0.95 < sure.low < 1
    assert sure.high == 1
    assert share(mixed, np.zeros(100, bool)) is UNKNOWN


def test_a_change_is_paired_by_frame(site: PlanSite) -> None:
    before = objects([[1, 1], [1, 0], [0, 0], [1, 1]])
    after = objects([[1, 0], [0, 0], [0, 0], [1, 0]])
    here = replace(site, centre=np.zeros(2))
    change = paired(before, after, here, 60)
    assert change.value == pytest.approx(-3 / 8)
    alone = [share(one, np.ones(8, bool)) for one in (before, after)]
    assert change.high - change.low < sum(one.high - one.low for one in alone)
    assert paired(before, before, here, 60).is_significant is False


def test_a_cheaper_option_that_may_find_as_much_is_named(site: PlanSite, units: Units) -> None:
    """Option 1 finds four of eight vehicles more. One frame decides nothing, and twenty do."""
    here, dear, cheap = replace(site, centre=np.zeros(2)), chosen(units, 0, 2), chosen(units, 3)
    at = {dear.units: standing(0.5), cheap.units: standing(0.4)}
    compared = Compared([dear, cheap], [], 2, units, (), at, lambda _: None, None)  # type: ignore
    setting = Setting(here, Request(9000), Effort(tell=str), None, None, None, [])  # type: ignore
    few = {dear.units: objects([[1, 1], [0, 0]]), cheap.units: objects([[0, 1], [0, 0]])}
    line = cheaper_line(compared, few, setting)
    less = units.price(dear.units).middle - units.price(cheap.units).middle
    assert line.startswith(f"Option 2 costs US$ {less:,.0f} less, and its share does not differ")
    many = {dear.units: objects([[1, 1]] * 20), cheap.units: objects([[0, 1], [0, 0]] * 10)}
    assert cheaper_line(compared, many, setting) == ""
    assert cheaper_line(compared, {}, setting) == ""
    reached = replace(compared, standings=at | {dear.units: standing(0.95)})
    assert cheaper_line(reached, few, setting) == ""


def test_what_if_has_the_cases_that_a_site_allows(site: PlanSite) -> None:
    names = [one.name for one in cases_of(site, ONE)]
    assert {"twice the traffic", "night", "rain 25 mm/h"} < set(names)
    assert "LiDAR 2 lost" in [one.name for one in cases_of(site, ONE * 2)]
    recorded = replace(site, keys=site.keys | {"trajectories": "tracks.csv"}, preset="paper")
    assert not {"twice the traffic", "night"} & {one.name for one in cases_of(recorded, ONE)}
    far = next(one for one in cases_of(site, ONE) if "further" in one.name)
    pose = np.array([site.centre[0] + 3, site.centre[1] + 4, 5, 0, 0])
    assert np.hypot(*(far.move(pose)[:2] - site.centre)) == pytest.approx(7)


def test_a_case_that_the_simulator_refuses_is_left_out(
    site: PlanSite, units: Units, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mast that is moved into a house must not lose the plan."""
    first, found = chosen(units, 0), objects([[1, 1], [1, 0]])
    at = {first.units: standing(0.5)}
    compared = Compared([first], [], 1, units, (), at, lambda _: SimpleNamespace(cut=0.5), None)  # type: ignore
    told: list[str] = []
    setting = Setting(site, Request(9000), Effort(tell=told.append), None, None, None, [])  # type: ignore

    def refuse(_: PlanSite, poses: object, *args: object, **named: object) -> Found:
        if named["scene"] == {} and not named["yaw_error_deg"]:
            raise Error("mount: expected a place outside buildings, got one inside a building")
        return found

    monkeypatch.setattr(sensitivity, "simulate_option", refuse)
    with pytest.warns(FindingWarning, match="left out, because the simulator refuses it: mount"):
        rows = list(simulated_rows(compared, setting, ONE, {first.units: found}))
    assert {"night", "rain 25 mm/h"} < {row["case"] for row in rows}
    assert not any("mast" in str(row["case"]) for row in rows)


def notes_of(units: Units, request: Request, site: PlanSite, every: pd.DataFrame = NO_POSES) -> str:
    law = laws.read_detectability("generalist")
    rows = pd.DataFrame({"option": [1], "poles": [2], "share": [90.0], "price_usd": [9000.0]})
    first = [(chosen(units, 0, 2), standing(0.9))]
    lines = [
        *answer.doubts(first[0], request, law, units, site, every),
        *how_chosen(first, rows, request, units),
    ]
    return " ".join(lines)


def test_a_choice_is_exact_only_without_larger_sets(units: Units, site: PlanSite) -> None:
    assert "exact over all pairs of pose and LiDAR" in notes_of(
        units, Request(50_000, poles=2), site
    )
    assert "for one and two LiDARs is exact" in notes_of(units, Request(50_000, poles=3), site)


def test_pedestrians_of_a_request_that_are_not_there_are_named(
    units: Units, site: PlanSite
) -> None:
    assert "no share of pedestrians" in notes_of(units, Request(50_000, people=1), site)
    assert "pedestrian" not in notes_of(units, Request(50_000), site)


def test_the_first_line_repeats_the_whole_request(site: PlanSite) -> None:
    text = answer.asked(site, Request(9000, poles=2, lidars_per_pole=3, people=0.5))
    assert "2 poles of at most 3 LiDARs each" in text
    assert "a pedestrian 0.5" in text


def test_a_sentence_names_no_share_without_an_object(units: Units) -> None:
    """Without a vehicle within the distance in the frames of the prediction."""
    row = {"lidar": "a", "x_m": 0.0, "y_m": 0.0, "height_m": 5.0, "yaw_deg": 0.0, "pitch_deg": 0.0}
    rows = pd.DataFrame([row | {"existing": False, "kind": "kerb", "latency_ms": 91.1}])
    people = replace(standing(0.9), recall=UNKNOWN, people=Interval(0.5, 0.4, 0.6))
    for one, words in (
        (people, ": finds 50 of 100 [40 to 60] pedestrians within 60 m"),
        (replace(people, people=UNKNOWN), ": no object is within 60 m"),
    ):
        assert words in answer.sentence((chosen(units, 2), one), rows, Request(9000))


def test_each_lidar_of_a_bundle_counts_in_the_latency(units: Units) -> None:
    """As in the number of computers."""
    five = replace(units.lidars[0], units=5)
    bundle = replace(units, lidars=[five, *units.lidars[1:]])
    assert bundle.latency_ms([0, 2]) == pytest.approx(6 * units.costs.latency_ms)
    assert units.latency_ms([0, 2]) == pytest.approx(2 * units.costs.latency_ms)


def test_predictions_are_of_other_traffic(site: PlanSite) -> None:
    other = other_traffic(site, 4)
    assert other.seed not in (site.seed, site.keys["seed"])
    both = site.present.merge(other.present, on=["frame", "id", "x", "y"])
    assert both.empty


def test_recorded_traffic_is_split_by_time(site: PlanSite) -> None:
    keys = site.keys | {"trajectories": "tracks.csv"}
    assert choice_end(keys, 90) == 60
    assert choice_end(site.keys, 90) == 90
    recorded = replace(site, keys=keys, every_frame=90)
    assert recorded.recorded
    assert set(recorded.other_frames(99)) == set(range(60, 90))


def test_a_yaw_error_turns_the_points_and_no_label(site: PlanSite) -> None:
    lidar = simulation.load_lidar(lidar_file("helios_16"))
    sequence = frames_at(site, POSE, lidar, site.frames[:1])
    true, turned = fused([sequence])[0], fused([sequence], 0.5)[0]
    angle = np.arctan2(*turned.points[:, 1::-1].T) - np.arctan2(*true.points[:, 1::-1].T)
    assert np.degrees((angle + np.pi) % (2 * np.pi) - np.pi) == pytest.approx(0.5, abs=0.01)
    assert (turned.points[:, 2:] == true.points[:, 2:]).all()
    columns = ["id", "x", "y", "points"]
    pd.testing.assert_frame_equal(
        true.objects[columns].sort_values("id", ignore_index=True),
        turned.objects[columns].sort_values("id", ignore_index=True),
    )


@pytest.mark.nightly
def test_a_plan_says_how_the_choice_moves(scene: Path, tmp_path: Path) -> None:
    text = lidar_file("helios_16").read_text()
    text = text.replace("rate_hz: 10, columns_per_turn: 1800", "rate_hz: 20, columns_per_turn: 900")
    fast = tmp_path / "fast.yaml"  # 20 frames a second, too many for one core
    fast.write_text(text.replace("channels/", f"{lidar_file('helios_16').parent / 'channels'}/"))
    poses = tmp_path / "poses.csv"
    poses.write_text("x_m,y_m,z_m,yaw_deg,pitch_deg\n-14,9.5,5,-30,0\n")
    words = {"lidars": [fast], "poses": poses, "frames": 4, "check_frames": 2}
    plan = pi.plan(scene, 8000, out=tmp_path / "out", **words)
    assert "If LiDAR prices rise by 20 %, no option is within the budget." in plan.text
    assert "It needs 2 cores to keep up" in plan.text
    table = pd.read_csv(tmp_path / "out/sensitivity.csv").set_index("case")
    assert table.chosen["LiDAR prices +20 %"] == "no"
    assert table.option["LiDAR prices -20 %"] == 1
    assert table.recall["LiDAR 1 lost"] == 0
    assert table.recall["rain 25 mm/h"] <= table.recall["as asked"] + 15
    assert len(plan.answer.lines) <= 10
    first = plan.options.iloc[0]
    assert first.share == pytest.approx(table.recall["as asked"], rel=1e-4)
    assert (first.source, first.share) == ("simulated", first.recall_simulated)
    assert (tmp_path / "out/notes.txt").read_text().count("an hour of other traffic") == 1
    words["what_if"] = True
    again = pi.plan(scene, 8000, out=tmp_path / "out", **words)
    table = again.sensitivity.set_index("case")
    assert (table.source["night"], table.source["rain 25 mm/h"]) == ("simulated",) * 2
    assert table.change_low["mast 0.5 m lower"] <= table.change["mast 0.5 m lower"]
    assert "with mast 0.5 m lower" in again.text
