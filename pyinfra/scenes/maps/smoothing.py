"""Converts front bumper positions of a traffic simulator to boxes with realistic motion.

A sideways jump, which is a lane change in one step, is replaced by a ramp over 3 seconds.
Positions are averaged over a short time. The rear axle follows the front axle, so that heading and
centre are those of a body on two axles. A track that still turns or accelerates too hard is
averaged over longer times. If no averaging helps, the track is refused.
"""

import math

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pyinfra.core.arrays import FloatArray
from pyinfra.core.boxes import wrapped
from pyinfra.scenes.maps.tracks import HEADING, STEP_S, FrontPath, Track

MAX_TURN_DEG = 5.0  # maximum change of heading per 0.1 s
MAX_ACCELERATION_M_S2 = 8.0  # maximum acceleration of the box centre, over 0.3 s
_OVER = 3  # number of steps of 0.1 s between the positions from which accelerations are computed
_AVERAGE_S = (0.4, 0.6, 0.9, 1.3, 2.0)  # standard deviations of the averaging, tried in this order
_JUMP_M = 0.3  # deviation from the mean of the neighbouring steps that counts as a jump
_SPREAD_S = 3.0  # duration of a lane change, over which a jump is spread
# Overhang and wheelbase relative to the length, as for many cars and lorries.
_OVERHANG, _WHEELBASE = 0.2, 0.6
# Maximum turn per step. The limit is needed because pedestrians turn on the spot.
_SLEW_RAD = math.radians(4.5)


def smooth(path: FrontPath) -> Track | None:
    """Returns the track of a front bumper's path, or None if no averaging meets the limits."""
    points = spread_jumps(path.points)
    for seconds in _AVERAGE_S:
        track = _track(path, _averaged(points, seconds))
        if within_limits(track):
            return track
    return None


def unsmoothed(path: FrontPath) -> Track:
    """Returns the track without smoothing.

    The box centre is half a length behind the front bumper.
    """
    length, _, height = path.size_m
    ahead = np.stack([np.cos(path.heading), np.sin(path.heading)], axis=1)
    centre = path.points.copy()
    centre[:, :2] -= ahead * length / 2
    centre[:, 2] += height / 2
    return _of_poses(path, centre, path.heading, np.zeros(len(centre)))


def within_limits(track: Track) -> bool:
    """Returns whether all turns and accelerations of a track are within the limits."""
    turn = turns_deg(track)
    acceleration = accelerations(track)
    return bool((turn <= MAX_TURN_DEG).all() and (acceleration <= MAX_ACCELERATION_M_S2).all())


def turns_deg(track: Track) -> FloatArray:
    """Returns the change of heading (n - 1,) in each 0.1 s, in degrees."""
    return np.asarray(np.degrees(np.abs(wrapped(np.diff(track.states[:, HEADING])))))


def accelerations(track: Track) -> FloatArray:
    """Returns the horizontal accelerations (n - 6,) of the box centre in m/s2.

    Each acceleration is computed from three positions that are 0.3 s apart. A short track has no
    acceleration.
    """
    p = track.states[:, :2]
    if len(p) <= 2 * _OVER:
        return np.zeros(0)
    second = p[2 * _OVER :] - 2 * p[_OVER:-_OVER] + p[: -2 * _OVER]
    return np.asarray(np.linalg.norm(second, axis=1) / (_OVER * STEP_S) ** 2)


def spread_jumps(points: FloatArray) -> FloatArray:
    """Replaces jumps of points (n, 3) by ramps over time.

    A jump is a step that differs from the mean of its neighbouring steps.
    """
    out = points.copy()
    steps = np.diff(points[:, :2], axis=0)
    if len(steps) < 3:
        return out
    expected = (steps[:-2] + steps[2:]) / 2
    extra = steps[1:-1] - expected
    half = round(_SPREAD_S / STEP_S / 2)
    jumps = np.flatnonzero(np.linalg.norm(extra, axis=1) > _JUMP_M) + 1
    for k in map(int, jumps):
        near = [np.linalg.norm(extra[i]) for i in (k - 2, k) if 0 <= i < len(extra)]
        if np.linalg.norm(extra[k - 1]) < max(near):
            continue  # a larger jump in a neighbouring step causes this deviation
        around = np.arange(max(0, k + 1 - half), min(len(points), k + 1 + half))
        u = np.clip((around - k - 0.5) / (2 * half) + 0.5, 0, 1)
        ramp = u * u * u * (u * (6 * u - 15) + 10) - (around > k)
        out[around, :2] += ramp[:, None] * extra[k - 1]
    return out


def _averaged(points: FloatArray, seconds: float) -> FloatArray:
    """Averages points over time with a Gaussian. Both ends are extended at constant velocity."""
    sigma = seconds / STEP_S
    pad = math.ceil(4 * sigma)
    if len(points) < 2:
        return points
    ahead = np.arange(1, pad + 1)[:, None]
    near = min(len(points) - 1, 5)
    first_step = (points[near] - points[0]) / near
    last_step = (points[-1] - points[-1 - near]) / near
    before = points[0] - ahead[::-1] * first_step
    after = points[-1] + ahead * last_step
    padded = np.concatenate([before, points, after])
    return np.asarray(gaussian_filter1d(padded, sigma, axis=0)[pad:-pad])


def _track(path: FrontPath, points: FloatArray) -> Track:
    """Returns the track of a body on two axles, or of a pedestrian who faces forwards."""
    if path.object_class == "Pedestrian":
        heading = _slewed(_walking_headings(path, points))
        centre = points + np.array([0, 0, path.size_m[2] / 2])
        return _of_poses(path, centre, heading, np.zeros(len(points)))
    length, _, height = path.size_m
    front, rear = _axles(path, points)
    along = front - rear
    heading = np.arctan2(along[:, 1], along[:, 0])
    pitch = -np.arctan2(along[:, 2], _WHEELBASE * length)
    middle = (front + rear) / 2  # the middle of the box, since both overhangs are equal
    centre = middle + np.stack([0 * pitch, 0 * pitch, np.cos(pitch) * height / 2], axis=1)
    slewed = _slewed(heading)
    # If the turn per step is limited, the box is rotated about its front bumper.
    bumper = points[:, :2] - middle[:, :2]
    turned = np.abs(wrapped(slewed - heading)) > 1e-9
    ahead = np.stack([np.cos(slewed), np.sin(slewed)], axis=1) * length / 2
    centre[turned, :2] = (middle[:, :2] + bumper - ahead)[turned]
    return _of_poses(path, centre, slewed, pitch)


def _axles(path: FrontPath, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the paths (n, 3) of front and rear axle.

    Both axles are points of a rod. The front end of the rod, the bumper, is pulled along the path.
    """
    length = float(path.size_m[0])
    reach = (1 - _OVERHANG) * length
    rear_xy = _followed(points[:, :2], float(path.heading[0]), reach)
    ahead = points[:, :2] - rear_xy
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    front_xy = points[:, :2] - ahead * _OVERHANG * length
    z = _heights_behind(points, np.array([_OVERHANG, 1 - _OVERHANG]) * length)
    return np.column_stack([front_xy, z[:, 0]]), np.column_stack([rear_xy, z[:, 1]])


def _followed(points: FloatArray, heading: float, reach: float) -> FloatArray:
    """Returns the path (n, 2) of the end of a rod of length `reach` pulled along points (n, 2)."""
    x = float(points[0, 0]) - reach * math.cos(heading)
    y = float(points[0, 1]) - reach * math.sin(heading)
    out = np.empty_like(points)
    for i, (to_x, to_y) in enumerate(points.tolist()):
        apart = math.hypot(to_x - x, to_y - y) or reach
        x = to_x - (to_x - x) / apart * reach
        y = to_y - (to_y - y) / apart * reach
        out[i] = x, y
    return out


def _heights_behind(points: FloatArray, behind_m: FloatArray) -> FloatArray:
    """Returns z (n, k) of a path (n, 3) at distances (k,) behind each point of the path.

    Before the first point, the path is extended with the slope at the first point.
    """
    steps = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(steps)])
    moving = np.concatenate([[True], np.diff(s) > 1e-9])
    s_known, z_known = s[moving], points[moving, 2]
    slope = 0.0
    if s_known[-1] > 1:
        slope = float(np.interp(1.0, s_known, z_known) - z_known[0])
    at = s[:, None] - behind_m
    return np.asarray(np.interp(at, s_known, z_known) + slope * np.minimum(at, 0))


def _walking_headings(path: FrontPath, points: FloatArray) -> FloatArray:
    step = np.gradient(points[:, :2], axis=0) if len(points) > 1 else np.zeros((1, 2))
    moving = np.linalg.norm(step, axis=1) > 0.03
    heading = np.where(moving, np.arctan2(step[:, 1], step[:, 0]), np.nan)
    if not moving.any():
        return path.heading[:1].repeat(len(points))
    last = np.maximum.accumulate(np.where(moving, np.arange(len(points)), -1))
    last[last < 0] = np.flatnonzero(moving)[0]
    return np.asarray(heading[last])


def _slewed(heading: FloatArray) -> FloatArray:
    """Returns the headings (n,) with a limited turn per step."""
    if (np.abs(wrapped(np.diff(heading))) <= _SLEW_RAD).all():
        return heading
    out = heading.tolist()
    for i in range(1, len(out)):
        turn = (out[i] - out[i - 1] + math.pi) % (2 * math.pi) - math.pi
        out[i] = out[i - 1] + min(max(turn, -_SLEW_RAD), _SLEW_RAD)
    return np.asarray(wrapped(np.array(out)))


def _of_poses(path: FrontPath, centre: FloatArray, heading: FloatArray, pitch: FloatArray) -> Track:
    velocity = np.gradient(centre, STEP_S, axis=0) if len(centre) > 1 else np.zeros((1, 3))
    speed = np.linalg.norm(velocity, axis=1)
    states = np.column_stack([centre, wrapped(heading), pitch, speed])
    return Track(path.name, path.object_class, path.size_m, path.first, states)
