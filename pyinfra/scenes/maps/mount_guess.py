"""Chooses a default pole beside the largest junction, off the carriageway.

The yaw is chosen so that a narrow field of view contains the junction and the greatest total length
of lanes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import FloatArray, Rows
from pyinfra.scenes.maps.lane_map import MapLane, SiteMap
from pyinfra.scenes.maps.surfaces import contains, to_segments

HEIGHT_M = 6.0  # height of the sensor above the road
NEAREST_M, FARTHEST_M = 12.0, 80.0  # minimum and maximum distance of the pole from the junction
CLEAR_M = 1.0  # minimum distance of the pole from lane edges and buildings
CLEAR_OF_TREES_M = 5.0
SEEN_M, SEEN_DEG = 100.0, 70.0  # range and width of the field of view for choosing the yaw
YAW_STEP_DEG = 5.0
# Maximum angle between the yaw and the direction to the target, for a junction and for a lane.
JUNCTION_OFF_DEG, LANE_OFF_DEG = 30.0, 60.0


@dataclass(frozen=True)
class Pole:
    """The pose of a mount in the world frame."""

    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float


def guess_pole(site_map: SiteMap) -> tuple[Pole, str]:
    """Returns the pole, and a text that names the junction or lane beside the pole."""
    lanes = [lane for lane in site_map.lanes if lane.kind == "road"]
    strips = _Strips.of(lanes)
    points = strips.start
    driven = [lane for lane in lanes if lane.driveable]
    inside = [
        j for j in site_map.junctions if np.hypot(*(points - j[1:]).T).min() < FARTHEST_M
    ]  # after the map was cut, some junctions have no lanes nearby
    if inside:
        ways, *centre = max(inside, key=lambda j: (j[0], -math.hypot(j[1], j[2])))
        target, beside = np.array(centre), f"the junction with most connections ({ways})"
    else:
        longest = max(driven, key=lambda lane: len(lane.centre))
        target, beside = longest.centre[len(longest.centre) // 2, :2], f"lane {longest.name}"
    foot = _clear_position(target, strips, site_map)
    dense = np.concatenate([lane.centre for lane in driven])
    road_z = dense[np.hypot(*(dense[:, :2] - foot).T).argmin(), 2]
    x, y, z = (round(float(v), 2) for v in (*foot, road_z + HEIGHT_M))
    off_deg = JUNCTION_OFF_DEG if inside else LANE_OFF_DEG
    return Pole(x, y, z, _yaw_deg(foot, target, driven, off_deg)), beside


def _yaw_deg(foot: FloatArray, target: FloatArray, lanes: list[MapLane], off_deg: float) -> float:
    """Returns the yaw at which the field of view contains the target and most of the lanes.

    Lanes are weighted by their length. Of several equally good yaws, the middle one is returned.
    """
    middles = [(lane.centre[1:] + lane.centre[:-1])[:, :2] / 2 - foot for lane in lanes]
    metres = [np.hypot(*np.diff(lane.centre[:, :2], axis=0).T) for lane in lanes]
    ways, weights = np.concatenate(middles), np.concatenate(metres)
    near = np.hypot(*ways.T) < SEEN_M
    at = np.degrees(np.arctan2(*ways[near].T[::-1]))
    to_target = math.degrees(math.atan2(*(target - foot)[::-1]))
    yaws = to_target + np.arange(-off_deg, off_deg + 1, YAW_STEP_DEG)
    off = np.abs((at - yaws[:, None] + 180) % 360 - 180)
    seen_m = ((off < SEEN_DEG / 2) * weights[near]).sum(1)
    best = np.flatnonzero(seen_m >= seen_m.max() - 1)
    run = best[: int(np.argmax(np.diff(best, append=np.inf) > 1)) + 1]
    return round(math.remainder(float(yaws[run[len(run) // 2]]), 360), 1)


def _clear_position(
    target: FloatArray, strips: _Strips, site_map: SiteMap, farthest_m: float = FARTHEST_M
) -> FloatArray:
    """Returns the free position nearest to the target.

    If there is no free position within `farthest_m`, the search is repeated with twice the default
    radius. If this search fails too, the position that is farthest from the lanes is returned.
    """
    axis = np.arange(-farthest_m, farthest_m + 1, 1.0)
    offsets = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    distance = np.hypot(*offsets.T)
    order = np.argsort(distance, kind="stable")
    order = order[(distance[order] >= NEAREST_M) & (distance[order] <= farthest_m)]
    reach = farthest_m + 20
    near = strips.select(np.hypot(*(strips.start - target).T) < reach)
    trees = np.array([(tree.x_m, tree.y_m) for tree in site_map.trees]).reshape(-1, 2)
    outlines = [thing.outline for thing in site_map.bodies] + site_map.areas
    outlines = [o for o in outlines if np.hypot(*(o - target).T).min() < reach]
    middles = np.array([o.mean(0) for o in outlines]).reshape(-1, 2)
    radii = np.array([np.hypot(*(o - o.mean(0)).T).max() for o in outlines])
    best, freest = target, -math.inf
    for offset in offsets[order]:
        position = target + offset
        away = to_segments(position, near.start, near.end)
        free = float((away - near.clear).min(initial=math.inf))
        if np.hypot(*(trees - position).T).min(initial=math.inf) < CLEAR_OF_TREES_M:
            continue
        beside = np.flatnonzero(np.hypot(*(middles - position).T) < radii + CLEAR_M)
        if any(_is_close(outlines[i], position) for i in beside):
            continue
        if free >= 0:
            return np.asarray(position)
        if free > freest:
            best, freest = position, free
    if farthest_m == FARTHEST_M and freest < 0:
        return _clear_position(target, strips, site_map, 2 * FARTHEST_M)
    return np.asarray(best)


@dataclass(frozen=True)
class _Strips(Rows):
    """Segments of lane centrelines, and the minimum distance of a free position from each."""

    start: FloatArray  # start points (n, 2)
    end: FloatArray  # end points (n, 2)
    clear: FloatArray  # minimum distances (n,), metres

    @staticmethod
    def of(lanes: list[MapLane]) -> _Strips:
        half = [np.maximum(lane.width[1:], lane.width[:-1]) / 2 + CLEAR_M for lane in lanes]
        ends = [
            np.concatenate([lane.centre[i : len(lane.centre) - 1 + i, :2] for lane in lanes])
            for i in (0, 1)
        ]
        return _Strips(ends[0], ends[1], np.concatenate(half))


def _is_close(outline: FloatArray, position: FloatArray) -> bool:
    """Returns whether a position lies in an outline (n, 2) or within CLEAR_M of it."""
    away = to_segments(position, outline, np.roll(outline, -1, axis=0))
    return bool(away.min() < CLEAR_M) or bool(contains(outline, position[None])[0])
