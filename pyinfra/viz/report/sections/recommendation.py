"""The answer of `pyinfra recommend` for the scenes of a user."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import pandas as pd

from pyinfra.experiments.coverage import ROAD
from pyinfra.experiments.option import Option
from pyinfra.experiments.option_table import option_table
from pyinfra.experiments.options import options_of
from pyinfra.experiments.recommend import Answer, recommend, with_interval
from pyinfra.experiments.requirements import Requirements, place_of
from pyinfra.metrics.comparison import Interval
from pyinfra.metrics.row_selection import AP_R1000, COUNTED
from pyinfra.viz.report.blocks import Block, Column, Remarks, Table, TableCell, number, span
from pyinfra.viz.report.names import capitalized, with_detector
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.value import spelled

NEEDED = ("experiments", "value", "distance")


def can_answer(material: Material) -> bool:
    """Returns whether the tables that an answer needs have rows."""
    return all(len(material.results.table(name)) > 0 for name in NEEDED)


@dataclass(frozen=True)
class SceneAnswer:
    """The options of a scene, and the answer."""

    options: Sequence[Option]
    answer: Answer

    @property
    def scene(self) -> str:
        return self.options[0].scene


def answers(material: Material, scenes: Sequence[str]) -> list[SceneAnswer]:
    """Returns the answer for each scene."""
    every = [options_of(material.results, scene, "", material.requirements) for scene in scenes]
    return [SceneAnswer(some, recommend(some, material.requirements)) for some in every]


def blocks(material: Material, one: SceneAnswer, *, alone: bool) -> list[Block]:
    """Returns the options of a scene as a table, and remarks on them, which are open if `alone`."""
    remarks = [spelled(material, remark) for remark in one.answer.remarks]
    table = [_table(material, one)] if one.answer.named else []
    return [*table, Remarks(f"Remarks on the options: {one.scene}", remarks, not alone)]


def overall(material: Material, answers: Sequence[SceneAnswer]) -> str:
    """Returns in words which option meets the requirements in all scenes, or in most of them."""
    tables = [option_table(one.options, material.requirements) for one in answers]
    rows = pd.concat(tables)
    rows = rows[rows.meets]
    required = f"Required: {_asked(material.requirements, answers)}."
    if rows.empty:
        return f"{required} No option meets this in any of the {len(answers)} scenes."
    groups = rows.groupby(["lidar", "detector"])
    order = groups.agg(scenes=("scene", "nunique"), ap=("ap_r1000", "mean"))
    lidar, detector_name = order.sort_values(["scenes", "ap"], ascending=False).index[0]
    best = rows[(rows.lidar == lidar) & (rows.detector == detector_name)]
    name = f"{material.names.model(lidar)} {with_detector(detector_name)}"
    least, most = (f"{usd:,.0f}" for usd in (best.price_usd.min(), best.price_usd.max()))
    price = f"{least} USD" if least == most else f"{least} to {most} USD"
    if len(best) == len(answers):
        return f"{required} {name} meets this in all {len(answers)} scenes, for {price}."
    where = ", ".join(best.scene)
    return (
        f"{required} No option meets this in all {len(answers)} scenes. {name} ({price}) meets it "
        f"in {len(best)} of them: {where}."
    )


def sentence(material: Material, one: SceneAnswer, *, alone: bool) -> str:
    """Returns the answer for a scene. alone: whether to repeat the requirements in it."""
    answer, any_one = one.answer, one.options[0]
    required = f", {_asked(material.requirements, [one])}" if alone else ""
    text = f"{capitalized(any_one.scene)}, preset {any_one.preset}{required}: "
    if not answer.named:
        return f"{text}no option meets the requirements."
    first = answer.named[0]
    name = _name(material, first)
    result = (
        f"{AP_R1000} of {COUNTED[first.whole]} {with_interval(first.ap_whole)}, "
        f"{first.price_usd:,.0f} USD"
    )
    if answer.meets:
        return f"{text}{name}. {result}."
    return (
        f"{text}no option meets the requirements. The nearest is {name}: {result}. It meets the "
        f"requirements with {answer.relax[0]}."
    )


def _asked(requirements: Requirements, answers: Sequence[SceneAnswer]) -> str:
    money = (
        f"at most {requirements.budget_usd:,.0f} USD"
        if math.isfinite(requirements.budget_usd)
        else "any price"
    )
    place = place_of(requirements.range_m)
    ap = f"AP of at least {requirements.min_ap:g} for the vehicles {place}"
    limits = requirements.limits_text(option.frame_ms for one in answers for option in one.options)
    return f"{money}, {ap}, at most {limits} per frame"


def _table(material: Material, one: SceneAnswer) -> Table:
    answer = one.answer
    road = answer.named[0].covered_in == ROAD
    covered = "Road covered, m" if road else f"Covered, {answer.named[0].covered_in}"
    titles = (f"{AP_R1000}, whole road", AP_R1000, "Price, US$", covered, "Median, ms")
    heads = [Column("LiDAR and detector"), *(Column(title, number=True) for title in titles)]
    heads += [] if answer.meets else [Column("To relax")]
    pairs = zip(answer.named, answer.relax, strict=True)
    rows = [_row(material, option, relax) for option, relax in pairs]
    caption = (
        f"{capitalized(one.scene)}: options of pyinfra recommend, in order of {AP_R1000} of "
        f"{COUNTED[answer.named[0].whole]} (whole road). The other {AP_R1000} is of the vehicles "
        "that the LiDAR captures. Road is covered where the AP of the whole road is above the "
        "required AP."
    )
    if not answer.meets:
        caption += " These are the nearest options, with the requirement to relax for each."
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
    return [*cells, TableCell(relax)] if relax else cells


def _covered(option: Option) -> TableCell:
    if math.isnan(option.road_m):
        return TableCell("")  # earlier versions have no road length for a site of lanes
    cell = _cell(option.covered_m, ".0f", f" of {option.road_m:.0f}")
    reason = f"no interval: {option.no_interval}"
    return cell if option.covered_m.is_known else replace(cell, below=reason)


def _cell(figure: Interval, form: str, more: str = "") -> TableCell:
    text = f"{figure.value:{form}}{more}"
    return TableCell(text, figure.value, below=span(figure.low, figure.high, form))


def _name(material: Material, option: Option) -> str:
    return f"{material.names.model(option.lidar)} {with_detector(option.detector)}"
