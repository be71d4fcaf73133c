"""The data of a plan's page: every figure is one of the plan's tables."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from plan_page_data import LIDARS

from pyinfra.cli import main
from pyinfra.experiments.planner.costs import lowest_prices, read_costs
from pyinfra.experiments.planner.detectability import read_detectability
from pyinfra.experiments.planner.front import CELL_M
from pyinfra.experiments.planner.plan import Plan
from pyinfra.experiments.planner.site import other_traffic
from pyinfra.formats.ply import Triangles, write_ply
from pyinfra.viz.plan_page.page import LARGEST_MB, render, write_plan_page
from pyinfra.viz.plan_page.plan_data import FIRST_CODE, LEVELS, plan_data
from pyinfra.viz.plan_page.site_map import site_map, window_of


@pytest.fixture(scope="module")
def folder(planned: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    write_plan_page(planned, folder)
    return folder


def test_the_detectability_was_fitted_on_the_frames_of_the_plan(planned: Plan) -> None:
    assert "learnt from frames" not in planned.text


def test_the_front_continues_the_options_with_the_same_columns(planned: Plan) -> None:
    table = planned.front.table
    listed = table[table.option <= planned.options.option.max()]
    pd.testing.assert_frame_equal(listed, planned.options)
    assert table.option.max() > planned.options.option.max()
    assert {"recall_within_30_m", "recall_within_30_m_low", "recall_stop line_high"} <= set(table)
    best = table.drop_duplicates("option")
    order = {"met": 0, "not known": 1, "not met": 2}
    first = best[best.verdict.map(order) == best.verdict.map(order).min()]
    first = first[first.share >= 70] if (first.share >= 70).any() else first
    assert best.price_usd[best.option == 1].item() == first.price_usd.min()


def test_the_choice_with_other_prices_is_an_option_of_the_front(planned: Plan) -> None:
    table = planned.front.table
    cases = planned.sensitivity.dropna(subset="option")
    assert cases.option.iloc[0] == 1
    for case in cases.itertuples():
        rows = table[table.option == case.option]
        assert case.lidars == " + ".join(rows.lidar)
        if "prices" in case.case:
            factor = 1 + int(case.case.split()[-2]) / 100
            low, high = sorted([factor, 1])
            ratio = case.price_usd / rows.price_usd.iloc[0]
            assert low - 1e-6 <= ratio <= high + 1e-6


def test_the_page_has_the_figures_of_the_tables(planned: Plan) -> None:
    data = json.loads(json.dumps(plan_data(planned), allow_nan=False))
    rows = planned.front.table.drop_duplicates("option").set_index("option")
    assert [one["number"] for one in data["options"]] == rows.index.tolist()
    assert data["lidars"] == sorted(LIDARS)
    assert data["request"]["false_per_minute"] is None
    for one in data["options"]:
        row = rows.loc[one["number"]]
        assert one["price"] == pytest.approx(
            row[["price_usd", "price_usd_low", "price_usd_high"]].tolist(), abs=0.01
        )
        ends = ["recall", "recall_low", "recall_high"]
        assert one["predicted"] == pytest.approx(row[ends].tolist(), abs=1e-3)
        if one["source"] == "predicted":
            assert one["shares"][0] == one["predicted"]
            assert one["shares"][0] == pytest.approx(
                row[["share", "share_low", "share_high"]].tolist(), abs=1e-3
            )
            assert f"finds {row.recall:.0f} of 100" in one["text"][0]
        assert one["weighted"] == pytest.approx(row.weighted, abs=1e-3)
        near = [goal["within"] for goal in data["goals"]].index(30)
        assert one["shares"][near][0] == pytest.approx(row.recall_within_30_m, abs=1e-3)
        assert sum(low for low, _ in one["costs"]) == pytest.approx(one["price"][1], abs=0.05)
        assert sum(high for _, high in one["costs"]) == pytest.approx(one["price"][2], abs=0.05)
    assert data["options"][0]["shares"][0] == [91, 90, 92]
    assert data["options"][0]["source"] == "simulated"
    assert all(one["source"] == "predicted" for one in data["options"][1:])


def test_the_cells_hold_the_vehicles_that_an_option_finds(planned: Plan) -> None:
    data, table = plan_data(planned), other_traffic(planned.site, 6).present
    vehicles = np.array(data["vehicles"])
    assert vehicles.sum() == (~table.person).sum()
    corners = np.array(data["cells"])
    assert len(np.unique(corners, axis=0)) == len(corners)
    assert (corners % CELL_M == 0).all()
    # All vehicles of the region are counted; 90 m from the centre hold nearly all of them.
    far = [one["within"] for one in data["goals"]].index(90)
    for one in data["options"]:
        share = np.array([ord(letter) - FIRST_CODE for letter in one["cells"]]) / LEVELS
        assert ((share >= 0) & (share <= 1)).all()
        away = np.hypot(*(corners + CELL_M / 2).T)
        near = away < 88
        mean = 100 * (share * vehicles)[near].sum() / vehicles[near].sum()
        assert mean == pytest.approx(one["shares"][far][0], abs=6)


def test_the_map_has_north_up_with_roads_and_places(planned: Plan) -> None:
    svg = plan_data(planned)["map"]
    for part in ("m-road", "m-walk", "m-dashed", "m-place", "m-area", 'id="map-poles"', "north"):
        assert part in svg
    pole = planned.candidates.iloc[0]
    assert f'cx="{pole.x_m:.1f}" cy="{-pole.y_m:.1f}"' in svg


def test_the_map_of_an_imported_site_has_its_meshes_and_crossings(
    planned: Plan, tmp_path: Path
) -> None:
    """The mesh has one triangle that is seen from above, and a wall that is not drawn."""
    corners = np.array([[10, 0, 0], [20, 0, 0], [20, 8, 0], [20, 8, 5]], float)
    write_ply(tmp_path / "house.ply", Triangles(corners, np.array([[0, 1, 2], [1, 2, 3]])))
    (tmp_path / "map.yaml").write_text(
        "features: {crossing: [{x_m: 3, y_m: 4}], bus_stop: [{x_m: 9, y_m: 4}]}\n"
    )
    keys = {"meshes": [{"file": "house.ply", "material": "structure"}]}
    site = replace(planned.site, keys=keys, file=tmp_path / "site.yaml")
    window = window_of(np.array([[-50.0, -50.0], [50.0, 50.0]]))
    svg = site_map(site, window, planned.candidates, ())
    assert re.findall('class="m-house" d="([^"]*)"', svg) == ["M10.0 -0.0L20.0 -0.0L20.0 -8.0z"]
    assert svg.count("m-crossing") == 1
    assert re.findall('class="m-stop" d="([^"]*)"', svg) == [
        "M7.5 -2.5L10.5 -2.5L10.5 -5.5L7.5 -5.5z"
    ]
    assert svg.count("m-road") == 1


def test_the_view_of_the_chosen_option_is_beside_the_page(planned: Plan, folder: Path) -> None:
    pages = [folder / "plan.html", folder / "view.html"]
    assert f'href="{pages[1].name}"' in pages[0].read_text()
    assert sum(page.stat().st_size for page in pages) < 1e6 * LARGEST_MB
    assert planned.options.lidar.iloc[0] in pages[1].read_text()
    assert 'href="view' not in render(plan_data(planned))


def test_lidars_above_the_budget_are_on_the_page_with_their_price(planned: Plan) -> None:
    """All LiDARs of this plan are within its budget, so one is added."""
    assert planned.above_budget == {}
    dear = plan_data(replace(planned, above_budget={"dear": 50_000.4}))
    assert dear["above_budget"] == {"dear": 50_000}
    names = [one.name for one in planned.lidars]
    poses = planned.candidates.assign(existing=False)
    costs = read_costs(None, 5, read_detectability("generalist"))
    prices = lowest_prices(planned.lidars, poses, costs)
    assert sorted(prices) == sorted(names)
    cheaper = lowest_prices(planned.lidars, poses.assign(existing=True), costs)
    assert all(cheaper[name] < prices[name] for name in names)


def test_no_score_makes_false_boxes_rarer_than_the_value_then(planned: Plan) -> None:
    front = planned.front
    table = front.table.assign(keeps_false=False)
    data = plan_data(replace(planned, front=replace(front, table=table)))
    for one in data["options"]:
        assert (one["false"][1] == one["false"][0]) == (one["source"] == "predicted")


def test_report_writes_the_same_page_again(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "again.html"
    assert main.main(["report", str(folder), "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    assert out.read_bytes() == (folder / "plan.html").read_bytes()
    assert out.stat().st_size < 1e6 * LARGEST_MB / 20
    assert "http" not in out.read_text().replace("http-equiv", "")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--budget", "9000"], "--budget: expected the results of a benchmark"),
        (["--tier", "quick"], "--tier: expected the results of a benchmark"),
    ],
)
def test_report_refuses_options_of_benchmarks_for_a_plan(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert main.main(["report", str(folder), *words, "--out", str(folder / "no.html")]) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "no.html").exists()


@pytest.mark.parametrize("text", ["{", "[]", '{"format": 0}'])
def test_report_refuses_damaged_data(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (tmp_path / "page.json").write_text(text)
    assert main.main(["report", str(tmp_path), "--out", str(tmp_path / "a.html")]) == 2
    assert "page.json: " in capsys.readouterr().err
