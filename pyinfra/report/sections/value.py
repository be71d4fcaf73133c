"""Price against performance."""

from __future__ import annotations

from typing import Any

import pandas as pd

from pyinfra.report import svg
from pyinfra.report.blocks import Block, Cell, Column, Figure, Panel, Section, Table, number
from pyinfra.report.looks import FAINT, GROUND, drawing, log_ticks, panel
from pyinfra.report.material import SCENES, Material
from pyinfra.report.names import DETECTORS, PRESETS, detector, in_order
from pyinfra.report.sections.distance import legend

CELL = ["scene", "lidar", "preset", "detector", "tier", "seed"]
HEADS = {
    "price_usd": ("Price, US$", ",.0f"),
    "ap_per_1000_usd": ("AP per US$ 1,000", ".2f"),
    "usd_per_hq_area": ("US$ per high-quality area", ",.0f"),
    "usd_per_m_road": ("US$ per metre of road", ",.1f"),
    "points_per_1000_usd": ("Vehicle points per US$ 1,000", ",.0f"),
}


def section(material: Material) -> Section | None:
    """Prices of the LiDARs, the Pareto front of AP against price, and what a dollar buys."""
    prices = material.results.table("lidars")
    value = _value(material)
    blocks: list[Block] = []
    if len(value) > 0:
        blocks += [_front(material, value, p) for p in in_order(value.preset, PRESETS)]
        blocks = [Figure(**vars(f) | {"closed": i > 0}) for i, f in enumerate(blocks)]
        blocks.append(_table(material, value))
    if len(prices) > 0:
        blocks.append(_prices(material, prices))
    if not blocks:
        return None
    return Section("value", "Price", _lead(material, value), blocks)


def _value(material: Material) -> pd.DataFrame:
    """Rows of value of the lowest seed, with the AP and interval of their cells."""
    table = material.results.table("value")
    cells = material.results.done()[[*CELL, "ap", "ap_low", "ap_high"]]
    own = [c for c in table if c not in ("ap", "ap_low", "ap_high")]
    return table[own].merge(cells, on=CELL)


def _lead(material: Material, value: pd.DataFrame) -> str:
    text = "Prices are of LiDARs alone, as their sources state them: no pole, computer or power."
    if value.empty:
        return text
    preset = material.preset_of_answers()
    parts = []
    for scene in in_order(value.scene, SCENES):
        rows = value[(value.preset == preset) & (value.scene == scene) & _on_front(value)]
        names = [material.names.model(x) for x in material.names.sorted(rows.lidar)]
        parts += [f"{scene}: {', '.join(names)}"] if names else []
    found = f" On the Pareto front of AP and price (preset {preset}) are, {'; '.join(parts)}."
    return text + found if parts else text


def _on_front(value: pd.DataFrame) -> pd.Series:
    return value.pareto.str.lower().isin(("true", "1", "yes"))


def _front(material: Material, value: pd.DataFrame, preset: str) -> Figure:
    rows = value[value.preset == preset]
    panels = [_panel(material, rows[rows.scene == s]) for s in in_order(rows.scene, SCENES)]
    return Figure(
        f"figure-price-{preset}",
        f"AP against price, preset {preset}, with intervals; every detector is a mark. The line "
        "joins the choices that no other beats in both; what is beaten is hollow.",
        panels,
        material.results.source("value"),
        legend(material.names, material.names.sorted(rows.lidar)),
    )


def _panel(material: Material, rows: pd.DataFrame) -> Panel:
    first = rows.iloc[0]
    with drawing():
        figure, ax = panel()
        front = rows[_on_front(rows)].sort_values(["price_usd", "ap"])
        ax.step(front.price_usd, front.ap, where="post", color=FAINT, linewidth=0.9)
        for row in rows.assign(front=_on_front(rows)).itertuples():
            _mark(material, ax, row, float(row.price_usd), bool(row.front))
        ax.set(xscale="log", xlabel="price (US$)", ylabel="AP")
        log_ticks(ax.xaxis)
        title = str(first.scene)
        label = f"AP against price with the Pareto front, {title}, preset {first.preset}"
        return Panel(title, svg.inline(figure, svg.identifier("price", *first[CELL[:3]]), label))


def _mark(material: Material, ax: Any, row: Any, x: float, front: bool) -> None:
    """A cell at x with the interval of its AP; hollow if it is not on the front."""
    look = material.names.look(row.lidar)
    ends = [[max(row.ap - row.ap_low, 0)], [max(row.ap_high - row.ap, 0)]]
    ends = [[e if e == e else 0.0 for e in end] for end in ends]
    face = look.colour if front else GROUND
    style: dict[str, Any] = {"color": look.colour, "marker": look.marker, "markerfacecolor": face}
    ax.errorbar(x, row.ap, ends, markersize=5, elinewidth=0.7, **style)


def _table(material: Material, value: pd.DataFrame) -> Table:
    heads = [Column(c) for c in ("Scene", "LiDAR", "Preset", "Detector")]
    heads += [Column("AP", number=True)]
    heads += [Column(title, number=True) for title, _ in HEADS.values()]
    rows = [_row(material, row) for _, row in value.iterrows()]
    return Table(
        "What a dollar buys, and what beats a choice that is not on the Pareto front.",
        [*heads, Column("Beaten by")],
        rows,
        material.results.source("value"),
        closed=len(rows) > 16,
    )


def _row(material: Material, row: pd.Series) -> list[Cell]:
    texts = [row.scene, material.names.model(row.lidar), row.preset, detector(row.detector)]
    values = [number(float(row[c]), form, str(row.origin)) for c, (_, form) in HEADS.items()]
    beaten = Cell(_spelled(material, str(row.dominated_by)))
    return [*(Cell(str(t)) for t in texts), number(row.ap), *values, beaten]


def _spelled(material: Material, text: str) -> str:
    for name in sorted(DETECTORS, key=len, reverse=True):
        text = text.replace(name, DETECTORS[name]) if name in text.split() else text
    return material.names.spelled(text)


def _prices(material: Material, prices: pd.DataFrame) -> Table:
    """The LiDARs; columns that the file has beyond those that are needed are shown as they are."""
    known = ("lidar", "units", "price_low_usd", "price_high_usd", "price_source", "price_date")
    more = [c for c in prices if c not in (*known, "origin")]
    titles = [c.replace("_deg", ", °").replace("_m", ", m").replace("_", " ") for c in more]
    heads = [Column("LiDAR"), Column("Units", number=True), Column("Price, US$", number=True)]
    heads += [*(Column(t.capitalize(), number=True) for t in titles), Column("Source of the price")]
    rows = []
    for _, row in prices.iterrows():
        low, high = float(row.price_low_usd), float(row.price_high_usd)
        price = f"{low:,.0f}" if low == high else f"{low:,.0f} to {high:,.0f}"
        first = [Cell(material.names.label(row.lidar)), number(row.units, ".0f")]
        numbers = [_value_cell(str(row[c])) for c in more]
        source = Cell(f"{row.price_source}, {row.price_date}".strip(", "))
        rows.append([*first, Cell(price, low, row.origin), *numbers, source])
    return Table("The LiDARs.", heads, rows, material.results.source("lidars"))


def _value_cell(text: str) -> Cell:
    try:
        return Cell(text, float(text))
    except ValueError:
        return Cell(text, float("nan"))
