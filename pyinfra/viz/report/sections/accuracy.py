"""The section on average precision by LiDAR and detector, with every experiment."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.metrics.row_selection import AP_R1000, OFF_REGION, hidden_share
from pyinfra.viz.report.blocks import (
    NOTHING,
    Block,
    Column,
    Columns,
    Section,
    Table,
    TableCell,
    Text,
    number,
    shown,
    span,
    table_of,
)
from pyinfra.viz.report.names import capitalized, detector, option_columns, ordered
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.speed import timing_load

TITLE = "Average precision"
Note = Callable[[pd.Series], str]


def section(material: Material) -> Section | None:
    """Returns an AP table (LiDARs x detectors) per scene and preset, and a table of experiments."""
    experiments = material.results.table("experiments")
    if experiments.empty:
        return None
    done = material.results.done()
    blocks = [*grids(material, done), *_failed(experiments), _all(material, experiments)]
    return Section("accuracy", TITLE, _lead(experiments, done), blocks)


def grids(material: Material, done: pd.DataFrame, note: Note = lambda _: "") -> list[Table]:
    """Returns a table for each scene and preset. note: returns the text below a row's AP."""
    return [
        _grid(material, rows, note)
        for preset in ordered(done.preset)
        for scene in ordered(done.scene)
        if len(rows := done[(done.preset == preset) & (done.scene == scene)])
    ]


def _lead(experiments: pd.DataFrame, done: pd.DataFrame) -> str:
    finished = int(experiments.ap.notna().sum())
    text = (
        f"{finished} of {len(experiments)} experiments have an {AP_R1000} with a 95 % "
        "interval over blocks of time. AP is from 0 to 100, at an IoU of footprints of at least "
        "0.5, over vehicles with at least one point."
    )
    seeds = experiments.seed.nunique()
    return text + (f" The tables show the first of {seeds} seeds." if seeds > 1 else "")


def _grid(material: Material, rows: pd.DataFrame, note: Note) -> Table:
    """Returns a table with LiDARs as rows and detectors as columns."""
    detectors = ordered(rows.detector)
    lines = []
    for lidar in material.names.sorted(rows.lidar):
        by_detector = rows[rows.lidar == lidar].set_index("detector", drop=False)
        cells = [_ap(by_detector, name, note) for name in detectors]
        lines.append([TableCell(material.names.label(lidar)), *cells])
    scene, preset = str(rows.scene.iloc[0]), str(rows.preset.iloc[0])
    return Table(
        f"{capitalized(scene)}, preset {preset}: {AP_R1000}.",
        [Column("LiDAR"), *(Column(detector(d), number=True) for d in detectors)],
        lines,
        material.results.source("experiments"),
    )


def _ap(by_detector: pd.DataFrame, name: str, note: Note) -> TableCell:
    if name not in by_detector.index:
        return TableCell(NOTHING, np.nan)
    row = by_detector.loc[name]
    below = span(row.ap_r1000_low, row.ap_r1000_high)
    below = "\n".join([below, more]) if (more := note(row)) else below
    return TableCell(shown(row.ap_r1000), float(row.ap_r1000), str(row.origin), below=below)


def _failed(experiments: pd.DataFrame) -> list[Block]:
    """Returns a text that names the experiments without AP and the reasons."""
    rows = experiments[experiments.ap.isna()]
    if rows.empty:
        return []
    names = [
        f"{r.scene}, {r.lidar}, {r.preset}, {r.detector}: {r.reason}" for r in rows.itertuples()
    ]
    others = "; the others are in the table below" if len(names) > 5 else ""
    shown_names = "; ".join(names[:5]) + others
    count = "One experiment has" if len(names) == 1 else f"{len(names)} experiments have"
    return [Text(f"{count} no AP. {shown_names}.")]


def _all(material: Material, experiments: pd.DataFrame) -> Table:
    """Returns a table of every experiment of the benchmark."""

    def lidar(row: Any) -> TableCell:
        below = str(row.reason)
        return TableCell(material.names.model(str(row.lidar)), origin=str(row.origin), below=below)

    def ap(row: Any) -> TableCell:
        ends = span(row.ap_r1000_low, row.ap_r1000_high)
        return TableCell(shown(row.ap_r1000), row.ap_r1000, str(row.origin), below=ends)

    def seed(row: Any) -> TableCell:
        text = str(row.seed)
        return TableCell(text, float(text) if text.isdigit() else np.nan)

    columns: Columns = {
        **option_columns(material.names),
        "LiDAR": lidar,
        "Seed": seed,
        AP_R1000: ap,
        f"{AP_R1000}, common": lambda row: number(row.ap_common_r1000),
        f"{AP_R1000}, all": lambda row: number(row.ap_all_r1000),
        f"{AP_R1000}, present": lambda row: number(row.ap_present_r1000),
        "Hidden, %": lambda row: number(100 * row.hidden, ".0f"),
        "Objects": lambda row: number(row.objects, ".0f"),
        "Outside region, per min": lambda row: number(getattr(row, OFF_REGION)),
        "Training, s": lambda row: number(row.train_seconds, ".0f"),
        "Median, ms": lambda row: number(row.latency_p50_ms, ".0f"),
        "95th percentile, ms": lambda row: number(row.latency_p95_ms, ".0f"),
    }
    caption = (
        "All experiments. Common: AP of the vehicles in the field of view of all LiDARs. All: AP "
        "of the vehicles of the region that are visible from the mount. Present: AP of all "
        "vehicles of the region. Hidden: share of the vehicles that are not visible from the "
        "mount. Outside region: boxes per minute with a score of at least 0.5 outside the region. "
        "Training: CPU time of one core. Median and 95th percentile: latency from points to boxes "
        f"on one core ({timing_load(experiments)})."
    )
    rows = experiments.assign(hidden=hidden_share(experiments))
    return table_of(caption, rows, columns, material.results.source("experiments"), closed=True)
