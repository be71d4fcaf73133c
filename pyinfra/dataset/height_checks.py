"""Checks a given sensor height against the road in the clouds."""

import math
from collections.abc import Iterator, Sequence

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error
from pyinfra.dataset.ground import MOST_HEIGHT_M
from pyinfra.dataset.road_plane import road_of

CHECKED = 5  # number of clouds in which the road is searched
# Difference between given and measured sensor height above which there is a warning. It is larger
# than the random height errors in the training of the pretrained detector v3.
HEIGHT_OFF_M = 0.2
# Tilt above which there is a warning. The pretrained detector v3 lost 3 to 9 AP at a tilt of 0.25
# degrees, and 8 to 25 AP at 0.5 degrees.
LEAN_DEG = 0.3


def check_height(height_m: float) -> None:
    """Raises Error for an implausible height of a sensor above the road."""
    if not 0 < height_m <= MOST_HEIGHT_M:
        raise Error(f"height_m: expected more than 0 to {MOST_HEIGHT_M:g}, got {height_m:g}")


def height_warnings(clouds: Sequence[Points], height_m: float) -> Iterator[str]:
    """Yields warnings if the road in the clouds contradicts the given height, or is tilted.

    Height and tilt matter because networks depend on the height of points above the road. Each
    cloud is (n, 4), in the levelled LiDAR frame. Yields nothing if the clouds show too little
    ground.
    """
    road = road_of(clouds)
    if road is None:
        return
    if abs(road.height_m - height_m) > HEIGHT_OFF_M:
        yield (
            f"`height_m` is {height_m:g} m, but the road in the clouds is {road.height_m:.2f} m "
            "below the sensor"
        )
    lean = math.degrees(math.hypot(*road.tilt))
    if lean > LEAN_DEG:
        yield (
            f"the sensor is tilted by {lean:.1f} degrees relative to the road; `pyinfra import` "
            "levels clouds"
        )
