"""The section on accuracy against latency and training time."""

from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.machine_load import load_text
from pyinfra.experiments.requirements import frame_ms
from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics.row_selection import AP_R1000
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Columns,
    Figure,
    Panel,
    Section,
    Table,
    number_in,
    table_of,
)
from pyinfra.viz.report.names import DETECTORS, option_columns, ordered
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend_of_both
from pyinfra.viz.report.style import FAINT, GROUND, drawing, log_ticks, panel
from pyinfra.viz.scanning_plots import MARKERS

COSTS = {
    "latency_p50_ms": ("latency", "median latency (ms)", "AP against median latency per frame"),
    "train_seconds": ("training", "training (s of one core)", "AP against training time"),
}


def section(material: Material) -> Section | None:
    """Returns figures of AP against latency and training time, with their Pareto fronts."""
    experiments = material.results.done()
    presets = ordered(experiments.preset)
    made = [_figure(material, experiments, preset, cost) for cost in COSTS for preset in presets]
    figures = [f for f in made if f is not None]
    if not figures:
        return None
    blocks = [Figure(**vars(f) | {"closed": not f.name.endswith(presets[0])}) for f in figures]
    fronts = [_fronts(experiments[experiments.preset == preset]) for preset in presets]
    table = _table(material, pd.concat(fronts, ignore_index=True))
    every = " or ".join(f"{ms:g}" for ms in _frame_ms(material, experiments))
    lead = (
        "Latency is the time from the points of a frame to its boxes on one core "
        f"({timing_load(experiments)}). A LiDAR delivers a frame every {every} ms (the "
        "vertical line). Training time is CPU time of one core."
    )
    return Section("speed", "Speed against accuracy", lead, [*blocks, table])


def _frame_ms(material: Material, rows: pd.DataFrame) -> list[float]:
    """Returns the different frame periods of the rows' LiDARs, in ms."""
    lidars = material.results.table("lidars")
    pairs = rows[["lidar", "preset"]].drop_duplicates()
    return sorted({frame_ms(lidars, *pair) for pair in pairs.itertuples(index=False)})


def timing_load(experiments: pd.DataFrame) -> str:
    """Returns a text on the load under which the latencies were measured."""
    return load_text(experiments.latency_other_cores[experiments.latency_p50_ms.notna()].tolist())


def pareto(rows: pd.DataFrame, cost: str) -> pd.Series:
    """Returns which rows are on the Pareto front of AP (R1000) and `cost`.

    A row is not on the front if another row has no higher cost and no lower AP, and is better in
    one of the two. A row without a cost is not on the front.
    """
    price, ap = rows[cost].to_numpy(np.float64), rows.ap_r1000.to_numpy(np.float64)
    cheaper = (price[None] <= price[:, None]) & (ap[None] >= ap[:, None])
    better = (price[None] < price[:, None]) | (ap[None] > ap[:, None])
    return pd.Series(~(cheaper & better).any(axis=1) & ~np.isnan(price), index=rows.index)


def _fronts(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows on the Pareto front of their scene, ordered by latency."""
    parts = [
        group[pareto(group, "latency_p50_ms")] for _, group in rows.groupby("scene", sort=False)
    ]
    return pd.concat(parts).sort_values(["scene", "latency_p50_ms"])


def _figure(material: Material, experiments: pd.DataFrame, preset: str, cost: str) -> Figure | None:
    rows = experiments[(experiments.preset == preset) & (experiments[cost] > 0)]
    if rows.empty:
        return None
    name, _, what = COSTS[cost]
    caption = (
        f"{what} (logarithmic), preset {preset}, with 95 % intervals. The line is the Pareto "
        "front. Filled marks are on the front."
    )
    if cost == "latency_p50_ms":
        caption += " The bar to the right of a mark ends at the 95th percentile of the latency."
    panels = [_panel(material, rows[rows.scene == s], cost) for s in ordered(rows.scene)]
    source = material.results.source("experiments")
    legend = legend_of_both(
        material.names, rows, lambda name: svg.line_swatch(FAINT, "none", _marker(name))
    )
    return Figure(f"figure-{name}-{preset}", caption, panels, source, legend)


def _marker(name: str) -> str:
    """Returns the marker of a detector. In this section, colours distinguish LiDARs."""
    names = list(DETECTORS)
    return MARKERS[names.index(name)] if name in names else "*"


def _panel(material: Material, rows: pd.DataFrame, cost: str) -> Panel:
    first = rows.iloc[0]
    name, label, what = COSTS[cost]
    with drawing():
        figure, ax = panel()
        on_front = pareto(rows, cost)
        front = rows[on_front].sort_values(cost)
        ax.step(front[cost], front.ap_r1000, where="post", color=FAINT, linewidth=0.9)
        if cost == "latency_p50_ms":
            for ms in _frame_ms(material, rows):
                ax.axvline(ms, color=FAINT, linewidth=0.7, linestyle=(0, (2, 2)))
        for row in rows.assign(front=on_front).itertuples():
            _mark(material, ax, row, cost)
        ax.set(xscale="log", xlabel=label, ylim=(0, 102), ylabel=AP_R1000)
        log_ticks(ax.xaxis)
        title = str(first.scene)
        text = f"{what} with the Pareto front, {title}, preset {first.preset}"
        return Panel(title, svg.inline(figure, svg.identifier(name, title, first.preset), text))


def _mark(material: Material, ax: Any, row: Any, cost: str) -> None:
    colour = material.names.look(row.lidar).colour
    ends = [[row.ap_r1000 - row.ap_r1000_low], [row.ap_r1000_high - row.ap_r1000]]
    up = np.nan_to_num(ends).clip(min=0)
    right = None
    if cost == "latency_p50_ms":
        right = np.nan_to_num([[0.0], [row.latency_p95_ms - row.latency_p50_ms]]).clip(min=0)
    style: dict[str, Any] = {
        "color": colour,
        "marker": _marker(row.detector),
        "markerfacecolor": colour if row.front else GROUND,
    }
    ax.errorbar(getattr(row, cost), row.ap_r1000, up, right, markersize=5, elinewidth=0.7, **style)


def _table(material: Material, rows: pd.DataFrame) -> Table:
    """Returns a table of the Pareto front of AP and latency."""
    columns: Columns = {
        **option_columns(material.names),
        AP_R1000: number_in("ap_r1000"),
        "Median, ms": number_in("latency_p50_ms", ".0f"),
        "95th percentile, ms": number_in("latency_p95_ms", ".0f"),
        "Training, s": number_in("train_seconds", ".0f"),
    }
    source = TableFile("report_pareto_latency.csv", rows)
    caption = f"The Pareto front of {AP_R1000} and latency."
    return table_of(caption, rows, columns, source, closed=len(rows) > 12)
