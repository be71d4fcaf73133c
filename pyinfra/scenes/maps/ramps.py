"""Computes the heights of ramps between roads at several levels."""

import heapq
import math
from collections.abc import Iterable

CLEARANCE_M = 6.0  # intended height difference between the surfaces of crossing roads
RAMP_M = 150.0  # length of a ramp that rises by CLEARANCE_M; its steepest grade is 6 %


def ramp_shares(
    next_: dict[str, dict[str, float]], way: list[str], still: set[str], height_m: float
) -> dict[str, float]:
    """Maps each node near a lifted or lowered way to the node's share of the way's height.

    The share is 1 on the way, and 0 at the ends of ramps and at fixed nodes.
    """
    length = RAMP_M * max(1.0, height_m / CLEARANCE_M)
    back = _distances(next_, still, length)
    shares = {}
    for node, metres in _distances(next_, way, length).items():
        ramp = min(length, metres + back.get(node, math.inf))
        u = min(1.0, metres / ramp) if ramp > 0 else 1.0
        shares[node] = 1 - u * u * (3 - 2 * u)
    return shares


def _distances(
    next_: dict[str, dict[str, float]], sources: Iterable[str], limit: float
) -> dict[str, float]:
    """Maps each node within the limit to its distance along the ways from the nearest source."""
    distances: dict[str, float] = {}
    heap = [(0.0, i) for i in sorted(sources)]
    while heap:
        metres, node = heapq.heappop(heap)
        if node in distances:
            continue
        distances[node] = metres
        for other, step in next_.get(node, {}).items():
            if other not in distances and metres + step <= limit:
                heapq.heappush(heap, (metres + step, other))
    return distances
