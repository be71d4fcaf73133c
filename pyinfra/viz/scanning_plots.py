"""Draws figures of the scanning statistics from their tables.

A LiDAR has the same colour, line style and marker in all figures. Bars have hatches, so that they
are legible in black and white. The colours are seaborn's palette for colour-blind readers.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyinfra.core.files import replacing
from pyinfra.metrics.scanning_tables import QUALITIES
from pyinfra.viz.picture_style import in_chart

LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)))
MARKERS = "osD^vPX*"
QUALITY_HATCHES = ("", "///", "...", "xxx")
STYLE: Any = {
    "svg.hashsalt": "pyinfra",  # fixed salt of the ids, so that each run writes the same bytes
    "svg.fonttype": "none",
    "font.size": 9,
    "axes.titlesize": 8,
}


def draw(name: str, table: pd.DataFrame) -> Figure:
    """Returns the figure of a table of scanning statistics, by the table's name."""
    with mpl.rc_context(STYLE), sns.axes_style("whitegrid"):
        return FIGURES[name](table)


def save(figure: Figure, stem: Path) -> None:
    """Writes stem.svg and stem.png."""
    with mpl.rc_context(STYLE):
        with replacing(Path(f"{stem}.svg")) as beside:
            figure.savefig(beside, format="svg", metadata={"Date": None})
        figure.set_layout_engine("none")  # the PNG keeps the layout of the SVG
        with replacing(Path(f"{stem}.png")) as beside:
            figure.savefig(beside, format="png", dpi=150)


def points_per_vehicle(table: pd.DataFrame) -> Figure:
    """Draws points per vehicle (APV) by distance with intervals.

    Columns are data sets, rows are vehicle subsets.
    """
    figure, axes = panels(_data_sets(table), table["set"].unique(), size=(4.2, 3.2))
    for ax, column, row in axes:
        part = table[(_data_sets(table) == column) & (table["set"] == row)]
        for name, lidar in _lidars(part, table):
            lidar = lidar[lidar.apv > 0]
            middle = (lidar.from_m + lidar.to_m) / 2
            ax.plot(middle, lidar.apv, label=name, markersize=4, **line_of(name, table))
            shown = in_chart(lidar.ci_low, part.apv)
            style = {"alpha": 0.2, "color": _colour(name, table)}
            ax.fill_between(middle, lidar.ci_low, lidar.ci_high, shown, **style)
        ax.set(
            yscale="log" if (table.apv > 0).any() else "linear",
            xlim=(table.from_m.min(), table.to_m.max()),
            xlabel="horizontal distance (m)",
            ylabel="points per vehicle",
            title=f"{column}: {row}",
        )
    return _finish(figure)


def quality(table: pd.DataFrame) -> Figure:
    """Draws stacked shares of the vehicles of the subset `common` by quality and distance.

    The qualities are missed, low, medium and high, by number of points.
    """
    table = table[(table["set"] == "common") & (table.quality != "hit")]
    # The row that covers all distances is not drawn.
    first_m, last_m = table.from_m.min(), table.to_m.max()
    table = table[~((table.from_m == first_m) & (table.to_m == last_m))]
    figure, axes = panels(table.lidar.unique(), _data_sets(table).unique(), size=(3, 2.4))
    greys = sns.color_palette("cividis_r", len(QUALITIES))
    for ax, column, row in axes:
        part = table[(_data_sets(table) == row) & (table.lidar == column)]
        bottom = np.zeros(part.from_m.nunique())
        for name, colour, hatch in zip(QUALITIES, greys, QUALITY_HATCHES, strict=True):
            bars = part[part.quality == name].sort_values("from_m")
            share = bars.share_percent.fillna(0).to_numpy()
            ax.bar(
                (bars.from_m + bars.to_m) / 2,
                share,
                width=bars.to_m - bars.from_m,
                bottom=bottom,
                label=name,
                color=colour,
                hatch=hatch,
                edgecolor="black",
                linewidth=0.4,
            )
            bottom = bottom + share
        ax.set(xlabel="horizontal distance (m)", ylabel="vehicles (%)", title=f"{column}, {row}")
    return _finish(figure)


def speeds(table: pd.DataFrame) -> Figure:
    """Draws a speed histogram for each scene, with the number of samples beyond the axis."""
    figure, axes = panels(table.scene.unique(), [""], size=(3.4, 2.6))
    for ax, scene, _ in axes:
        part = table[table.scene == scene].drop_duplicates(["from_km_h", "seed"])
        part = part.groupby(["from_km_h", "to_km_h"], as_index=False)[["samples"]].sum()
        inside = part[np.isfinite(part.to_km_h)]
        ax.bar(
            inside.from_km_h,
            100 * inside.samples / max(part.samples.sum(), 1),
            width=inside.to_km_h - inside.from_km_h,
            align="edge",
            color=sns.color_palette("colorblind")[0],
            edgecolor="black",
            linewidth=0.4,
        )
        beyond = part.samples.sum() - inside.samples.sum()
        ax.set(xlabel="speed (km/h)", ylabel="samples (%)", title=scene)
        ax.text(0.98, 0.95, f"beyond: {beyond}", ha="right", va="top", transform=ax.transAxes)
    return _finish(figure)


def lit_share(table: pd.DataFrame) -> Figure:
    """Draws, against integration time, the share of the field of view that rays hit."""
    figure, axes = panels(table.preset.unique(), [""], size=(4.2, 3.2))
    for ax, preset, _ in axes:
        for name, lidar in _lidars(table[table.preset == preset], table):
            ax.plot(
                lidar.time_s, lidar.lit_percent, label=name, markersize=4, **line_of(name, table)
            )
        ax.set(
            xscale="log",
            ylim=(0, 102),
            xlabel="integration time (s)",
            ylabel="field of view lit (%)",
            title=preset,
        )
    return _finish(figure)


def angular_density(table: pd.DataFrame) -> Figure:
    """Draws the density of rays by off-axis angle, and by elevation near the x axis."""
    figure, axes = panels(table.axis.unique(), table.preset.unique(), size=(4.2, 3))
    names = {"off_axis": "angle off the axis (deg)", "elevation": "elevation (deg)"}
    for ax, axis, preset in axes:
        part = table[(table.axis == axis) & (table.preset == preset) & (table.rays > 0)]
        for name, lidar in _lidars(part, table):
            middle = (lidar.from_deg + lidar.to_deg) / 2
            ax.plot(middle, lidar.density, label=name, markersize=3, **line_of(name, table))
        ax.set(
            yscale="log", xlabel=names[axis], ylabel="rays per s and square degree", title=preset
        )
    return _finish(figure)


def dots(value: str, label: str, by: str) -> Callable[[pd.DataFrame], Figure]:
    """Returns a function that draws a value and its interval for each LiDAR.

    The function draws a panel for each value of column `by`.
    """

    def of(table: pd.DataFrame) -> Figure:
        figure, axes = panels(table[by].unique(), [""], size=(4.2, 2.8))
        for ax, panel, _ in axes:
            part = table[table[by] == panel]
            data_sets = list(_data_sets(part).unique())
            names = list(table.lidar.unique())
            for name, lidar in _lidars(part, table):
                shift = 0.12 * (names.index(name) - (len(names) - 1) / 2)
                at = [data_sets.index(p) + shift for p in _data_sets(lidar)]
                middle = lidar[value]
                ends = [middle - lidar.ci_low, lidar.ci_high - middle]
                style = line_of(name, table) | {"linestyle": "none"}
                ax.errorbar(
                    at, middle, np.nan_to_num(ends).clip(min=0), label=name, capsize=2, **style
                )
            ax.set_xticks(range(len(data_sets)), data_sets, rotation=20, ha="right")
            ax.set(ylabel=label, title=str(panel))
        return _finish(figure)

    return of


FIGURES: dict[str, Callable[[pd.DataFrame], Figure]] = {
    "hit_points": dots("hit_points", "points per frame", "above_road"),
    "points_per_vehicle": points_per_vehicle,
    "quality": quality,
    "only_one": dots("share_percent", "hit by this LiDAR only (%)", "set"),
    "speed": speeds,
    "decay": dots("exponent", "decay exponent", "set"),
    "box_points": dots("outside_box_percent", "points outside the box (%)", "set"),
    "aggregation": dots("change_percent", "change (%)", "counted"),
    "lit_share": lit_share,
    "angular_density": angular_density,
}


def _data_sets(table: pd.DataFrame) -> Any:
    """Returns a name for each row's data set: scene and preset.

    Aggregation and seed are appended if the rows differ in them.
    """
    names = table.scene + ", " + table.preset
    if table.aggregation.nunique() > 1:
        names = names + ", " + table.aggregation
    if table.seed.nunique() > 1:
        names = names + ", seed " + table.seed.astype(str)
    return names


def panels(
    columns: Any, rows: Any, size: tuple[float, float], more: tuple[float, float] = (1.2, 0.0)
) -> tuple[Figure, Iterator[tuple[Axes, Any, Any]]]:
    """Returns a figure, and its axes, each with the names of the column and row of its panel.

    size: width and height of a panel. more: width and height of the legend.
    """
    columns, rows = list(dict.fromkeys(columns)), list(dict.fromkeys(rows))
    width, height = size[0] * len(columns) + more[0], size[1] * len(rows) + more[1]
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(len(rows), len(columns), squeeze=False, sharey=True)
    named = (
        (axes[i, j], column, row) for i, row in enumerate(rows) for j, column in enumerate(columns)
    )
    return figure, named


def _finish(figure: Figure) -> Figure:
    """Adds one legend for all panels."""
    labels = handles_of(figure)
    if labels:
        figure.legend(labels.values(), labels.keys(), loc="outside right upper")
    return figure


def handles_of(figure: Figure) -> dict[str, Any]:
    """Returns the legend handles of all panels by label."""
    drawn = [ax.get_legend_handles_labels() for ax in figure.axes]
    return {label: handle for pair in drawn for handle, label in zip(*pair, strict=True)}


def _lidars(part: pd.DataFrame, table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for name in table.lidar.unique():
        rows = part[part.lidar == name]
        if len(rows) > 0:
            yield name, rows


def _colour(name: str, table: pd.DataFrame) -> Any:
    colours = sns.color_palette("colorblind")
    return colours[list(table.lidar.unique()).index(name) % len(colours)]


def line_of(name: str, table: pd.DataFrame) -> dict[str, Any]:
    """Returns the line style of a LiDAR, which is the same in every panel of a table."""
    at = list(table.lidar.unique()).index(name)
    return {
        "color": _colour(name, table),
        "linestyle": LINES[at % len(LINES)],
        "marker": MARKERS[at % len(MARKERS)],
    }
