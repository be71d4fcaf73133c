"""Compares imported lanes with those of SUMO's network, and finds bodies that stand on lanes."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import MapBody, MapLane
from pyinfra.scenes.maps.surfaces import contains

NEAR_M = 1.0  # maximum distance between the same lane in the map and in SUMO's network
SAME_LEVEL_M = 2.0  # maximum height difference of the same lane in the map and in SUMO's network
STEP_M = 1.0  # distance between points of a lane
LEAST_M = 10.0  # minimum length of compared lanes; lanes of junctions are often shorter
MOST_SHARE = 0.5  # minimum share of a lane that must agree with SUMO's network
MOST_LISTED = 50
AGAINST = "against the network of SUMO"
CLEARANCE_M = 2.5  # height above the terrain from which a body may hang over a lane


def lane_differences(lanes: Sequence[MapLane], network: Sequence[MapLane]) -> list[str]:
    """Returns a message for each driven lane that differs from SUMO's network.

    A lane differs if most of it has no lane of the network at its place, or if the lane there has
    the opposite direction. Traffic follows the network.
    """
    parts = [_dense(lane) for lane in network if lane.driveable]
    if not parts:
        return ["SUMO's network has no lane for vehicles"]
    points, ahead = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    tree = cKDTree(points[:, :2])
    notes = []
    for lane in lanes:
        at, direction = _dense(lane)
        if not lane.driveable or len(at) * STEP_M < LEAST_M:
            continue
        away, nearest = tree.query(at[:, :2])
        same = (away <= NEAR_M) & (np.abs(at[:, 2] - points[nearest, 2]) <= SAME_LEVEL_M)
        along = (direction * ahead[nearest]).sum(1) > 0
        x, y, _ = at[len(at) // 2]
        if same.mean() < MOST_SHARE:
            notes.append(f"lane {lane.name}: not in the network of SUMO at {x:.1f} {y:.1f}")
        elif along[same].mean() < MOST_SHARE:
            notes.append(f"lane {lane.name}: runs {AGAINST} at {x:.1f} {y:.1f}")
    more = len(notes) - MOST_LISTED
    return notes[:MOST_LISTED] + (
        [f"{more} more lanes differ from the network"] if more > 0 else []
    )


def bodies_on_lanes(bodies: Sequence[MapBody], lanes: Sequence[MapLane]) -> list[str]:
    """Returns a message for each body that stands on a lane for vehicles."""
    parts = [(lane, _dense(lane)[0]) for lane in lanes if lane.driveable]
    notes = []
    for body in bodies:
        low, high = body.outline.min(0), body.outline.max(0)
        if body.hangs and body.above_m >= CLEARANCE_M:
            continue
        for lane, points in parts:
            near = points[((points[:, :2] >= low) & (points[:, :2] <= high)).all(1)]
            inside = near[contains(body.outline, near[:, :2])]
            if len(inside) > 0:
                x, y, _ = inside[0]
                name = body.name or "a body"
                notes.append(f"{name}: stands on a lane, {lane.name}, at {x:.1f} {y:.1f}")
                break
    return notes


def _dense(lane: MapLane) -> tuple[FloatArray, FloatArray]:
    """Returns points (n, 3) along a centreline, and the direction (n, 2) at each."""
    centre = lane.centre
    steps = np.diff(centre, axis=0)
    lengths = np.hypot(*steps[:, :2].T)
    s = np.concatenate([[0], np.cumsum(lengths)])
    at = np.arange(STEP_M / 2, max(s[-1], STEP_M), STEP_M)
    points = np.column_stack([np.interp(at, s, centre[:, i]) for i in range(3)])
    segment = np.clip(np.searchsorted(s, at) - 1, 0, len(steps) - 1)
    return points, steps[segment, :2] / np.maximum(lengths[segment, None], 1e-9)
