"""Makes the report's section on average precision, with the paper's values."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics.row_selection import AP_R40
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Figure,
    LegendEntry,
    Panel,
    Section,
)
from pyinfra.viz.report.names import detector
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections import accuracy
from pyinfra.viz.report.style import FAINT, drawing, panel
from reproduction.paper_tables import paper_ap

PAPER_DETECTORS = {"pointrcnn": "o", "pointpillars": "s", "pv-rcnn": "^", "dsvt": "D"}
KEY = ["scene", "lidar", "detector"]
BELOW = f" Below each value: its 95 % interval, {AP_R40} and the paper's {AP_R40}."


def section(material: Material) -> Section | None:
    """Adds the paper's AP to pyinfra's section, with a figure."""
    base = accuracy.section(material)
    if base is None:
        return None
    done = material.results.done()
    paper = paper_ap().set_index(KEY).ap

    def note(row: pd.Series) -> str:
        printed = paper.get((row.scene, row.lidar, row.detector), np.nan)
        compared = row.preset == "paper" and np.isfinite(printed)
        return f"R40 {row.ap:.1f}, paper {printed:.1f}" if compared else ""

    grids = accuracy.grids(material, done, note)
    scenes = tuple(f"{name.capitalize()}, preset paper:" for name in paper.index.unique("scene"))
    named = [
        replace(grid, caption=grid.caption + BELOW) if grid.caption.startswith(scenes) else grid
        for grid in grids
    ]
    figure = _against_paper(material, done, paper)
    return replace(base, blocks=[*named, *figure, *base.blocks[len(grids) :]])


def _against_paper(material: Material, done: pd.DataFrame, paper: pd.Series) -> list[Block]:
    """Returns a figure of this benchmark's AP against the paper's AP, under preset `paper`."""
    rows = done[done.preset == "paper"].join(paper.rename("paper_ap"), on=KEY)
    rows = rows[rows.paper_ap.notna()]
    if rows.empty:
        return []
    columns = [*KEY, "preset", "seed", "ap", "ap_low", "ap_high", "paper_ap", "origin"]
    source = TableFile("report_ap_against_paper.csv", rows[columns])
    panels = [_versus(material, group) for _, group in rows.groupby("scene", sort=False)]
    lidars = material.names.sorted(rows.lidar)
    legend = [
        LegendEntry(
            material.names.label(x), svg.line_swatch(material.names.look(x).colour, "none", "o")
        )
        for x in lidars
    ]
    legend += [
        LegendEntry(detector(d), svg.line_swatch(FAINT, "none", marker))
        for d, marker in PAPER_DETECTORS.items()
        if d in set(rows.detector)
    ]
    caption = (
        f"{AP_R40} of this benchmark (preset paper, with 95 % intervals) against the paper's "
        f"{AP_R40}. On the line, both values are equal."
    )
    return [Figure("figure-ap-paper", caption, panels, source, legend)]


def _versus(material: Material, rows: pd.DataFrame) -> Panel:
    scene = str(rows.scene.iloc[0])
    with drawing():
        figure, ax = panel()
        ax.plot([0, 100], [0, 100], color=FAINT, linewidth=0.8)
        for row in rows.itertuples():
            ends = np.array([[row.ap - row.ap_low], [row.ap_high - row.ap]], dtype=np.float64)
            style: dict[str, Any] = {
                "color": material.names.look(str(row.lidar)).colour,
                "marker": PAPER_DETECTORS.get(str(row.detector), "x"),
            }
            ax.errorbar(row.paper_ap, row.ap, np.nan_to_num(ends).clip(min=0), **style)
        ax.set(
            xlim=(0, 100),
            ylim=(0, 100),
            xlabel=f"{AP_R40}, paper",
            ylabel=f"{AP_R40}, this benchmark",
        )
        label = f"AP of this benchmark against the paper's, {scene}, {len(rows)} pairs"
        return Panel(scene, svg.inline(figure, svg.identifier("versus", scene), label))
