"""Draws the scan patterns of LiDARs, as seen from the sensor."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pyinfra.core.arrays import FloatArray
from pyinfra.viz.picture_style import STYLE, DrawnArea

CAR_AT_M = 60.0
# Azimuth and elevation (rad) of a car's rear, 1.8 m wide and 1.5 m high. The sensor is 6 m higher
# than the car's bottom edge.
CAR = np.arctan(np.array([[-0.9, -6.0], [0.9, -4.5]]) / CAR_AT_M)
FIELD = DrawnArea((-40, 40), (-40, 40))  # drawn azimuths and elevations in degrees
CLOSE_UP = DrawnArea((-3, 3), (-8, -2))


def pattern_picture(patterns: Mapping[str, FloatArray], periods_s: Mapping[str, float]) -> Figure:
    """Draws the directions of each LiDAR's rays: all rays, and the rays on a car's rear at 60 m.

    patterns: by name, (n, 3) azimuth, elevation (rad) and time (s), from 0 s on. Only the rays of
    the first frame are drawn. The mean number of rays on the car is computed from all rays.
    periods_s: frame periods by name.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.5 * len(patterns) + 0.3, 5.3), layout="constrained")
        grid = figure.subplots(2, len(patterns), squeeze=False, sharey="row")
        for column, (name, rays) in enumerate(patterns.items()):
            field, close = grid[:, column]
            period_s = periods_s[name]
            frame = np.degrees(rays[rays[:, 2] < period_s, :2])
            _draw_rays(field, frame, FIELD, 0.35)
            _draw_rays(close, frame, CLOSE_UP, 2.3)
            low, high = np.degrees(CAR)
            size = high - low
            car = Rectangle(low, *size, fill=False, edgecolor="#D55E00", linewidth=1.6)
            close.add_patch(car)
            on_car = ((rays[:, :2] > CAR[0]) & (rays[:, :2] < CAR[1])).all(axis=1)
            frames = max(1, round(float(rays[:, 2].max()) / period_s))
            field.set_title(f"{name}\n{len(frame):,} rays in {period_s:g} s")
            close.set_title(
                f"on a car's rear at {CAR_AT_M:g} m:\n{on_car.sum() / frames:.0f} rays on average"
            )
            close.set_xlabel("azimuth (°)")
        for axes in grid[:, 0]:
            axes.set_ylabel("elevation (°)")
    return figure


def _draw_rays(axes: Axes, degrees: FloatArray, window: DrawnArea, size: float) -> None:
    drawn = degrees[window.holds(degrees)]
    axes.plot(
        drawn[:, 0],
        drawn[:, 1],
        linestyle="none",
        marker="o",
        markersize=size,
        color="black",
        markeredgewidth=0,
    )
    axes.set_aspect("equal")
    axes.set_xlim(*reversed(window.x))  # azimuth grows to the left, as seen from the sensor
    axes.set_ylim(*window.y)
