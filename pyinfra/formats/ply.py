"""Triangle meshes as PLY files, binary and little-endian."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.files import write

FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
SMALLEST_M2 = 1e-6  # triangles with a smaller area are degenerate


@dataclass(frozen=True, eq=False)
class Triangles:
    """A triangle mesh, metres."""

    vertices: FloatArray  # (n, 3) coordinates of the vertices
    faces: IntArray  # (m, 3) indices of vertices


def degenerate(mesh: Triangles) -> BoolArray:
    """Returns a mask (m,) of triangles that, in float32, are almost a line or a point."""
    a, b, c = (mesh.vertices.astype("f4").astype(float)[mesh.faces[:, k]] for k in range(3))
    twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.maximum.reduce(
        [np.linalg.norm(q - p, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    )
    return np.asarray((twice < 2 * SMALLEST_M2) | (twice < 1e-4 * longest**2))


def together(meshes: list[Triangles]) -> Triangles:
    """Joins meshes. Drops degenerate triangles, and vertices that no remaining triangle uses."""
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = [m.faces + s for m, s in zip(meshes, starts, strict=False)]
    mesh = Triangles(
        np.concatenate([np.zeros((0, 3)), *(m.vertices for m in meshes)]),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]),
    )
    kept = mesh.faces[~degenerate(mesh)]
    used, numbers = np.unique(kept, return_inverse=True)
    return Triangles(mesh.vertices[used], numbers.reshape(-1, 3))


def write_ply(file: Path, mesh: Triangles) -> None:
    """Writes a mesh, with vertices as float32 in metres."""
    out = io.BytesIO()
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(mesh.vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    out.write("\n".join(head).encode())
    out.write(mesh.vertices.astype("<f4").tobytes())
    faces = np.empty(len(mesh.faces), FACE)
    faces["count"], faces["corners"] = 3, mesh.faces
    out.write(faces.tobytes())
    write(file, out.getvalue())


def read_ply(file: Path) -> Triangles:
    """Reads a file that `write_ply` wrote. Other PLY variants are not supported."""
    head, _, rest = file.read_bytes().partition(b"end_header\n")
    points, faces = (int(w.split()[2]) for w in head.decode().splitlines() if w.startswith("elem"))
    vertices = np.frombuffer(rest, "<f4", 3 * points).reshape(-1, 3).astype(float)
    table = np.frombuffer(rest, FACE, faces, offset=12 * points)
    return Triangles(vertices, table["corners"].astype(np.int64))
