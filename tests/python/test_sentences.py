"""The answers of the pages of results follow from their tables."""

import re

import pandas as pd
import pytest

from pyinfra.core.errors import Error
from pyinfra.metrics.comparison import Interval
from reproduction import ROOT
from reproduction.commands import tables
from reproduction.tables import common, sentences, sentences_of_models

PAGES = {page.stem: page for page in (ROOT / "docs/results").glob("*.md")}
# Pages whose first paragraph has no result, or results that no table has.
WITHOUT = {"index", "measured", "plans", "sites", "speed"}
BLOCKS = re.compile(r"<!-- text (.+?) -->\n.*?<!-- end -->\n", re.DOTALL)


@pytest.mark.parametrize("page", sorted(PAGES.keys() - WITHOUT))
def test_the_answer_of_a_page_is_written_from_its_table(page: str) -> None:
    first = PAGES[page].read_text("utf-8").split("\n\n", 2)[1]
    assert first.startswith("<!-- text "), f"{page}: the answer is not in TEXTS"


def test_each_text_is_in_a_page() -> None:
    used = [name for page in tables.PAGES for name in BLOCKS.findall(page.read_text("utf-8"))]
    assert sorted(used) == sorted(tables.TEXTS)


@pytest.mark.parametrize("name", tables.TEXTS)
def test_a_text_has_whole_sentences_without_unknown_values(name: str) -> None:
    text = tables.TEXTS[name]()
    assert text.endswith(".")
    assert not re.search(r"\bnan\b|\binf\b|\bNone\b|  |{", text)


def claim_rows(**verdicts: str) -> pd.DataFrame:
    """Returns rows of a claim: names are scene_preset, values the verdict."""
    rows = [
        {"scene": name.split("_")[0], "preset": name.split("_")[1], "verdict": verdict}
        for name, verdict in verdicts.items()
    ]
    common = {"claim": "gentle", "training": "fine-tuned", "subset": "captured", "value": 1.0}
    common |= {"label_time": "scan", "law_exponent": 0.25, "low": 0.0, "high": 2.0}
    both = pd.DataFrame(rows).assign(training="both", verdict="one detector only")
    return pd.concat([pd.DataFrame(rows).assign(training="fine-tuned"), both]).assign(
        **{k: v for k, v in common.items() if k != "training"}
    )


def test_a_sentence_names_the_cases_of_each_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = claim_rows(highway_paper="holds", curve_paper="holds", curve_datasheet="not known")
    monkeypatch.setattr(sentences, "results", lambda _: rows)
    text = sentences.by_verdict("gentle", {"holds": "It decreases less"})
    assert text.startswith(
        "It decreases less on the highway and on the curve with the settings of the study. "
        "The difference is not significant on the curve with the settings of the data sheets."
    )
    rows.loc[rows["training"] == "fine-tuned", "verdict"] = "fails above"
    with pytest.raises(Error, match=r"gentle: expected a sentence .*fails above"):
        sentences.by_verdict("gentle", {"holds": "It decreases less"})


def test_verdicts_of_both_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = claim_rows(highway_paper="holds", curve_paper="holds")
    both = (rows["training"] == "both") & (rows.scene == "curve")
    rows.loc[both, "verdict"] = "depends on the detector"
    monkeypatch.setattr(sentences, "results", lambda _: rows)
    assert sentences.of_both("gentle").endswith(
        "in one of two cases. The verdict of both detectors is `depends on the detector` on the "
        "curve with the settings of the study."
    )


def test_a_sentence_that_the_tables_contradict_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    table = common.results("placement_summary").copy()
    found = table.quantity.str.contains("vehicles found within 60 m") & (table.low < 0)
    table.loc[found, "low"] = 1.0
    monkeypatch.setattr(sentences_of_models, "results", lambda _: table)
    with pytest.raises(Error, match="the vehicles found do not differ significantly"):
        sentences_of_models.placement()


def test_spans_and_limits_are_rounded() -> None:
    assert sentences.span([1.6, 2.4, 3.4]) == "2 to 3"
    assert sentences.span([1.96, 2.04], 1) == "2.0"
    assert sentences.within([Interval(0.1, -1.21, 0.4), Interval(0, -1, 1)]) == "1.3"


def test_cases_in_a_sentence_with_not_are_joined_by_or() -> None:
    scenes = ("highway", "curve", "crossroad")
    keys = [*((scene, "paper") for scene in scenes), ("highway", "datasheet")]
    rows = pd.DataFrame(index=pd.MultiIndex.from_tuples(keys, names=["scene", "preset"]))
    assert sentences.where(rows, "or") == (
        "in any of the three scenes with the settings of the study, or on the highway with those "
        "of the data sheets"
    )
    assert sentences.where(rows[1:], "or").startswith("on the curve or at the crossroad with")
