"""Compares the AP of a benchmark with the paper's AP."""

import math

import numpy as np
import pandas as pd
from scipy.stats import permutation_test, rankdata, spearmanr

from pyinfra.metrics.row_selection import first_seed
from reproduction.paper_tables import paper_ap

CASE = ["scene", "lidar", "detector"]
LEAST_EXPERIMENTS = 3
REPLICATES = 9999  # random permutations; with up to 7 experiments, all permutations are used


def paper_table(experiments: pd.DataFrame) -> pd.DataFrame:
    """Compares the AP of a benchmark under preset `paper` with the paper's AP.

    Only experiments that also occur in the paper are used.

    Returns
    -------
    One row per scene, and one row for all scenes together (`all`). Columns: scene; preset;
    experiments (number of experiments); rank_correlation (Spearman); p_value (two-sided permutation
    test); mean_difference (AP of the benchmark minus AP of the paper).
    """
    ours = first_seed(experiments[(experiments.preset == "paper") & experiments.ap.notna()])
    pairs = ours.merge(paper_ap(), on=CASE, suffixes=("", "_paper"))
    groups = [*pairs.groupby("scene", sort=False), ("all", pairs)]
    rows = [{"scene": s, "preset": "paper", **agreement(t)} for s, t in groups]
    return pd.DataFrame([row for row in rows if row["experiments"] >= LEAST_EXPERIMENTS])


def agreement(both: pd.DataFrame) -> dict[str, float]:
    enough = len(both) >= LEAST_EXPERIMENTS
    return {
        "experiments": len(both),
        "rank_correlation": spearmanr(both.ap, both.ap_paper).statistic if enough else math.nan,
        "p_value": by_chance(both) if enough else math.nan,
        "mean_difference": float((both.ap - both.ap_paper).mean()),
    }


def by_chance(both: pd.DataFrame) -> float:
    """Returns the two-sided p-value of the rank correlation from a permutation test."""
    theirs = rankdata(both.ap_paper)
    test = permutation_test(
        (rankdata(both.ap),),
        lambda ours, axis: (ours * (theirs - theirs.mean())).sum(axis=axis),
        permutation_type="pairings",
        n_resamples=REPLICATES,
        vectorized=True,
        rng=np.random.default_rng(1),
    )
    return float(test.pvalue)
