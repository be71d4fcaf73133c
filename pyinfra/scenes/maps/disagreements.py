"""Finds lanes that overlap at slightly different heights, which is an error of the map."""

import numpy as np

from pyinfra.scenes.maps.lane_map import MapLane
from pyinfra.scenes.maps.surfaces import paved_points

CELL_M = 0.5  # side of the square cells in which heights of lanes are compared
# Smallest height difference that is reported as an error. Even a steep road rises less in a cell.
LEAST_M = 0.1
BRIDGE_M = 2.0  # minimum height difference between a bridge and the lane below it


def disagreements(lanes: list[MapLane]) -> list[str]:
    """Returns a message for each lane that lies slightly below another lane."""
    driven = [lane for lane in lanes if lane.driveable]
    parts = [paved_points([lane]) for lane in driven]
    lane_of = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    points = np.concatenate(parts)
    x, y = np.floor(points[:, :2] / CELL_M).T
    order = np.lexsort([points[:, 2], y, x])
    below, above = order[:-1], order[1:]
    rise = points[above, 2] - points[below, 2]
    same = (x[below] == x[above]) & (y[below] == y[above]) & (lane_of[below] != lane_of[above])
    close = np.flatnonzero(same & (rise > LEAST_M) & (rise < BRIDGE_M))
    messages: dict[int, str] = {}
    for k in close[np.argsort(-rise[close], kind="stable")]:
        lower, upper = driven[lane_of[below[k]]].name, driven[lane_of[above[k]]].name
        position = "{:.1f} {:.1f}".format(*points[below[k], :2])
        text = f"lane {lower}: {rise[k]:.2f} m below lane {upper} at {position}; left unchanged"
        messages.setdefault(int(lane_of[below[k]]), text)
    return list(messages.values())
