"""Reads the surfaces of CityJSON files (versions 1.0 to 2.0), by the public specification.

A file has integer vertices with a scale and an offset, and objects with geometries. The geometry
with the highest level of detail of each object is read.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.core.files import check_size
from pyinfra.formats.ply import Triangles
from pyinfra.scenes.maps.osm_relations import with_holes
from pyinfra.scenes.maps.surfaces import ears

ENDINGS = (".json", ".cityjson")
MOST_BYTES = 1 << 30
# Number of nested lists around a surface in `boundaries`.
DEPTH = {"MultiSurface": 0, "CompositeSurface": 0, "Solid": 1, "MultiSolid": 2, "CompositeSolid": 2}
MOST_M = 1e9
MOST_CORNERS = 2000  # maximum number of corners of a surface


def read_city_json(file: Path) -> Triangles:
    """Reads all surfaces as triangles, in metres and the coordinates of the file.

    Raises FormatError for a file that is not CityJSON, or that has no surface.
    """
    check_size(file, MOST_BYTES)
    try:
        content = json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{file}: cannot be read as JSON: {str(error)[:200]}") from None
    kind = content.get("type") if isinstance(content, dict) else None
    if kind != "CityJSON":
        raise FormatError(f"{file}: type: expected 'CityJSON', got {str(kind)[:40]!r}")
    vertices = _vertices(file, content)
    objects = content.get("CityObjects")
    faces = [
        face
        for name, thing in (objects.items() if isinstance(objects, dict) else ())
        for surface in _surfaces(thing)
        for face in _triangles(f"{file}: object {name}", surface, vertices)
    ]
    if not faces:
        raise FormatError(f"{file}: expected objects with surfaces or solids, got none")
    return Triangles(vertices, np.array(faces, dtype=np.int64))


def _vertices(file: Path, content: Mapping[str, Any]) -> FloatArray:
    transform = content.get("transform") or {"scale": [1, 1, 1], "translate": [0, 0, 0]}
    try:
        raw = np.array(content["vertices"], dtype=np.float64).reshape(-1, 3)
        scale, shift = (np.array(transform[k], dtype=np.float64) for k in ("scale", "translate"))
        with np.errstate(all="ignore"):
            vertices = raw * scale.reshape(3) + shift.reshape(3)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise FormatError(
            f"{file}: vertices, transform: expected vertices of three numbers, and scale and "
            f"translate of three numbers, got a missing or wrong value: {error}"
        ) from None
    near = (np.abs(vertices) <= MOST_M).all(axis=1)  # false for NaN
    if not near.all():
        at = int(near.argmin())
        raise FormatError(
            f"{file}: vertices: {at}: expected coordinates up to {MOST_M:g} m, got "
            f"{vertices[at].tolist()}"
        )
    return np.asarray(vertices)


def _surfaces(thing: object) -> Iterator[Any]:
    """Yields the surfaces of the most detailed geometry of an object. A surface is its rings."""
    parts = thing.get("geometry") if isinstance(thing, dict) else None
    known = [g for g in parts or () if isinstance(g, dict) and g.get("type") in DEPTH]
    if not known:
        return
    best = max(known, key=lambda g: str(g.get("lod", "")))
    level = [best.get("boundaries")]
    for _ in range(DEPTH[best["type"]] + 1):
        level = [inner for outer in level if isinstance(outer, list) for inner in outer]
    yield from level


def _triangles(where: str, surface: object, vertices: FloatArray) -> list[list[int]]:
    """Returns the triangles of a surface: an outline, and holes. Raises FormatError."""
    rings = surface if isinstance(surface, list) else []
    try:
        index = [np.array(ring, dtype=np.int64).reshape(-1) for ring in rings]
    except (TypeError, ValueError, OverflowError):
        raise FormatError(
            f"{where}: boundaries: expected indices of vertices, got {str(rings)[:40]}"
        ) from None
    for ring in index:
        if len(ring) and not (ring.min() >= 0 and ring.max() < len(vertices)):
            raise FormatError(
                f"{where}: boundaries: expected vertex indices from 0 to {len(vertices) - 1}, got "
                f"{ring.min()} to {ring.max()}"
            )
    if not index or len(index[0]) < 3 or sum(map(len, index)) > MOST_CORNERS:
        return []
    if len(index) == 1 and len(index[0]) == 3:
        return [index[0].tolist()]
    corners = vertices[index[0]]
    normal = np.cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0]).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    plane = [(axis + 1) % 3, (axis + 2) % 3]  # this order of axes keeps the orientation
    flat = [vertices[ring][:, plane] for ring in index]
    number = {
        (x, y): int(k)
        for ring, points in zip(index, flat, strict=True)
        for k, (x, y) in zip(ring, points.tolist(), strict=True)
    }
    outline = with_holes(flat[0], flat[1:])
    faces = [[number[tuple(outline[k])] for k in face] for face in ears(outline).tolist()]
    return faces if normal[axis] > 0 else [face[::-1] for face in faces]
