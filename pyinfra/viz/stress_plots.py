"""Draws AP against severity from the rows of a stress test, with a panel per stressor."""

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyinfra.experiments.stress.stressors import STRESSORS, Stressor
from pyinfra.experiments.stress.summary import curves
from pyinfra.metrics.row_selection import AP_R1000
from pyinfra.viz.scanning_plots import LINES, MARKERS, STYLE, handles_of, save

ACROSS = 4
UNITS = {"1/km": "extinction, 1/km", "times": "factor on the scene's value", "name": ""}


def draw_all(table: pd.DataFrame, out: Path) -> list[Path]:
    """Writes a figure for each LiDAR, preset and scene as SVG and PNG; returns the files."""
    files = []
    for key, rows in table.groupby(["scene", "preset", "lidar"], sort=False):
        if any(curves(rows)):
            stem = out / ("stress_" + "_".join(key))
            save(stress(rows), stem)
            files += [Path(f"{stem}.svg"), Path(f"{stem}.png")]
    return files


def stress(table: pd.DataFrame) -> Figure:
    """Draws a panel per stressor with a line and its interval per detector, for one LiDAR."""
    all_curves = list(curves(table))
    names = [name for name in STRESSORS if any(s.name == name for _, s, _ in all_curves)]
    styles = list(dict.fromkeys(key["detector"] for key, _, _ in all_curves))
    with mpl.rc_context(STYLE), sns.axes_style("whitegrid"):
        down = math.ceil(len(names) / ACROSS)
        across = min(ACROSS, len(names))
        size = (2.8 * across + 0.4, 2.3 * down + 0.6)
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(down, across, squeeze=False, sharey=True)
        for ax, name in zip(axes.flat, names, strict=False):
            selected = [
                (key["detector"], s, curve) for key, s, curve in all_curves if s.name == name
            ]
            panel(ax, selected, styles)
        for ax in axes[:, 0]:
            ax.set_ylabel(AP_R1000)
        for ax in axes.flat[len(names) :]:
            ax.remove()
        handles = handles_of(figure)
        shown = [handles[name] for name in styles]
        figure.legend(shown, styles, loc="outside lower center", ncols=len(styles), frameon=False)
    return figure


def panel(
    ax: Axes,
    stressor_curves: Sequence[tuple[str, Stressor, pd.DataFrame]],
    detectors: Sequence[str] | None = None,
) -> None:
    """Draws the curves of one stressor, one per detector.

    detectors: all detectors in the order that sets their colours; by default those of the curves.
    """
    names = detectors or list(dict.fromkeys(name for name, _, _ in stressor_curves))
    for name, stressor, curve in stressor_curves:
        _line(ax, curve, stressor, names, name)
    _finish(ax, stressor_curves[0][1], pd.concat([curve for _, _, curve in stressor_curves]))


def _line(
    ax: Axes, curve: pd.DataFrame, stressor: Stressor, labels: Sequence[str], label: str
) -> None:
    at = labels.index(label)
    colour = sns.color_palette("colorblind")[at % 10]
    style = {"color": colour, "marker": MARKERS[at % len(MARKERS)], "markersize": 4}
    if stressor.named:
        # Names have no order, so points are drawn side by side without a line.
        ax.errorbar(
            curve["at"] + 0.12 * (at - (len(labels) - 1) / 2),
            curve.ap_r1000,
            yerr=_reach(curve),
            linestyle="",
            elinewidth=0.8,
            label=label,
            **style,
        )
        return
    ax.plot(curve["at"], curve.ap_r1000, label=label, linestyle=LINES[at % len(LINES)], **style)
    ax.fill_between(
        curve["at"], curve.ap_r1000_low, curve.ap_r1000_high, color=colour, alpha=0.2, linewidth=0
    )


def _reach(curve: pd.DataFrame) -> list[pd.Series]:
    """Returns the lengths of the interval's parts below and above AP; 0 if AP is unknown."""
    low, high = curve.ap_r1000 - curve.ap_r1000_low, curve.ap_r1000_high - curve.ap_r1000
    return [low.clip(lower=0).fillna(0), high.clip(lower=0).fillna(0)]


def _finish(ax: Axes, stressor: Stressor, curves: pd.DataFrame) -> None:
    if stressor.named:
        named = curves.drop_duplicates("severity")
        ax.set_xticks(named["at"], named.severity, rotation=25, ha="right")
    ax.set(title=stressor.name.replace("_", " "), ylim=(0, 102))
    ax.set_xlabel(UNITS.get(stressor.unit, stressor.unit))
    if stressor.name == "training_frames":
        ax.invert_xaxis()
