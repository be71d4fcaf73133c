"""What a million triangles cost: seconds to build a scene, rays a second, against a plain scene.

    .venv/bin/python benchmarks/meshes.py --work /tmp/meshes

The site is a square of terrain of 400 m, rolling by some metres, with a road across it and two rows
of houses, all of one grid, at several sizes of its cells. The plain scenes are the crossroad, whose
houses and ground are a hundred triangles, and the highway, where most rays meet nothing. All rays
are cast (`--cast-all`), by one thread, with no vehicle near; the fastest of three runs.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from pyinfra.dataset.launch import binary

ROOT = Path(__file__).resolve().parents[1]
SIDE_M = 400.0
CELLS = (70, 224, 708)  # along a side: about 10,000, 100,000 and 1,000,000 triangles
LIDARS = ("ruby_plus", "livox_avia", "helios_16")
FRAMES = 10
TIMES = 3
PLAIN = ("highway", "crossroad")


def relief(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Level at the road along x = y = 0, hills and houses beside it."""
    hills = 3 * np.sin(x / 40) * np.cos(y / 55) * np.clip((np.abs(y) - 10) / 40, 0, 1)
    houses = 8.0 * ((np.abs(np.abs(y) - 40) < 6) & (np.mod(x, 30) < 15))
    return np.asarray(hills + houses - 0.05 * (np.abs(y) > 6))


def write_site(folder: Path, cells: int) -> tuple[Path, int]:
    """The scene file, and how many triangles it has."""
    folder.mkdir(parents=True, exist_ok=True)
    line = np.linspace(-SIDE_M / 2, SIDE_M / 2, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x, y, relief(x, y)], axis=-1).reshape(-1, 3).astype("<f4")
    corner = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel()
    quads = np.stack([corner, corner + cells + 1, corner + cells + 2, corner + 1], axis=1)
    faces = np.zeros(len(quads), [("n", "u1"), ("corners", "<i4", 4)])
    faces["n"], faces["corners"] = 4, quads
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += f"element face {len(quads)}\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "terrain.ply").write_bytes(head.encode() + vertices.tobytes() + faces.tobytes())
    (folder / "lanes.csv").write_text("lane,x,y,z,width\na,-190,-2,0,3.5\na,190,-2,0,3.5\n")
    rows = "".join(f"{k / 10},1,Car,190,-2,0.8,0,4,1.8,1.6,0\n" for k in range(FRAMES + 1))
    header = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n"
    (folder / "trajectories.csv").write_text(header + rows)
    (folder / "site.yaml").write_text(
        f"name: mesh_{cells}\nduration_s: {FRAMES / 10}\n"
        "mounts: {pole: {x_m: 0, y_m: -8, z_m: 6}}\nlanes: lanes.csv\n"
        "meshes: [{file: terrain.ply, material: terrain}]\ntrajectories: trajectories.csv\n"
    )
    return folder / "site.yaml", 2 * len(quads)


def infrasim(*words: object) -> float:
    """Seconds that a call took. Raises CalledProcessError."""
    start = time.perf_counter()
    command = [str(binary()), *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def mrays_per_s(scene: Path, out: Path, *words: str) -> dict[str, float]:
    """By LiDAR."""
    lidars = [ROOT / f"configs/lidars/{name}.yaml" for name in LIDARS]
    frames = ("--frames", f"0:{FRAMES}", "--cast-all", "--threads", "1")
    fastest = dict.fromkeys(LIDARS, 0.0)
    for i in range(TIMES):
        folder = out.with_name(f"{out.name}_{i}")
        infrasim("run", scene, "--lidar", *lidars, *frames, *words, "--out", folder)
        with (folder / "summary.csv").open() as stream:
            for row in csv.DictReader(stream):
                fastest[row["lidar"]] = max(fastest[row["lidar"]], float(row["mrays_per_s"]))
    return fastest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True, help="an empty folder")
    work = parser.parse_args().work
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["scene", "triangles", "check_s", *(f"{name}_mrays_per_s" for name in LIDARS)])
    no_traffic = ("--set", "traffic.vehicles_per_km_lane=0", "--set", f"duration_s={FRAMES / 10}")
    for name in PLAIN:
        speed = mrays_per_s(ROOT / f"configs/scenes/{name}.yaml", work / name, *no_traffic)
        table.writerow([name, "", "", *(round(speed[lidar], 1) for lidar in LIDARS)])
    for cells in CELLS:
        scene, triangles = write_site(work / f"site_{cells}", cells)
        seconds = min(infrasim("check", scene) for _ in range(TIMES))
        speed = mrays_per_s(scene, work / f"data_{cells}")
        rates = (round(speed[lidar], 1) for lidar in LIDARS)
        table.writerow([scene.parent.name, triangles, round(seconds, 2), *rates])


if __name__ == "__main__":
    main()
