"""What traffic needs of a site's folder, and the time that it fills."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.core.files import write
from pyinfra.formats.yaml_file import read_keys
from pyinfra.scenes.maps.geographic import Projection, network_projection

SCENE, MAP, NET = "site.yaml", "map.yaml", "map.net.xml"


def feet(site: Path) -> FloatArray:
    """x y of each mount of site.yaml, world: (k, 2). Raises FormatError, OSError."""
    file = site / SCENE
    mounts = read_keys(file).get("mounts") or {}
    try:
        positions = [(float(m["x_m"]), float(m["y_m"])) for m in dict(mounts).values()]
    except (AttributeError, KeyError, TypeError, ValueError):
        positions = []
    points = np.array(positions).reshape(-1, 2)
    if not len(points) or not np.isfinite(points).all():
        raise FormatError(f"{file}: mounts: found none with x_m and y_m, allowed one or more")
    return points


def offset(site: Path) -> FloatArray:
    """x y z (3,) that is taken from the coordinates of the map that was imported.

    It is `offset_m` of map.yaml; without the file or the key nothing is taken. The site's own
    network is in the world's coordinates already.
    """
    file = site / MAP
    value = read_keys(file).get("offset_m") if file.exists() else None
    if value is None:
        return np.zeros(3)
    try:
        vector = np.array([float(v) for v in value])
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise FormatError(f"{file}: offset_m: found {value!r}, allowed [x, y, z] in metres")
    return vector


def projection(site: Path) -> Projection | None:
    """How degrees become the world's metres, by the site's network. Raises FormatError, OSError."""
    file = site / NET
    return network_projection(file) if file.exists() else None


def set_duration(site: Path, seconds: float) -> None:
    """Writes `duration_s` into site.yaml, and leaves all else in it as it is."""
    file = site / SCENE
    before = read_keys(file).get("duration_s")
    if before == seconds:
        return
    text, line = file.read_text(), f"duration_s: {seconds:g}"
    if before is None:
        changed = text.rstrip("\n") + f"\n{line}\n"
    else:
        changed = re.sub(r"^duration_s:[^#\n]*?(?=\s*(#|$))", line, text, flags=re.MULTILINE)
    write(file, changed)
