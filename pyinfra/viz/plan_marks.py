"""Marks of plans that are drawn with north up: a scale bar and an arrow to the north."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

ON_TOP = 7  # drawing order of marks that cover roads, buildings and sensors
HALO: dict[str, Any] = {"path_effects": [withStroke(linewidth=3, foreground="white")]}


def draw_scale(axes: Axes, x: float, y: float, length_m: float) -> None:
    """Draws a scale bar whose left end is at x, y."""
    ends = [x, x + length_m], [y, y]
    axes.plot(*ends, color="white", linewidth=4.5, zorder=ON_TOP)
    axes.plot(*ends, color="black", linewidth=2.5, solid_capstyle="butt", zorder=ON_TOP)
    axes.text(ends[0][1], y, f"  {length_m:g} m", va="center", fontsize=7, zorder=ON_TOP, **HALO)


def draw_north(axes: Axes) -> None:
    """Draws an arrow to the north in the upper right corner. The y axis must point north."""
    arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.2, **HALO}
    place: dict[str, Any] = {
        "xycoords": "axes fraction",
        "ha": "center",
        "va": "center",
        "fontsize": 9,
    }
    axes.annotate("N", (0.96, 0.98), (0.96, 0.9), arrowprops=arrow, zorder=ON_TOP, **place, **HALO)
