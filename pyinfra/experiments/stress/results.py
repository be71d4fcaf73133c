"""The tables of a stress test, from the rows that are there."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pyinfra.core.files import held, replacing
from pyinfra.experiments.stress import summary, trials


def write(out: Path) -> list[Path]:
    """Writes the summary and the ranking of the rows that are there; returns the files."""
    table = trials.read(out / "stress.csv")
    tables: dict[str, pd.DataFrame] = {
        "stress_summary": summary.summary(table),
        "stress_ranking": summary.ranking(table),
    }
    files = [out / "stress.csv"]
    with held(out / "locks" / "summary", wait=True):
        for name, rows in tables.items():
            files.append(out / f"{name}.csv")
            with replacing(files[-1]) as beside:
                rows.to_csv(beside, index=False, float_format="%.4g")
    return files
