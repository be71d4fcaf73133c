"""Bootstrap replicates of a benchmark's experiments, and which differences are significant."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import pandas as pd

from pyinfra.experiments.value import KEY
from pyinfra.metrics.replicates import difference

Key: TypeAlias = "Mapping[str, object] | pd.Series"  # an experiment's values of the columns KEY
MEASURE = "ap_r1000"


@dataclass(frozen=True, eq=False)
class ExperimentReplicates:
    """A table of bootstrap replicates: one row for each experiment, ground truth and measure."""

    rows: pd.DataFrame

    def row(self, experiment: Key, ground_truth: str, measure: str = MEASURE) -> pd.Series | None:
        """Returns the row of an experiment; None if the table does not have it.

        `measure` is by default AP (R1000). Tables of earlier versions do not have this measure.
        """
        values = (str(experiment[name]) for name in KEY)
        number = self._numbers.get((ground_truth, measure, *values))
        return None if number is None else self.rows.iloc[number]

    @cached_property
    def _numbers(self) -> dict[tuple[str, ...], int]:
        """The first row number with each combination of ground truth, measure and experiment."""
        if self.rows.empty:
            return {}
        columns = [self.rows[name].astype(str) for name in ("ground_truth", "measure", *KEY)]
        numbered = reversed(list(enumerate(zip(*columns, strict=True))))
        return {key: number for number, key in numbered}

    def alike(self, best: Key, others: Iterable[Key], ground_truth: str) -> list[int]:
        """Returns indices of `others` whose AP (R1000) does not differ significantly from `best`.

        Each is compared with `best`. Experiments without bootstrap replicates are left out,
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
