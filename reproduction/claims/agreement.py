"""How the AP of a benchmark goes with the paper's."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from scipy.stats import permutation_test, rankdata, spearmanr

from pyinfra.metrics.row_selection import first_seed
from reproduction.paper_tables import paper_ap

CASE = ["scene", "lidar", "detector"]
LEAST_CELLS = 3
DRAWS = 9999  # orders; of up to 7 cells every one


def paper_table(cells: pd.DataFrame) -> pd.DataFrame:
    """Spearman's rank correlation with the paper, and the mean difference, of preset `paper`.

    One row a scene, and one for the scenes together (`all`); over the cells that both have.
    Columns scene, preset, cells, rank_correlation, p_value (share of the orders of one side that
    correlate as much, either way), mean_difference (here less the paper).
    """
    ours = first_seed(cells[(cells.preset == "paper") & cells.ap.notna()])
    both = ours.merge(paper_ap(), on=CASE, suffixes=("", "_paper"))
    groups = [*both.groupby("scene", sort=False), ("all", both)]
    rows = [{"scene": s, "preset": "paper", **agreement(t)} for s, t in groups]
    return pd.DataFrame([row for row in rows if row["cells"] >= LEAST_CELLS])


def agreement(both: pd.DataFrame) -> dict[str, float]:
    enough = len(both) >= LEAST_CELLS
    return {
        "cells": len(both),
        "rank_correlation": spearmanr(both.ap, both.ap_paper).statistic if enough else math.nan,
        "p_value": by_chance(both) if enough else math.nan,
        "mean_difference": float((both.ap - both.ap_paper).mean()),
    }


def by_chance(both: pd.DataFrame) -> float:
    """How likely a correlation of the ranks is that is as far from 0."""
    theirs = rankdata(both.ap_paper)
    test = permutation_test(
        (rankdata(both.ap),),
        lambda ours, axis: (ours * (theirs - theirs.mean())).sum(axis=axis),
        permutation_type="pairings",
        n_resamples=DRAWS,
        vectorized=True,
        rng=np.random.default_rng(1),
    )
    return float(test.pvalue)
