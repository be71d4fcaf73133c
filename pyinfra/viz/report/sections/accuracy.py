"""Average precision beside the paper's, and every cell of the benchmark."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from pyinfra.dataset.catalogue import SCENES
from pyinfra.dataset.paper_tables import paper_ap
from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics.row_selection import AP_R40, ap_name, hidden_share
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    NOTHING,
    Block,
    Column,
    Figure,
    LegendEntry,
    Panel,
    Section,
    Table,
    TableCell,
    Text,
    number,
    shown,
    span,
)
from pyinfra.viz.report.names import DETECTORS, PRESETS, detector, in_order
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.speed import timing_load
from pyinfra.viz.report.style import FAINT, drawing, panel

PAPER_DETECTORS = {"pointrcnn": "o", "pointpillars": "s", "pv-rcnn": "^", "dsvt": "D"}
TITLE = "Average precision"
KEY = ["scene", "lidar", "detector"]


def section(material: Material) -> Section | None:
    """LiDAR by detector for each scene and preset, against the paper, and all cells."""
    cells = material.results.table("cells")
    if cells.empty:
        return None
    done = material.results.done()
    paper = paper_ap().set_index(KEY).ap
    blocks: list[Block] = []
    for preset in in_order(done.preset, PRESETS):
        for scene in in_order(done.scene, SCENES):
            rows = done[(done.preset == preset) & (done.scene == scene)]
            if len(rows) > 0:
                blocks.append(_grid(material, rows, paper))
    blocks += [*_against_paper(material, done, paper), *_failed(cells), _all(material, cells)]
    blocks += _agreement(material)
    return Section("accuracy", TITLE, _lead(cells, done), blocks)


def _agreement(material: Material) -> list[Block]:
    """Spearman's rank correlation with the paper."""
    rows = material.results.table("paper")
    if rows.empty:
        return []
    heads = ("Scene", "Cells", "Rank correlation", "Mean difference")
    cells: list[list[TableCell]] = [
        [
            TableCell(str(row.scene)),
            number(float(row.cells), "g"),
            number(float(row.rank_correlation), ".2f"),
            number(float(row.mean_difference), "+.1f"),
        ]
        for row in rows.itertuples()
    ]
    caption = (
        "Whether LiDAR and detector stand in the paper's order, preset paper: Spearman's rank "
        "correlation over the cells that both have, and the mean of AP (R40) here less "
        "the paper's."
    )
    columns = [Column(head, number=head != "Scene") for head in heads]
    return [Table(caption, columns, cells, TableFile(material.results.file("paper"), rows))]


def _lead(cells: pd.DataFrame, done: pd.DataFrame) -> str:
    finished = int(cells.ap.notna().sum())
    text = (
        f"{finished} of {len(cells)} cells have an {ap_name(done)} (0 to 100; bird's-eye overlap "
        "of 0.5 or more; vehicles with at least one point), each with its 95 % interval over "
        "blocks of time."
    )
    seeds = cells.seed.nunique()
    return text + (f" Of {seeds} seeds the first is shown here." if seeds > 1 else "")


def _grid(material: Material, rows: pd.DataFrame, paper: pd.Series) -> Table:
    """LiDARs down, detectors across; below each AP that of the paper."""
    detectors = in_order(rows.detector, DETECTORS)
    scene, preset = str(rows.scene.iloc[0]), str(rows.preset.iloc[0])
    lines = []
    for lidar in material.names.sorted(rows.lidar):
        by_detector = rows[rows.lidar == lidar].set_index("detector")
        printed = {d: float(paper.get((scene, lidar, d), np.nan)) for d in detectors}
        cells = [
            _ap(by_detector, d, printed[d] if preset == "paper" else np.nan) for d in detectors
        ]
        lines.append([TableCell(material.names.label(lidar)), *cells])
    compared = preset == "paper" and scene in paper.index.get_level_values("scene")
    versus = f" Below: the interval, {AP_R40} and the paper's {AP_R40}." if compared else ""
    return Table(
        f"{scene.capitalize()}, preset {preset}: {ap_name(rows)}.{versus}",
        [Column("LiDAR"), *(Column(detector(d), number=True) for d in detectors)],
        lines,
        material.results.source("cells"),
    )


def _ap(by_detector: pd.DataFrame, name: str, printed: float) -> TableCell:
    if name not in by_detector.index:
        return TableCell(NOTHING, np.nan)
    row = by_detector.loc[name]
    below = span(row.ap_fine_low, row.ap_fine_high)
    if np.isfinite(printed):
        below = f"{below}\nR40 {row.ap:.1f}, paper {printed:.1f}"
    return TableCell(shown(row.ap_fine), float(row.ap_fine), str(row.origin), below=below)


def _against_paper(material: Material, done: pd.DataFrame, paper: pd.Series) -> list[Block]:
    """A figure of our AP against the paper's, under preset paper."""
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
        f"{AP_R40} measured here (preset paper, with intervals) against the paper's; equal on the "
        "line."
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
            xlim=(0, 100), ylim=(0, 100), xlabel=f"{AP_R40}, the paper", ylabel=f"{AP_R40}, here"
        )
        label = f"AP measured against the paper's, {scene}, {len(rows)} pairs"
        return Panel(scene, svg.inline(figure, svg.identifier("versus", scene), label))


def _failed(cells: pd.DataFrame) -> list[Block]:
    """Which cells have no AP, and why."""
    rows = cells[cells.ap.isna()]
    if rows.empty:
        return []
    names = [
        f"{r.scene}, {r.lidar}, {r.preset}, {r.detector}: {r.reason}" for r in rows.itertuples()
    ]
    shown_names = "; ".join(names[:5]) + ("; and more, see below" if len(names) > 5 else "")
    count = "One cell has" if len(names) == 1 else f"{len(names)} cells have"
    return [Text(f"{count} no AP. {shown_names}.")]


def _all(material: Material, cells: pd.DataFrame) -> Table:
    """Every row of the benchmark."""
    heads = [Column(c) for c in ("Scene", "LiDAR", "Preset", "Detector")]
    name = ap_name(cells)
    numbers = [
        "Seed",
        name,
        f"{name}, common",
        f"{name}, all",
        f"{name}, present",
        "Hidden, %",
        "Objects",
        "Training, s",
        "Median, ms",
        "95 %, ms",
    ]
    heads += [Column(c, number=True) for c in numbers]
    rows = []
    for row in cells.assign(hidden=hidden_share(cells)).itertuples():
        origin = str(row.origin)
        first = TableCell(str(row.scene), origin=origin, below=str(row.reason))
        texts = [material.names.model(str(row.lidar)), str(row.preset), detector(str(row.detector))]
        ends = span(row.ap_fine_low, row.ap_fine_high)
        ap = TableCell(shown(row.ap_fine), row.ap_fine, origin, below=ends)
        fine = (row.ap_common_fine, row.ap_all_fine, row.ap_present_fine)
        ap_of = [number(value) for value in fine]
        values = [*ap_of, number(100 * row.hidden, ".0f"), number(row.objects, ".0f")]
        times = [row.train_seconds, row.latency_p50_ms, row.latency_p95_ms]
        seed = TableCell(str(row.seed), float(str(row.seed)) if str(row.seed).isdigit() else np.nan)
        rows.append(
            [
                first,
                *(TableCell(t) for t in texts),
                seed,
                ap,
                *values,
                *(number(t, ".0f") for t in times),
            ]
        )
    caption = (
        "Every cell. Common: vehicles in the view of all LiDARs; all: every vehicle of the region "
        "that the mount can see; present: every one; hidden: those that it cannot see. Training: "
        "CPU time of one core; latency: from points to boxes, one core "
        f"({timing_load(cells)})."
    )
    return Table(caption, heads, rows, material.results.source("cells"), closed=True)
