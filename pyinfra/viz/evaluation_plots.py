"""Draws figures of evaluations from their tables.

A table may have the rows of several LiDARs. The figures are legible in black and white and for
colour-blind readers. Lines differ in style and marker, and area qualities in lightness and hatch.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

from pyinfra.dataset.roads import Road, strip
from pyinfra.dataset.windows import WINDOW_M, WINDOW_STEP_M
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY
from pyinfra.metrics.row_selection import AP_R1000
from pyinfra.viz.scanning_plots import STYLE, handles_of, line_of, panels, save

STYLES: dict[str, dict[str, Any]] = {
    "high": {"facecolor": "#00204d", "hatch": ""},
    "undecided": {"facecolor": "#7c7b78", "hatch": "///"},
    "low": {"facecolor": "#ffe945", "hatch": ""},
    "few": {"facecolor": "#ffffff", "hatch": "..."},
}
LABELS = {
    "high": f"AP > {HIGH_QUALITY:g}",
    "undecided": f"undecided: the interval includes {HIGH_QUALITY:g}, or there is none",
    "low": f"AP <= {HIGH_QUALITY:g}",
    "few": "too few objects",
}


def draw_all(evaluation: Evaluation, out: Path) -> list[Path]:
    """Writes every figure as SVG and PNG; returns the files.

    The plan of the areas is drawn only if the roads are known.
    """
    parts = evaluation.distance_ap if evaluation.cells is None else evaluation.cells
    figures = {
        "pr_curve": pr_curve(evaluation.pr_curve),
        "distance_ap": distance_ap(evaluation.distance_ap),
        "areas": areas(parts),
    }
    roads = evaluation.truth.roads
    if roads:
        sensor = evaluation.truth.lidar.T_world_levelled if evaluation.truth.lidar else None
        position = (sensor.x, sensor.y) if sensor else None
        figures["areas_plan"] = areas_plan(parts, roads, position)
    files = []
    for name, figure in figures.items():
        save(figure, out / name)
        files += [out / f"{name}.svg", out / f"{name}.png"]
    return files


def pr_curve(table: pd.DataFrame) -> Figure:
    """Draws precision against recall, with a line per LiDAR and a panel per ground truth."""
    with mpl.rc_context(STYLE), sns.axes_style("whitegrid"):
        figure, parts = _panels(table, (4.2, 3.6))
        for ax, rows in parts:
            for name, part, style in _lidars(rows, table):
                reached = part[part.precision > 0]
                ax.plot(reached.recall, reached.precision, label=name, markevery=10, **style)
                _band(ax, reached.recall, reached.precision_low, reached.precision_high, style)
            ax.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="recall", ylabel="precision")
        return _legend(figure)


def distance_ap(table: pd.DataFrame) -> Figure:
    """Draws AP with intervals in windows along each road, and the threshold of high quality."""
    with mpl.rc_context(STYLE), sns.axes_style("whitegrid"):
        figure, parts = _panels(table, (5.2, 3.2), "road")
        for ax, rows in parts:
            for name, part, style in _lidars(rows, table):
                ax.plot(part.s, part.ap_r1000, label=name, markersize=3, **style)
                _band(ax, part.s, part.ap_r1000_low, part.ap_r1000_high, style)
                if "ap_cut_first" in part:
                    ax.plot(part.s, part.ap_cut_first, "k:", label="cut before matching")
            ax.axhline(HIGH_QUALITY, color="black", linewidth=0.8, linestyle=(0, (8, 4)))
            ends = (float(table.s.min()), float(table.s.max()))
            ax.set(xlim=ends, ylim=(0, 102), ylabel=AP_R1000)
            ax.set_xlabel(f"s, middle of {WINDOW_M:g} m (m)")
        return _legend(figure)


def areas(distance: pd.DataFrame) -> Figure:
    """Draws stacked bars of detection areas by quality per LiDAR, a panel per ground truth."""
    with mpl.rc_context(STYLE), sns.axes_style("whitegrid", {"axes.grid.axis": "y"}):
        lidars = list(distance.lidar.unique())
        figure, parts = _panels(distance, (1.2 * len(lidars) + 1.6, 3.4))
        for ax, rows in parts:
            bottom = np.zeros(len(lidars))
            for quality, look in STYLES.items():
                selected = rows[rows.quality == quality]
                count = np.array([(selected.lidar == name).sum() for name in lidars])
                ax.bar(lidars, count, bottom=bottom, width=0.6, edgecolor="black", **look)
                _numbers(ax, count, bottom, dark=quality == "high")
                bottom += count
            ax.set_ylabel("areas")
            ax.tick_params(axis="x", rotation=20)
        return _legend(figure, _handles())


def areas_plan(
    distance: pd.DataFrame, roads: Sequence[Road], sensor: tuple[float, float] | None = None
) -> Figure:
    """Draws the detection areas on the plan of the road, in the world frame.

    A window is drawn as 5 m of road around the middle of the window. distance: rows of one LiDAR,
    of windows or square cells. sensor: x and y in the world frame, drawn as a triangle.
    """
    with mpl.rc_context(STYLE), sns.axes_style("white"):
        points = np.concatenate([road.xy for road in roads])
        span = np.ptp(points, axis=0) + 40
        width = 6.5 if span[0] >= span[1] else 4.0
        figure, parts = _panels(distance, (width, min(width * span[1] / span[0] + 0.8, 7)))
        by_name = {road.name: road for road in roads}
        for ax, rows in parts:
            for row in rows.itertuples():
                is_cell = "x" in rows
                outline = _square(row) if is_cell else _piece(by_name[str(row.road)], float(row.s))
                ax.add_patch(Polygon(outline, edgecolor="black", lw=0.3, **STYLES[row.quality]))
            if sensor is not None:
                ax.plot(*sensor, "^", color="#d55e00", markeredgecolor="white", markersize=8)
            ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
            ax.autoscale_view()
        return _legend(figure, _handles())


def _square(cell: Any) -> np.ndarray[Any, Any]:
    """Returns the outline (4, 2) of a square cell."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.asarray((cell.x, cell.y) + WINDOW_M / 2 * corners)


def _piece(road: Road, middle: float) -> np.ndarray[Any, Any]:
    """Returns the outline (n, 2) of a road piece of WINDOW_STEP_M, cut at the road's ends."""
    half = WINDOW_STEP_M / 2
    ends = np.clip([middle - half, middle + half], road.s[0], road.s[-1])
    s = np.linspace(ends[0], ends[1], 6)
    centre = np.stack([np.interp(s, road.s, road.xy[:, i]) for i in range(2)], axis=1)
    heading = np.interp(s, road.s, np.unwrap(road.heading))
    return strip(centre, heading, np.interp(s, road.s, road.half_width))


def _panels(
    table: pd.DataFrame, size: tuple[float, float], down: str | None = None
) -> tuple[Figure, Iterator[tuple[Axes, pd.DataFrame]]]:
    """Returns a figure with a column per ground truth and a row per value of column `down`.

    The second value is an iterator over pairs of axes and their rows of the table.
    """
    rows = table[down].unique() if down else [None]
    figure, axes = panels(table.ground_truth.unique(), rows, size, more=(0.0, 0.6))

    def named() -> Iterator[tuple[Axes, pd.DataFrame]]:
        for ax, which, row in axes:
            part = table[table.ground_truth == which]
            if row is not None:
                part = part[part[down] == row]
            ax.set_title(f"{which}: {row}" if row else which)
            yield ax, part

    return figure, named()


def _lidars(
    rows: pd.DataFrame, table: pd.DataFrame
) -> Iterator[tuple[str, pd.DataFrame, dict[str, Any]]]:
    """Yields name, rows and style of each LiDAR; the style is the same in every panel."""
    for name in table.lidar.unique():
        yield name, rows[rows.lidar == name], line_of(name, table)


def _band(ax: Axes, x: Any, low: Any, high: Any, style: dict[str, Any]) -> None:
    ax.fill_between(x, low, high, color=style["color"], alpha=0.2, linewidth=0)


def _numbers(ax: Axes, count: Any, bottom: Any, *, dark: bool) -> None:
    for at, (n, base) in enumerate(zip(count, bottom, strict=True)):
        if n > 0:
            box = None if dark else {"facecolor": "white", "edgecolor": "none", "pad": 1}
            colour = "white" if dark else "black"
            ax.text(at, base + n / 2, str(n), ha="center", va="center", color=colour, bbox=box)


def _handles() -> list[Patch]:
    return [Patch(edgecolor="black", label=LABELS[name], **look) for name, look in STYLES.items()]


def _legend(figure: Figure, handles: list[Patch] | None = None) -> Figure:
    entries = handles_of(figure)
    if handles is not None:
        entries = {str(handle.get_label()): handle for handle in handles}
    columns = min(4, max(1, int(figure.get_figwidth() / 2.2)))
    figure.legend(
        entries.values(), entries.keys(), loc="outside lower center", ncols=columns, frameon=False
    )
    return figure
