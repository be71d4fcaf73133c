"""Where a pole would stand if nobody says: off the carriageway beside the biggest junction."""

import math
from dataclasses import dataclass

import numpy as np

from pyinfra.arrays import FloatArray
from pyinfra.site.lane_map import SiteMap
from pyinfra.site.surfaces import Sheet, contains

HEIGHT_M = 6.0
NEAREST_M, FARTHEST_M = 12.0, 80.0  # from the junction's middle
CLEAR_M = 1.0  # from the lanes' edges and from houses


@dataclass(frozen=True)
class Pole:
    """A mount's pose in the world."""

    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float


def guess_pole(found: SiteMap, terrain: Sheet) -> tuple[Pole, str]:
    """The pole, and in words what it looks at."""
    lanes = [lane for lane in found.lanes if lane.kind == "road"]
    points = np.concatenate([lane.centre[:, :2] for lane in lanes])
    clear = np.concatenate([lane.width / 2 + CLEAR_M for lane in lanes])
    driven = [lane for lane in lanes if lane.driveable]
    inside = [
        j for j in found.junctions if np.hypot(*(points - j[1:]).T).min() < FARTHEST_M
    ]  # of a map that was cut
    if inside:
        ways, *place = max(inside, key=lambda j: (j[0], -math.hypot(j[1], j[2])))
        target, what = np.array(place), f"the junction with most ways through ({ways})"
    else:
        longest = max(driven, key=lambda lane: len(lane.centre))
        target, what = longest.centre[len(longest.centre) // 2, :2], f"lane {longest.name}"
    foot = _clear_place(target, points, clear, [thing.outline for thing in found.bodies])
    dense = np.concatenate([lane.centre for lane in driven])
    road_z = dense[np.hypot(*(dense[:, :2] - foot).T).argmin(), 2]
    yaw = math.degrees(math.atan2(*(target - foot)[::-1]))
    x, y, z = (round(float(v), 2) for v in (*foot, road_z + HEIGHT_M))
    return Pole(x, y, z, round(yaw, 1)), what


def _clear_place(
    target: FloatArray, points: FloatArray, clear: FloatArray, houses: list[FloatArray]
) -> FloatArray:
    """The free place nearest to the target; if all is paved, the one that is freest."""
    axis = np.arange(-FARTHEST_M, FARTHEST_M + 1, 1.0)
    offsets = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    distance = np.hypot(*offsets.T)
    order = np.argsort(distance, kind="stable")
    order = order[(distance[order] >= NEAREST_M) & (distance[order] <= FARTHEST_M)]
    near = np.hypot(*(points - target).T) < FARTHEST_M + 20
    best, freest = target, -math.inf
    for offset in offsets[order]:
        place = target + offset
        free = (np.hypot(*(points[near] - place).T) - clear[near]).min(initial=math.inf)
        if any(contains(house, place[None])[0] for house in houses):
            continue
        if free >= 0:
            return np.asarray(place)
        if free > freest:
            best, freest = place, free
    return np.asarray(best)
