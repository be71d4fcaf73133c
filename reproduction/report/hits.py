"""Makes the report's section on hit points per frame, with the paper's values."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Column,
    Figure,
    LegendEntry,
    Panel,
    Section,
    Table,
    number,
)
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections import hits
from pyinfra.viz.report.style import FAINT, drawing, log_ticks, panel
from reproduction.paper_tables import paper_hits


def section(material: Material) -> Section | None:
    """Adds the paper's hit points, and the differences to them, to pyinfra's section."""
    base = hits.section(material)
    if base is None:
        return None
    rows, remark = hits.measured(material)
    rows = rows.merge(paper_hits().rename(columns={"hits": "paper_hits"}), on=hits.KEY, how="left")
    rows["difference_percent"] = 100 * (rows.hits_per_frame / rows.paper_hits - 1)
    source = TableFile("report_hits.csv", rows)
    (table,) = base.blocks
    assert isinstance(table, Table)
    if rows.paper_hits.isna().all():
        return replace(base, blocks=[replace(table, source=source)])
    blocks: list[Block] = [_table(material, table, rows, remark, source)]
    same = rows[rows.paper_hits.notna() & (rows.preset == "paper")]
    blocks += [_figure(material, same, source)] if len(same) else []
    return replace(base, lead=_lead(rows), blocks=blocks)


def _table(
    material: Material, table: Table, rows: pd.DataFrame, remark: str, source: TableFile
) -> Table:
    """Adds the paper's hit points and the difference as two columns to pyinfra's table."""
    first, second, *presets = table.columns
    columns = [first, second, Column("Paper", number=True), *presets]
    lines = []
    for row, (_, group) in zip(table.rows, hits.by_lidar(material, rows), strict=True):
        change = group[group.preset == "paper"].difference_percent
        paper = number(float(group.paper_hits.iloc[0]), ",.0f", "paper_hit_points.csv")
        difference = number(float(change.iloc[0]) if len(change) else np.nan, "+.1f")
        lines.append([*row[:2], paper, *row[2:], difference])
    caption = (
        "Mean number of points per frame. The difference compares preset paper with the paper's "
        "table. " + remark
    )
    return Table(caption, [*columns, Column("Difference, %", number=True)], lines, source)


def _lead(rows: pd.DataFrame) -> str:
    change = rows[(rows.preset == "paper") & rows.paper_hits.notna()].difference_percent.abs()
    if change.empty:
        return "The paper has no number of points for these scenes and LiDARs under preset paper."
    return (
        "With the paper's settings (preset paper), the number of points per frame differs from "
        f"the paper's by {change.mean():.1f} % on average and by {change.max():.1f} % at most."
    )


def _figure(material: Material, rows: pd.DataFrame, source: TableFile) -> Figure:
    """Returns a figure of simulated hit points against the paper's, with a panel per scene."""
    looks = {lidar: material.names.look(lidar) for lidar in material.names.sorted(rows.lidar)}

    def point(ax: Any, row: Any) -> None:
        ax.plot(row.paper_hits, row.hits_per_frame, **looks[row.lidar].style())

    panels = [
        versus(
            str(scene),
            group,
            point,
            (0.8 * group.paper_hits.min(), 1.25 * group.paper_hits.max()),
            "hits",
            f"Points per frame, simulated against the paper's, {scene}",
            xscale="log",
            yscale="log",
            xlabel="points per frame, paper",
            ylabel="points per frame, simulated",
        )
        for scene, group in rows.groupby("scene", sort=False)
    ]
    legend = [
        LegendEntry(material.names.label(lidar), svg.line_swatch(look.colour, "none", look.marker))
        for lidar, look in looks.items()
    ]
    caption = (
        "Points per frame, simulated (preset paper) against the paper's. On the line, both "
        "values are equal."
    )
    return Figure("figure-hits", caption, panels, source, legend)


def versus(
    scene: str,
    rows: pd.DataFrame,
    point: Callable[[Any, Any], None],
    ends: tuple[float, float],
    name: str,
    label: str,
    **axes: Any,
) -> Panel:
    """Returns a plot of the values of one scene against the paper's values.

    Parameters
    ----------
    point : draws a row on the axes
    ends : ends of the line on which both values are equal
    name : start of the drawing's id
    axes : properties of the axes
    """
    with drawing():
        figure, ax = panel()
        ax.plot(ends, ends, color=FAINT, linewidth=0.8)
        for row in rows.itertuples():
            point(ax, row)
        ax.set(**axes)
        if ax.get_xscale() == "log":
            log_ticks(ax.xaxis)
            log_ticks(ax.yaxis)
        return Panel(scene, svg.inline(figure, svg.identifier(name, scene), label))
