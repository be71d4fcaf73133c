"""The report of the study: its comparison with the paper."""

import re
from pathlib import Path

import pandas as pd
import pytest
import report_data
from report_data import Read

from pyinfra.cli import main
from reproduction.paper_tables import paper_ap


def report(results: Path) -> Path:
    """Writes the page of a folder beside the folder."""
    out = results.parent / "report.html"
    words = ["report", str(results), "--sections", "reproduction.report", "--out", str(out)]
    assert main.main(words) == 0
    return out


def custom_site(folder: Path) -> Path:
    """Writes the tables of a benchmark of a site that is not in the paper."""
    names = ("quick.csv", "quick_areas.csv", "quick_distance.csv", "quick_hits.csv")
    more = ("quick_value.csv", "lidars.csv")
    every = report_data.tables()
    return report_data.write(
        folder, {name: every[name].replace("highway", "bridge") for name in (*names, *more)}
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes the page of all tables."""
    folder = tmp_path_factory.mktemp("report") / "results"
    return report(report_data.write(folder, report_data.tables()))


def test_nothing_that_is_missing_is_shown_as_nan(whole: Path) -> None:
    assert not re.search(r"\bnan\b|\bNone\b", Read(whole).text)


def test_links_lead_somewhere_and_ids_are_unique(whole: Path) -> None:
    page = Read(whole)
    assert len(page.ids) == len(set(page.ids))
    assert {link[1:] for link in page.links if link.startswith("#")} <= set(page.ids)


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
    for name, table in report_data.tables().items():
        if (results / name).is_file() and "scene" in table:
            both = pd.concat([pd.read_csv(results / name), table])
            both.to_csv(results / name, index=False)
    text = Read(report(results)).text
    assert text.index("Bridge, preset paper") < text.index("Highest AP of the vehicles it captures")
    assert "figure-hits" in set(Read(results.parent / "report.html").ids)
