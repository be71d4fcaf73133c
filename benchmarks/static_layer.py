"""Frames with the static layer against those of casting all: differences, rays cast, and times.

Writes results/static_layer.csv, a row for each scene, preset and LiDAR that repeats:
    .venv/bin/python benchmarks/static_layer.py --frames 30
"""

from __future__ import annotations

import argparse
import filecmp
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd

from pyinfra.core.version import __version__, machine

ROOT = Path(__file__).resolve().parent.parent
BINARY = ROOT / "build" / "dev" / "cpp" / "infrasim"
SCENES = ("highway", "crossroad", "curve")
PRESETS = ("paper", "equal", "datasheet")
FILES = sorted((ROOT / "configs" / "lidars").glob("*.yaml"))


def repeating(preset: str) -> list[Path]:
    """The catalogue's LiDARs that have the preset and a pattern that repeats."""
    words = ("columns_per_turn", f"\n  {preset}:")
    return [file for file in FILES if all(word in file.read_text() for word in words)]


def run(scene: str, preset: str, frames: int, threads: int, out: Path, *more: str) -> pd.DataFrame:
    """The summary of one run of all LiDARs that have the preset, by LiDAR."""
    command: list[str | Path] = [
        BINARY,
        "run",
        scene,
        "--lidar",
        *repeating(preset),
        "--preset",
        preset,
        "--fields",
    ]
    command += ["--frames", f"0:{frames}", "--threads", str(threads), "--out", out, *more]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return pd.read_csv(out / "summary.csv", index_col="lidar")


def different_files(a: Path, b: Path) -> int:
    """How many files of either folder the other lacks or has with other bytes."""
    names = {str(file.relative_to(a)) for file in a.rglob("*") if file.is_file()}
    others = {str(file.relative_to(b)) for file in b.rglob("*") if file.is_file()}
    _, mismatch, errors = filecmp.cmpfiles(a, b, names & others, shallow=False)
    return len(mismatch) + len(errors) + len(names ^ others)


def compare(scene: str, preset: str, frames: int, folder: Path) -> pd.DataFrame:
    """One row a LiDAR: layers on one, two and four threads against casting all."""
    all_cast = run(scene, preset, frames, 1, folder / "all", "--cast-all")
    layered = {
        threads: run(scene, preset, frames, threads, folder / str(threads)) for threads in (1, 2, 4)
    }
    rows = layered[1][["rays_per_frame", "rays_cast_per_frame", "hits_per_frame"]].copy()
    rows["different_files"] = [
        sum(different_files(folder / "all" / name, folder / str(t) / name) for t in layered)
        for name in rows.index
    ]
    rows["cast_share"] = rows.rays_cast_per_frame / rows.rays_per_frame
    rows["time_ratio"] = layered[1].seconds / all_cast.seconds
    return rows.reset_index().assign(scene=scene, preset=preset, frames=frames)


def main() -> None:
    """Compares, prints and writes the table; fails if a file differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "static_layer.csv")
    args = parser.parse_args()
    parts = []
    for scene in SCENES:
        for preset in PRESETS:
            with tempfile.TemporaryDirectory() as folder:
                parts.append(compare(scene, preset, args.frames, Path(folder)))
            print(parts[-1].round(3).to_string(index=False), flush=True)
    table = pd.concat(parts, ignore_index=True).round(4)
    command = f"benchmarks/static_layer.py --frames {args.frames}"
    table.assign(command=command, seed=1, version=__version__, machine=machine()).to_csv(
        args.out, index=False
    )
    sys.exit(int(table.different_files.sum() > 0))


if __name__ == "__main__":
    main()
