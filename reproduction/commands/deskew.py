"""Tests by how much motion changes the points in boxes if a frame begins at another angle.

The command tests the claim `deskew` as `scanning` does, with preset `paper`, for cut angles of the
spinning LiDARs that are turned left. It writes results/deskew.csv:

    python -m reproduction deskew --work data/deskew --out results/deskew.csv
"""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pyinfra.core.vocabulary import Preset
from pyinfra.dataset.catalogue import lidar_file
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.claims.scanning import AVIA, SPINNING, columns_of
from reproduction.commands.experiments import turned
from reproduction.commands.scanning import FRAMES, over_seeds, rows_of_seed
from reproduction.simulate import simulate

PRESET: Preset = "paper"
ANGLES_DEG = (0, 90, 180, 270)


@command
def main(
    *,
    work: Work,
    out: Out = Path("deskew.csv"),
    seeds: Sequence[int] = (1, 2, 3),
    frames: str = FRAMES,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 1 GB
    seeds : traffic seeds; default: 1 2 3
    frames : frames to simulate; default: %(default)s
    """
    unturned = simulate("highway", SPINNING, work / "unturned", preset=PRESET, frames="0:1")
    tables = []
    for angle in ANGLES_DEG:
        spinning = turned([unturned / name for name in SPINNING], angle, work / f"lidars_{angle}")
        lidars = (*spinning, lidar_file(AVIA))
        per_seed = [
            [r for r in rows_of_seed(PRESET, seed, frames, work, lidars) if r.claim == "deskew"]
            for seed in seeds
        ]
        tables.append(pd.DataFrame(map(columns_of, over_seeds(per_seed))))
        tables[-1].insert(0, "cut_angle_deg", angle)
    command = f"deskew --seeds {' '.join(map(str, seeds))} --frames {frames}"
    table = pd.concat(tables).assign(preset=PRESET, seeds=len(seeds), **provenance(command))
    table.to_csv(out, index=False, float_format="%.4g")
