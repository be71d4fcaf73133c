"""Hit points per frame beside the paper's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from pyinfra.dataset.catalogue import SCENES
from pyinfra.dataset.paper_tables import paper_hits
from pyinfra.experiments.result_tables import TableFile
from pyinfra.formats.csv_table import read_csv
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Column,
    Figure,
    LegendEntry,
    Panel,
    Section,
    Table,
    TableCell,
    number,
)
from pyinfra.viz.report.names import PRESETS, in_order
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.style import FAINT, drawing, log_ticks, panel

KEY = ["scene", "lidar"]


def section(material: Material) -> Section | None:
    """Mean hits of a frame: those under each preset, and the paper's where it has any."""
    rows, file = _measured(material)
    if rows.empty:
        return None
    paper = paper_hits().rename(columns={"hits": "paper_hits"})
    rows = rows.merge(paper, on=KEY, how="left")
    rows["difference_percent"] = 100 * (rows.hits_per_frame / rows.paper_hits - 1)
    source = TableFile("report_hits.csv", rows)
    printed = bool(rows.paper_hits.notna().any())
    versus = " Difference: preset paper against the paper's table." if printed else ""
    heads = _heads(rows, printed=printed)
    table = Table(
        f"Mean hit points of a frame.{versus} {file}",
        [Column("Scene"), Column("LiDAR"), *(Column(c, number=True) for c in heads)],
        _table_rows(material, rows, printed=printed),
        source,
    )
    ours = rows[rows.paper_hits.notna() & (rows.preset == "paper")]
    blocks: list[Block] = [table, *([_figure(material, ours, source)] if len(ours) else [])]
    return Section("hits", "Hit points", _lead(rows), blocks)


def _measured(material: Material) -> tuple[pd.DataFrame, str]:
    """scene, lidar, preset, hits_per_frame, origin; and what the rows are from."""
    table = material.results.table("hits")
    if len(table) > 0:
        return table[[*KEY, "preset", "frames", "hits_per_frame", "origin"]], ""
    parts = [
        read_csv(data.folder / "summary.csv").assign(scene=data.scene, preset=data.preset)
        for data in material.data
        if (data.folder / "summary.csv").is_file() and data.aggregation == "exact"
    ]
    if not parts:
        return table, ""
    rows = pd.concat(parts, ignore_index=True)[[*KEY, "preset", "frames", "hits_per_frame"]]
    return rows.assign(origin="summary.csv of the data set"), "From the summaries of the data sets."


def _heads(rows: pd.DataFrame, *, printed: bool) -> list[str]:
    heads = [f"Preset {p}" for p in in_order(rows.preset, PRESETS)]
    return ["The paper", *heads, "Difference, %"] if printed else heads


def _table_rows(material: Material, rows: pd.DataFrame, *, printed: bool) -> list[list[TableCell]]:
    presets = in_order(rows.preset, PRESETS)
    lines = []
    for scene in in_order(rows.scene, SCENES):
        for lidar in material.names.sorted(rows[rows.scene == scene].lidar):
            selected = rows[(rows.scene == scene) & (rows.lidar == lidar)]
            by_preset = selected.drop_duplicates("preset").set_index("preset")
            cells = [_hits(by_preset, preset) for preset in presets]
            if printed:
                change = by_preset.difference_percent.get("paper", np.nan)
                paper = number(float(selected.paper_hits.iloc[0]), ",.0f", "paper_hit_points.csv")
                cells = [paper, *cells, number(float(change), "+.1f")]
            lines.append([TableCell(scene), TableCell(material.names.label(lidar)), *cells])
    return lines


def _hits(by_preset: pd.DataFrame, preset: str) -> TableCell:
    if preset not in by_preset.index:
        return number(np.nan)
    row = by_preset.loc[preset]
    return number(float(row.hits_per_frame), ",.0f", str(row.origin))


def _lead(rows: pd.DataFrame) -> str:
    change = rows[(rows.preset == "paper") & rows.paper_hits.notna()].difference_percent.abs()
    if rows.paper_hits.isna().all():
        return "How many points a frame has, on average over all frames."
    if change.empty:
        return "The paper prints no hit points for these scenes and LiDARs under preset paper."
    return (
        f"With the paper's settings (preset paper) the hits of a frame are on average "
        f"{change.mean():.1f} % from the paper's, {change.max():.1f} % at most."
    )


def _figure(material: Material, rows: pd.DataFrame, source: TableFile) -> Figure:
    """Simulated against printed, a panel for each scene, on logarithmic axes."""
    panels = [_panel(material, group) for _, group in rows.groupby("scene", sort=False)]
    lidars = material.names.sorted(rows.lidar)
    legend = [LegendEntry(material.names.label(x), _swatch(material, x)) for x in lidars]
    caption = (
        "Hit points of a frame, simulated (preset paper) against the paper's; equal on the line."
    )
    return Figure("figure-hits", caption, panels, source, legend)


def _swatch(material: Material, lidar: str) -> str:
    look = material.names.look(lidar)
    return svg.line_swatch(look.colour, "none", look.marker)


def _panel(material: Material, rows: pd.DataFrame) -> Panel:
    scene = str(rows.scene.iloc[0])
    with drawing():
        figure, ax = panel(left=0.75)
        ends = (0.8 * rows.paper_hits.min(), 1.25 * rows.paper_hits.max())
        ax.plot(ends, ends, color=FAINT, linewidth=0.8)
        for row in rows.itertuples():
            style: dict[str, Any] = material.names.look(str(row.lidar)).style()
            ax.plot(row.paper_hits, row.hits_per_frame, **style)
        ax.set(xscale="log", yscale="log", xlabel="the paper", ylabel="simulated")
        log_ticks(ax.xaxis)
        log_ticks(ax.yaxis)
        label = f"Hit points simulated against the paper's, {scene}"
        return Panel(scene, svg.inline(figure, svg.identifier("hits", scene), label))
