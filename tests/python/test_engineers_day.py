"""An engineer's day: from a map to a sheet to sign, with an existing mast that has an arm.

The fast test has a few frames and little traffic. `make nightly` repeats the day at full size.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from browser import Browser
from site_maps import Osm

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.dataset import catalogue
from pyinfra.experiments.planner import sensitivity
from pyinfra.experiments.planner.costs import open_lidars
from pyinfra.experiments.planner.simulate import frames_at
from pyinfra.experiments.planner.site import open_site
from pyinfra.formats.ply import read_ply
from pyinfra.scenes.maps import site_traffic, traffic
from pyinfra.scenes.maps.tracks import Track

pytest.importorskip("sumo", reason="Eclipse SUMO is not installed: extra `site`")

ARM_M = 170.0
MAST = (10.0, 10.0)
POSE = [-14.0, 9.5, 6.0, -30.0, 0.0]


def junction_text() -> str:
    """Returns a map of one junction with signals, crossings, a house and a tree."""
    osm = Osm(8.4, 49.0)
    middle = osm.node(0, 0, highway="traffic_signals")
    kind = {"highway": "secondary", "maxspeed": "50", "lanes": "2"}
    for east, north in ((1, 0), (0, 1)):
        crossings = [
            osm.node(k * east, k * north, highway="crossing", crossing="traffic_signals")
            for k in (-11, 11)
        ]
        ends = [osm.node(k * ARM_M * east, k * ARM_M * north) for k in (-1, 1)]
        osm.way([ends[0], crossings[0], middle, crossings[1], ends[1]], **kind)
    osm.house([(-40, 15), (-15, 15), (-15, 40), (-40, 40)], building__levels="3")
    osm.node(25, -12, natural="tree", height="8")
    return osm.text()


def plan_words(site: Path, masts: Path, out: Path) -> list[str]:
    return [
        *("plan", str(site), "--budget", "12000", "--find", "0.95", "--within", "60"),
        *("--people", "1", "--poses", str(masts), "--what-if", "--out", str(out)),
    ]


def write_masts(folder: Path) -> Path:
    """Writes an existing mast with an arm to the south-west, and a place for a new pole."""
    file = folder / "masts.csv"
    rows = [(*MAST, "yes", 3.0, 225.0), (-12.0, -12.0, "no", 0.0, 0.0)]
    table = pd.DataFrame(rows, columns=["x_m", "y_m", "existing", "arm_m", "bearing_deg"])
    table.to_csv(file, index=False)
    return file


def make_site(folder: Path, *words: str) -> Path:
    """Imports the map, and simulates 12,000 vehicles an hour and people."""
    (folder / "junction.osm").write_text(junction_text())
    site = folder / "site"
    assert main.main(["site", "import", str(folder / "junction.osm"), "--out", str(site)]) == 0
    rates = ["--vehicles-per-hour", "12000", "--pedestrians-per-hour", "600"]
    assert main.main(["site", "traffic", str(site), *rates, *words]) == 0
    return site


def check_day(site: Path, out: Path, printed: str, answer: str) -> None:
    """Checks what the engineer reads on screen, in the answer and in the tables."""
    first, verdict, *_ = answer.splitlines()
    x, y = map(float, re.findall(r"site, centre \((-?\d+), (-?\d+)\) m", first)[0])
    assert max(abs(x), abs(y)) <= 1  # the middle of the junction
    assert "95 of 100 vehicles within 60 m" in first
    assert "The pretrained detector is not equally good for all LiDARs" in first
    assert verdict.split(":")[0].startswith(("Met", "Not met", "Not known"))
    assert len(answer.splitlines()) <= 10
    full = "12,000 vehicles an hour were asked for, and"
    assert printed.count(full) == 1
    assert answer.count(full) == 1
    assert yaml.safe_load((site / "traffic.yaml").read_text())[site_traffic.DRIVEN] < 9600
    assert "on an arm of an existing mast" in answer
    assert re.search(r"yaw -?\d+ \(compass \d+\)", answer)
    assert "at the crossings" in answer
    options = pd.read_csv(out / "options.csv")
    arm = options[options.kind == "arm"].iloc[0]
    end = 3 / 2**0.5
    assert (arm.x_m, arm.y_m) == pytest.approx((MAST[0] - end, MAST[1] - end), abs=0.01)
    assert set(options.kind) == {"arm", "file"}  # each mast of the file has an option
    assert (
        options.price_usd[options.kind == "arm"].min()
        < options.price_usd[options.kind == "file"].min()
    )
    cases = pd.read_csv(out / "sensitivity.csv")
    done = cases[cases.change.notna()]
    expected = {"mast 2 m further from the centre", "a lorry standing in a lane", "night"}
    assert expected <= set(done.case)
    assert (done.change_low <= done.change).all()
    assert (done.change <= done.change_high).all()
    assert "with a lorry standing in a lane" in answer
    page = (out / "plan.html").read_text()
    assert "Signature" in page


def test_an_engineer_plans_a_junction_with_a_mast_and_its_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(traffic, "_WALKING_S", 60)
    site = make_site(tmp_path, "--seconds", "12")
    printed = capsys.readouterr().out
    words = ["--lidar", "hesai_xt32", "--max-frames", "4", "--heights", "6"]
    words += ["--pitches", "0", "--check-frames", "2"]
    out = tmp_path / "plan"
    assert main.main([*plan_words(site, write_masts(tmp_path), out), *words]) == 0
    check_day(site, out, printed, capsys.readouterr().out)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_the_day_at_full_size_ends_with_one_sheet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], browser: Browser
) -> None:
    site = make_site(tmp_path, "--seconds", "120")
    printed = capsys.readouterr().out
    out = tmp_path / "plan"
    lidars = ["--lidar", "helios_16", "hesai_xt32", "pandar_64", "livox_avia"]
    assert main.main([*plan_words(site, write_masts(tmp_path), out), *lidars]) == 0
    check_day(site, out, printed, capsys.readouterr().out)
    with browser.open(out / "plan.html") as view:
        view.page.emulate_media(media="print")
        pdf = view.page.pdf(path=tmp_path / "plan.pdf")
    assert len(re.findall(rb"/Type\s*/Page\b", pdf)) == 1


@pytest.fixture(scope="module")
def planned_masts(tmp_path_factory: pytest.TempPathFactory) -> pi.Plan:
    """A plan with a good mast, one that sees little, and one whose arm is from the first."""
    file = tmp_path_factory.mktemp("masts") / "masts.csv"
    file.write_text(
        "x_m,y_m,z_m,existing,arm_m,bearing_deg\n"
        "-14,9.5,6,yes,0,0\n-14,9.5,6,yes,2,180\n-90,12,16,yes,0,0\n"
    )
    grid = pi.PoseGrid(pitches_deg=(0,))
    return pi.plan(
        "crossroad", 12_000, lidars=["helios_16", "hesai_xt32"], poses=file, frames=12, grid=grid,
        check_frames=0, poles=2, lidars_per_pole=2,
    )  # fmt: skip


def test_each_position_of_the_user_has_an_option(planned_masts: pi.Plan) -> None:
    options = planned_masts.options
    alone = options[options.groupby("option").unit.transform("size") == 1]
    assert {(-14.0, 9.5), (-14.0, 7.5), (-90.0, 12.0)} == set(
        zip(alone.x_m, alone.y_m, strict=True)
    )
    assert alone.share[alone.x_m == -90].max() < 0.7 * alone.share[alone.x_m == -14].max()


def test_lidars_on_the_arms_of_one_mast_share_it(planned_masts: pi.Plan) -> None:
    options = planned_masts.options
    near = options[options.groupby("option").x_m.transform("min") == -14]
    both = near[near.groupby("option").y_m.transform("nunique") == 2]
    assert len(both) > 0
    assert set(both.poles) == {1}


def test_heights_that_may_be_feet_are_said_once(planned_masts: pi.Plan) -> None:
    assert planned_masts.text.count("If these are feet, 16 feet are 4.9 m") == 1


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("x_m,y_m,arm_m\n-14,9.5,2\n", ":1: expected the column bearing_deg beside arm_m"),
        ("x_m,y_m,arm_m,bearing_deg\n-14,9.5,31,0\n", ":2: arm_m: expected 0 to 30, got 31"),
        ("x_m,y_m,arm_m,bearing_deg\n-14,9.5,3,400\n", ":2: bearing_deg: expected -360 to 360"),
        ("x_m,y_m,arm_m,bearing_deg\n-14,9.5,3,\n", ":2: bearing_deg: expected -360 to 360"),
    ],
)
def test_a_wrong_arm_is_named(tmp_path: Path, rows: str, message: str) -> None:
    file = tmp_path / "masts.csv"
    file.write_text(rows)
    with pytest.raises(pi.Error, match=message):
        pi.plan("crossroad", 9000, lidars=["helios_16"], poses=file, frames=4)


def test_costs_without_a_source_are_said_once(tmp_path: Path) -> None:
    costs = pd.read_csv(catalogue.configs() / "planner/costs.csv")
    costs.loc[costs["item"] == "cable_usd", "source"] = ""
    costs.to_csv(file := tmp_path / "costs.csv", index=False)
    masts = tmp_path / "masts.csv"
    masts.write_text("x_m,y_m,existing\n-14,9.5,yes\n")
    grid = pi.PoseGrid(pitches_deg=(0,), heights_m=(5,))
    result = pi.plan(
        "crossroad", 9000, lidars=["helios_16"], poses=masts, frames=4, grid=grid,
        check_frames=0, costs=file,
    )  # fmt: skip
    assert result.text.count("Without a source: the prices of cable_usd.") == 1


def track(name: str, first: int, object_class: str = "Car") -> Track:
    return Track(name, object_class, np.ones(3), first, np.zeros((10, 6)))


def test_traffic_that_a_network_cannot_carry_is_named_by_its_figures(tmp_path: Path) -> None:
    tracks = [track("a", 0), track("b", 5), track("b", 90), track("p", 7, "Pedestrian")]
    assert site_traffic.driven_per_hour([*tracks, track("c", 20)], 10) == 720
    record = {"vehicles_per_hour": 12_000.0, site_traffic.DRIVEN: 4500}
    (tmp_path / site_traffic.RECORD).write_text(yaml.safe_dump(record))
    text = site_traffic.lacking_traffic(tmp_path)
    assert "12,000 vehicles an hour were asked for, and 4,500 drive" in text
    record[site_traffic.DRIVEN] = 11_000
    (tmp_path / site_traffic.RECORD).write_text(yaml.safe_dump(record))
    assert site_traffic.lacking_traffic(tmp_path) == ""


def test_a_lorry_stands_in_the_lane_between_mast_and_centre() -> None:
    site = open_site("crossroad", 4)
    case = sensitivity.standing_lorry(site, np.array(POSE[:2]))
    x, y = case.without
    assert x == pytest.approx(-7, abs=1)
    assert 0 < y < 7.5  # on the carriageway, at the side of the mast
    (mesh,) = case.scene["meshes"]
    box = read_ply(Path(str(mesh["file"]))).vertices
    assert np.ptp(box, axis=0) == pytest.approx([12, 2.55, 3.7], abs=0.01)
    lidar = open_lidars(["helios_16"], site)[0].unit
    free, hidden = (
        frames_at(site, POSE, lidar, site.frames, scene=keys) for keys in (None, case.scene)
    )
    points = [sum(frame.objects.points.sum() for frame in frames) for frames in (free, hidden)]
    assert points[1] < points[0]
