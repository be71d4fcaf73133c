"""Reads mounts, offset and projection of a site folder, and sets its duration."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error, FormatError, check_exists
from pyinfra.core.files import write
from pyinfra.formats.yaml_file import read_keys, read_yaml
from pyinfra.scenes.maps.geographic import Projection, metres_of_degrees, network_projection

SCENE, MAP, NET = "site.yaml", "map.yaml", "map.net.xml"


def scene_of(site: Path) -> Path:
    """Returns the scene file of a site folder. Raises Error if `site` is not such a folder."""
    if site.is_file():
        raise Error(f"{site}: expected the folder of a site, got a file; use {site.parent}")
    check_exists(site)
    if not (site / SCENE).is_file():
        inside = ", ".join(str(file.parent) for file in sorted(site.glob(f"*/{SCENE}")))
        more = f"; sites in it: {inside}" if inside else "; `pyinfra site import` makes a site"
        raise Error(f"{site}: expected a site folder with {SCENE}, got a folder without it{more}")
    return site / SCENE


def feet(site: Path) -> FloatArray:
    """Reads x y (k, 2) of all mounts of site.yaml, world frame. Raises Error, OSError."""
    file = scene_of(site)
    mounts = read_keys(file).get("mounts") or {}
    try:
        positions = [(float(m["x_m"]), float(m["y_m"])) for m in dict(mounts).values()]
    except (AttributeError, KeyError, TypeError, ValueError):
        positions = []
    points = np.array(positions).reshape(-1, 2)
    if not len(points) or not np.isfinite(points).all():
        raise FormatError(f"{file}: mounts: expected one or more mounts with x_m and y_m, got none")
    check_metres(site, points, f"{file}: mounts: x_m, y_m")
    return points


def yaws(site: Path) -> dict[str, float]:
    """Reads the yaw of each mount of site.yaml in degrees. Raises Error, OSError."""
    mounts = read_keys(scene_of(site)).get("mounts") or {}
    try:
        return {name: float(mount.get("yaw_deg", 0)) for name, mount in dict(mounts).items()}
    except (AttributeError, TypeError, ValueError):
        raise FormatError(
            f"{site / SCENE}: mounts: expected a mapping of names to mounts, got "
            f"{str(mounts)[:40]!r}"
        ) from None


def offset(site: Path) -> FloatArray:
    """Reads the offset x y z (3,) that was subtracted from the imported map's coordinates.

    The offset is `offset_m` of map.yaml, or 0 without the file or the key. The network in the site
    folder is already in world coordinates. Raises FormatError.
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
        raise FormatError(f"{file}: offset_m: expected [x, y, z] in metres, got {value!r}")
    return vector


def features(site: Path) -> dict[str, FloatArray]:
    """Reads x y (n, 2) of the features in map.yaml by kind, such as `crossing`, world frame.

    The result is empty without the file. Raises FormatError.
    """
    file = site / MAP
    listed = read_keys(file).get("features") if file.exists() else None
    if not isinstance(listed, dict | None):
        raise FormatError(f"{file}: features: expected kinds with positions, got {listed!r}")
    positions = {}
    for kind, rows in (listed or {}).items():
        try:
            xy = [(float(row["x_m"]), float(row["y_m"])) for row in rows]
        except (KeyError, TypeError, ValueError):
            raise FormatError(
                f"{file}: features: {kind}: expected a list of positions with the keys x_m and "
                f"y_m, got {str(rows)[:40]}"
            ) from None
        positions[str(kind)] = np.array(xy).reshape(-1, 2)
    return positions


def projection(site: Path) -> Projection | None:
    """Reads the projection of the site's network, or returns None if it is unknown.

    Raises FormatError and OSError.
    """
    file = site / NET
    return network_projection(file) if file.exists() else None


def check_metres(site: Path, xy: FloatArray, where: str) -> None:
    """Raises FormatError if positions of poles (n, 2) are longitude and latitude of the site.

    The message begins with `where`. Positions at a site without a known projection are not checked.
    """
    try:
        known = projection(site)
    except FormatError:  # geographic.py does not support this kind of projection
        return
    metres = metres_of_degrees(xy, known)
    if metres is not None:
        (x, y), (got_x, got_y) = metres[0], xy[0]
        raise FormatError(
            f"{where}: expected metres in the frame of the site, got {got_x:g}, {got_y:g}, which "
            f"are longitude and latitude of the site; in metres, this is {x:.2f}, {y:.2f}"
        )


def set_duration(site: Path, seconds: float) -> None:
    """Sets `duration_s` in site.yaml, and changes nothing else in the file.

    Raises FormatError if the YAML style of the file does not allow this.
    """
    file = site / SCENE
    before, text = read_keys(file), file.read_text(encoding="utf-8-sig")
    if before.get("duration_s") == seconds:
        return
    line = f"duration_s: {seconds:g}"
    if "duration_s" in before:
        value: Any = read_yaml(file).at("duration_s").node
        start, end = value.start_mark, value.end_mark
        lines = text.splitlines(keepends=True)
        if start.line == end.line:
            old = lines[start.line]
            lines[start.line] = f"{old[: start.column].rstrip()} {seconds:g}{old[end.column :]}"
        changed = "".join(lines)
    else:
        changed = text.rstrip("\n") + f"\n{line}\n"
    wanted = {**before, "duration_s": float(f"{seconds:g}")}
    check_edit(file, changed, wanted, f"duration_s: cannot be changed; write `{line}` by hand")
    write(file, changed)


def check_edit(file: Path, text: str, wanted: dict[str, Any], advice: str) -> None:
    """Raises FormatError with `advice` if the new text of a scene file differs from `wanted`."""
    try:
        has_them = yaml.safe_load(text) == wanted
    except yaml.YAMLError:
        has_them = False
    if not has_them:
        raise FormatError(f"{file}: {advice}")
