"""The folders of a benchmark: for frames and trainings, and for tables of results."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pyinfra.experiments import store
from pyinfra.experiments.benchmark import frames
from pyinfra.experiments.benchmark.matrix import Experiment
from pyinfra.experiments.value import KEY

KEYS = {  # columns that identify a row of each table
    "experiments": KEY,
    "areas": KEY,
    "distance": KEY,
    "ranges": KEY,
    "squares": KEY,
    "replicates": KEY,
    "value": KEY,
    "until": ["scene", "preset"],
    "lidars": ["lidar", "preset"],
    "hits": ["scene", "preset", "lidar"],
    **{name: ["scene", "preset"] for name in frames.STATISTICS},
}


@dataclass(frozen=True)
class Workspace:
    """The folders of a benchmark: `work` for frames and trainings, `results` for tables."""

    work: Path
    results: Path
    tier: str

    def data(self, data_set: str) -> Path:
        """Returns the folder of a data set, or of its fused frames if it has several mounts.

        data_set: name of the data set (`Experiment.data_set`).
        """
        folder = self.work / "data" / data_set
        fused = folder / "fused"
        return fused if (fused / "dataset.yaml").is_file() else folder

    def table(self, name: str) -> Path:
        """Returns the file of a table.

        The file is TIER.csv for `experiments`, lidars.csv for `lidars`, and TIER_NAME.csv for other
        tables.
        """
        file = {"lidars": "lidars", "experiments": self.tier}.get(name, f"{self.tier}_{name}")
        return self.results / f"{file}.csv"

    def put(self, tables: dict[str, pd.DataFrame]) -> None:
        for name, rows in tables.items():
            store.put(self.table(name), rows, KEYS[name])

    def finished(self) -> pd.DataFrame:
        """Returns the rows of experiments that did not fail."""
        table = store.read(self.table("experiments"))
        return table[table.ap.notna()] if len(table) else table

    def without_row(self, experiments: Sequence[Experiment]) -> list[Experiment]:
        table = store.read(self.table("experiments"))
        return store.with_row(experiments, table, present=False)
