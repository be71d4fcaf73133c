"""CityJSON files become static meshes of a site, with the area and the place of their surfaces.

The files are made by the public specification, https://www.cityjson.org/specs/2.0.1/.
"""

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pyinfra.core.errors import Error, FormatError
from pyinfra.scenes.maps.city_json import read_city_json
from pyinfra.scenes.maps.map_import import import_map
from pyinfra.scenes.maps.mesh_import import _read

PIECES = (b"9", b"-1", b"[]", b"null", b"1e99", b"")
SCALE, SHIFT = 0.001, [84_000.0, 446_000.0, 3.0]


def city(*, holes: bool = True, kind: str = "Solid") -> dict[str, Any]:
    """Returns a house of 20 x 10 x 6 m, whose floor and roof have a courtyard of 4 x 2 m."""
    corners = [(0, 0), (20, 0), (20, 10), (0, 10), (8, 4), (12, 4), (12, 6), (8, 6)]
    vertices = [[1000 * x, 1000 * y, 1000 * z] for z in (0, 6) for x, y in corners]
    roof = [[8, 9, 10, 11], [15, 14, 13, 12]]
    floor = [[3, 2, 1, 0], [4, 5, 6, 7]]
    walls = [[[k, (k + 1) % 4, 8 + (k + 1) % 4, 8 + k]] for k in range(4)]
    walls += [[[4 + (k + 1) % 4, 4 + k, 12 + k, 12 + (k + 1) % 4]] for k in range(4)]
    surfaces = [roof[: 1 + holes], floor[: 1 + holes], *walls]
    shape: Any = {"MultiSurface": surfaces, "Solid": [surfaces], "MultiSolid": [[surfaces]]}[kind]
    low = {"type": "MultiSurface", "lod": "1.0", "boundaries": [[[0, 1, 2, 3]]]}
    high = {"type": kind, "lod": "2.2", "boundaries": shape}
    return {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [SCALE] * 3, "translate": SHIFT},
        "CityObjects": {"house": {"type": "Building", "geometry": [low, high]}, "group": {}},
        "vertices": vertices,
    }


def written(folder: Path, content: object) -> Path:
    file = folder / "a.city.json"
    file.write_text(json.dumps(content))
    return file


def areas(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Returns the directed areas (n, 3) of the triangles, and their middles (n, 3)."""
    mesh = read_city_json(file)
    corners = mesh.vertices[mesh.faces]
    sides = corners[:, 1:] - corners[:, :1]
    return np.cross(sides[:, 0], sides[:, 1]) / 2, corners.mean(axis=1)


@pytest.mark.parametrize("kind", ["MultiSurface", "Solid", "MultiSolid"])
def test_surfaces_keep_their_area_their_place_and_their_side(kind: str, tmp_path: Path) -> None:
    directed, middles = areas(written(tmp_path, city(kind=kind)))
    size = np.linalg.norm(directed, axis=1)
    assert size.sum() == pytest.approx(2 * (200 - 8) + 6 * 60 + 6 * 12)
    assert np.allclose(directed.sum(axis=0), 0, atol=1e-6)  # closed, and all faces look outwards
    outwards = (directed * (middles - np.array([84_010, 446_005, 6]))).sum() / 3
    assert outwards == pytest.approx((200 - 8) * 6)  # the volume
    assert middles.min(axis=0) == pytest.approx([84_000, 446_000, 3], abs=8)


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    file = written(tmp_path, city())
    before = read_city_json(file)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert np.array_equal(read_city_json(file).vertices, before.vertices)


def test_a_file_of_the_ending_is_a_mesh(tmp_path: Path) -> None:
    assert len(_read(written(tmp_path, city())).faces) > 20


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"type": "FeatureCollection"}, "type: expected 'CityJSON', got 'FeatureCollection'"),
        ({"CityObjects": {}}, "expected objects with surfaces"),
        ({"vertices": [[0, 0]]}, "expected vertices of three numbers"),
        ({"vertices": [[0, 0, 0]] * 3}, "expected vertex indices from 0 to 2, got 8 to 11"),
        ({"transform": {"scale": [1]}}, "vertices, transform: expected"),
    ],
)
def test_wrong_files_are_named(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=message):
        read_city_json(written(tmp_path, city() | change))


@pytest.mark.parametrize("name", ["a.city.json", "a.cityjson", "a.gml", "a.obj"])
def test_a_map_import_of_buildings_names_the_way(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(json.dumps(city()))
    with pytest.raises(Error, match=r"expected a map with lanes.*`pyinfra site mesh`"):
        import_map(tmp_path / name, tmp_path / "site")


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    data, refused = json.dumps(city()).encode(), 0
    for seed in range(200):
        r = random.Random(seed)
        changed = bytearray(data)
        for _ in range(r.randint(1, 4)):
            at = r.randrange(len(changed))
            changed[at : at + r.randint(0, 3)] = r.choice(PIECES)
        file = tmp_path / "a.json"
        file.write_bytes(changed)
        try:
            read_city_json(file)
        except FormatError:
            refused += 1
    assert 0 < refused < 200
