"""The report of the study: its comparison with the paper, and its section on models of a scene."""

import re
from pathlib import Path

import pandas as pd
import pytest
import report_data
from report_data import Read

from pyinfra.cli import main
from pyinfra.viz.report.report_data import Material, read_material
from reproduction.paper_tables import paper_ap
from reproduction.report import TABLES, ladder
from reproduction.report.fidelity import section as fidelity_section


def report(results: Path) -> Path:
    """Writes the page of a folder beside the folder."""
    out = results.parent / "report.html"
    words = ["report", str(results), "--sections", "reproduction.report", "--out", str(out)]
    assert main.main(words) == 0
    return out


def read(folder: Path) -> Material:
    return read_material(folder, [], [], None, more=TABLES)


def custom_site(folder: Path) -> Path:
    """Writes the tables of a benchmark of a site that is not in the paper."""
    names = ("quick.csv", "quick_areas.csv", "quick_distance.csv", "quick_hits.csv")
    more = ("quick_value.csv", "lidars.csv")
    every = report_data.study_tables()
    return report_data.write(
        folder, {name: every[name].replace("highway", "bridge") for name in (*names, *more)}
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes the page of all tables."""
    folder = tmp_path_factory.mktemp("report") / "results"
    return report(report_data.write(folder, report_data.study_tables()))


def test_nothing_that_is_missing_is_shown_as_nan(whole: Path) -> None:
    assert not re.search(r"\bnan\b|\bNone\b", Read(whole).text)


def test_links_lead_somewhere_and_ids_are_unique(whole: Path) -> None:
    page = Read(whole)
    assert len(page.ids) == len(set(page.ids))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)


@pytest.mark.parametrize("name", list(report_data.study_tables())[-3:])
def test_one_table_alone_makes_a_page(name: str, tmp_path: Path) -> None:
    tables = {name: report_data.study_tables()[name]}
    page = Read(report(report_data.write(tmp_path / "results", tables)))
    assert "Methods and provenance" in page.text
    assert not re.search(r"\bnan\b", page.text)


def test_ap_stands_beside_the_papers(whole: Path) -> None:
    assert re.search(r"92\.5 \[90\.5, 93\.5\] R40 92\.5, paper 92\.4 ", Read(whole).text)


def test_hits_stand_beside_the_papers(whole: Path) -> None:
    text = Read(whole).text
    assert "10,529 11,582 +10.0" in text
    assert "by 10.0 % on average and by 10.0 % at most" in text


@pytest.mark.usefixtures("undrawn")
def test_what_the_paper_shows_and_this_page_does_not_is_named(tmp_path: Path) -> None:
    results = report_data.write(tmp_path / "results", {"quick.csv": report_data.experiments()})
    assert "Figure: scanning patterns not here: needs a data set" in Read(report(results)).text


def test_the_coarsest_model_that_changes_nothing_is_recommended(tmp_path: Path) -> None:
    tables = {"fidelity.csv": report_data.fidelity(), "aggregation.csv": report_data.aggregation()}
    report_data.write(tmp_path, tables)
    made = fidelity_section(read(tmp_path))
    assert made is not None
    assert made.lead.startswith("Recommended: detail low, ")
    assert "is 0.50 %, and a run takes 0.90 times as long" in made.lead
    assert "slices:100 takes 40.9 ms" in made.lead


def test_the_cheapest_model_whose_conclusions_stay_is_named(tmp_path: Path) -> None:
    report_data.write(tmp_path, {"ladder.csv": report_data.ladder()})
    words, made = ladder.blocks(read(tmp_path))
    assert "detail low (1.00 of the time of fine)" in words
    assert "aggregation instant (1.00 of the time of exact)" in words
    assert "frames 500 (0.50 of the time of 1000)" in words
    assert [block.kind for block in made] == ["figure", "table"]
    same = {(r.setting, r.value): r.same for r in ladder.compared_values(with_seconds(tmp_path))}
    assert not same["detail", "box"]
    assert not same["frames", "50"]


@pytest.mark.nightly
def test_a_ladder_of_another_preset_is_left_out(tmp_path: Path) -> None:
    table = report_data.ladder().assign(preset="datasheet")
    report_data.write(tmp_path, {"ladder.csv": table})
    words, _ = ladder.blocks(read(tmp_path))
    other = table[table.seed < 3].assign(preset="paper", ap_r1000=1.0)
    report_data.write(tmp_path, {"ladder.csv": pd.concat([other, table])})
    assert ladder.blocks(read(tmp_path))[0] == words


def test_a_ladder_with_two_seeds_recommends_nothing(tmp_path: Path) -> None:
    table = report_data.ladder()
    report_data.write(tmp_path, {"ladder.csv": table[table.seed < 3]})
    words, _ = ladder.blocks(read(tmp_path))
    assert words == ladder.TOO_FEW_SEEDS


def test_a_model_with_an_uncertain_change_of_ap_is_not_recommended(tmp_path: Path) -> None:
    table = report_data.ladder()
    low = table.detail == "low"
    table.loc[low & (table.seed == 2), "ap_r1000"] += 3  # the mean change is 1
    report_data.write(tmp_path, {"ladder.csv": table})
    same = {(r.setting, r.value): r.same for r in ladder.compared_values(with_seconds(tmp_path))}
    assert same["detail", "mid"]
    assert not same["detail", "low"]


def test_the_parts_of_vehicles_are_a_setting_where_the_ladder_has_them(tmp_path: Path) -> None:
    usual = report_data.ladder().assign(parts="glass+gap+coat")
    turned = usual[:6].assign(parts="none", ap_r1000=[70.0, 71.0, 72.0, 60.0, 61.0, 62.0])
    every = usual[:6].assign(parts="all")
    report_data.write(tmp_path, {"ladder.csv": pd.concat([usual, turned, every])})
    words, _ = ladder.blocks(read(tmp_path))
    assert "parts glass+gap+coat (1.00 of the time of all)" in words
    same = {(r.setting, r.value): r.same for r in ladder.compared_values(with_seconds(tmp_path))}
    assert same["parts", "glass+gap+coat"]
    assert not same["parts", "none"]
    assert not same["detail", "box"]
    assert {value for setting, value in same if setting == "label_time"} == {"frame"}


def with_seconds(folder: Path) -> pd.DataFrame:
    table = read(folder).results.table("ladder")
    return table.assign(seconds=table.ms_per_frame_set * table.frames.astype(float) / 1000)


def test_the_papers_ap_is_complete() -> None:
    table = paper_ap()
    assert len(table) == 3 * 4 * 4
    value = table.set_index(["scene", "lidar", "detector"]).ap
    assert value["highway", "ruby_plus", "pv-rcnn"] == 93.29
    assert value["crossroad", "livox_avia", "pointpillars"] == 84.03
    assert value["curve", "helios_16", "pointrcnn"] == 16.40


@pytest.mark.usefixtures("undrawn")
@pytest.mark.nightly
def test_the_report_of_an_own_site_has_nothing_of_the_paper(tmp_path: Path) -> None:
    page = Read(report(custom_site(tmp_path / "results")))
    assert "figure-hits" not in page.ids
    assert {"hits", "methods"} <= set(page.ids)
    assert "the paper" not in page.text


@pytest.mark.usefixtures("undrawn")
@pytest.mark.nightly
def test_scenes_of_the_paper_beside_an_own_site_keep_their_cards(tmp_path: Path) -> None:
    results = custom_site(tmp_path / "results")
    for name, table in report_data.study_tables().items():
        if (results / name).is_file() and "scene" in table:
            both = pd.concat([pd.read_csv(results / name), table])
            both.to_csv(results / name, index=False)
    text = Read(report(results)).text
    assert text.index("Bridge, preset paper") < text.index("Highest AP of the vehicles it captures")
    assert "figure-hits" in set(Read(results.parent / "report.html").ids)
