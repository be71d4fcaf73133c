"""The draws of a benchmark's cells: what can be said of two of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import pandas as pd

from pyinfra.benchmark.value import KEY
from pyinfra.evaluation.draws import difference, drawn
from pyinfra.statistics.compare import Bootstrapped, Measured

Key = Mapping[str, object]  # of a cell, by the columns of KEY
ALSO = ("scene", "preset", "tier")  # must be the same beside what an evaluation says


@dataclass(frozen=True, eq=False)
class CellDraws:
    """A table of draws, one row for each cell, ground truth and measure."""

    rows: pd.DataFrame

    def row(self, cell: Key, ground_truth: str, measure: str) -> pd.Series | None:
        """None if the table has none, as those of earlier versions."""
        if self.rows.empty:
            return None
        here = (self.rows.ground_truth == ground_truth) & (self.rows.measure == measure)
        for name in KEY:
            here &= self.rows[name].astype(str) == str(cell[name])
        found = self.rows[here]
        return None if found.empty else found.iloc[0]

    def drawn(self, cell: Key, ground_truth: str, measure: str) -> Bootstrapped | None:
        row = self.row(cell, ground_truth, measure)
        return None if row is None else drawn(row)

    def difference(
        self, a: Key, b: Key, ground_truth: str, measure: str = "ap_fine"
    ) -> Measured | None:
        """The first less the second, paired; None if one keeps no draws.

        Raises ValueError for cells whose draws are not of the same blocks.
        """
        rows = [self.row(cell, ground_truth, measure) for cell in (a, b)]
        if rows[0] is None or rows[1] is None:
            return None
        return difference(rows[0], rows[1], ALSO).measured()

    def alike(self, best: Key, others: Iterable[Key], ground_truth: str) -> list[int]:
        """Which of the others, by their place, cannot be told from the best by fine AP.

        One without draws is not among them: nothing is known of it.
        """
        found = [self.difference(best, other, ground_truth) for other in others]
        return [i for i, apart in enumerate(found) if apart is not None and not apart.is_told]

    def unknown(self, cells: Iterable[Key], ground_truth: str) -> list[int]:
        """Which of the cells, by their place, keep no draws or have no interval."""
        kept = [self.drawn(cell, ground_truth, "ap_fine") for cell in cells]
        return [i for i, one in enumerate(kept) if one is None or not one.measured().is_known]
