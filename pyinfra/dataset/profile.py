"""The vertical profile of a scene along one direction, as `dataset.yaml` stores it."""

from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.formats.yaml_file import YamlNode


@dataclass(frozen=True, eq=False)
class Profile:
    """The height of the road as a polyline over the station, constant beyond the polyline's ends.

    A parabola of length `curve_m` replaces each corner of the polyline.
    """

    start: FloatArray  # (2,) x, y of station 0, metres
    heading: float  # direction of increasing stations, radians
    points: FloatArray  # (n, 2) station and rise, metres
    curve_m: float

    def rise_m(self, xy: FloatArray) -> FloatArray:
        """Returns the rise in metres at positions (..., 2) in the world frame."""
        axis = np.array([np.cos(self.heading), np.sin(self.heading)])
        beyond = ((xy - self.start) @ axis)[..., None] - self.points[:, 0]
        steps = np.diff(self.points, axis=0)
        changes = np.diff(steps[:, 1] / steps[:, 0], prepend=0, append=0)
        on_curve = np.clip(beyond + self.curve_m / 2, 0, self.curve_m)
        after = np.maximum(beyond - self.curve_m / 2, 0)
        lifted = (on_curve**2 / (2 * self.curve_m) + after) @ changes
        return np.asarray(self.points[0, 1] + lifted)


def profile_of(node: YamlNode) -> Profile:
    """Reads a profile. Raises FormatError with file, line and key."""
    return Profile(
        start=np.array([node.at("x_m").number(), node.at("y_m").number()]),
        heading=float(np.radians(node.at("heading_deg").number())),
        points=np.array([_station_and_rise(pair) for pair in node.at("points_m").items()]),
        curve_m=node.at("vertical_curve_m").number(),
    )


def _station_and_rise(node: YamlNode) -> list[float]:
    pair = [number.number() for number in node.items()]
    if len(pair) != 2:
        node.fail(f"expected 2 numbers (station and rise), got {len(pair)}")
    return pair
