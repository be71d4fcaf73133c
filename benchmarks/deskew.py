"""How many points motion takes out of boxes, by where the motors of spinning LiDARs begin a turn.

The study's four LiDARs on the highway, preset `paper`; their seams turned in steps of 45 degrees,
each against its twin whose world stands still within a frame. Writes results/deskew.csv:
    .venv/bin/python benchmarks/deskew.py --work data/deskew
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments.stress import lidar
from pyinfra.metrics.scanning_claims import AVIA, SPINNING, claims_table

ROOT = Path(__file__).resolve().parent.parent
LIDARS = (AVIA, *SPINNING)
FRAMES = "0:5000:23"  # of every 25th an Avia's slow wedge would show one phase


def simulated(preset: str, aggregation: str, files: list[Path], out: Path) -> Path:
    words = ["--preset", preset, "--aggregation", aggregation, "--frames", FRAMES]
    words += ["--set", "region_half_length_m=125", "--out", str(out)]
    infrasim("run", scene_file("highway"), "--lidar", *files, *words)
    return out


def turned(data: Path, degrees: float, out: Path) -> list[Path]:
    """Files of a data set's LiDARs, their seams further left."""
    out.mkdir(parents=True, exist_ok=True)
    files = [out / f"{name}.yaml" for name in LIDARS]
    for name, file in zip(LIDARS, files, strict=True):
        file.write_text(lidar.text(data / name / lidar.FILE, (degrees,)), "utf-8")
    return files


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of frames; about 15 GB")
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "deskew.csv")
    args = parser.parse_args()
    tables = []
    files = [lidar_file(name) for name in LIDARS]
    for degrees in range(0, 360, 45):
        work = args.work / f"{args.preset}_{degrees}"
        exact = simulated(args.preset, "exact", files, work / "exact")
        instant = simulated(args.preset, "instant", files, work / "instant")
        found = claims_table([exact, instant])
        found = found[found.claim == "deskew"].assign(seam_turned_deg=degrees)
        tables.append(found.drop(columns=["command", "seed", "version"]))
        print(tables[-1].to_string(index=False, max_colwidth=60), flush=True)
        files = turned(work / "exact", 45, args.work / f"turned_{degrees + 45}")
    about = {"command": f"benchmarks/deskew.py --preset {args.preset}", "seed": 1}
    table = pd.concat(tables).assign(**about, version=__version__, machine=machine())
    table.to_csv(args.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
