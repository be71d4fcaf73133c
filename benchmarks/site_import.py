"""What an import of OpenDRIVE maps costs, and whether its surfaces lie where the maps say.

    python benchmarks/site_import.py town.xodr ... --out out/sites

Rays straight down every 0.5 m along each lane, from 2 m above it: the share that meets the road
within 2 cm of the lane's z, and within 2 cm of the elevation that the file's own polynomials say
there, computed here from the file alone.
"""

import argparse
import csv
import math
import resource
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.formats.ply import degenerate, read_ply, together

CELL_M = 4.0
ABOVE_M = 2.0
CLOSE_M = 0.02
RAY_STEP_M = 0.5
FINE_M = 0.05


def heights_below(vertices: FloatArray, faces: IntArray, rays: FloatArray) -> FloatArray:
    """(n,) z of the first triangle under each ray's start x y z; -inf: none."""
    corners = vertices[faces]
    low, high = (f(corners[..., :2], 1) for f in (np.min, np.max))
    first, last = np.floor(low / CELL_M).astype(int), np.floor(high / CELL_M).astype(int)
    cells: dict[tuple[int, int], list[int]] = defaultdict(list)
    for k, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        for i in range(a[0], b[0] + 1):
            for j in range(a[1], b[1] + 1):
                cells[i, j].append(k)
    where: dict[tuple[int, int], list[int]] = defaultdict(list)
    for k, (i, j) in enumerate(np.floor(rays[:, :2] / CELL_M).astype(int).tolist()):
        where[i, j].append(k)
    out = np.full(len(rays), -np.inf)
    for cell, some in where.items():
        if cell in cells:
            out[some] = _below(corners[cells[cell]], rays[some])
    return out


def _below(corners: FloatArray, rays: FloatArray) -> FloatArray:
    a, b, c = (corners[None, :, k] for k in range(3))
    p = rays[:, None]

    def area(u: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        (ax, ay), (bx, by) = np.moveaxis(v - u, -1, 0)[:2], np.moveaxis(w - u, -1, 0)[:2]
        return np.asarray(ax * by - ay * bx)

    whole = area(a, b, c)
    with np.errstate(divide="ignore", invalid="ignore"):
        wa, wb = area(p, b, c) / whole, area(a, p, c) / whole
        wc = 1 - wa - wb
        inside = (np.minimum(np.minimum(wa, wb), wc) >= -1e-9) & (np.abs(whole) > 1e-12)
        z = wa * a[..., 2] + wb * b[..., 2] + wc * c[..., 2]
    return np.asarray(np.where(inside & (z <= p[..., 2]), z, -np.inf).max(1, initial=-np.inf))


def read_lanes(file: Path) -> dict[str, FloatArray]:
    """x y z width of each lane of lanes.csv."""
    lanes: dict[str, list[list[float]]] = defaultdict(list)
    with file.open() as stream:
        for name, *values in list(csv.reader(stream))[1:]:
            lanes[name].append([float(v) for v in values])
    return {name: np.array(rows) for name, rows in lanes.items()}


def along(lane: FloatArray) -> FloatArray:
    """(n, 3) places every RAY_STEP_M."""
    s = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(lane[:, :2], axis=0).T))])
    at = np.arange(0.0, s[-1], RAY_STEP_M)
    return np.stack([np.interp(at, s, lane[:, k]) for k in range(3)], 1)


def reference(road: ElementTree.Element) -> FloatArray:
    """(n, 4) s x y z of a reference line of lines and arcs, by steps of the heading."""
    rows: list[tuple[float, float, float]] = []
    for node in road.iter("geometry"):
        s, x, y, heading, length = (float(node.attrib[k]) for k in ("s", "x", "y", "hdg", "length"))
        arc = node.find("arc")
        bend = 0.0 if arc is None else float(arc.attrib["curvature"])
        for _ in range(max(1, math.ceil(length / FINE_M))):
            step = length / max(1, math.ceil(length / FINE_M))
            rows.append((s, x, y))
            x += step * math.cos(heading + bend * step / 2)
            y += step * math.sin(heading + bend * step / 2)
            heading, s = heading + bend * step, s + step
        rows.append((s, x, y))
    table = np.array(rows)
    z = np.zeros(len(table))
    for e in sorted(road.iter("elevation"), key=lambda e: float(e.attrib["s"])):
        u = table[:, 0] - float(e.attrib["s"])
        z = np.where(u >= -1e-9, np.polyval([float(e.attrib[k]) for k in "dcba"], u), z)
    return np.column_stack([table, z])


def elevations(file: Path, offset: FloatArray, places: dict[str, FloatArray]) -> FloatArray:
    """z at the places of each lane, from the map file."""
    roads = {str(r.get("id")): reference(r) for r in ElementTree.parse(file).iter("road")}
    found = []
    for name, xyz in places.items():
        line = roads[name.removeprefix("road").split("_")[0]]
        _, nearest = cKDTree(line[:, 1:3]).query(xyz[:, :2] + offset[:2])
        found.append(line[nearest, 3] - offset[2])
    return np.concatenate(found)


def measure(file: Path, out: Path) -> None:
    """One map: prints what it cost and the shares."""
    folder = out / file.stem
    shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, "-m", "pyinfra", "site", "import", str(file), "--out", str(folder)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    record = yaml.safe_load((folder / "map.yaml").read_text())
    meshes = {p.stem: read_ply(p) for p in sorted((folder / "meshes").glob("*.ply"))}
    places = {name: along(lane) for name, lane in read_lanes(folder / "lanes.csv").items()}
    rays = np.concatenate(list(places.values()))
    wanted = elevations(file, np.array(record["offset_m"]), places)
    everything = together(list(meshes.values()))
    up = np.array([0, 0, ABOVE_M])
    hits = heights_below(everything.vertices, everything.faces, rays + up)
    print(f"{file.name}: {wall:.1f} s, {cpu:.1f} s of processor, {after.ru_maxrss / 1024:.0f} MB")
    print(f"  triangles: { {k: len(m.faces) for k, m in meshes.items()} }")
    print(f"  degenerate: {sum(int(degenerate(m).sum()) for m in meshes.values())}")
    print(f"  {len(places)} lanes, {len(rays)} rays")
    for name, z in (("lane", rays[:, 2]), ("elevation of the file", wanted)):
        off = np.abs(hits - z)
        print(f"  within 2 cm of the {name}: {100 * (off <= CLOSE_M).mean():.3f} %")
    off = hits - rays[:, 2]
    print(f"  off by more: {(off > CLOSE_M).sum()} above, {(off < -CLOSE_M).sum()} below")
    for k in np.argsort(-np.abs(off))[:3]:
        print(f"    {off[k]:.3f} m at {rays[k].round(1)}")
    print(f"  not understood: {len(record['not_understood'])}, mended: {len(record['mended'])}")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("maps", type=Path, nargs="+", help=".xodr files")
    parser.add_argument("--out", type=Path, default=Path("out/sites"))
    args = parser.parse_args()
    for file in args.maps:
        measure(file, args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
