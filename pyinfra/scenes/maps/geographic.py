"""Recognises positions in longitude and latitude, and projects them to metres at a site."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.scenes.maps.openstreetmap import transverse_mercator

NEAR_M = 20_000.0  # maximum distance of positions from the site's origin
AT_SITE_M = 5_000.0  # maximum distance of a pole at the site from the site's origin
# Limit for the change of x and y per second. If the coordinates of a moving object change more
# slowly than this, they are in degrees; otherwise they are in metres.
_CRAWL = 0.01
# Limit for the distance in x and y, relative to the distance that follows from the speeds. Below
# this limit, x and y are in degrees, because a degree is 10 to 111 km long.
_SHARE = 1e-3
_ELLIPSOIDS = ("WGS84", "GRS80")


# The motion of one object: times (n,) in s, xy (n, 2), speeds (n,) in m/s or NaN.
Motion = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Projection:
    """A transverse Mercator projection, and an offset that is added to its metres."""

    centre: tuple[float, float]  # longitude and latitude of the origin, degrees
    scale: float = 1.0
    offset_m: tuple[float, float] = (0.0, 0.0)

    def metres(self, lon_lat: FloatArray) -> FloatArray:
        """Converts longitude and latitude (n, 2) in degrees to x y (n, 2) in metres."""
        unscaled = transverse_mercator(lon_lat, self.centre)
        return np.asarray(unscaled * self.scale + np.array(self.offset_m))


def in_degrees(objects: Sequence[Motion], projection: Projection | None) -> bool:
    """Returns whether positions are longitude and latitude.

    All values must be in the range of longitude and latitude. In addition, x and y must change far
    less than the speeds of the objects imply. If speeds are missing, x and y must change by less
    per second than the coordinates of any moving object in metres. If no object moves, the
    positions must be near the site.
    """
    positions = np.concatenate([xy for _, xy, _ in objects])
    if not fits(positions):
        return False
    moved = expected = fastest = 0.0
    for times, xy, speeds in objects:
        seconds, step = np.diff(times), np.hypot(*np.diff(xy, axis=0).T)
        moved += float(step.sum())
        expected += float(np.nansum(speeds[1:] * seconds))
        fastest = max(fastest, float((step / seconds.clip(1e-6)).max(initial=0.0)))
    if moved > 0:
        return moved < expected * _SHARE if expected > 1 else fastest < _CRAWL
    return projection is not None and bool(_away_m(positions, projection) < NEAR_M)


def fits(xy: FloatArray) -> bool:
    """Returns whether all values (n, 2) are in the range of longitude and latitude."""
    return bool((np.abs(xy) <= (180, 85)).all())


def centred_on(lon_lat: FloatArray) -> Projection:
    """Returns the projection centred on the middle of positions (n, 2)."""
    lon, lat = (lon_lat.min(0) + lon_lat.max(0)) / 2
    return Projection((round(float(lon), 6), round(float(lat), 6)))


def check_near_site(lon_lat: FloatArray, projection: Projection) -> None:
    """Raises FormatError if no position is near the site."""
    away = _away_m(lon_lat, projection)
    if not away < NEAR_M:
        lon, lat = lon_lat[0]
        raise FormatError(
            f"x, y: expected longitude and latitude within {NEAR_M / 1000:g} km of the site, got "
            f"{lon:.4f} {lat:.4f}, {away / 1000:.0f} km away"
        )


def _away_m(lon_lat: FloatArray, projection: Projection) -> float:
    """Returns the smallest distance of positions (n, 2) from the site's origin, in metres.

    It is infinite if all positions are more than 10 degrees of longitude away.
    """
    near = lon_lat[np.abs(lon_lat[:, 0] - projection.centre[0]) < 10]
    return float(np.hypot(*projection.metres(near).T).min(initial=math.inf))


def metres_of_degrees(xy: FloatArray, projection: Projection | None) -> FloatArray | None:
    """Returns positions (n, 2) in metres if the values are longitude and latitude, else None.

    The order may also be latitude and longitude. All positions must be at the site. Positions in
    metres can only be so if they are within centimetres of one point. Values near 0 count as
    metres, because many maps without a real location have a projection centred on 0 degrees.
    """
    if projection is None or not len(xy) or (np.abs(xy).max(axis=1) < 1).any():
        return None
    for lon_lat in (xy, xy[:, ::-1]):
        if fits(lon_lat) and (np.abs(lon_lat[:, 0] - projection.centre[0]) < 10).all():
            metres = projection.metres(lon_lat)
            if (np.hypot(*metres.T) < AT_SITE_M).all():
                return metres
    return None


def network_projection(net_file: Path) -> Projection | None:
    """Reads the projection of a SUMO network. Returns None if the network has no projection.

    Raises FormatError for a projection that is not a transverse Mercator, and OSError.
    """
    try:
        with net_file.open("rb") as stream:  # `iterparse` closes a file only if read to the end
            for _, node in ElementTree.iterparse(stream, events=("start",)):
                if node.tag == "location":
                    words = node.get("projParameter", "!")
                    return _of_location(words, node.get("netOffset", "0,0"))
                if node.tag in ("edge", "junction"):
                    break
    except (ElementTree.ParseError, ValueError) as error:
        raise FormatError(
            f"{net_file}: location: expected a projection that SUMO writes, got {error}"
        ) from error
    return None


def _of_location(words: str, offset: str) -> Projection | None:
    keys = dict(w.removeprefix("+").partition("=")[::2] for w in words.split() if w != "!")
    if not keys:
        return None
    ellipsoid = keys.get("ellps", keys.get("datum", "WGS84"))
    if keys.get("proj") not in ("utm", "tmerc") or ellipsoid not in _ELLIPSOIDS:
        raise Error(f"expected a projection utm or tmerc on WGS84, got '{words[:80]}'")
    net_offset = [float(v) for v in offset.split(",")]
    if keys["proj"] == "utm":
        north = 1e7 if "south" in keys else 0.0
        zone = float(keys["zone"]) if "zone" in keys else math.nan
        return _checked((6 * zone - 183, 0.0), 0.9996, (5e5 + net_offset[0], north + net_offset[1]))
    centre = (float(keys.get("lon_0", 0)), float(keys.get("lat_0", 0)))
    scale = float(keys.get("k", keys.get("k_0", 1)))
    false = [float(keys.get(k, 0)) for k in ("x_0", "y_0")]
    return _checked(centre, scale, (false[0] + net_offset[0], false[1] + net_offset[1]))


def _checked(
    centre: tuple[float, float], scale: float, offset_m: tuple[float, float]
) -> Projection:
    if not np.isfinite([*centre, scale, *offset_m]).all():
        raise Error("a value that is not a number")
    return Projection(centre, scale, offset_m)
