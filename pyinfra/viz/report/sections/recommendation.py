"""The answer of `pyinfra recommend` for the scenes of a user."""

from __future__ import annotations

import math
from dataclasses import replace

from pyinfra.experiments.coverage import ROAD
from pyinfra.experiments.options import Option, options_of
from pyinfra.experiments.recommend import Answer, recommend, with_interval
from pyinfra.experiments.requirements import Requirements
from pyinfra.metrics.comparison import Interval
from pyinfra.metrics.row_selection import COUNTED
from pyinfra.viz.report.blocks import Block, Column, Table, TableCell, Text, number, span
from pyinfra.viz.report.names import detector
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.value import spelled

NEEDED = ("experiments", "value", "distance")


def can_answer(material: Material) -> bool:
    """Returns whether the tables that an answer needs have rows."""
    return all(len(material.results.table(name)) > 0 for name in NEEDED)


def answer_for(material: Material, scene: str) -> tuple[str, list[Block]]:
    """Returns the answer in a sentence, and blocks with the options and remarks on them."""
    options = options_of(material.results, scene, "", material.requirements)
    answer = recommend(options, material.requirements)
    lead = _lead(material, answer, options[0])
    blocks: list[Block] = [_table(material, answer)] if answer.named else []
    blocks += [Text(spelled(material, remark.replace("`", ""))) for remark in answer.remarks]
    return lead, blocks


def _lead(material: Material, answer: Answer, any_one: Option) -> str:
    text = (
        f"{any_one.scene.capitalize()}, preset {any_one.preset}, {_asked(material.requirements)}: "
    )
    if not answer.named:
        return f"{text}no option meets the requirements."
    first = answer.named[0]
    name = _name(material, first)
    result = (
        f"{first.ap_name} of {COUNTED[first.whole]} {with_interval(first.ap_whole)}, "
        f"{first.price_usd:,.0f} USD"
    )
    if answer.meets:
        return f"{text}{name}. {result}."
    relaxed = answer.relax[0].replace("`", "")
    return (
        f"{text}no option meets the requirements. The nearest is {name}: {result}. It meets the "
        f"requirements with {relaxed}."
    )


def _asked(requirements: Requirements) -> str:
    money = (
        f"at most {requirements.budget_usd:,.0f} USD"
        if math.isfinite(requirements.budget_usd)
        else "any price"
    )
    ap = f"AP of at least {requirements.min_ap:g} for the vehicles of the whole road"
    asked = f"{money}, {ap}, {requirements.range_m:g} m in each direction"
    return f"{asked}, at most {requirements.latency_ms:g} ms per frame"


def _table(material: Material, answer: Answer) -> Table:
    name = answer.named[0].ap_name
    road = answer.named[0].covered_in == ROAD
    covered = "Road covered, m" if road else f"Covered, {answer.named[0].covered_in}"
    titles = (f"{name}, whole road", name, "Price, US$", covered, "Median, ms")
    heads = [Column("LiDAR and detector"), *(Column(title, number=True) for title in titles)]
    heads += [] if answer.meets else [Column("To relax")]
    pairs = zip(answer.named, answer.relax, strict=True)
    rows = [_row(material, option, relax) for option, relax in pairs]
    caption = (
        f"Options of pyinfra recommend, in order of {name} of {COUNTED[answer.named[0].whole]} "
        f"(whole road). The other {name} is of the vehicles that the LiDAR captures. Road is "
        "covered where the AP of the whole road is above the required AP."
    )
    if not answer.meets:
        caption = f"The nearest options, and the requirement to relax for each. {caption}"
    return Table(caption, heads, rows, material.results.source("experiments"))


def _row(material: Material, option: Option, relax: str) -> list[TableCell]:
    prices = Interval(option.price_usd, option.price_low_usd, option.price_high_usd)
    cells = [
        TableCell(_name(material, option)),
        _cell(option.ap_whole, ".1f"),
        _cell(option.ap, ".1f"),
        _cell(prices, ",.0f") if prices.low < prices.high else number(prices.value, ",.0f"),
        _covered(option),
        number(option.latency_ms, ".0f"),
    ]
    return [*cells, TableCell(relax.replace("`", ""))] if relax else cells


def _covered(option: Option) -> TableCell:
    if math.isnan(option.road_m):
        return TableCell("")  # a site of lanes whose results come from an earlier version
    cell = _cell(option.covered_m, ".0f", f" of {option.road_m:.0f}")
    reason = f"no interval: {option.no_interval}"
    return cell if option.covered_m.is_known else replace(cell, below=reason)


def _cell(figure: Interval, form: str, more: str = "") -> TableCell:
    text = f"{figure.value:{form}}{more}"
    return TableCell(text, figure.value, below=span(figure.low, figure.high, form))


def _name(material: Material, option: Option) -> str:
    return f"{material.names.model(option.lidar)} with {detector(option.detector)}"
