"""The section on price against performance."""

import math
import re
from typing import Any

import pandas as pd

from pyinfra.experiments.value import mounts_of
from pyinfra.metrics.row_selection import AP_R1000, first_seed
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Column,
    Columns,
    Figure,
    Panel,
    Section,
    Table,
    TableCell,
    number,
    number_in,
    table_of,
)
from pyinfra.viz.report.names import DETECTORS, option_columns, ordered
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend
from pyinfra.viz.report.style import FAINT, GROUND, drawing, log_ticks, panel

HEADS = {
    "price_usd": ("Price, US$", ",.0f"),
    "ap_per_1000_usd": ("AP per US$ 1,000", ".2f"),
    "usd_per_hq_area": ("US$ per high-quality area", ",.0f"),
    "usd_per_m_road": ("US$ per metre of road", ",.1f"),
    "points_per_1000_usd": ("Vehicle points per US$ 1,000", ",.0f"),
}


def section(material: Material) -> Section | None:
    """Returns the Pareto front of AP against price, value for money, and the LiDARs' prices."""
    prices = material.results.table("lidars")
    value = _value(material)
    blocks: list[Block] = []
    if len(value) > 0:
        blocks += _fronts(material, value)
        blocks.append(_table(material, value))
    if len(prices) > 0:
        blocks.append(_prices(material, prices))
    if not blocks:
        return None
    return Section("value", "Price", _lead(material, value), blocks)


def _value(material: Material) -> pd.DataFrame:
    value = first_seed(material.results.table("value"))
    whole = value.ap_whole_r1000.fillna(value.ap_all_r1000)  # results of version 0.3 lack this AP
    return value.assign(ap_whole_r1000=whole)


def _lead(material: Material, value: pd.DataFrame) -> str:
    text = (
        "Prices are those of the LiDARs only, from the listed sources, without pole, computer and "
        "power."
    )
    if value.site_usd.max() > 0:
        least, most = (f"{usd:,.0f}" for usd in (value.site_usd.min(), value.site_usd.max()))
        site = f"US$ {least}" if least == most else f"US$ {least} to {most}"
        text = (
            f"Prices are those of the LiDARs, from the listed sources, plus an assumed {site} for "
            "the site."
        )
    if mounts_of(value).max() > 1:
        text += " For a scene with several mounts, the price is the sum over all mounts."
    if value.empty:
        return text
    best = material.of_answers(value)
    parts = []
    for scene in ordered(best.scene):
        rows = best[(best.scene == scene) & _on_front(best)]
        names = [material.names.model(x) for x in material.names.sorted(rows.lidar)]
        parts += [f"{scene} ({rows.preset.iloc[0]}): {', '.join(names)}"] if names else []
    claim = "On the Pareto front of price and AP of the whole road"
    return f"{text} {claim}: {'; '.join(parts)}." if parts else text


def _on_front(value: pd.DataFrame) -> pd.Series:
    return value.pareto.str.lower().isin(("true", "1", "yes"))


def _fronts(material: Material, value: pd.DataFrame) -> list[Figure]:
    """Returns a figure per preset. Presets that the text uses come first and are open."""
    of_text = set(material.of_answers(value).preset)
    presets = ordered(value.preset)
    presets.sort(key=lambda preset: preset not in of_text)
    figures = [(_front(material, value, preset), preset in of_text) for preset in presets]
    return [Figure(**vars(figure) | {"closed": not is_open}) for figure, is_open in figures]


def _front(material: Material, value: pd.DataFrame, preset: str) -> Figure:
    rows = value[value.preset == preset]
    panels = [_panel(material, rows[rows.scene == s]) for s in ordered(rows.scene)]
    return Figure(
        f"figure-price-{preset}",
        f"{AP_R1000} of the vehicles of the whole road against price, preset {preset}, with "
        "a mark for each detector. The line is the Pareto front. Options that are not on the "
        "front have hollow marks.",
        panels,
        material.results.source("value"),
        legend(material.names, material.names.sorted(rows.lidar)),
    )


def _panel(material: Material, rows: pd.DataFrame) -> Panel:
    first = rows.iloc[0]
    with drawing():
        figure, ax = panel()
        front = rows[_on_front(rows)].sort_values(["price_usd", "ap_whole_r1000"])
        ax.step(front.price_usd, front.ap_whole_r1000, where="post", color=FAINT, linewidth=0.9)
        for row in rows.assign(front=_on_front(rows)).itertuples():
            look = material.names.look(str(row.lidar))
            face = look.colour if row.front else GROUND
            style: dict[str, Any] = {"color": look.colour, "markerfacecolor": face}
            ax.plot(row.price_usd, row.ap_whole_r1000, marker=look.marker, markersize=5, **style)
        ax.set(xscale="log", xlabel="price (US$)", ylim=(0, 102))
        ax.set_ylabel(f"{AP_R1000}, whole road")
        log_ticks(ax.xaxis)
        title = str(first.scene)
        label = f"AP against price with the Pareto front, {title}, preset {first.preset}"
        return Panel(title, svg.inline(figure, svg.identifier("price", title, first.preset), label))


def _table(material: Material, value: pd.DataFrame) -> Table:
    caption = (
        "Performance per dollar. An option that is not on the Pareto front is dominated by the "
        "option in the last column."
    )
    columns: Columns = {
        **option_columns(material.names),
        AP_R1000: lambda row: number(row.ap_r1000),
        f"{AP_R1000}, whole road": lambda row: number(row.ap_whole_r1000),
        **{title: number_in(column, form) for column, (title, form) in HEADS.items()},
        "Dominated by": lambda row: spelled(material, str(row.dominated_by)),
    }
    source = material.results.source("value")
    return table_of(caption, value, columns, source, closed=len(value) > 16)


def spelled(material: Material, text: str) -> str:
    """Replaces the names of LiDARs and detectors in a text by their display names."""
    for name, shown in DETECTORS.items():
        text = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", shown, text)
    return material.names.spelled(text)


def _prices(material: Material, prices: pd.DataFrame) -> Table:
    """Returns a table of the LiDARs with prices and specifications from their files."""
    known = ("lidar", "model", "units", "origin")
    more = [
        c
        for c in prices
        if c not in known and not c.startswith("price_") and prices[c].notna().any()
    ]
    numbers = prices[more].apply(pd.to_numeric, errors="coerce")
    heads = [Column("LiDAR"), Column("Units", number=True), Column("Price, US$", number=True)]
    heads += [Column(_title(c), number=bool(numbers[c].notna().any())) for c in more]
    rows = []
    for at, row in prices.iterrows():
        low, high = float(row.price_low_usd), float(row.price_high_usd)
        price = f"{low:,.0f}" if low == high else f"{low:,.0f} to {high:,.0f}"
        first = [TableCell(material.names.label(row.lidar)), number(row.units, ".0f")]
        others = [
            TableCell("" if pd.isna(row[c]) else str(row[c]))
            if math.isnan(value := float(numbers[c][at]))
            else TableCell(f"{value:.4g}", value, row.origin)
            for c in more
        ]
        source = TableCell(f"{row.price_source}, {row.price_date}".strip(", "))
        rows.append([*first, TableCell(price, low, row.origin), *others, source])
    heads.append(Column("Source of the price"))
    return Table("The LiDARs.", heads, rows, material.results.source("lidars"))


def _title(column: str) -> str:
    """Returns a column's title, such as Horizontal field of view, ° for horizontal_fov_deg."""
    for unit, shown in (("_deg", ", °"), ("_m", ", m")):
        if column.endswith(unit):
            column = column.removesuffix(unit) + shown
    return column.replace("_", " ").replace("fov", "field of view").capitalize()
