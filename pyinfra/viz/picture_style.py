"""The common parts of pictures: style, legend, PNG palette, drawn area, scale bar and north arrow.

The pictures are legible in black and white and for colour-blind readers. The more points a vehicle
has, the darker, thicker and more solid its box is. The colours follow Okabe and Ito.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from PIL import Image

from pyinfra.core.arrays import BoolArray, FloatArray, Floats
from pyinfra.core.files import replacing

STYLE: Any = {"font.size": 8, "axes.titlesize": 9, "axes.linewidth": 0.6}
DPI = 150
REGION_COLOUR = "#F1EDE4"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # one colour per LiDAR
VIEW_LINE: dict[str, Any] = {"color": "black", "linewidth": 0.6, "linestyle": (0, (6, 3))}
ON_TOP = 7  # drawing order of marks that cover roads, buildings and sensors
HALO: dict[str, Any] = {"path_effects": [withStroke(linewidth=3, foreground="white")]}
MARGIN_M = 12.0
HALF_HEIGHT_M = 32.0  # minimum half-height of a picture, above and below its middle


@dataclass(frozen=True)
class Quality:
    """Vehicles with up to `most` points, and the style of their boxes."""

    name: str
    most: float
    colour: str
    line: Any
    width: float


QUALITIES = (
    Quality("missed: 0 points", 0, "#D55E00", (0, (1, 1)), 0.7),
    Quality("low: 1 to 4", 4, "#E69F00", (0, (3, 1)), 1.2),
    Quality("medium: 5 to 20", 20, "#0090C8", "-", 1.1),
    Quality("high: more than 20", np.inf, "#00205B", "-", 1.6),
)
PEOPLE = Quality("people", np.inf, "#009E73", "-", 1.1)


def in_chart(low: pd.Series, drawn: pd.Series) -> pd.Series:
    """Returns which intervals have a lower end that a logarithmic chart can show.

    The chart is assumed to begin at half its smallest positive value. low: lower ends of the
    intervals. drawn: all values of the chart.
    """
    return low > 0.5 * drawn[drawn > 0].min()


def save(figure: Figure, file: Path, dpi: int = DPI) -> None:
    """Writes a PNG with the fixed palette of these pictures. The palette keeps the file small."""
    with mpl.rc_context(STYLE), io.BytesIO() as png:
        figure.savefig(png, format="png", dpi=dpi)
        with Image.open(png) as image:
            few = image.convert("RGB").quantize(palette=_palette(), dither=Image.Dither.NONE)
    with replacing(file) as beside:
        few.save(beside, format="png", optimize=True)


def _palette() -> Image.Image:
    """Returns the palette: greys, the region's colour, and for each colour its tints to white."""
    greys = np.repeat(np.linspace(0, 1, 32)[:, None], 3, axis=1)
    lines = np.array([to_rgb(c) for c in (*(look.colour for look in QUALITIES), *COLOURS)])
    steps = [1 - share * (1 - lines) for share in (1.0, 0.8, 0.6, 0.4)]
    colours = np.concatenate([greys, [to_rgb(REGION_COLOUR)], *steps])
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.rint(255 * colours).astype(np.uint8).tobytes())
    return palette


def legend_below(figure: Figure, handles: Sequence[Artist]) -> None:
    """Adds a legend under the axes, with as many columns as fit into the figure's width."""
    style: Any = {"handles": handles, "loc": "outside lower center", "frameon": False}
    empty = Figure(figsize=(figure.get_figwidth(), figure.get_figheight()))
    for columns in range(len(handles), 0, -1):
        tried = empty.legend(ncols=columns, **style)
        if columns == 1 or tried.get_window_extent().width <= empty.bbox.width:
            break
    figure.legend(ncols=columns, **style)


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


@dataclass(frozen=True)
class DrawnArea:
    """The drawn part of a plane."""

    x: tuple[float, float]
    y: tuple[float, float]

    def shape(self) -> tuple[float, float]:
        return self.x[1] - self.x[0], self.y[1] - self.y[0]

    def holds(self, xy: Floats) -> BoolArray:
        """Returns whether positions (n, 2) lie in the area: (n,) bool."""
        low, high = np.transpose([self.x, self.y])
        return np.asarray(((xy >= low) & (xy <= high)).all(axis=1))


def window_around(outlines: Sequence[FloatArray]) -> DrawnArea:
    """Returns an area around road outlines (n, 2), with a margin and a minimum height."""
    x, y = np.concatenate(outlines).T
    middle = (y.min() + y.max()) / 2
    half = max((y.max() - y.min()) / 2 + MARGIN_M, HALF_HEIGHT_M)
    return DrawnArea(
        (float(x.min() - MARGIN_M), float(x.max() + MARGIN_M)),
        (float(middle - half), float(middle + half)),
    )
