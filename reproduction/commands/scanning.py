"""Tests the study's claims about scanning over several traffic seeds.

For each preset and seed, the command simulates every 7th of 5,000 frames of the highway with the
study's four LiDARs, once with aggregation `exact` and once with `instant`. 7 shares no factor with
200, the number of frames after which the Avia's pattern repeats. A claim's value is the mean over
the seeds, with Student's 95 % interval over the seeds. It writes results/scanning_claims.csv:

    python -m reproduction scanning --work data/scanning --out results/scanning_claims.csv
"""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from pyinfra.core.vocabulary import PRESETS, Preset
from pyinfra.dataset.data_set import read_data_set
from pyinfra.metrics.comparison import over_replicates
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.claims.scanning import AVIA, SPINNING, Row, claims_of, columns_of, never
from reproduction.simulate import simulate

FRAMES = "0:5000:7"
REGION_HALF_LENGTH_M = 125  # half length of the region; the claims extend to 120 m


def rows_of_seed(
    preset: Preset,
    seed: int,
    frames: str,
    work: Path,
    lidars: Sequence[str | Path] = (AVIA, *SPINNING),
) -> list[Row]:
    """Simulates one seed and returns all tested claims; the frames are removed afterwards."""
    sets = []
    for aggregation in ("exact", "instant"):
        folder = work / f"{preset}_{seed}_{aggregation}"
        simulate(
            "highway", lidars, folder, preset=preset, seed=seed, frames=frames,
            aggregation=aggregation, set=[f"region_half_length_m={REGION_HALF_LENGTH_M}"],
        )  # fmt: skip
        sets.append(read_data_set(folder))
    rows = claims_of(*sets)
    for data in sets:
        shutil.rmtree(data.folder)
    return rows


def over_seeds(per_seed: Sequence[Sequence[Row]]) -> Iterator[Row]:
    """Yields each claim with its mean and interval over the seeds.

    If the case of a claim occurs with some seeds only, the claim has the rule of these seeds.
    """
    for rows in zip(*per_seed, strict=True):
        mean = over_replicates([row.value for row in rows])
        ends = {"value": mean.value, "low": mean.low, "high": mean.high}
        rule = next((row.rule for row in rows if row.rule is not never), never)
        yield replace(rows[0], rule=rule, **ends)


@command
def main(
    *,
    work: Work,
    out: Out = Path("scanning_claims.csv"),
    seeds: Sequence[int] = (1, 2, 3),
    frames: str = FRAMES,
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 2 GB
    seeds : traffic seeds; default: 1 2 3
    frames : frames to simulate; default: %(default)s
    """
    command = f"scanning --seeds {' '.join(map(str, seeds))} --frames {frames}"
    tables = []
    for preset in PRESETS:
        per_seed = [rows_of_seed(preset, seed, frames, work) for seed in seeds]
        rows = [{"preset": preset, **columns_of(row)} for row in over_seeds(per_seed)]
        tables.append(pd.DataFrame(rows).assign(seeds=len(seeds), **provenance(command)))
        print(tables[-1][["preset", "claim", "value", "low", "high", "verdict"]].to_string())
    pd.concat(tables).to_csv(out, index=False, float_format="%.4g")
