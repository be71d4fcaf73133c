"""Bootstrap replicates of a benchmark's experiments, and which differences are significant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import pandas as pd

from pyinfra.experiments.value import KEY
from pyinfra.metrics.replicates import difference

Key: TypeAlias = "Mapping[str, object] | pd.Series"  # values of the columns KEY
MEASURE = "ap_r1000"


@dataclass(frozen=True, eq=False)
class ExperimentReplicates:
    """A table of bootstrap replicates: one row for each experiment, ground truth and measure."""

    rows: pd.DataFrame

    def row(self, experiment: Key, ground_truth: str, measure: str = MEASURE) -> pd.Series | None:
        """Returns the row of an experiment; None if the table does not have it.

        `measure` is by default AP (R1000). Tables of earlier versions do not have this measure.
        """
        if self.rows.empty:
            return None
        here = (self.rows.ground_truth == ground_truth) & (self.rows.measure == measure)
        for name in KEY:
            here &= self.rows[name].astype(str) == str(experiment[name])
        rows = self.rows[here]
        return None if rows.empty else rows.iloc[0]

    def alike(self, best: Key, others: Iterable[Key], ground_truth: str) -> list[int]:
        """Returns the indices of the `others` whose AP (R1000) is not significantly different.

        They are compared with `best`. Experiments without bootstrap replicates are left out,
        because their difference has no interval. Raises Error for experiments whose replicates are
        of different blocks of time.
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
