"""Where a pole would stand if nobody says: off the carriageway beside the biggest junction.

It looks where a narrow field of view holds most metres of lanes.
"""

import math
from dataclasses import dataclass

import numpy as np

from pyinfra.arrays import FloatArray
from pyinfra.site.lane_map import MapLane, SiteMap
from pyinfra.site.surfaces import contains

HEIGHT_M = 6.0
NEAREST_M, FARTHEST_M = 12.0, 80.0  # from the junction's middle
CLEAR_M = 1.0  # from the lanes' edges and from houses
CLEAR_OF_TREES_M = 5.0
SEEN_M, SEEN_DEG = 100.0, 70.0  # of roads that the yaw is chosen by
YAW_STEP_DEG = 5.0


@dataclass(frozen=True)
class Pole:
    """A mount's pose in the world."""

    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float


def guess_pole(found: SiteMap) -> tuple[Pole, str]:
    """The pole, and in words what it stands beside."""
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
    foot = _clear_place(target, points, clear, found)
    dense = np.concatenate([lane.centre for lane in driven])
    road_z = dense[np.hypot(*(dense[:, :2] - foot).T).argmin(), 2]
    x, y, z = (round(float(v), 2) for v in (*foot, road_z + HEIGHT_M))
    return Pole(x, y, z, _yaw_deg(foot, driven)), what


def _yaw_deg(foot: FloatArray, lanes: list[MapLane]) -> float:
    """Where most metres of lanes lie within a field of view; of several the middle one."""
    middles = [(lane.centre[1:] + lane.centre[:-1])[:, :2] / 2 - foot for lane in lanes]
    metres = [np.hypot(*np.diff(lane.centre[:, :2], axis=0).T) for lane in lanes]
    ways, weights = np.concatenate(middles), np.concatenate(metres)
    near = np.hypot(*ways.T) < SEEN_M
    at = np.degrees(np.arctan2(*ways[near].T[::-1]))
    yaws = np.arange(-180, 180, YAW_STEP_DEG)
    off = np.abs((at - yaws[:, None] + 180) % 360 - 180)
    seen = ((off < SEEN_DEG / 2) * weights[near]).sum(1)
    best = np.flatnonzero(seen >= seen.max() - 1)
    run = best[: int(np.argmax(np.diff(best, append=np.inf) > 1)) + 1]
    return float(yaws[run[len(run) // 2]])


def _clear_place(
    target: FloatArray, points: FloatArray, clear: FloatArray, found: SiteMap
) -> FloatArray:
    """The free place nearest to the target; if all is paved, the one that is freest."""
    axis = np.arange(-FARTHEST_M, FARTHEST_M + 1, 1.0)
    offsets = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    distance = np.hypot(*offsets.T)
    order = np.argsort(distance, kind="stable")
    order = order[(distance[order] >= NEAREST_M) & (distance[order] <= FARTHEST_M)]
    near = np.hypot(*(points - target).T) < FARTHEST_M + 20
    trees = np.array([(tree.x_m, tree.y_m) for tree in found.trees]).reshape(-1, 2)
    best, freest = target, -math.inf
    for offset in offsets[order]:
        place = target + offset
        free = (np.hypot(*(points[near] - place).T) - clear[near]).min(initial=math.inf)
        if np.hypot(*(trees - place).T).min(initial=math.inf) < CLEAR_OF_TREES_M:
            continue
        if any(_is_close(thing.outline, place) for thing in found.bodies):
            continue
        if free >= 0:
            return np.asarray(place)
        if free > freest:
            best, freest = place, free
    return np.asarray(best)


def _is_close(outline: FloatArray, place: FloatArray) -> bool:
    """Whether a place lies in an outline (n, 2) or within CLEAR_M of it."""
    sides = np.roll(outline, -1, axis=0) - outline
    along = ((place - outline) * sides).sum(1) / np.maximum((sides**2).sum(1), 1e-12)
    away = outline + along.clip(0, 1)[:, None] * sides - place
    return bool(np.hypot(*away.T).min() < CLEAR_M) or bool(contains(outline, place[None])[0])
