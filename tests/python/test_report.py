"""The report as files: its text, the sources of its numbers, and its behaviour if tables are
missing."""

import re
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import report_data
from benchmark_data import with_r1000
from matplotlib.figure import Figure
from report_data import HOSTILE, Read

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.dataset.catalogue import configs
from pyinfra.experiments.requirements import Requirements
from pyinfra.experiments.result_tables import read_results
from pyinfra.viz.report import svg
from pyinfra.viz.report.names import capitalized, read_names
from pyinfra.viz.report.report_data import read_material
from pyinfra.viz.report.sections import answer as answer_section
from pyinfra.viz.report.sections import methods, recommendation, value
from pyinfra.viz.report.sections.speed import pareto
from pyinfra.viz.report.sections.stability import curve
from pyinfra.viz.report.style import drawing, panel


def report(results: Path, *words: object) -> Path:
    """Writes the page of a folder beside the folder."""
    out = results.parent / "report.html"
    assert main.main(["report", str(results), *map(str, words), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes the page of all tables."""
    return report(report_data.write(tmp_path_factory.mktemp("report") / "results"))


def test_the_answer_comes_first_and_names_lidar_and_detector(whole: Path) -> None:
    text = Read(whole).text
    answer, hits = (
        text.index("Highest AP of the vehicles it captures"),
        text.index("Mean number of points per frame"),
    )
    assert answer < hits
    first = text[answer : answer + 200]
    assert "RoboSense Ruby Plus with PointPillars" in first
    assert "AP (R1000) 92.5 [90.5, 93.5]; the difference to Livox Avia with PointPillars" in first


@pytest.mark.usefixtures("undrawn")
@pytest.mark.nightly
def test_without_replicates_it_is_reported_once_that_nothing_is_significant(tmp_path: Path) -> None:
    tables = report_data.tables()
    del tables["quick_replicates.csv"]
    text = Read(report(report_data.write(tmp_path / "results", tables))).text
    assert (
        text.count("it is not known whether the best option differs significantly from the next")
        == 1
    )
    assert "is not significant" not in text


def test_the_cheapest_choice_is_told_with_its_ap_of_the_whole_road(whole: Path) -> None:
    assert "US$ 2,079, AP (R1000) 45.6 of all visible vehicles" in Read(whole).text


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("truth", ["all", "present"])
def test_cards_rank_by_the_whole_road_and_not_by_what_a_lidar_captured(
    tmp_path: Path, truth: str
) -> None:
    """The Avia finds nearly all vehicles that it captures, costs less and is faster. But it
    captures few vehicles."""
    rows = report_data.experiments().assign(reason="").fillna({"ap": 84.0})
    narrow = (rows.lidar == "livox_avia").to_numpy()
    names = ("ap", "ap_r1000", "ap_low", "ap_high", "ap_r1000_low", "ap_r1000_high")
    rows = rows.assign(**dict.fromkeys(names, np.where(narrow, 96.0, 81.0)))
    for name in ("all", "present") if truth == "present" else ("all",):
        value = np.where(narrow, 40.0, 80.0) if name == truth else np.where(narrow, 96.0, 81.0)
        ends = ("", "_low", "_high", "_r1000", "_r1000_low", "_r1000_high")
        rows = rows.assign(**dict.fromkeys([f"ap_{name}{end}" for end in ends], value))
    rows["latency_p50_ms"] = np.where(narrow, 10.0, 70.0)
    tables = report_data.tables() | {"quick.csv": rows}
    text = Read(report(report_data.write(tmp_path / "results", tables))).text
    cards = text[text.index("Highest AP of the vehicles it captures") :]
    of = {"all": "all visible vehicles", "present": "every vehicle"}[truth]
    for card, words in {
        "Fastest with at most 5 AP less than": f"70 ms a frame, AP (R1000) 80.0 of {of}",
        "Cheapest LiDAR with at most 5 AP less than": f"US$ 24,000, AP (R1000) 80.0 of {of}",
        "Without labels of the site": f"AP (R1000) 80.0 [80.0, 80.0] of {of}",
    }.items():
        named = cards[cards.index(card) + len(card) :][:160]
        assert "RoboSense Ruby Plus" in named.split("Livox")[0], card
        assert words in named, card


@pytest.mark.nightly
def test_boxes_off_the_region_are_in_the_table_of_experiments(tmp_path: Path) -> None:
    rows = report_data.experiments()
    for name, table in (("old", rows), ("new", rows.assign(off_region_per_min=12.34))):
        page = Read(report(report_data.write(tmp_path / name, {"quick.csv": table})))
        assert ("Outside region, per min" in page.text) == (name == "new")
        assert ("12.3" in page.text) == (name == "new")


def test_captions_say_that_captured_vehicles_do_not_compare_positions(whole: Path) -> None:
    text = Read(whole).text
    for figure in ("AP along the road, preset paper: ", "Areas by quality, preset paper: "):
        caption = text[text.index(f"{figure}vehicles on which the LiDAR has") :][:240]
        assert "must not be used to compare positions of a sensor" in caption


def test_a_failed_experiment_is_named_with_its_reason(whole: Path) -> None:
    assert "One experiment has no AP." in Read(whole).text
    assert "MemoryError: none <left> & gone" in Read(whole).text


def test_every_origin_is_a_row_of_a_file_beside_the_page(whole: Path) -> None:
    matches = [re.match(r"([\w.]+\.csv), row (\d+)", origin) for origin in Read(whole).origins]
    rows = {(match[1], int(match[2])) for match in matches if match}
    assert len(rows) > 20
    for name in {name for name, _ in rows}:
        written = pd.read_csv(whole.parent / "report_data" / name)
        assert all(row <= len(written) for file, row in rows if file == name)


def test_the_ap_of_an_experiment_is_that_of_the_row_it_names(whole: Path) -> None:
    html = whole.read_text()
    experiments = re.findall(
        r'data-sort="([\d.]+)" title="quick.csv, row (\d+)">([\d.]+)<small>', html
    )
    written = pd.read_csv(whole.parent / "report_data/quick.csv")
    assert len(experiments) >= 6
    for sort, row, shown in experiments:
        assert written.ap[int(row) - 1] == float(sort)
        assert shown == f"{float(sort):.1f}"


def test_links_lead_somewhere_and_ids_are_unique(whole: Path) -> None:
    page = Read(whole)
    assert len(page.ids) == len(set(page.ids))
    for link in page.links:
        if link.startswith("#"):
            assert link[1:] in page.ids
        else:
            assert (whole.parent / link).is_file()


def test_every_figure_has_an_accessible_name(whole: Path) -> None:
    page = Read(whole)
    assert "svg" in page.tags
    assert page.unnamed == []


def test_nothing_that_is_missing_is_shown_as_nan(whole: Path) -> None:
    assert not re.search(r"\bnan\b|\bNone\b", Read(whole).text)


@pytest.mark.nightly
def test_the_same_results_give_the_same_bytes(whole: Path) -> None:
    before = whole.read_bytes()
    assert report(whole.parent / "results").read_bytes() == before


@pytest.mark.parametrize("name", report_data.tables())
def test_one_table_alone_makes_a_page(name: str, tmp_path: Path) -> None:
    results = report_data.write(tmp_path / "results", {name: report_data.tables()[name]})
    page = Read(report(results))
    assert "Methods and provenance" in page.text
    assert not re.search(r"\bnan\b", page.text)


def test_tables_without_rows_are_not_there(tmp_path: Path) -> None:
    tables = {name: table.iloc[:0] for name, table in report_data.tables().items()}
    tables["lidars.csv"] = report_data.lidars()
    page = Read(report(report_data.write(tmp_path / "results", tables)))
    assert {"value", "methods"} <= set(page.ids)
    assert "answer" not in page.ids


@pytest.mark.usefixtures("undrawn")
def test_one_detector_only(tmp_path: Path) -> None:
    experiments = report_data.experiments()
    results = report_data.write(
        tmp_path / "results", {"quick.csv": experiments[experiments.detector == "background"]}
    )
    text = Read(report(results)).text
    assert "with Background, Livox Avia has the highest AP" in text
    assert "Livox Avia with Background" not in text  # the sentence names it once


def test_experiments_that_all_failed_have_no_answer(tmp_path: Path) -> None:
    experiments = report_data.experiments().tail(1)
    text = Read(report(report_data.write(tmp_path / "results", {"quick.csv": experiments}))).text
    assert "0 of 1 experiments have an AP" in text
    assert "Highest AP of the vehicles it captures" not in text


def test_a_name_is_text_and_never_markup(tmp_path: Path) -> None:
    tables = {
        name: table.replace({"livox_avia": HOSTILE, "highway": HOSTILE, "pointpillars": HOSTILE})
        for name, table in report_data.tables().items()
    }
    page = Read(report(report_data.write(tmp_path / "results", tables)))
    assert "img" not in page.tags
    assert " ".join(HOSTILE.split()) in page.text
    assert len(page.ids) == len(set(page.ids))


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("stress.csv", "detector\na\n", "stress.csv:1: expected the columns detector, run, "),
        (
            "quick_hits.csv",
            "scene,lidar,preset,frames,hits_per_frame\nh,a,paper,1,2\nh,a,paper,1,many\n",
            "quick_hits.csv:3: hits_per_frame: expected a number or an empty cell, got 'many'",
        ),
        ("lidars.csv", 'lidar\n"open\n', "lidars.csv: cannot be read as a table"),
    ],
)
def test_a_wrong_table_is_reported_in_one_line(
    file: str, text: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / file).write_text(text)
    out = tmp_path / "report.html"
    assert main.main(["report", str(tmp_path), "--out", str(out)]) == 2
    message = capsys.readouterr().err
    assert expected in message
    assert message.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        ([], 2, "expected tables of `pyinfra benchmark`, got none"),
        (["--tier", "full"], 2, "full.csv: expected one or more finished experiments, got none"),
        (["--data", "nowhere"], 1, "nowhere: No such file or directory"),
        (["--runs", "nowhere"], 1, "nowhere: No such file or directory"),
    ],
)
def test_wrong_arguments_are_reported(
    words: list[str], code: int, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if words and words[0] != "--tier":
        report_data.write(tmp_path)
    out = tmp_path / "report.html"
    assert main.main(["report", str(tmp_path), *words, "--out", str(out)]) == code
    assert expected in capsys.readouterr().err
    assert not out.exists()


def test_the_tier_with_the_most_finished_experiments_is_chosen(tmp_path: Path) -> None:
    experiments = report_data.experiments()
    tables = {
        "full.csv": experiments.head(1),
        "quick.csv": experiments,
        "smoke.csv": experiments.head(2),
    }
    report_data.write(tmp_path, tables)
    assert read_results(tmp_path).tier == "quick"
    assert read_results(tmp_path, "full").tier == "full"


def test_the_lowest_seed_stands_for_an_experiment(tmp_path: Path) -> None:
    experiments = report_data.experiments().head(1)
    report_data.write(
        tmp_path,
        {"quick.csv": pd.concat([experiments.assign(seed=10), experiments.assign(seed=2)])},
    )
    assert list(read_results(tmp_path).done().seed) == ["2"]


def test_pareto_keeps_what_no_other_beats() -> None:
    rows = pd.DataFrame(
        {"cost": [1.0, 2.0, 2.0, 3.0, None, 1.0], "ap_r1000": [50.0, 60.0, 55.0, 60.0, 99.0, 50.0]}
    )
    assert list(pareto(rows, "cost")) == [True, True, False, False, False, True]


def test_curves_of_stress_start_without_it(tmp_path: Path) -> None:
    report_data.write(tmp_path, {"stress.csv": report_data.stress()})
    table = read_results(tmp_path).table("stress")

    def points(stressor: str) -> list[tuple[float, float]]:
        rows = curve(table, stressor)
        return list(zip(rows["at"], rows.ap, strict=True))

    assert points("rain") == [(0, 90), (50, 80), (100, 60)]
    assert points("density") == [(1, 90), (2, 85)]
    assert points("unseen_scene") == [(0, 90), (1, 40)]
    assert points("training_frames") == [(200, 70), (800, 90)]


def test_the_function_takes_the_module_of_the_sections_and_checks_the_tier(tmp_path: Path) -> None:
    report_data.write(tmp_path)
    page = pi.report(tmp_path, tmp_path / "r.html", sections="pyinfra.viz.report.contents")
    assert page.is_file()
    with pytest.raises(pi.Error, match="tier: "):
        pi.report(tmp_path, page, tier="large")  # type: ignore[arg-type]


def test_a_legend_draws_lines_without_markers_and_markers_without_lines() -> None:
    assert svg.line_swatch("#000000", "-", "").count("<path") == 1
    assert svg.line_swatch("#000000", "none", "s").count("<path") == 1
    assert 'd="z"' not in svg.line_swatch("#000000", "--", "")


def test_a_lidar_looks_the_same_in_every_report() -> None:
    one, many = read_names(["ruby_plus"], {}), read_names(["a_new_one", "ruby_plus", "zz"], {})
    assert one.look("ruby_plus") == many.look("ruby_plus")
    assert many.model("ruby_plus") == "RoboSense Ruby Plus"
    assert many.model("a_new_one") == "a_new_one"


def custom_site(folder: Path) -> Path:
    """Writes the tables of a benchmark of a site that is not in the paper."""
    names = ("quick.csv", "quick_areas.csv", "quick_distance.csv", "quick_hits.csv")
    more = ("quick_value.csv", "lidars.csv")
    tables = {name: report_data.tables()[name].replace("highway", "bridge") for name in names}
    tables |= {name: report_data.tables()[name].replace("highway", "bridge") for name in more}
    return report_data.write(folder, tables)


@pytest.mark.usefixtures("undrawn")
def test_the_report_of_an_own_site_opens_with_what_is_recommended(tmp_path: Path) -> None:
    text = Read(report(custom_site(tmp_path / "results"))).text
    answer = text[text.index("Bridge, preset paper, any price, AP of at least 85 for the") :]
    nearest = "no option meets the requirements. The nearest is RoboSense Ruby Plus"
    assert answer.index(nearest) < 170
    assert "It meets the requirements with a minimum AP of 46.2" in answer
    assert "Prices include LiDARs only, without computer, pole, installation, energy" in answer
    assert "Highest AP of the vehicles it captures" not in text


@pytest.mark.usefixtures("undrawn")
def test_the_report_of_an_own_site_takes_the_limits_of_recommend(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = custom_site(tmp_path / "results")
    text = Read(report(results, "--budget", 3000, "--min-ap", 40)).text
    asked = "at most 3,000 USD, AP of at least 40 for the vehicles in the whole region, at most"
    assert asked in text
    assert (
        "Livox Avia with PointPillars. AP (R1000) of all visible vehicles 45.6 (no interval), "
        "2,079 USD." in text
    )
    assert "Left out: RoboSense Ruby Plus with PointPillars: costs 24,000 USD." in text
    assert (
        main.main(["report", str(results), "--min-ap", "0.85", "--out", str(tmp_path / "a.html")])
        == 2
    )
    assert "--min-ap: expected above 1 and at most 100, got 0.85" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
@pytest.mark.nightly
def test_a_shipped_scene_is_answered_by_the_limits_that_are_asked(tmp_path: Path) -> None:
    results = report_data.write(tmp_path / "results", report_data.tables())
    text = Read(report(results, "--budget", 3000, "--min-ap", 40)).text
    assert "Highway, preset paper, at most 3,000 USD, AP of at least 40 for the vehicles" in text
    assert "Left out: RoboSense Ruby Plus with PointPillars: costs 24,000 USD." in text
    assert "Highest AP of the vehicles it captures" not in text
    assert "Highest AP of the vehicles it captures" in Read(report(results)).text


@pytest.mark.usefixtures("undrawn")
def test_what_is_slower_than_its_lidar_is_reported_as_such(tmp_path: Path) -> None:
    experiments = report_data.experiments().assign(latency_p50_ms=544.0)
    text = Read(report(report_data.write(tmp_path / "results", {"quick.csv": experiments}))).text
    assert "544 ms a frame, more than the 100 ms of a frame, AP (R1000)" in text


@pytest.mark.usefixtures("undrawn")
def test_other_presets_are_under_a_section_of_that_name(tmp_path: Path) -> None:
    tables = {
        name: pd.concat([table, table.assign(preset="datasheet")])
        for name, table in report_data.tables().items()
        if name in ("quick.csv", "quick_value.csv")
    }
    file = report(report_data.write(tmp_path / "results", tables))
    (title,) = re.findall(r'other presets of section "([^"]+)"', Read(file).text)
    titles = re.findall(r"<h2 id=[^>]*>([^<]+)</h2>", file.read_text())
    assert title in titles


@pytest.mark.usefixtures("undrawn")
def test_the_open_chart_of_prices_is_of_the_preset_of_its_text(tmp_path: Path) -> None:
    value = report_data.value()
    tables = {"quick_value.csv": pd.concat([value, value.assign(preset="datasheet")])}
    html = report(report_data.write(tmp_path / "results", tables)).read_text()
    section = html[html.index('<section id="value"') :]
    assert "highway (datasheet)" in section[: section.index("<figure")]
    figures = re.findall(r'(<details>.*?)?<figure id="figure-price-(\w+)"', section)
    assert [(bool(folded), preset) for folded, preset in figures] == [
        (False, "datasheet"),
        (True, "paper"),
    ]


def test_a_module_of_sections_takes_the_place_of_the_usual(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own_sections.py").write_text(
        "from pyinfra.experiments.result_tables import kind\n"
        "from pyinfra.viz.report.blocks import Section, Text\n"
        "def mine(material):\n"
        "    rows = material.results.table('mine')\n"
        "    return Section('mine', 'My section', f'{len(rows)} row', [Text('Mine.')])\n"
        "SECTIONS = [mine]\n"
        "TABLES = {'mine': kind('mine.csv', 'name', 'x')}\n"
    )
    (tmp_path / "no_sections.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    tables = report_data.tables() | {"mine.csv": pd.DataFrame([{"name": "a", "x": 1}])}
    results = report_data.write(tmp_path / "results", tables)
    page = Read(report(results, "--sections", "own_sections"))
    assert page.ids == ["mine", "mine-title"]
    assert "1 row Mine." in page.text
    assert (tmp_path / "report_data/mine.csv").is_file()
    for wrong in ("no_sections", "nowhere", "nowhere.at_all"):
        assert (
            main.main(
                ["report", str(results), "--sections", wrong, "--out", str(tmp_path / "a.html")]
            )
            == 2
        )
        assert f"got '{wrong}'" in capsys.readouterr().err


def test_every_reference_in_a_figure_leads_to_an_id_of_this_figure() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 2], [2, 1], marker="o", color="#ff7f0e")
    axes.fill_between([1, 2], [0, 1], hatch="//", color="#123456")
    markup = svg.inline(figure, "name", "a <label>")
    root = ElementTree.fromstring(markup)
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    referred = re.findall(r'(?:url\(#|href="#)([^)"]+)', markup)
    assert referred
    assert set(referred) == set(ids)
    assert root.get("aria-label") == "a <label>"
    assert "#ff7f0e" in markup
    assert "#123456" in markup


@pytest.mark.parametrize("top", [1.0, 1e7])
def test_labels_are_not_cut_beside_wide_ticks(top: float) -> None:
    with drawing():
        figure, ax = panel()
        ax.plot([0, 1], [0, top])
        ax.set_yticks([0, top], ["0", f"{top:,.4f}"])
        ax.set_xticks([0, 1], ["first", "the second of the ticks"])
        ax.set(xlim=(0, 1), xlabel="x (m)", ylabel="points per vehicle")
        svg.inline(figure, "wide", "wide ticks")
        drawn, size = figure.get_tightbbox(), figure.get_size_inches()
    assert min(drawn.x0, drawn.y0) >= 0
    assert drawn.x1 <= size[0]
    assert drawn.y1 <= size[1]


@pytest.mark.usefixtures("undrawn")
def test_columns_without_a_value_are_left_out(tmp_path: Path) -> None:
    """The artificial results have no US$ per metre of road."""
    text = Read(report(report_data.write(tmp_path / "results"))).text
    assert "US$ per high-quality area" in text
    assert "US$ per metre of road" not in text


def test_charts_of_ap_start_at_zero(whole: Path) -> None:
    """The axis of AP in the charts of price and latency has the labels 0 and 100."""
    page = whole.read_text()
    for name in ("figure-price-paper", "figure-latency-paper"):
        (drawn,) = re.findall(rf'id="{name}".*?</figure>', page, re.DOTALL)
        labels = set(re.findall(r"<text[^>]*>([^<]*)</text>", drawn))
        assert {"0", "100"} <= labels


def several_scenes(folder: Path) -> Path:
    """Writes results of two scenes; in `curve`, only Livox Avia with PointPillars has a high AP."""
    low = {"ap": 60.0, "ap_all": 30.0, "ap_common": 60.0}
    tables = {}
    for name, table in report_data.tables().items():
        if "scene" not in table:
            tables[name] = table
            continue
        curve = table.assign(scene="curve")
        if name == "quick.csv":
            others = (curve.lidar != "livox_avia") & curve.ap.notna()
            curve.loc[others, list(low)] = list(low.values())
            curve = with_r1000(curve)
        tables[name] = pd.concat([table, curve])
    return report_data.write(folder, tables)


def test_prices_that_differ_between_scenes_are_a_range(tmp_path: Path) -> None:
    """Two LiDARs stand at the curve, and the site costs more there."""
    results = several_scenes(tmp_path / "results")
    file = results / "quick_value.csv"
    table = pd.read_csv(file)
    at_curve = table.scene == "curve"
    table.assign(
        price_usd=table.price_usd.where(~at_curve, 2 * table.price_usd + 3000),
        site_usd=3000.0 * at_curve,
        pole_usd=3000.0 * at_curve,
        mounts=1 + at_curve,
    ).to_csv(file, index=False)
    asked = Requirements(min_ap=40)
    material = read_material(results, [], [], "quick", asked)
    answers = recommendation.answers(material, ["highway", "curve"])
    assert "in all 2 scenes, for 2,079 to 7,158 USD." in recommendation.overall(material, answers)
    lead = value._lead(material, value._value(material))
    assert "plus an assumed US$ 0 to 3,000 for the site" in lead


def test_each_detector_of_the_package_is_described() -> None:
    for file in (configs() / "detectors").glob("*.yaml"):
        assert file.stem in methods.KINDS


def test_the_pretrained_detector_needs_no_labels_of_the_site() -> None:
    rows = pd.DataFrame(
        {
            "detector": ["pv-rcnn", "generalist-as-is", "background"],
            "lidar": "a",
            "scene": "b",
            "origin": "",
            "whole": "present",
            "latency_p50_ms": 80.0,
            "ap_whole": [90.0, 70.0, 40.0],
        }
    )
    for end in ("", "_low", "_high"):
        rows[f"ap_whole_r1000{end}"] = rows.ap_whole
    results = SimpleNamespace(table=lambda _: rows)
    material = SimpleNamespace(names=read_names(["a"], {}), results=results)
    line = answer_section._untrained(material, rows)
    assert line is not None
    assert line.choice.endswith("with the pretrained detector")


def test_a_scene_keeps_the_capitals_of_its_name() -> None:
    assert capitalized("A8_Nord") == "A8_Nord"
    assert capitalized("junction") == "Junction"


@pytest.mark.usefixtures("undrawn")
def test_results_of_several_scenes_begin_with_one_overall_answer(tmp_path: Path) -> None:
    report_page = report(several_scenes(tmp_path / "results"))
    text = Read(report_page).text
    overall = text.index("Over all 2 scenes, Livox Avia with PointPillars has the highest mean AP")
    first = text.index("On the highway, preset paper, RoboSense Ruby Plus with PointPillars")
    second = text.index("On the curve, preset paper, Livox Avia with PointPillars")
    assert overall < first < second < text.index("Highest AP of the vehicles it captures")
    labels = re.findall(r'aria-label="(Plan of \w+)', report_page.read_text())
    assert labels == ["Plan of highway", "Plan of curve"]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("least", "answer"),
    [
        (40, "Livox Avia with PointPillars meets this in all 2 scenes, for 2,079 USD."),
        pytest.param(46, "No option meets this in all 2 scenes.", marks=pytest.mark.nightly),
        (90, "No option meets this in any of the 2 scenes."),
    ],
)
def test_the_overall_answer_names_an_option_that_meets_the_requirements_in_all_scenes(
    tmp_path: Path, least: float, answer: str
) -> None:
    text = Read(report(several_scenes(tmp_path / "results"), "--min-ap", least)).text
    assert answer in text
    assert text.index(answer) < text.index("Highway, preset paper:")
    assert text.count("any price, AP of at least") == 1
