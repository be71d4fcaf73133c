"""Makes the report's section on average precision, with the paper's values."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics.row_selection import AP_R40
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import Block, Figure, LegendEntry, Section
from pyinfra.viz.report.names import detector
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections import accuracy
from pyinfra.viz.report.style import FAINT
from reproduction.paper_tables import paper_ap
from reproduction.report.hits import versus

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
    names = material.names
    colours = {lidar: names.look(lidar).colour for lidar in names.sorted(rows.lidar)}

    def point(ax: Any, row: Any) -> None:
        ends = np.array([[row.ap - row.ap_low], [row.ap_high - row.ap]], dtype=np.float64)
        marker = PAPER_DETECTORS.get(row.detector, "x")
        bars = np.nan_to_num(ends).clip(min=0)
        ax.errorbar(row.paper_ap, row.ap, bars, color=colours[row.lidar], marker=marker)

    panels = [
        versus(
            str(scene),
            group,
            point,
            (0, 100),
            "versus",
            f"AP of this benchmark against the paper's, {scene}, {len(group)} pairs",
            xlim=(0, 100),
            ylim=(0, 100),
            xlabel=f"{AP_R40}, paper",
            ylabel=f"{AP_R40}, this benchmark",
        )
        for scene, group in rows.groupby("scene", sort=False)
    ]
    legend = [
        LegendEntry(names.label(lidar), svg.line_swatch(colour, "none", "o"))
        for lidar, colour in colours.items()
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
