"""Imports mesh files (OBJ, glTF, STL, PLY) and CityJSON files into a site."""

from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError, missing
from pyinfra.core.files import write
from pyinfra.formats.ply import Triangles, together, write_ply
from pyinfra.formats.yaml_file import read_keys
from pyinfra.scenes.maps import city_json
from pyinfra.scenes.maps.site_folder import SCENE, check_edit, feet

ENDINGS = (".obj", ".glb", ".gltf", ".stl", ".ply", *city_json.ENDINGS)
UPWARDS_Y = (".glb", ".gltf")  # formats whose upward axis is y, as glTF defines
MATERIALS = ("road", "sidewalk", "terrain", "structure", "vegetation")
WIDEST_M = 10_000.0  # maximum extent of a mesh
FARTHEST_M = 1_000.0  # maximum distance of a mesh from a mount
MOST_TRIANGLES = 20_000_000


def import_mesh(
    file: Path,
    site: Path,
    material: str,
    *,
    scale: float,
    up: str,
    offset_m: tuple[float, float, float],
) -> None:
    """Writes meshes/NAME.ply to the site and adds it to site.yaml.

    The arguments are those of `pyinfra.import_mesh`. Raises FormatError, FileExistsError, OSError,
    and ImportError if trimesh is not installed.
    """
    name = f"meshes/{file.stem.lower()}.ply"
    if (site / name).exists():
        raise FileExistsError(
            f"{site / name}: expected a new file, got an existing mesh; rename {file}"
        )
    mounts = feet(site)
    mesh = _placed(_read(file), file, scale, up, np.array(offset_m))
    away = _away_m(mesh, mounts)
    if away > FARTHEST_M:
        x, y = mesh.vertices[:, :2].mean(axis=0)
        raise FormatError(
            f"{file}: expected a mesh within {FARTHEST_M:g} m of a mount, got a distance of "
            f"{away:.0f} m, around x = {x:.0f}, y = {y:.0f}; `offset_m` moves the mesh"
        )
    scene = with_mesh(site / SCENE, {"file": name, "material": material})
    (site / "meshes").mkdir(exist_ok=True)
    write_ply(site / name, mesh)
    write(site / SCENE, scene)


def _read(file: Path) -> Triangles:
    """Reads all triangles of a file, in the file's coordinates. Raises FormatError."""
    if file.suffix.lower() not in ENDINGS:
        endings = ", ".join(ENDINGS)
        raise FormatError(
            f"{file}: expected a file name that ends in {endings}; got '{file.suffix}'"
        )
    if not file.stat().st_size:
        raise FormatError(f"{file}: expected a mesh, got an empty file")
    if file.suffix.lower() in city_json.ENDINGS:
        return city_json.read_city_json(file)
    try:
        import trimesh
    except ImportError as error:
        raise missing("trimesh", "site") from error
    try:
        loaded = trimesh.load_scene(file, process=False).to_mesh()
        vertices = np.asarray(loaded.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(loaded.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # the readers of trimesh raise exceptions of many types
        why = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise FormatError(f"{file}: cannot be read as a mesh: {why}") from error
    if not len(faces):
        raise FormatError(f"{file}: expected one or more faces, got none")
    if len(faces) > MOST_TRIANGLES:
        raise FormatError(f"{file}: expected up to {MOST_TRIANGLES} faces, got {len(faces)}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise FormatError(
            f"{file}: expected faces with vertex indices from 0 to {len(vertices) - 1}, got "
            f"indices from {faces.min()} to {faces.max()}"
        )
    if not np.isfinite(vertices).all():
        at = int(np.flatnonzero(~np.isfinite(vertices).all(1))[0])
        raise FormatError(
            f"{file}: vertex {at}: expected finite numbers, got {vertices[at].tolist()}"
        )
    return Triangles(vertices, faces)


def _placed(mesh: Triangles, file: Path, scale: float, up: str, offset_m: FloatArray) -> Triangles:
    up = up or ("y" if file.suffix.lower() in UPWARDS_Y else "z")
    vertices = mesh.vertices * scale
    widest = float(np.ptp(vertices, axis=0).max())
    if widest > WIDEST_M:
        raise FormatError(
            f"{file}: expected a mesh of at most {WIDEST_M:g} m, got {widest:.4g} m from end to "
            "end; if the coordinates are in millimetres, set `scale` to 0.001"
        )
    if up == "y":
        vertices = vertices[:, [0, 2, 1]] * [1, -1, 1]
    made = together([Triangles(vertices + offset_m, mesh.faces)])
    if not len(made.faces):
        raise FormatError(
            f"{file}: expected faces with an area, got {len(mesh.faces)} faces without an area; "
            f"the mesh measures {widest:.3g} m from end to end, and `scale` enlarges it"
        )
    return made


def _away_m(mesh: Triangles, mounts: FloatArray) -> float:
    """Returns the smallest horizontal distance of a mesh's bounding box from the mounts (k, 2)."""
    low, high = mesh.vertices[:, :2].min(0), mesh.vertices[:, :2].max(0)
    outside = np.maximum(np.maximum(low - mounts, mounts - high), 0)
    return float(np.hypot(*outside.T).min())


def with_mesh(file: Path, entry: dict[str, Any]) -> str:
    """Returns the text of a scene file with an entry added to `meshes`, and no other change.

    Raises FormatError if the YAML style of `meshes` does not allow another line.
    """
    lines = file.read_text(encoding="utf-8-sig").splitlines()
    before = read_keys(file)
    line = f"- {{file: {entry['file']}, material: {entry['material']}}}"
    if "meshes" not in before:
        lines += ["meshes:", line]
    elif "meshes:" in lines:
        at = lines.index("meshes:") + 1
        indent = len(lines[at]) - len(lines[at].lstrip()) if at < len(lines) else 0
        lines.insert(at, " " * indent + line)
    text = "\n".join(lines) + "\n"
    wanted = {**before, "meshes": [entry, *(before.get("meshes") or [])]}
    advice = f"the list cannot be extended; add this entry by hand: {line}"
    check_edit(file, text, wanted, f"meshes: {advice}")
    return text
