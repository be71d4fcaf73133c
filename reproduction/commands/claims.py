"""Tests the paper's claims on data sets or on the tables of `pyinfra benchmark`."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.experiments import store
from pyinfra.experiments.result_tables import read_results
from pyinfra.formats.csv_table import write_csv
from reproduction.arguments import Out, command
from reproduction.claims import detection, scanning
from reproduction.claims.agreement import paper_table

SHOWN = "claim preset value low high verdict statement".split()


@command
def main(
    folders: Sequence[Path], *, tier: str | None = None, out: Out = Path("scanning_claims.csv")
) -> None:
    """Tests the paper's claims. Data sets test the claims about scanning; each data set has one
    preset. A folder of results tests the claims about detection. In that case the command writes
    TIER_claims.csv and TIER_paper.csv (agreement of AP with the paper) into the folder.

    examples: python -m reproduction claims data/highway_paper data/highway_paper_instant; python
    -m reproduction claims out/results

    Parameters
    ----------
    folders : data sets, or one folder of results
    tier : tier of the results; default: the most complete one
    """
    if any((folder / "dataset.yaml").is_file() for folder in folders):
        table = of_data_sets(folders, out)
    elif len(folders) == 1:
        table = of_results(folders[0], tier)
    else:
        raise Error(
            f"folders: expected data sets or one folder of results, got {len(folders)} folders"
        )
    print(table[SHOWN].to_string(index=False, float_format=lambda v: f"{v:.3g}", max_colwidth=90))


def of_data_sets(folders: Sequence[Path], out: Path) -> pd.DataFrame:
    """Tests the claims about scanning, writes the table to `out` and returns it."""
    table = scanning.claims_table(folders)
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as beside:
        table.to_csv(beside, index=False, float_format="%.4g")
    return table


def of_results(folder: Path, tier: str | None) -> pd.DataFrame:
    """Tests the claims about detection and returns them as a table.

    The function writes the claims, and the agreement with the paper's AP, into `folder`. Raises
    Error for tier smoke, because its networks are trained for too few steps.
    """
    chosen = read_results(folder, tier).tier
    if chosen == "smoke":
        raise Error(
            f"{folder}: tier: expected quick or full, got smoke; networks of the smoke tier are "
            "trained for too few steps to test claims"
        )
    files = {name: folder / f"{chosen}_{name}.csv" for name in ("replicates", "value")}
    files |= {
        "experiments": folder / f"{chosen}.csv",
        "stress_replicates": folder / "stress_replicates.csv",
    }
    tables = {name: store.read(file) for name, file in files.items()}
    outputs = {
        "claims": detection.claims_table(tables),
        "paper": paper_table(tables["experiments"]),
    }
    for name, rows in outputs.items():
        if len(rows):
            write_csv(folder / f"{chosen}_{name}.csv", rows)
    return outputs["claims"]
