"""Colours, lines and markers: a LiDAR looks the same in every figure of the report.

Figures are drawn in the colours of light mode. In the page each colour is a variable, so that dark
mode can replace it. Lines and markers differ too, for black and white and for colour-blind readers.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from pyinfra.viz.scanning_plots import LINES, MARKERS

INK, FAINT, GRID, GROUND = "#262626", "#6a6a6a", "#cccccc", "#ffffff"
ACCENT = "#0b5cad"
SERIES = (  # colours on the light and the dark page; the first four are those of catalogue.LIDARS
    ("#0072b2", "#5ab4ee"),
    ("#b65a00", "#f2a65a"),
    ("#00805c", "#46cfa2"),
    ("#a03a7a", "#ea93c8"),
    ("#5b4bc4", "#aaa0ff"),
    ("#7a6a00", "#d9c64a"),
    ("#00737f", "#57cbd6"),
    ("#777777", "#b4b4b4"),
)
QUALITIES = {  # area colours of evaluation_plots: name, colour on the light and on the dark page
    "#00204d": ("high", "#0b5cad", "#6fb4f6"),
    "#7c7b78": ("undecided", "#9dc0e2", "#35587a"),
    "#ffe945": ("low", "#e4e4e0", "#3b3c40"),
}
DARK = {INK: "#e8e8e6", FAINT: "#a9a9a6", GRID: "#3d3f43", GROUND: "#17181b", ACCENT: "#6fb4f6"}
NAMES = {INK: "ink", FAINT: "faint", GRID: "grid", GROUND: "ground", ACCENT: "accent"} | {
    light: f"series-{i}" for i, (light, _) in enumerate(SERIES)
}
NAMES |= {colour: name for colour, (name, _, _) in QUALITIES.items()}
LABEL_MARGIN_IN = 0.03
STYLE: Any = {
    "svg.fonttype": "none",
    "text.parse_math": False,  # a name may contain dollar signs
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "hatch.linewidth": 0.6,
}
AXES: dict[str, Any] = {
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


@dataclass(frozen=True)
class Look:
    """The line style of one series."""

    colour: str
    line: Any
    marker: str

    def style(self) -> dict[str, Any]:
        return {"color": self.colour, "linestyle": self.line, "marker": self.marker}


def look(index: int) -> Look:
    """Returns the style of the LiDAR at an index in the order of all LiDARs."""
    return Look(
        SERIES[index % len(SERIES)][0], LINES[index % len(LINES)], MARKERS[index % len(MARKERS)]
    )


def themes() -> tuple[dict[str, str], dict[str, str]]:
    """Returns the colours by name on the light and on the dark page."""
    light = {c: c for c in NAMES} | {c: hex_colour for c, (_, hex_colour, _) in QUALITIES.items()}
    dark = DARK | dict(SERIES) | {c: hex_colour for c, (_, _, hex_colour) in QUALITIES.items()}
    return {n: light[c] for c, n in NAMES.items()}, {n: dark[c] for c, n in NAMES.items()}


@contextmanager
def drawing() -> Iterator[None]:
    """Applies the report's style to figures made inside the context."""
    with mpl.rc_context(STYLE), sns.axes_style("whitegrid", AXES):
        yield


def panel(width: float = 3.7, height: float = 2.6) -> tuple[Figure, Axes]:
    """Returns a small figure with one set of axes. The size is in inches."""
    figure = Figure(figsize=(width, height))
    edges = {"left": 0.5 / width, "bottom": 0.43 / height}
    return figure, figure.subplots(
        gridspec_kw=edges | {"right": 1 - 0.12 / width, "top": 1 - 0.08 / height}
    )


def fit_labels(figure: Figure) -> None:
    """Widens the margins of a panel so that all labels are inside the figure.

    Labels that would leave the plot less than a third of the width are cut.
    """
    (axes,) = figure.axes
    (width, height), drawn, place = (
        figure.get_size_inches(),
        figure.get_tightbbox(),
        axes.get_position(),
    )
    left = place.x0 + max(0.0, LABEL_MARGIN_IN - drawn.x0) / width
    right = place.x1 - max(0.0, drawn.x1 - width + LABEL_MARGIN_IN) / width
    bottom = place.y0 + max(0.0, LABEL_MARGIN_IN - drawn.y0) / height
    top = place.y1 - max(0.0, drawn.y1 - height + LABEL_MARGIN_IN) / height
    left = min(left, right - 0.33)
    axes.set_position((left, bottom, right - left, top - bottom))


def log_ticks(axis: Any) -> None:
    """Puts plain numbers at 1, 2 and 5 times the powers of ten."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter("{x:,g}")
