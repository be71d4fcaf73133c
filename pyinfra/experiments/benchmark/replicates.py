"""The draws of a benchmark's cells: which of them cannot be told apart."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import pandas as pd

from pyinfra.experiments.value import KEY
from pyinfra.metrics.replicates import difference

Key: TypeAlias = "Mapping[str, object] | pd.Series"  # with the columns of KEY
MEASURE = "ap_fine"


@dataclass(frozen=True, eq=False)
class CellDraws:
    """A table of draws, one row for each cell, ground truth and measure."""

    rows: pd.DataFrame

    def row(self, cell: Key, ground_truth: str, measure: str = MEASURE) -> pd.Series | None:
        """Of AP (R1000); None if the table has none, as those of earlier versions."""
        if self.rows.empty:
            return None
        here = (self.rows.ground_truth == ground_truth) & (self.rows.measure == measure)
        for name in KEY:
            here &= self.rows[name].astype(str) == str(cell[name])
        rows = self.rows[here]
        return None if rows.empty else rows.iloc[0]

    def alike(self, best: Key, others: Iterable[Key], ground_truth: str) -> list[int]:
        """Which of the others, by their place, cannot be told from the best by fine AP.

        One without draws is not among them: nothing is known of it. Raises Error for cells
        whose draws are not of the same blocks.
        """
        reference = self.row(best, ground_truth)
        rows = [self.row(other, ground_truth) for other in others]
        return [
            i
            for i, row in enumerate(rows)
            if reference is not None
            and row is not None
            and not difference(reference, row, ("tier",)).measured().is_significant
        ]
