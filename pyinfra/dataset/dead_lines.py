"""Finds lines of a LiDAR without points from the first frame on, such as those of a dead laser.

A line is missing if the lines next to it have points, and the angle between them is too large.
Lines whose numbers do not follow their elevation are not checked, because a line without points may
then look at the sky.
"""

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, Points, Records

LEAST_LINES = 8  # recordings with fewer scan lines are not checked for dead lines
LEAST_POINTS = 20  # minimum median number of points per frame of a scan line that works
# Minimum angle between the two lines beside a missing line, relative to the usual angle between two
# lines with a difference of 2 in their numbers.
WIDE = 1.6
# If a larger share of the lines is missing, `ring` probably does not contain line numbers.
MOST_SHARE = 0.25


def elevations_of(points: Points, records: Records) -> FloatArray:
    """Returns the mean elevation of the points of each line: (lines,) radians, NaN if none."""
    ring = records["ring"].astype(np.int64)
    xyz = points[:, :3].astype(np.float64)
    angle = np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1]))
    counts = np.bincount(ring)
    sums = np.bincount(ring, weights=angle)
    return np.asarray(np.where(counts > 0, sums / np.maximum(counts, 1), np.nan))


def dead_lines(counts: IntArray, elevations: FloatArray) -> list[int]:
    """Returns the numbers of the lines that have no points in any frame, because a laser is dead.

    counts, elevations: (frames, lines) number of points of each line, and their mean elevation.
    """
    if counts.shape[1] < LEAST_LINES:
        return []
    usual = np.median(counts, axis=0)
    alive = np.flatnonzero(usual >= LEAST_POINTS)
    if len(alive) < LEAST_LINES:
        return []
    gaps = np.diff(np.nanmedian(elevations[:, alive], axis=0))
    if not ((gaps > 0).all() or (gaps < 0).all()):
        return []
    between = np.diff(alive)
    step = np.abs(gaps)
    single = float(np.median(step[between == 1])) if (between == 1).any() else np.inf
    missing: list[int] = []
    for k in np.flatnonzero(between > 1):
        inner = range(int(alive[k]) + 1, int(alive[k + 1]))
        beside = [step[j] for j in (k - 1, k + 1) if 0 <= j < len(step) and between[j] == 1]
        local = float(np.mean(beside)) if beside else single
        if not counts[:, list(inner)].any() and step[k] > WIDE * local * (between[k] / 2):
            missing += inner
    return missing if len(missing) <= MOST_SHARE * (len(alive) + len(missing)) else []
