"""What an engineer asks of a plan."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pyinfra.core.errors import Error
from pyinfra.core.names import check_name
from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.experiments.planner.areas import Area


@dataclass(frozen=True)
class Request:
    """The requirements of a plan, and how much of it is computed."""

    budget_usd: float
    find: float = 0.9  # share of the objects to be found in a frame, 0 to 1
    within_m: float = 60.0  # distance from the centre of the site within which objects count
    false_per_minute: float = math.inf  # most false boxes a minute; infinite: score 0.5
    poles: int = 1  # most poles
    lidars_per_pole: int = 1  # most LiDARs on a pole
    people: float = 0.0  # weight of a person relative to a vehicle in the choice
    areas: tuple[Area, ...] = ()  # areas of other weights, such as crossings
    years: float = 5.0
    detector: str = "generalist"
    preset: str = "datasheet"
    frames: int = 96  # most frames of a pose
    most: int = 1200  # most pairs of pose and LiDAR after the first frames
    keep: float = 0.99  # confidence with which a pose must be worse to be left out
    period_s: float = PERIOD_S  # frame period of the LiDARs

    @property
    def units(self) -> int:
        """The most LiDARs of an option."""
        return self.poles * self.lidars_per_pole

    @property
    def frames_per_minute(self) -> float:
        return 60 / self.period_s


WHOLE = ("poles", "lidars_per_pole", "frames", "most")
BOUNDS = {
    "budget_usd": (1, 1e9),
    "find": (0, 1),
    "within_m": (5, 500),
    "poles": (1, 20),
    "lidars_per_pole": (1, 8),
    "people": (0, 1000),
    "years": (0, 100),
    "frames": (2, 5000),
    "most": (10, 100_000),
    "keep": (0.5, 0.9999),
}


def checked(request: Request) -> Request:
    """Returns the request. Raises Error for a value out of range."""
    for name, (low, high) in BOUNDS.items():
        value = getattr(request, name)
        if not (isinstance(value, (int, float)) and low <= value <= high):
            note = ""
            if name == "find" and 1 < value <= 100:
                note = f"; it is a share, not percent: {value / 100:g}"
            raise Error(f"{name}: expected {low:g} to {high:g}, got {value}{note}")
        if name in WHOLE and value != int(value):
            raise Error(f"{name}: expected a whole number, got {value}")
    if not request.false_per_minute > 0:
        raise Error(f"false_per_minute: expected more than 0, got {request.false_per_minute}")
    check_name(request.preset, PRESETS, "preset")
    return request
