"""Whether the road of some clouds lies where the sensor's height puts it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error
from pyinfra.dataset.ground import MOST_HEIGHT_M
from pyinfra.dataset.road_plane import road_of

CHECKED = 5  # clouds, for their road
HEIGHT_OFF_M = 0.2  # beyond the errors that version 3 of the pretrained detector learnt from
LEAN_DEG = 0.3  # a quarter of a degree cost it 3 to 9 AP, half of one 8 to 25


def check_height(height_m: float) -> None:
    """Raises Error for a height of a sensor above the road that no pole has."""
    if not 0 < height_m <= MOST_HEIGHT_M:
        raise Error(f"height_m: expected more than 0 to {MOST_HEIGHT_M:g}, got {height_m:g}")


def height_warnings(clouds: Sequence[Points], height_m: float) -> Iterator[str]:
    """Says where the road lies elsewhere: a network sees vehicles by their height above it.

    clouds: (n, 4) each, levelled LiDAR frame; nothing is said where little ground is seen.
    """
    road = road_of(clouds)
    if road is None:
        return
    if abs(road.height_m - height_m) > HEIGHT_OFF_M:
        yield (
            f"`height_m` says {height_m:g} m, the road of the clouds lies {road.height_m:.2f} m "
            "below the sensor"
        )
    lean = math.degrees(math.hypot(*road.tilt))
    if lean > LEAN_DEG:
        yield (
            f"the sensor leans by {lean:.1f} degrees to the road; `pyinfra import` levels clouds"
        )
